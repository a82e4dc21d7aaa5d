"""Surfaces with all fingers but one fixed: the paper's scan."""

import math

import numpy as np
import numpy.typing as npt

from grasp3d._kernels.scanning import scan
from grasp3d.arrays import Floats, locked
from grasp3d.errors import SettingError
from grasp3d.mesh import ObjectMesh
from grasp3d.mesh.surface_points import SurfacePoints, nearest_surface_point
from grasp3d.settings import GraspModel, with_fingers
from grasp3d.surface.contacts import SurfaceContacts
from grasp3d.surface.critical_angles import SAME, critical_angles
from grasp3d.surface.extreme_normals import SEARCH_FRACTION, check_combinations_of
from grasp3d.surface.labels import Reason, SearchReport, SurfaceLabels
from grasp3d.surface.vertex_grasps import grasps_at, largest_distance
from grasp3d.system.progress import Progress, ignore, within


def scan_surface(
    mesh: ObjectMesh,
    model: GraspModel | None = None,
    *,
    fixed: npt.ArrayLike,
    threads: int | None = None,
    progress: Progress | None = None,
) -> SurfaceLabels:
    """Fix all fingers but one and label every vertex as the place of the last.

    Wan & Howe 2018, Sec. IV, fix one of two. Here the grasp is given, so a U is a proof as well,
    except where a fixed finger stands already (`Reason.SAME_PLACE`). Of two fingers both ways to
    close count: squeezing and pushing apart.

    Args:
        mesh: The object's surface.
        model: Friction and sensor resolution; the number of fingers, unless it is the usual 2, must
            be one more than are fixed.
        fixed: Places of the fixed fingers, shape (3,) or (k, 3), moved to the nearest places of the
            surface.
        threads: Threads; None: one per processor. The result does not depend on it.
        progress: Called with the share of the work done, from 0 to 1, where it takes long: while
            angles of three fingers and more are found, and hulls enumerated.

    Raises:
        SettingError: `fixed` are no finite points, or they or extreme normals are too many.
    """
    points = _fixed_points(fixed)
    model = with_fingers(model or GraspModel(), len(points) + 1)
    if model.method == "extremes":
        check_combinations_of(model)
    count, told = len(mesh.vertices), progress or ignore
    nearest = [nearest_surface_point(mesh, (point - mesh.center) / mesh.size) for point in points]
    spots = np.stack([place for place, _, _ in nearest])  # normalised frame
    faces = np.array([[face for _, face, _ in nearest]])
    weights = np.stack([weights for _, _, weights in nearest])[None]
    hand = SurfaceContacts(mesh, SurfacePoints(faces, weights))  # one grasp, of the fixed alone
    begun = SEARCH_FRACTION if model.method == "extremes" and len(points) > 1 else 0.0
    if len(points) == 1:
        angles, grip = _scan_pairs(hand, spots[0])
    else:
        angles = _scan_multifinger(hand, spots, threads, within(told, 0.0, begun or 1.0))
        grip = np.zeros(count, dtype=np.int8)
    reason = np.where(np.isinf(angles[0, mesh.canonical]), Reason.SAME_PLACE, Reason.FOUND)
    partners = np.tile(mesh.from_normalized(spots), (count, 1, 1))
    labels = SurfaceLabels(
        mesh=mesh,
        model=model,
        sampling=None,
        mode="scan",
        critical_angle=locked(angles[0, mesh.canonical]),
        critical_angle_best=locked(angles[1, mesh.canonical]),
        partners=locked(partners),
        partner_normals=locked(np.tile(hand.normals, (count, 1, 1))),
        partner_points=SurfacePoints(
            locked(np.tile(faces, (count, 2, 1))), locked(np.tile(weights, (count, 2, 1, 1)))
        ),
        opening=locked(largest_distance(mesh.vertices, partners)),
        grip=locked(grip[mesh.canonical]),
        reason=locked(np.where(mesh.on_surface, reason, Reason.OFF_SURFACE), np.uint8),
        search=SearchReport(cone=math.pi),
        threads=threads,
    )
    labels.enumerate_extremes(within(told, begun, 1.0))
    return labels


def _fixed_points(fixed: npt.ArrayLike) -> Floats:
    """Check the places of fixed fingers; shape (k, 3)."""
    try:
        points = np.atleast_2d(np.asarray(fixed, dtype=np.float64))
    except (TypeError, ValueError):
        points = np.zeros((0, 3))
    if points.ndim != 2 or points.shape[1] != 3 or not len(points):
        points = np.full((1, 3), math.nan)
    if not np.isfinite(points).all():
        raise SettingError(
            f"fixed must be one point or more, each of three finite numbers; got {fixed!r}"
        )
    return points


def _scan_pairs(hand: SurfaceContacts, spot: Floats) -> tuple[Floats, npt.NDArray[np.int8]]:
    """Angles (2, V) and grips (V,) of every vertex with one fixed finger."""
    mesh = hand.mesh
    normals = hand.set_normals[:0] if hand.any_normal.any() else hand.set_normals
    angles = np.empty((2, len(mesh.vertices)))
    grip = np.empty(len(mesh.vertices), dtype=np.int8)
    scan(spot, normals, mesh.normalized, mesh.contact_normals, angles[0], angles[1], grip)
    return angles, grip


def _scan_multifinger(
    hand: SurfaceContacts, spots: Floats, threads: int | None, progress: Progress
) -> Floats:
    """Angles (2, V) of every vertex with several fixed fingers."""
    mesh = hand.mesh
    vertices = np.unique(mesh.faces)
    away = np.linalg.norm(mesh.normalized[vertices, None] - spots, axis=2).min(axis=1)
    vertices = vertices[away > SAME]
    others = np.broadcast_to(
        hand.surface_points.faces[:, None], (len(mesh.vertices), 2, len(spots))
    )
    weights = np.broadcast_to(hand.surface_points.weights[:, None], (*others.shape, 3))
    grasps = grasps_at(mesh, SurfacePoints(others, weights), vertices, 0)
    angles = np.full((2, len(mesh.vertices)), math.inf)
    angles[:, vertices] = critical_angles(grasps, threads=threads, progress=progress)
    return angles
