"""Which grasps a hand reaches on an object, and from where."""

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import Self

import numpy as np

from grasp3d._kernels.jaws import gripper_parts
from grasp3d.arrays import Bools, Bytes, Floats, Ints, locked, short_repr
from grasp3d.mesh import ObjectMesh


class Reachability(IntEnum):
    """Whether a gripper reaches a grasp, or why not."""

    REACHED = gripper_parts.REACHED
    """A pose was found that is free of collisions, as is the way to it."""
    WIDTH = gripper_parts.WIDTH
    """The opening, with the clearance, is outside the stroke."""
    TIP = gripper_parts.TIP
    """A round tip touches the object elsewhere too."""
    DIRECTION = gripper_parts.DIRECTION
    """No tested approach direction is within the allowed ones."""
    TABLE = gripper_parts.TABLE
    """Only the table is in the way."""
    BLOCKED = gripper_parts.BLOCKED
    """At every tested angle the gripper collides with the object."""
    NO_GRASP = gripper_parts.NO_GRASP
    """There is no grasp that could be reached."""


@dataclass(frozen=True, eq=False)
class Reach:
    """What a gripper reaches of b grasps; lengths in metres."""

    state: Bytes
    """`Reachability` of each grasp, shape (b,)."""
    poses: Floats
    """From the gripper's frame to the mesh's, nan where not reached, shape (b, 4, 4)."""
    approach_margin: Floats
    """Angle about the closing axis by which the approach may turn either way, all tested angles on
    the way being free [rad]; pi: all around. Nan where not reached, shape (b,)."""
    opening: Floats
    """Distance between the inner faces of the fingers, or between the nearest points of round tips,
    when the object is held; nan where not reached, shape (b,)."""
    pregrasp_opening: Floats
    """The same before the fingers close (external) or open (internal), shape (b,)."""
    depth: Floats
    """How far the fingertips reach beyond the contacts along z, shape (b,)."""
    free: Bools
    """Free approach angles at this depth, in equal steps about x, shape (b, angles)."""

    __repr__ = short_repr

    @property
    def reached(self) -> Bools:
        """Mask of the grasps that are reached, shape (b,)."""
        return np.asarray(self.state == Reachability.REACHED)

    @classmethod
    def of(cls, mesh: ObjectMesh, results: gripper_parts.ReachResults, angles: int) -> Self:
        """Arrange the results of the kernels, which are in the normalised frame.

        Args:
            mesh: The object.
            results: Codes, masks of free angles, and poses with the numbers behind them.
            angles: Number of approach angles.
        """
        free, rows = results.free, results.found
        poses = rows[:, :16].reshape(-1, 4, 4)
        poses[:, :3, 3] = mesh.from_normalized(poses[:, :3, 3])
        bits = (free[:, None] >> np.arange(angles, dtype=np.uint64)) & np.uint64(1)
        return cls(
            state=locked(results.codes),
            poses=locked(poses),
            approach_margin=locked(rows[:, gripper_parts.MARGIN]),
            opening=locked(rows[:, gripper_parts.OPENING] * mesh.size),
            pregrasp_opening=locked(rows[:, gripper_parts.PREGRASP] * mesh.size),
            depth=locked(rows[:, gripper_parts.DEPTH] * mesh.size),
            free=locked(bits.astype(np.bool_)),
        )

    def take(self, which: Ints | Bools) -> "Reach":
        """The chosen grasps."""
        return Reach(**{name: locked(values[which]) for name, values in vars(self).items()})

    def among(self, count: int, rows: Ints) -> "Reach":
        """The same with `count` rows, of which these are `rows`; the others are no grasps."""
        every = {}
        for name, values in vars(self).items():
            empty = math.nan if values.dtype.kind == "f" else 0
            every[name] = np.full((count, *values.shape[1:]), empty, dtype=values.dtype)
            every[name][rows] = values
        others = np.setdiff1d(np.arange(count), rows)
        every["state"][others] = Reachability.NO_GRASP
        return Reach(**{name: locked(values) for name, values in every.items()})
