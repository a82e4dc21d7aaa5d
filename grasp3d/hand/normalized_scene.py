"""A gripper, an object and a table as the kernels take them: in the normalised frame."""

import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple, Self

import numpy as np

from grasp3d._kernels.box_tree import BoxTree, box_tree
from grasp3d._kernels.gripper_shape import ApproachLimits, GripperShape, make_workspace
from grasp3d.arrays import ArrayLike
from grasp3d.errors import ContactError
from grasp3d.hand.approach import Approach
from grasp3d.hand.jaws import Jaws
from grasp3d.hand.metres import metres_per_unit
from grasp3d.hand.table import Table
from grasp3d.mesh import ObjectMesh
from grasp3d.system.processors import available_processors

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
        surface = mesh.contact_surface
        scale = 1.0 / (metres_per_unit(mesh) * mesh.size)
        lengths = {name: getattr(hand, name) * scale for name in GripperShape._fields}
        if hand.round_tips:
            lengths["pad_height"] = 0.0
        return cls(
            GripperShape(**lengths),
            normalized_limits(mesh, table, approach),
            box_tree(surface.points, surface.faces),
        )


def normalized_limits(mesh: ObjectMesh, table: Table | None, approach: Approach) -> ApproachLimits:
    """Table and approach directions in the mesh's normalised frame, as the kernels take them."""
    direction = approach.direction
    if direction is None and table is not None:
        direction = -table.normal
    limited = direction is not None and approach.within < math.pi
    return ApproachLimits(
        direction=np.zeros(3) if direction is None else np.array(direction),
        least_cosine=math.cos(approach.within) if limited else -2.0,
        table_normal=np.zeros(3) if table is None else np.array(table.normal),
        table_offset=-math.inf
        if table is None
        else float((table.offset - mesh.center @ table.normal) / mesh.size),
    )


def in_chunks(
    work: Callable[[slice, Any], None], count: int, angles: int, threads: int | None
) -> None:
    """Run work on slices of rows in threads, each with a workspace of its own.

    Args:
        work: Called with the rows and a `ReachWorkspace`.
        count: Number of rows.
        angles: Approach angles of the workspaces.
        threads: Threads to use; None: one per processor.
    """
    threads = max(1, min(threads or available_processors(), -(-count // CHUNK)))
    starts = range(0, count, CHUNK)

    def run(number: int) -> None:
        workspace = make_workspace(angles)
        for start in starts[number::threads]:
            work(slice(start, start + CHUNK), workspace)

    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(run, range(threads)))


def checked_grip(grip: ArrayLike, count: int) -> Any:
    """Grips as signs, shape (count,).

    Raises:
        ContactError: They are neither 1 nor -1, or too many.
    """
    signs = np.asarray(grip)
    if signs.shape not in {(), (count,)} or not np.isin(signs, (-1, 1)).all():
        raise ContactError(
            f"grip must be 1 (external) or -1 (internal), one number or one for each of {count}; "
            f"got {grip!r}"
        )
    return np.array(np.broadcast_to(signs, (count,)), dtype=np.int8)
