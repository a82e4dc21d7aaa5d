"""The pose in which a gripper, or a hand with joints, holds one grasp."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from trimesh import transform_points

from grasp3d.arrays import Floats, short_repr
from grasp3d.hand.hand import Hand
from grasp3d.hand.reach import Reach
from grasp3d.hand.triangles import Triangles


@dataclass(frozen=True, eq=False)
class GripperPose:
    """A gripper at one grasp; lengths in metres."""

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
    posture: Floats = field(default_factory=lambda: np.zeros(0))
    """Values of the joints of a hand [rad or m], shape (p,); p is 0 for a parallel gripper."""
    toward: Floats = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))
    """Approach direction in the gripper's frame, unit vector, shape (3,)."""
    colors: Mapping[int, tuple[int, int, int]] = field(default_factory=dict)
    """Red, green and blue of links by number; other links keep the grey of their part. All parts of
    a parallel gripper have the number 0."""

    __repr__ = short_repr

    @classmethod
    def of(cls, reach: Reach | None, row: int) -> "GripperPose | None":
        """The pose of one grasp; None if the gripper does not reach it.

        Args:
            reach: How a gripper reaches some grasps; None: no gripper.
            row: Number of the grasp.
        """
        if reach is None or not np.isfinite(reach.poses[row]).all():
            return None
        columns = reach.opening, reach.pregrasp_opening, reach.approach_margin, reach.depth
        opening, before, margin, depth = (float(column[row]) for column in columns)
        return cls(reach.poses[row], opening, before, margin, depth)

    @property
    def has_joints(self) -> bool:
        """Whether it is a hand with joints, which has neither a closing axis nor a TCP."""
        return len(self.posture) > 0

    @property
    def approach(self) -> Floats:
        """Approach direction in the mesh's frame, shape (3,)."""
        return np.asarray(self.pose[:3, :3] @ self.toward)

    def triangles(self, hand: Hand) -> Triangles:
        """The shape of the gripper at this pose, in the frame of the mesh."""
        shape = hand.shape(self.opening, self.posture)
        return replace(shape, vertices=transform_points(shape.vertices, self.pose))
