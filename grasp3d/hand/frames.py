"""Frame conventions of grippers, and poses of objects in the frame of a robot.

A frame convention states which axes and origin a program uses for a gripper's pose. NumPy is
imported only when a matrix is made, so the command line starts quickly.
"""

import json
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

from grasp3d.errors import ContactError, SettingError
from grasp3d.hand.choices import AXES
from grasp3d.system.documents import number_of, parse_json

if TYPE_CHECKING:
    from grasp3d.arrays import ArrayLike, Floats
    from grasp3d.hand.hand import Hand


FAR = 100.0
"""Distance of an object from its robot from which on it is probably in millimetres [m]."""

FORMS = "x,y,z,yaw (metres, degrees) or x,y,z,qx,qy,qz,qw"
"""Text forms of an object's pose, for error messages."""


@dataclass(frozen=True)
class ObjectPose:
    """The pose of an object (of the frame of its mesh) in the frame of a robot.

    As text it is the position and the angle about the robot's z, 'x,y,z,yaw' in metres and degrees,
    or the position and a quaternion, 'x,y,z,qx,qy,qz,qw'. The name of the robot's frame may follow.

    Example:
        >>> from grasp3d.hand.frames import ObjectPose
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
        """Make the pose that a text or a matrix states.

        Args:
            value: A text as above; or a matrix from object to robot coordinates, translation in
                metres, shape (4, 4).

        Raises:
            ContactError: The value is neither, or the matrix scales, mirrors or shears.
        """
        if isinstance(value, ObjectPose):
            return value
        return _of_text(value) if isinstance(value, str) else _pose_of_matrix(value)

    def __str__(self) -> str:
        """The text form, which `of` reads."""
        frame = [] if self.frame == "robot" else [self.frame]
        return ",".join([*map(str, (*self.position, *self.quaternion)), *frame])

    @cached_property
    def matrix(self) -> "Floats":
        """Matrix from object to robot coordinates [m], shape (4, 4)."""
        import numpy as np
        from scipy.spatial.transform import Rotation

        matrix = np.eye(4)
        matrix[:3, :3] = Rotation.from_quat(self.quaternion).as_matrix()
        matrix[:3, 3] = self.position
        return matrix


def _of_text(text: str) -> ObjectPose:
    """Parse the text of a pose. Raises ContactError."""
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


def _pose_of_matrix(value: "ArrayLike") -> ObjectPose:
    """Make the pose that a matrix states. Raises ContactError."""
    from scipy.spatial.transform import Rotation

    from grasp3d.hand.pose_checks import checked_pose

    matrix = checked_pose(value, "the matrix of the object's pose")
    quaternion = Rotation.from_matrix(matrix[:3, :3]).as_quat(canonical=True)
    return ObjectPose(tuple(matrix[:3, 3].tolist()), tuple(quaternion.tolist()))


Origin = Literal["tcp", "base", "ends"]
"""The tool centre point, the origin of the hand's own frame, or the ends of the fingers."""

AUTO = "auto"
"""Stands for the frame that explains the poses, where they are read with their object."""

LARGEST = 1.0
"""Largest distance of the TCP from a frame's origin [m]."""


@dataclass(frozen=True)
class GripperFrame:
    """The frame in which a program states the poses of a gripper.

    It has a name in `FRAMES`, belongs to a link of a hand with joints, or is defined by the pose of
    the TCP in it.

    Example:
        >>> from grasp3d.hand.frames import GripperFrame
        >>> str(GripperFrame.of("graspgen"))
        'graspgen'
        >>> turned = [[0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0.1034], [0, 0, 0, 1]]
        >>> GripperFrame.of(turned).to_tcp(None)[:3, 3].tolist()
        [0.0, 0.0, 0.1034]
    """

    name: str = field(default="", compare=False)
    """Its name in `FRAMES`; empty: none."""
    approach: str = "z"
    """Axis of the frame along the approach direction, such as 'z' or '-x'; empty: as stated by the
    gripper's `base_axes`."""
    closing: str = "x"
    """Axis of the frame from finger 1 to finger 2; empty: as above."""
    turn: float = 0.0
    """Angle about the approach direction from `closing` to the gripper's closing axis [rad]."""
    origin: Origin = "tcp"
    """Point of the hand from which the frame's origin is measured."""
    ahead: float = 0.0
    """How far that point is ahead of the origin along the approach direction [m]."""
    link: str = ""
    """Link of a hand with joints whose frame it is, with the joints above it at 0; empty: none."""
    matrix: tuple[tuple[float, ...], ...] = ()
    """Rows of the pose of the TCP in the frame [m], replacing all fields above; empty: not
    stated."""

    @classmethod
    def of(cls, value: "GripperFrame | str | ArrayLike") -> "GripperFrame":
        """Make the frame that a name or a matrix states.

        Args:
            value: A name in `FRAMES`, the name of a link of a hand with joints, or the pose of the
                TCP in the frame as a matrix or as text, translation in metres, shape (4, 4).

        Raises:
            ContactError: The matrix is not a pose. SettingError: The name is 'auto' or empty.
        """
        if isinstance(value, GripperFrame):
            return value
        if not isinstance(value, str) or value.startswith("["):
            return _of_matrix(parse_json(value) if isinstance(value, str) else value)
        if value in {AUTO, ""}:
            raise SettingError(
                f"{value!r} is not a frame itself; auto is for poses that are read with an object "
                "(evaluate, validate, simulate; in Python results.reading.applied(poses))"
            )
        return FRAMES.get(value) or GripperFrame(link=value)

    def __str__(self) -> str:
        """The text form, which `of` reads."""
        return self.name or self.link or json.dumps(self.matrix)

    @property
    def words(self) -> str:
        """The option that selects a frame of `frames_of`, or its description if it has no name."""
        return f"{'--frame' if self.link or self.name in FRAMES else 'the axes of'} {self}"

    def to_tcp(self, hand: "Hand | None") -> "Floats":
        """Matrix from gripper (TCP) coordinates to those of this frame [m], shape (4, 4).

        Args:
            hand: The gripper; None: not known.

        Raises:
            SettingError: The frame depends on a gripper and none is given, or the frame is unknown.
        """
        import numpy as np

        if self.matrix:
            return np.array(self.matrix)
        if self.link:
            return np.asarray(np.linalg.inv(self._link_pose(hand)))
        joints, jaws, names = hasattr(hand, "link_poses"), None, ("x", "z")
        if self.origin == "ends" or not (joints or (self.approach and self.origin == "tcp")):
            jaws = self._jaws(hand)
            names = jaws.base_axes
        names = (self.closing, self.approach) if self.approach else names
        unturned, approach = (np.array(AXES[name]) for name in names)
        side = np.cross(approach, unturned)
        closing = math.cos(self.turn) * unturned + math.sin(self.turn) * side
        ahead = self.ahead  # of the TCP from the origin, along the approach direction
        if jaws is not None and self.origin != "tcp":
            ahead += jaws.base_to_tcp if self.origin == "base" else -jaws.end
        pose = np.eye(4)
        pose[:3, :3] = np.stack([closing, np.cross(approach, closing), approach], axis=1)
        pose[:3, 3] = ahead * approach
        return pose

    def _link_pose(self, hand: "Hand | None") -> "Floats":
        """Pose of the link in the hand's frame with all joints at 0."""
        import numpy as np

        links = getattr(hand, "link_names", ())
        if self.link not in links:
            further = f", the links of {hand.name}" if hand is not None and links else ""
            raise SettingError(
                f"unknown gripper frame {self.link!r}; known are {', '.join(FRAMES)}{further}; or "
                "a file with the pose of the TCP in it, a 4x4 matrix (.npy, .txt, .json, .yaml)"
            )
        poses = hand.link_poses(np.zeros((1, len(hand.joint_names))))  # type: ignore[union-attr]
        return np.asarray(poses[0, links.index(self.link)])

    def _jaws(self, hand: Any) -> Any:
        if hasattr(hand, "base_to_tcp"):
            return hand
        raise SettingError(
            f"poses in the frame {str(self)!r} need the lengths of a parallel gripper: give it "
            "(--hand, in Python hand=...)"
        )


def _of_matrix(value: "ArrayLike") -> GripperFrame:
    """Make the frame that a matrix states. Raises ContactError."""
    from grasp3d.hand.pose_checks import checked_pose

    matrix = checked_pose(value, "the matrix of a gripper's frame")
    if max(map(abs, matrix[:3, 3])) > LARGEST:
        raise ContactError(
            f"the TCP must be at most {LARGEST:g} m from the origin of a gripper's frame; got "
            f"{matrix[:3, 3].tolist()}: the matrix is in metres"
        )
    return GripperFrame(matrix=tuple(map(tuple, matrix.tolist())))


FRAMES: dict[str, GripperFrame] = {
    frame.name: frame
    for frame in (
        GripperFrame("tcp"),
        GripperFrame("hand", "", "", origin="base"),
        GripperFrame("isaac", "", "", origin="base"),
        GripperFrame("moveit", "", "", origin="base"),
        GripperFrame("graspgen", origin="base"),
        GripperFrame("acronym", origin="base"),
        GripperFrame("graspnetapi", "x", "y", origin="ends", ahead=0.02),
        GripperFrame("dexnet", "x", "y"),
        GripperFrame("gpd", "x", "y", origin="ends", ahead=0.06),
        GripperFrame("burg", "-z", "x", origin="ends"),
        GripperFrame("panda_hand", "z", "-y", origin="base"),
        GripperFrame("panda_hand_tcp", "z", "-y"),
        GripperFrame("panda_link8", "z", "-y", -0.25 * math.pi, "base"),
        GripperFrame("robotiq_arg2f_base_link", "z", "y", origin="base"),
        GripperFrame("robotiq_85_base_link", origin="base"),
    )
}
"""Frames by name, as the programs define them (see docs/reference/frames.md); several names may
mean the same frame."""


def frames_of(hand: Any) -> Iterator[GripperFrame]:
    """Yield the frames in which poses of a hand may be stated.

    For grippers these are the named frames, and their axes at the TCP and at the base; for hands
    with joints, the frames of the links from base to palm and of the links fixed to them.
    """
    if hasattr(hand, "link_poses"):
        joints, path = hand.tree.joints, hand.tree.chain(hand.palm)
        fixed = (n for link in path for n in hand.tree.children(link) if joints[n].kind == "fixed")
        yield from (GripperFrame(link=name) for name in (*path, *fixed))
        return
    yield from FRAMES.values()
    for name, frame in FRAMES.items():
        yield replace(frame, name=f"{name} at the TCP", origin="tcp", ahead=0.0)
        yield replace(frame, name=f"{name} at the base", origin="base", ahead=0.0)
