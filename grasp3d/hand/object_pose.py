"""The pose of an object in the frame of a robot: of a text, of a matrix.

Nothing here imports NumPy until a pose is made, so that the command line starts quickly.
"""

import math
import re
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

from grasp3d.errors import ContactError
from grasp3d.settings.checks import DEGREE
from grasp3d.settings.lengths import METRES, NUMBER_AND_UNIT

if TYPE_CHECKING:
    from grasp3d.arrays import ArrayLike, Floats

FAR = 100.0
"""Distance of an object from its robot that suggests millimetres [m]."""

_LENGTHS = {str(unit): metres for unit, metres in METRES.items()}
_ANGLES = {"deg": DEGREE, "rad": 1.0}
_PARTS = {
    "x": _LENGTHS, "y": _LENGTHS, "z": _LENGTHS,
    "roll": _ANGLES, "pitch": _ANGLES, "yaw": _ANGLES,
    "qx": {"": 1.0}, "qy": {"": 1.0}, "qz": {"": 1.0}, "qw": {"": 1.0},
}  # fmt: skip
"""Units of the parts of a text."""


@dataclass(frozen=True)
class ObjectPose:
    """The pose of an object, that is of the frame of its mesh, in the frame of a robot.

    As text it has parts with names, in any order: lengths x, y and z; angles roll, pitch and yaw
    about the robot's x, then its y, then its z, or the quaternion qx, qy, qz and qw; and the name
    of the robot's frame. Parts that are left out are 0. Lengths and angles have units.

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
    stated = {"frame": "robot", **dict(parts)}
    frame = stated.pop("frame")
    if len(dict(parts)) < max(1, len(parts)) or not stated.keys() <= _PARTS.keys():
        raise ContactError(
            "the object's pose must be a file, or parts with names: x=0.4m,y=-5cm,z=0.1m,yaw=90deg "
            f"(also roll, pitch, frame; or qx, qy, qz, qw); got {text!r}"
        )
    position, angles, quaternion = (
        tuple(_part(name, stated.get(name, "0")) for name in names)
        for names in (("x", "y", "z"), ("roll", "pitch", "yaw"), ("qx", "qy", "qz", "qw"))
    )
    if any(quaternion) and any(angles):
        raise ContactError(f"the object's pose needs angles or a quaternion, not both: {text!r}")
    if not any(quaternion):
        quaternion = tuple(Rotation.from_euler("xyz", angles).as_quat(canonical=True).tolist())
    return ObjectPose(position, quaternion, frame)


def _part(name: str, text: str) -> float:
    """A length [m], an angle [rad] or a number. Raises ContactError."""
    units, match = _PARTS[name], NUMBER_AND_UNIT.fullmatch(text)
    number, unit = (float(match[1]), match[2].lower()) if match else (math.nan, "")
    if (unit not in units and number != 0.0) or math.isnan(number):
        needed = "a number" + (f" with a unit, {' or '.join(units)}" if "" not in units else "")
        raise ContactError(f"{name} of the object's pose must be {needed}; got {text!r}")
    return number * units.get(unit, 1.0)


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
