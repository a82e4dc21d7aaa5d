"""Where on this object is a two-finger grasp reliable?"""

import math

import numpy as np
import numpy.typing as npt

from grasp3d._kernels.faces import normals_at
from grasp3d._kernels.scan import scan
from grasp3d.arrays import Floats, locked
from grasp3d.errors import SettingError
from grasp3d.labels import Reason, SearchReport, SurfaceLabels
from grasp3d.mesh import ObjectMesh
from grasp3d.mesh.places import SurfacePlaces, nearest_place
from grasp3d.processors import available_processors
from grasp3d.progress import Progress, ignore, within
from grasp3d.sampling.antipodal import best_grasps, contact_normals, contact_surface
from grasp3d.settings import GraspModel, Sampling, search_cone
from grasp3d.surface_extremes import check_combinations_of

SEARCH_SHARE = 0.3
"""Of the work of label_surface with method extremes, what the search for grasps is taken for."""


def label_surface(
    mesh: ObjectMesh,
    model: GraspModel | None = None,
    *,
    sampling: Sampling | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> SurfaceLabels:
    """Find the best two-finger grasp through every vertex and tell how reliable it is.

    With `model.method` 'extremes' the grasps are the same, but their labels come from the wrench
    hulls at extreme normals alone, as in Wan & Howe 2018.

    Args:
        mesh: The object's surface.
        model: Friction and sensor resolution.
        sampling: How grasps are searched.
        threads: Threads to use; None: one per processor. The result does not depend on it.
        progress: Called with the share of the work done, from 0 to 1.

    Raises:
        SettingError: The settings contradict each other, or extreme normals are too many.
    """
    model, sampling = model or GraspModel(), sampling or Sampling()
    threads = available_processors() if threads is None else threads
    if threads < 1:
        raise SettingError(f"threads must be at least 1; got {threads}")
    cone = search_cone(model, sampling)
    told = progress or ignore
    enumerated = model.method == "extremes"
    if enumerated:
        check_combinations_of(model)
    searching = within(told, 0.0, SEARCH_SHARE) if enumerated else told
    grasps = best_grasps(mesh, sampling, cone, threads=threads, progress=searching)
    labels = SurfaceLabels(
        mesh=mesh,
        model=model,
        sampling=sampling,
        mode="label",
        critical_angle=locked(grasps.worst),
        critical_angle_best=locked(grasps.best),
        partner=locked(grasps.partner),
        partner_normal=locked(grasps.partner_normal),
        places=SurfacePlaces(locked(grasps.places.faces), locked(grasps.places.weights)),
        opening=locked(np.linalg.norm(grasps.partner - mesh.vertices, axis=1)),
        grip=locked(grasps.grip),
        reason=locked(np.where(mesh.on_surface, grasps.reason, Reason.OFF_SURFACE), np.uint8),
        search=SearchReport(cone, grasps.rays, grasps.rounds, grasps.still_falling),
        threads=threads,
    )
    labels.enumerate_extremes(within(told, SEARCH_SHARE, 1.0))
    return labels


def scan_surface(
    mesh: ObjectMesh,
    model: GraspModel | None = None,
    *,
    fixed: npt.ArrayLike,
    threads: int | None = None,
    progress: Progress | None = None,
) -> SurfaceLabels:
    """Fix one finger and label every vertex as the place of the other (Wan & Howe 2018, Sec. IV).

    Here the grasp is given, so a U is a proof as well. Both ways to close count: squeezing and
    pushing apart.

    Args:
        mesh: The object's surface.
        model: Friction and sensor resolution.
        fixed: Place of the fixed finger, shape (3,) or (1, 3), moved to the nearest place of the
            surface.
        threads: Threads for hulls and epsilon; None: one per processor. The result does not depend
            on it.
        progress: Called with the share of the work done, from 0 to 1, while hulls are enumerated.

    Raises:
        SettingError: `fixed` is not one finite point, or extreme normals are too many.
    """
    model = model or GraspModel()
    if model.method == "extremes":
        check_combinations_of(model)
    point = np.asarray(fixed, dtype=np.float64).reshape(-1)
    if point.shape != (3,) or not np.isfinite(point).all():
        raise SettingError(f"fixed must be one point of three finite numbers; got {fixed!r}")
    place, face, weights = nearest_place(mesh, (point - mesh.center) / mesh.size)
    normals = _normals_at(mesh, face, weights)
    count = len(mesh.vertices)
    worst, best = np.empty(count), np.empty(count)
    grip = np.empty(count, dtype=np.int8)
    scan(place, normals, mesh.normalized, contact_normals(mesh), worst, best, grip)
    middle = normals.sum(axis=0)
    snapped = mesh.from_normalized(place)
    reason = np.where(np.isinf(worst[mesh.canonical]), Reason.SAME_PLACE, Reason.FOUND)
    labels = SurfaceLabels(
        mesh=mesh,
        model=model,
        sampling=None,
        mode="scan",
        critical_angle=locked(worst[mesh.canonical]),
        critical_angle_best=locked(best[mesh.canonical]),
        partner=locked(np.tile(snapped, (count, 1))),
        partner_normal=locked(np.tile(middle / max(np.linalg.norm(middle), 1e-300), (count, 1))),
        places=SurfacePlaces(
            locked(np.full((count, 2), face)), locked(np.tile(weights, (count, 2, 1)))
        ),
        opening=locked(np.linalg.norm(snapped - mesh.vertices, axis=1)),
        grip=locked(grip[mesh.canonical]),
        reason=locked(np.where(mesh.on_surface, reason, Reason.OFF_SURFACE), np.uint8),
        search=SearchReport(cone=math.pi, rays=0, rounds=0, still_falling=0.0),
        threads=threads,
    )
    labels.enumerate_extremes(progress or ignore)
    return labels


def _normals_at(mesh: ObjectMesh, face: int, weights: Floats) -> Floats:
    """Normals that a contact on a face may have, shape (k, 3)."""
    sets, found = contact_normals(mesh), np.empty((2, 3))
    count, vertex = normals_at(face, tuple(weights), contact_surface(mesh), sets, found)
    if vertex >= 0:
        first = sets.start[vertex]
        return sets.normals[first : first + sets.counts[vertex]].copy()
    return found[:count].copy()
