"""The pose of an object in the frame of a robot: of a text, of a matrix.

Nothing here imports NumPy until a pose is made, so that the command line starts quickly.
"""

import math
import re
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

from grasp3d.errors import ContactError
from grasp3d.system.documents import number_of

if TYPE_CHECKING:
    from grasp3d.arrays import ArrayLike, Floats

FAR = 100.0
"""Distance of an object from its robot that suggests millimetres [m]."""

FORMS = "x,y,z,yaw (metres, degrees) or x,y,z,qx,qy,qz,qw"
"""Forms of the text, for error messages."""


@dataclass(frozen=True)
class ObjectPose:
    """The pose of an object, that is of the frame of its mesh, in the frame of a robot.

    As text it has the position and the angle about the robot's z, 'x,y,z,yaw' in metres and
    degrees, or the position and a quaternion, 'x,y,z,qx,qy,qz,qw'; the name of the robot's frame
    may follow.

    Example:
        >>> from grasp3d.hand.object_pose import ObjectPose
        >>> ObjectPose.of("0.4,0,0.1,90").matrix.round(3).tolist()
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
                "were given as metres"
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
        frame = [] if self.frame == "robot" else [self.frame]
        return ",".join([*map(str, (*self.position, *self.quaternion)), *frame])

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
    parts = [part.strip() for part in text.split(",")]
    frame = parts.pop() if len(parts) in {5, 8} else "robot"
    numbers = [number_of(part) for part in parts]
    if len(numbers) not in {4, 7} or not all(map(math.isfinite, numbers)):
        raise ContactError(
            f"the object's pose must be {FORMS}, or a file (.npy, .txt, .json, .yaml; in Python "
            f"grasp3d.formats.read_object_pose reads it); got {text!r}"
        )
    if len(numbers) == 4:
        half = 0.5 * math.radians(numbers.pop())
        numbers += [0.0, 0.0, math.sin(half), math.cos(half)]
    return ObjectPose(tuple(numbers[:3]), tuple(numbers[3:]), frame)


def _of_matrix(value: "ArrayLike") -> ObjectPose:
    """The pose of a matrix. Raises ContactError."""
    from scipy.spatial.transform import Rotation

    from grasp3d.hand.pose_checks import checked_pose

    matrix = checked_pose(value, "the matrix of the object's pose")
    quaternion = Rotation.from_matrix(matrix[:3, :3]).as_quat(canonical=True)
    return ObjectPose(tuple(matrix[:3, 3].tolist()), tuple(quaternion.tolist()))
