"""The pose of an object in the frame of a robot: of a text, of a matrix.

Nothing here imports NumPy until a pose is made, so that the command line starts quickly.
"""

import math
import re
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

from grasp3d.errors import ContactError, SettingError
from grasp3d.settings.checks import parse_angle
from grasp3d.settings.lengths import Measure, parse_length

if TYPE_CHECKING:
    from grasp3d.arrays import ArrayLike, Floats

FAR = 100.0
"""Distance of an object from its robot that suggests millimetres [m]."""

_LENGTHS, _ANGLES = ("x", "y", "z"), ("roll", "pitch", "yaw")
_NUMBERS = ("qx", "qy", "qz", "qw")


@dataclass(frozen=True)
class ObjectPose:
    """The pose of an object, that is of the frame of its mesh, in the frame of a robot.

    As text it has parts with names, in any order: lengths x, y and z; angles roll, pitch and yaw
    about the robot's x, then its y, then its z, or the quaternion qx, qy, qz and qw; and the name
    of the robot's frame. Parts that are left out are 0. Lengths have units; angles without one are
    degrees.

    Example:
        >>> from grasp3d.hand.object_pose import ObjectPose
        >>> ObjectPose.of("x=40cm,z=0.1m,yaw=90deg,frame=base_link").matrix.round(3).tolist()
        [[0.0, -1.0, 0.0, 0.4], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.1], [0.0, 0.0, 0.0, 1.0]]
    """

    position: tuple[float, ...]
    """x, y, z of the origin of the mesh's frame [m]."""
    quaternion: tuple[float, ...]
    """x, y, z, w; of length 1."""
    frame: str = "robot"
    """Name of the robot's frame."""

    def __post_init__(self) -> None:
        length, distance = math.hypot(*self.quaternion), math.hypot(*self.position)
        if not abs(length - 1.0) <= 1e-3:
            raise ContactError(
                f"the object's pose needs a quaternion of length 1; got {length:.4g}"
            )
        if not distance < FAR:
            raise ContactError(
                f"the object's pose is {distance:.4g} m away from the robot, as if millimetres "
                "were given as metres: write x=400mm; matrices and files are in metres"
            )
        if not re.fullmatch(r"[\w./:-]+", self.frame):
            raise ContactError(f"the name of a robot's frame must be one word; got {self.frame!a}")

    @classmethod
    def of(cls, value: "ObjectPose | str | ArrayLike") -> "ObjectPose":
        """The pose that a text or a matrix states.

        Args:
            value: A text as above; or a matrix that takes coordinates of the object to those of the
                robot, translation in metres, shape (4, 4).

        Raises:
            ContactError: It is neither; or the matrix scales, mirrors or shears.
        """
        if isinstance(value, ObjectPose):
            return value
        return _of_text(value) if isinstance(value, str) else _of_matrix(value)

    def __str__(self) -> str:
        """The text of it, which `of` reads."""
        lengths = [f"{axis}={one!r}m" for axis, one in zip("xyz", self.position, strict=True)]
        turned = [f"q{axis}={one!r}" for axis, one in zip("xyzw", self.quaternion, strict=True)]
        return " ".join([*lengths, *turned, f"frame={self.frame}"])

    @cached_property
    def matrix(self) -> "Floats":
        """Takes coordinates of the object to those of the robot [m], shape (4, 4)."""
        import numpy as np
        from scipy.spatial.transform import Rotation

        matrix = np.eye(4)
        matrix[:3, :3] = Rotation.from_quat(self.quaternion).as_matrix()
        matrix[:3, 3] = self.position
        return matrix


def _of_text(text: str) -> ObjectPose:
    """The pose of a text. Raises ContactError."""
    from scipy.spatial.transform import Rotation

    parts = [part.partition("=")[::2] for part in re.findall(r"[^,\s]+", text)]
    stated = {**dict.fromkeys((*_LENGTHS, *_ANGLES, *_NUMBERS), "0"), "frame": "robot"}
    if not parts or len(dict(parts)) < len(parts) or not dict(parts).keys() <= stated.keys():
        raise ContactError(
            "the object's pose must be parts with names: x=0.4m,y=-5cm,z=0.1m,yaw=90deg (also "
            "roll, pitch, frame; or qx, qy, qz, qw), or a file (.npy, .txt, .json, .yaml; in "
            f"Python grasp3d.grasps.read_object_pose reads it); got {text!r}"
        )
    stated |= dict(parts)
    try:
        position = tuple(_metres(name, stated[name]) for name in _LENGTHS)
        angles = tuple(parse_angle(name, stated[name]) for name in _ANGLES)
        quaternion = tuple(float(stated[name]) for name in _NUMBERS)
    except (SettingError, ValueError) as error:
        raise ContactError(f"the object's pose: {error}") from error
    names = dict(parts).keys()
    if names & {*_ANGLES} and names & {*_NUMBERS}:
        raise ContactError(f"the object's pose needs angles or a quaternion, not both: {text!r}")
    if not names & {*_NUMBERS}:
        quaternion = tuple(Rotation.from_euler("xyz", angles).as_quat(canonical=True).tolist())
    return ObjectPose(position, quaternion, stated["frame"])


def _metres(name: str, text: str) -> float:
    """A length [m]. Raises SettingError."""
    length = parse_length(name, text)
    if not isinstance(length, Measure) and length != 0.0:
        raise SettingError(f"{name} needs a unit, such as {name}={text}m")
    return length.metres if isinstance(length, Measure) else 0.0


def _of_matrix(value: "ArrayLike") -> ObjectPose:
    """The pose of a matrix. Raises ContactError."""
    from scipy.spatial.transform import Rotation

    from grasp3d.hand.pose_checks import checked_poses

    try:
        (matrix,) = checked_poses(value)
    except (ContactError, ValueError) as error:
        text = str(error).removeprefix("pose 1").lstrip(": ")
        raise ContactError(f"the matrix of the object's pose: {text}") from error
    quaternion = Rotation.from_matrix(matrix[:3, :3]).as_quat(canonical=True)
    return ObjectPose(tuple(matrix[:3, 3].tolist()), tuple(quaternion.tolist()))
