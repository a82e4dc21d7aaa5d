"""Frame and joints of a hand in its robot description and in simulators."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

from grasp3d.errors import SettingError
from grasp3d.hand.jaws import check_metres

if TYPE_CHECKING:
    from grasp3d.arrays import Floats

AXES: dict[str, tuple[float, float, float]] = {
    "x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0),
    "-x": (-1.0, 0.0, 0.0), "-y": (0.0, -1.0, 0.0), "-z": (0.0, 0.0, -1.0),
}  # fmt: skip
"""Unit vectors of the axes of a hand's own frame, by name."""


@dataclass(frozen=True, kw_only=True)
class RobotFrame:
    """The hand's own frame, that of its robot description, and the joints of its fingers.

    What each field means is in `ParallelGripper`.
    """

    base_to_tcp: float = 0.0
    base_axes: tuple[str, str] = ("x", "z")
    joint_names: tuple[str, ...] = ()
    joint_scale: tuple[float, ...] = ()
    joint_closed: tuple[float, ...] = ()

    def check_frame(self, gripper: str) -> None:
        """Refuse axes that are none, and joints without their numbers.

        Args:
            gripper: Name of the gripper.
        """
        check_metres(gripper, "base_to_tcp", self.base_to_tcp)
        one, two = self.base_axes if len(self.base_axes) == 2 else ("", "")
        if not {one, two} <= AXES.keys() or one[-1] == two[-1]:
            raise SettingError(
                f"gripper {gripper!r}: base_axes must be two axes at right angles of "
                f"{', '.join(AXES)}; got {list(self.base_axes)}"
            )
        joints = len(self.joint_names)
        if not len(self.joint_scale) == len(self.joint_closed) == joints:
            raise SettingError(
                f"gripper {gripper!r}: joint_scale and joint_closed must have a number for each "
                f"of the {joints} joint_names"
            )

    @property
    def base_pose(self) -> "Floats":
        """Matrix that takes coordinates of the hand's own frame to the gripper's, shape (4, 4).

        Its translation is in metres.
        """
        import numpy as np

        closing, approach = (np.array(AXES[name]) for name in self.base_axes)
        pose = np.eye(4)
        pose[:3, :3] = np.stack([closing, np.cross(approach, closing), approach])
        pose[2, 3] = -self.base_to_tcp
        return pose
