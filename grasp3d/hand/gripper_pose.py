"""The pose in which a gripper holds one grasp."""

import math
from dataclasses import dataclass

import numpy as np

from grasp3d.arrays import Bools, Floats, short_repr
from grasp3d.hand.reach import Reach


@dataclass(frozen=True, eq=False)
class GripperPose:
    """A gripper at one grasp; lengths in the mesh's unit."""

    pose: Floats
    """Matrix that takes coordinates of the gripper's frame to the mesh's, shape (4, 4)."""
    opening: float
    """Distance between the pads, or between the nearest points of round tips."""
    pregrasp_opening: float
    """Opening before the fingers close; nan: unknown."""
    approach_margin: float
    """Half-width of the free approach angles about the closing axis [rad]; nan: unknown."""
    depth: float
    """How far the TCP is inserted beyond the contacts, along the approach; nan: unknown."""

    __repr__ = short_repr

    @classmethod
    def of(cls, reach: Reach | None, row: int) -> "GripperPose | None":
        """The pose of one grasp; None: there is none, as it is not reached.

        Args:
            reach: How a gripper reaches some grasps; None: no gripper.
            row: Number of the grasp.
        """
        if reach is None or not has_pose(reach)[row]:
            return None
        return cls(
            reach.poses[row],
            float(reach.opening[row]),
            float(reach.pregrasp_opening[row]),
            float(reach.approach_margin[row]),
            float(reach.depth[row]),
        )

    @property
    def arcs(self) -> list[tuple[float, float]]:
        """Free approach angles about the pose's x-axis, low and high [rad]; none if unknown."""
        margin = self.approach_margin
        return [(-margin, margin)] if math.isfinite(margin) and margin > 0.0 else []


def has_pose(reach: Reach) -> Bools:
    """Whether each grasp has a pose, shape (b,)."""
    return np.asarray(np.isfinite(reach.poses).all(axis=(1, 2)))
