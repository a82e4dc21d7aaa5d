"""Whether a gripper at given poses collides with an object or a table."""

from typing import Any

import numpy as np

from grasp3d._kernels.pose_collisions import collide_poses
from grasp3d.arrays import ArrayLike, Bools, Floats
from grasp3d.errors import ContactError
from grasp3d.hand.approach import Approach
from grasp3d.hand.closed_jaws import ClosedJaws
from grasp3d.hand.jaws import Jaws
from grasp3d.hand.metres import metres_per_unit
from grasp3d.hand.normalized_scene import NormalizedScene, checked_grip, in_chunks
from grasp3d.hand.table import Table
from grasp3d.mesh import ObjectMesh

RIGID = 1e-6
"""Largest deviation of a pose's rotation from an orthonormal matrix."""


def collides(
    mesh: ObjectMesh,
    poses: ArrayLike,
    opening: ArrayLike,
    hand: Jaws,
    *,
    grip: ArrayLike = 1,
    table: Table | None = None,
    swept: bool = True,
    threads: int | None = None,
) -> Bools:
    """Test whether a gripper collides at given poses with the object or the table.

    The object may reach up to the compliance into pads and tips.

    Args:
        mesh: The object; its unit must be known.
        poses: From the gripper's frame to the mesh's, in the mesh's unit, shape (b, 4, 4).
        opening: Distance between the inner faces of the fingers, or between the nearest points of
            round tips, in the mesh's unit, one number or shape (b,).
        hand: The gripper, in metres.
        grip: +1: the fingers close from a clearance outside, -1: from inside, one number or (b,).
        table: What the object stands on; None: nothing.
        swept: Whether the straight approach and the clearance are tested too; else the final
            pose only.
        threads: Threads to use; None: one per processor.

    Returns:
        Whether the gripper collides, shape (b,).

    Raises:
        SettingError: The mesh has no unit.
        ContactError: Poses, openings or grips of wrong shapes or values.

    Example:
        >>> import numpy as np, trimesh, grasp3d
        >>> from grasp3d.hand.parallel_gripper import ParallelGripper
        >>> from grasp3d.hand.collisions import collides
        >>> mesh = grasp3d.load_mesh(trimesh.creation.box([60, 40, 20]), unit="mm", max_edge=90)
        >>> hand = ParallelGripper(
        ...     name="hand", max_opening=0.08, finger_thickness=0.02, finger_width=0.02,
        ...     finger_length=0.045, pad_width=0.018, pad_height=0.018, palm_thickness=0.2,
        ...     palm_width=0.06, palm_length=0.06)
        >>> collides(mesh, [np.eye(4), np.eye(4)], [70.0, 50.0], hand)
        array([False,  True])
    """
    matrices, openings, signs = _checked_poses(poses, opening, grip)
    scene = NormalizedScene.of(mesh, hand, table, Approach())
    matrices[:, :3, 3] = (matrices[:, :3, 3] - mesh.center) / mesh.size
    openings = openings / mesh.size
    verdict = np.zeros(len(matrices), dtype=np.bool_)

    def work(rows: slice, workspace: Any) -> None:
        collide_poses(
            matrices[rows], openings[rows], signs[rows], swept, scene.shape, scene.limits,
            scene.tree, workspace, verdict[rows],
        )  # fmt: skip

    in_chunks(work, len(matrices), 1, threads)
    return verdict


def collides_closing(
    mesh: ObjectMesh,
    poses: Floats,
    closed: ClosedJaws,
    hand: Jaws,
    *,
    held: Bools,
    table: Table | None = None,
    threads: int | None = None,
) -> Bools:
    """Test whether a gripper collides on its way to poses at which its jaws then close.

    Where the jaws do not close symmetrically about the TCP, hand or object has given way.

    Args:
        mesh: The object; its unit must be known.
        poses: From the gripper's frame to the mesh's, in the mesh's unit, shape (k, 4, 4).
        closed: Where the jaws close there.
        hand: The gripper, in metres.
        held: Whether it is tested around the object that it holds there, or else wide open, shape
            (k,).
        table: What the object stands on; None: nothing.
        threads: Threads to use; None: one per processor.

    Returns:
        Whether the gripper collides, shape (k,).
    """
    wide = hand.limits[1] / metres_per_unit(mesh)
    opening = np.where(held, np.maximum(closed.opening, 0.0), wide)
    centred = poses.copy()
    offset = np.where(held, closed.offset, 0.0)
    centred[:, :3, 3] += offset[:, None] * poses[:, :3, 0]
    return collides(mesh, centred, opening, hand, table=table, threads=threads)


def _checked_poses(
    poses: ArrayLike, opening: ArrayLike, grip: ArrayLike
) -> tuple[Floats, Floats, Any]:
    """Poses, openings and grips as arrays of the caller's own."""
    matrices = np.array(poses, dtype=np.float64)
    if matrices.ndim != 3 or matrices.shape[1:] != (4, 4) or not np.isfinite(matrices).all():
        raise ContactError(
            f"poses must be finite numbers of shape (poses, 4, 4); got {matrices.shape}"
        )
    turns = matrices[:, :3, :3]
    wrong = np.abs(turns @ turns.swapaxes(1, 2) - np.eye(3)).max(axis=(1, 2)) > RIGID
    wrong |= np.linalg.det(turns) < 0.0
    if wrong.any():
        raise ContactError(
            f"pose {int(np.flatnonzero(wrong)[0])} must be a rotation and a translation"
        )
    openings = np.asarray(opening, dtype=np.float64)
    count = len(matrices)
    if openings.shape not in {(), (count,)} or not (openings >= 0.0).all():
        raise ContactError(
            f"opening must be a length of at least 0, one number or one for each of {count} poses"
        )
    return matrices, np.array(np.broadcast_to(openings, (count,))), checked_grip(grip, count)
