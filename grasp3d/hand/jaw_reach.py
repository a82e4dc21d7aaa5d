"""Which grasps a parallel gripper reaches on an object."""

import math
from typing import Any

import numpy as np

from grasp3d._kernels import gripper_shape
from grasp3d._kernels.reaching import reach_pairs, reach_tips
from grasp3d.arrays import ArrayLike, Floats, locked, unit_rows
from grasp3d.errors import ContactError, SettingError
from grasp3d.hand.approach import Approach
from grasp3d.hand.jaws import Jaws
from grasp3d.hand.normalized_scene import NormalizedScene, checked_grip, in_chunks
from grasp3d.hand.reach import Reach
from grasp3d.hand.table import Table
from grasp3d.mesh import ObjectMesh


def reach_grasps(
    mesh: ObjectMesh,
    points: ArrayLike,
    normals: ArrayLike,
    hand: Jaws,
    *,
    grip: ArrayLike = 1,
    table: Table | None = None,
    approach: Approach | None = None,
    threads: int | None = None,
) -> Reach:
    """Test whether a gripper reaches grasps, and find a pose for each.

    A grasp of two fingers is reached where the gripper fits at one of the approach angles about the
    closing axis at least: no part of it meets the object beyond the compliance, or the table, in
    the final pose, on the straight way there from outside the object's bounding ball, and while the
    fingers close from the pre-grasp opening. The middle of the widest arc of free angles becomes
    the pose. With flat pads the contacts are at the pads' centres, or else up to 0.4 pad heights
    away from them along z, where that makes the widest arc. Angles between those tested are not.

    Of three to five fingers only round tips are tested, each as a ball: that it touches nothing
    else, and is above the table. Poses, margins and openings are nan then, and no approach is.

    Args:
        mesh: The object; its unit must be known.
        points: Contacts, in the mesh's frame and unit, shape (b, n, 3).
        normals: Inward unit normals there, shape (b, n, 3).
        hand: The gripper, in metres.
        grip: +1 external grasps, -1 internal ones (the fingers inside, pushing outward), one
            number or shape (b,).
        table: What the object stands on; None: nothing.
        approach: Approach angles and allowed directions; None: 32 angles, any direction.
        threads: Threads to use; None: one per processor. The result does not depend on it.

    Raises:
        SettingError: The mesh has no unit, or flat pads are given more than two contacts.
        ContactError: Points, normals or grips of wrong shapes or values.

    Example:
        >>> import numpy as np, trimesh, grasp3d
        >>> from grasp3d.hand.parallel_gripper import ParallelGripper
        >>> from grasp3d.hand.jaw_reach import reach_grasps
        >>> from grasp3d.hand.reach import Reachability
        >>> mesh = grasp3d.load_mesh(trimesh.creation.box([60, 40, 20]), unit="mm", max_edge=90)
        >>> hand = ParallelGripper(
        ...     name="hand", max_opening=0.08, finger_thickness=0.02, finger_width=0.02,
        ...     finger_length=0.045, pad_width=0.018, pad_height=0.018, palm_thickness=0.2,
        ...     palm_width=0.06, palm_length=0.06)
        >>> reach = reach_grasps(mesh, [[[0, -20, 0], [0, 20, 0]]], [[[0, 1, 0], [0, -1, 0]]], hand)
        >>> Reachability(reach.state[0]).name, float(reach.opening[0].round(6))
        ('REACHED', 40.0)
    """
    points, normals, signs = _checked(points, normals, grip)
    approach = approach or Approach()
    scene = NormalizedScene.of(mesh, hand, table, approach)
    inner = np.ascontiguousarray((points - mesh.center) / mesh.size)
    if points.shape[1] > 2:
        return _reach_tips(scene, inner, normals, threads)
    count, angles = len(points), approach.angles
    explain = True
    results = gripper_shape.no_results(count)

    def work(rows: slice, workspace: Any) -> None:
        reach_pairs(
            inner[rows], normals[rows], signs[rows], scene.shape, scene.limits, explain,
            scene.tree, workspace, *(array[rows] for array in results),
        )  # fmt: skip

    in_chunks(work, count, angles, threads)
    return Reach.of(mesh, results, angles)


def _checked(points: ArrayLike, normals: ArrayLike, grip: ArrayLike) -> tuple[Floats, Floats, Any]:
    """Contacts, unit normals and grips as arrays for the kernels."""
    p, n = np.array(points, dtype=np.float64), np.array(normals, dtype=np.float64)
    if p.ndim != 3 or p.shape[2] != 3 or not 2 <= p.shape[1] <= 5 or n.shape != p.shape:
        raise ContactError(
            "points and normals of grasps must both have the shape (grasps, fingers, 3), with 2 to "
            f"5 fingers; got {p.shape} and {n.shape}"
        )
    if not (np.isfinite(p).all() and np.isfinite(n).all()):
        raise ContactError("points and normals of grasps must be finite numbers")
    if (np.linalg.norm(n, axis=2) == 0.0).any():
        raise ContactError("normals of grasps must not be zero")
    return p, np.ascontiguousarray(unit_rows(n)), checked_grip(grip, len(p))


def _reach_tips(
    scene: NormalizedScene, points: Floats, normals: Floats, threads: int | None
) -> Reach:
    """Reach of grasps of three fingers and more: their tips alone."""
    if scene.shape.tip_radius == 0.0:
        raise SettingError(
            f"grasps of {points.shape[1]} fingers need a gripper with round tips (tip_radius); "
            "flat pads are for two"
        )
    codes = np.zeros(len(points), dtype=np.uint8)

    def work(rows: slice, workspace: Any) -> None:
        reach_tips(
            points[rows], normals[rows], scene.shape, scene.limits, scene.tree, workspace,
            codes[rows],
        )  # fmt: skip

    in_chunks(work, len(points), 1, threads)
    nan = locked(np.full(len(points), math.nan))
    return Reach(
        state=locked(codes),
        poses=locked(np.full((len(points), 4, 4), math.nan)),
        approach_margin=nan,
        opening=nan,
        pregrasp_opening=nan,
        depth=nan,
        posture=locked(np.zeros((len(points), 0))),
        free=locked(np.zeros((len(points), 0), dtype=np.bool_)),
    )
