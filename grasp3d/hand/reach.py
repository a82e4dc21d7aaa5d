"""Which grasps of an object a parallel gripper reaches, from where, and where it collides."""

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, NamedTuple, Self

import numpy as np

from grasp3d._kernels.jaws import gripper_parts
from grasp3d._kernels.jaws.gripper_parts import ApproachLimits, GripperShape, make_workspace
from grasp3d._kernels.jaws.reaching import collide_poses, reach_pairs
from grasp3d._kernels.surface.box_tree import BoxTree
from grasp3d.arrays import ArrayLike, Bools, Bytes, Floats, Ints, locked, short_repr, unit_rows
from grasp3d.hand.jaws import IN_METRES, Jaws
from grasp3d.hand.pose_checks import checked_poses
from grasp3d.hand.table import Approach, Table, best_approach
from grasp3d.mesh import ObjectMesh
from grasp3d.system.context import in_threads

ANGLES = 32
"""Angles of the approach about the closing axis that are tested."""


class Reachability(IntEnum):
    """Whether a gripper reaches a grasp, or why not."""

    REACHED = gripper_parts.REACHED
    """A pose was found that is free of collisions, as is the way to it."""
    WIDTH = gripper_parts.WIDTH
    """The opening, with the clearance, is outside the stroke."""
    TIP = gripper_parts.TIP
    """A round tip touches the object elsewhere too."""
    DIRECTION = gripper_parts.DIRECTION
    """No tested approach direction is allowed."""
    TABLE = gripper_parts.TABLE
    """Only the table is in the way."""
    BLOCKED = gripper_parts.BLOCKED
    """At every tested angle the gripper collides with the object."""
    NO_GRASP = gripper_parts.NO_GRASP
    """There is no grasp to reach."""


@dataclass(frozen=True, eq=False)
class Reach:
    """How a gripper reaches b grasps; lengths in metres."""

    state: Bytes
    """`Reachability` of each grasp, shape (b,)."""
    poses: Floats
    """From the gripper's frame to the mesh's, nan where not reached, shape (b, 4, 4)."""
    approach_margin: Floats
    """Angle about the closing axis by which the approach may turn either way with all tested angles
    free [rad], shape (b,); pi: all around; nan where not reached."""
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
    def of(cls, mesh: ObjectMesh, results: gripper_parts.ReachResults) -> Self:
        """Arrange the results of the kernels, which are in the normalised frame.

        Args:
            mesh: The object.
            results: Codes, masks of free angles, and poses with the numbers behind them.
        """
        rows = results.found
        poses = rows[:, :16].reshape(-1, 4, 4)
        poses[:, :3, 3] = mesh.from_normalized(poses[:, :3, 3])
        bits = (results.free[:, None] >> np.arange(ANGLES, dtype=np.uint64)) & np.uint64(1)
        margin, free = rows[:, gripper_parts.MARGIN], bits.astype(np.bool_)
        lengths = rows[:, [gripper_parts.OPENING, gripper_parts.PREGRASP, gripper_parts.DEPTH]].T
        return cls(*map(locked, (results.codes, poses, margin, *lengths * mesh.size, free)))

    def take(self, which: Ints | Bools) -> "Reach":
        """The chosen grasps."""
        return Reach(**{name: locked(values[which]) for name, values in vars(self).items()})

    def among(self, count: int, rows: Ints) -> "Reach":
        """The same grasps as `rows` among `count` rows; the other rows are no grasps."""
        every = {}
        for name, values in vars(self).items():
            empty = math.nan if values.dtype.kind == "f" else 0
            empty = Reachability.NO_GRASP if name == "state" else empty
            every[name] = np.full((count, *values.shape[1:]), empty, dtype=values.dtype)
            every[name][rows] = values
        return Reach(**{name: locked(values) for name, values in every.items()})


CHUNK = 256
"""Grasps that a thread tests in one call."""


class NormalizedScene(NamedTuple):
    """A gripper and what is around it, in the mesh's normalised frame, as the kernels take them."""

    shape: GripperShape
    limits: ApproachLimits
    tree: BoxTree

    @classmethod
    def of(cls, mesh: ObjectMesh, hand: Jaws, table: Table | None, approach: Approach) -> Self:
        """Arrange a gripper, an object and a table.

        Args:
            mesh: The object; its unit must be known.
            hand: The gripper, in metres.
            table: What the object stands on; None: nothing.
            approach: Allowed directions.

        Raises:
            SettingError: The mesh has no unit.
        """
        mesh.needs_metres(IN_METRES)
        scale = 1.0 / mesh.size
        lengths = {name: getattr(hand, name) * scale for name in GripperShape._fields}
        if hand.round_tips:
            lengths["pad_height"] = 0.0
        direction = best_approach(table, approach)
        limited = direction is not None and approach.within < math.pi
        normal = np.zeros(3) if table is None else np.array(table.normal)
        height = -math.inf if table is None else table.offset - mesh.center @ normal
        limits = ApproachLimits(
            direction=np.zeros(3) if direction is None else np.array(direction),
            least_cosine=math.cos(approach.within) if limited else -2.0,
            table_normal=normal,
            table_offset=float(height / mesh.size),
        )
        return cls(GripperShape(**lengths), limits, mesh.boxes)


def reach_grasps(
    mesh: ObjectMesh,
    points: Floats,
    normals: Floats,
    hand: Jaws,
    *,
    grip: ArrayLike = 1,
    table: Table | None = None,
    approach: Approach | None = None,
) -> Reach:
    """Test whether a gripper reaches grasps, and find a pose for each.

    A grasp of two fingers is reached if the gripper fits at one or more approach angles about the
    closing axis. It fits if no part of it meets the object beyond the compliance, or the table: in
    the final pose, on the straight way there from outside the object's bounding ball, and while the
    fingers close from the pre-grasp opening. The middle of the widest arc of free angles becomes
    the pose. With flat pads the contacts are at the pads' centres, or up to 0.4 pad heights away
    from them along z if that gives the widest arc. Only `ANGLES` angles are tested, none between
    them.

    Args:
        mesh: The object; its unit must be known.
        points: Contacts, in the mesh's frame, shape (b, 2, 3).
        normals: Inward unit normals there, shape (b, 2, 3).
        hand: The gripper, in metres.
        grip: +1 external grasps, -1 internal ones (the fingers inside, pushing outward), one
            number or shape (b,).
        table: What the object stands on; None: nothing.
        approach: Allowed directions; None: any.

    Raises:
        SettingError: The mesh has no unit, or there are more than two contacts.

    Example:
        >>> import numpy as np, trimesh, grasp3d
        >>> from grasp3d.hand.parallel_gripper import ParallelGripper
        >>> from grasp3d.hand.reach import reach_grasps
        >>> from grasp3d.hand.reach import Reachability
        >>> mesh = grasp3d.load_mesh(trimesh.creation.box([60, 40, 20]), unit="mm", max_edge=90)
        >>> hand = ParallelGripper(
        ...     name="hand", max_opening=0.08, finger_thickness=0.02, finger_width=0.02,
        ...     finger_length=0.045, pad_width=0.018, pad_height=0.018, palm_thickness=0.2,
        ...     palm_width=0.06, palm_length=0.06)
        >>> reach = reach_grasps(
        ...     mesh, np.array([[[0, -0.02, 0], [0, 0.02, 0]]]),
        ...     np.array([[[0.0, 1, 0], [0, -1, 0]]]), hand)
        >>> Reachability(reach.state[0]).name, float(reach.opening[0].round(6))
        ('REACHED', 0.04)
    """
    hand.check_fingers(points.shape[1])
    signs = np.full(len(points), grip, dtype=np.int8)
    scene = NormalizedScene.of(mesh, hand, table, approach or Approach())
    inner = np.ascontiguousarray((points - mesh.center) / mesh.size)
    normals = np.ascontiguousarray(unit_rows(normals))
    results = gripper_parts.no_results(len(points))

    def work(rows: slice, workspace: Any) -> None:
        reach_pairs(
            inner[rows], normals[rows], signs[rows], scene.shape, scene.limits, scene.tree,
            workspace, *(array[rows] for array in results),
        )  # fmt: skip

    in_threads(work, len(points), CHUNK, lambda: make_workspace(ANGLES))
    return Reach.of(mesh, results)


def collides(
    mesh: ObjectMesh,
    poses: ArrayLike,
    opening: ArrayLike,
    hand: Jaws,
    *,
    grip: ArrayLike = 1,
    table: Table | None = None,
    swept: bool = True,
    only: int = -1,
) -> Bools:
    """Test whether a gripper collides at given poses with the object or the table.

    The object may reach up to the compliance into pads and tips.

    Args:
        mesh: The object; its unit must be known.
        poses: From the gripper's frame to the mesh's [m], shape (b, 4, 4).
        opening: Distance between the inner faces of the fingers, or between the nearest points of
            round tips [m], one number or shape (b,).
        hand: The gripper, in metres.
        grip: +1: the fingers close from a clearance outside, -1: from inside, one number or (b,).
        table: What the object stands on; None: nothing.
        swept: Whether the straight approach and the clearance are tested too; else the final
            pose only.
        only: 0 or 1: only that finger, without its round tip; 2: only the palm, each without the
            table; -1: all.

    Returns:
        Whether the gripper collides, shape (b,).

    Raises:
        SettingError: The mesh has no unit.
        ContactError: A pose is not a rigid motion.

    Example:
        >>> import numpy as np, trimesh, grasp3d
        >>> from grasp3d.hand.parallel_gripper import ParallelGripper
        >>> from grasp3d.hand.reach import collides
        >>> mesh = grasp3d.load_mesh(trimesh.creation.box([60, 40, 20]), unit="mm", max_edge=90)
        >>> hand = ParallelGripper(
        ...     name="hand", max_opening=0.08, finger_thickness=0.02, finger_width=0.02,
        ...     finger_length=0.045, pad_width=0.018, pad_height=0.018, palm_thickness=0.2,
        ...     palm_width=0.06, palm_length=0.06)
        >>> collides(mesh, [np.eye(4), np.eye(4)], [0.07, 0.05], hand)
        array([False,  True])
    """
    matrices = checked_poses(poses)
    count = len(matrices)
    signs = np.full(count, grip, dtype=np.int8)
    openings = np.array(np.broadcast_to(np.asarray(opening) / mesh.size, (count,)))
    scene = NormalizedScene.of(mesh, hand, table, Approach())
    matrices[:, :3, 3] = (matrices[:, :3, 3] - mesh.center) / mesh.size
    verdict = np.zeros(count, dtype=np.bool_)

    def work(rows: slice, workspace: Any) -> None:
        collide_poses(
            matrices[rows], openings[rows], signs[rows], swept, only, scene.shape, scene.limits,
            scene.tree, workspace, verdict[rows],
        )  # fmt: skip

    in_threads(work, count, CHUNK, lambda: make_workspace(1))
    return verdict
