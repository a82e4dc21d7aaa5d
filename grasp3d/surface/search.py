"""Search for the best grasp through every vertex, with labels as the result."""

import math

import numpy as np

from grasp3d.arrays import Bytes, Floats, Ints
from grasp3d.gripper.reach import Reach, reach_grasps
from grasp3d.gripper.reaching import Reaching
from grasp3d.mesh import ObjectMesh
from grasp3d.mesh.surface_points import SurfacePoints
from grasp3d.settings import GraspModel, Sampling, search_cone
from grasp3d.surface.contacts import SurfaceContacts
from grasp3d.surface.critical_angles import critical_angles
from grasp3d.surface.labels import SearchReport, SurfaceLabels
from grasp3d.surface.sampling.antipodal import Ranking, best_pairs
from grasp3d.surface.sampling.multifinger import search
from grasp3d.surface.vertex_grasps import Reason, VertexGrasps, grasps_at, grasps_differ
from grasp3d.system.progress import Progress, within

BEFORE_ANGLES = 0.9
"""Fraction of the work for three fingers and more that the search is expected to take."""


def label_pairs(
    mesh: ObjectMesh,
    model: GraspModel,
    sampling: Sampling,
    reaching: Reaching | None,
    threads: int,
    progress: Progress,
) -> SurfaceLabels:
    """Label a surface by the best grasps with two fingers.

    Args:
        mesh: The object's surface.
        model: Friction and sensor resolution; labels are computed later.
        sampling: How grasps are searched for.
        reaching: The gripper that must reach each grasp; None: ideal points.
        threads: Threads to use.
        progress: Called with the fraction of the work done, from 0 to 1.
    """
    cone, ranking = search_cone(model, sampling), Ranking.of(model)
    limited = sampling if reaching is None else reaching.within_stroke(mesh, sampling)
    grasps = best_pairs(
        mesh, limited, cone, threads=threads, reaching=reaching, ranking=ranking, progress=progress
    )
    points = SurfacePoints(
        grasps.partner_points.faces[..., None], grasps.partner_points.weights[..., None, :]
    )
    found = np.flatnonzero((grasps.reason == Reason.FOUND) & mesh.on_surface)
    normals = np.full((len(mesh.vertices), 1, 3), math.nan)
    partners = SurfacePoints(points.faces[found, 0], points.weights[found, 0])
    normals[found] = SurfaceContacts(mesh, partners).normals
    angles = grasps.worst, grasps.best
    if ranking != Ranking():  # costs, which are more than the critical angles
        angles = _angles_of_pairs(mesh, points, np.unique(mesh.canonical[found]))
    vertex_grasps = VertexGrasps.of(
        mesh,
        angles=angles,
        partners=grasps.partner[:, None],
        partner_normals=normals,
        partner_points=points,
        grip=grasps.grip,
        reason=grasps.reason,
        reach=grasps.reach,
    )
    report = SearchReport(
        cone, rays=grasps.rays, rounds=grasps.rounds, still_falling=grasps.still_falling
    )
    return SurfaceLabels(
        vertex_grasps, model, sampling=sampling, mode="label", search=report, reaching=reaching,
        threads=threads,
    )  # fmt: skip


def _angles_of_pairs(
    mesh: ObjectMesh, points: SurfacePoints, vertices: Ints
) -> tuple[Floats, Floats]:
    """Critical angles (V,) of the two grasps that each of some vertices has."""
    angles = np.full((2, len(mesh.vertices)), math.inf)
    for number in range(2):
        contacts = grasps_at(mesh, points, vertices, number)
        angles[number, vertices] = critical_angles(contacts)[number]
    worst, best = angles[:, mesh.canonical]
    return worst, best


def label_multifinger(
    mesh: ObjectMesh,
    model: GraspModel,
    sampling: Sampling,
    reaching: Reaching | None,
    threads: int,
    progress: Progress,
) -> SurfaceLabels:
    """Label a surface by the best grasps with three fingers or more.

    Args:
        mesh: The object's surface.
        model: Friction and sensor resolution; labels are computed later.
        sampling: How grasps are searched for.
        reaching: A gripper whose round tips must fit at each contact; None: ideal points.
        threads: Threads to use.
        progress: Called with the fraction of the work done, from 0 to 1.

    Raises:
        SettingError: The mesh has fewer vertices than fingers.
    """
    cone, count = search_cone(model, sampling), len(mesh.vertices)
    searching, finishing = (
        within(progress, 0.0, BEFORE_ANGLES),
        within(progress, BEFORE_ANGLES, 1.0),
    )
    found = search(mesh, model.fingers, sampling, cone, threads=threads, progress=searching)
    points = _both_grasps(found.partner_points)
    reasons, reach = found.reason, None
    if reaching is not None:
        reasons, reach = _reach_of_tips(mesh, points, reasons, reaching, threads)
    vertices = np.unique(mesh.canonical[(reasons == Reason.FOUND) & mesh.on_surface])
    grasps = grasps_at(mesh, points, vertices, 0)
    angles = np.full((2, count), math.inf)
    angles[:, vertices] = critical_angles(grasps, threads=threads, progress=finishing)
    differing = vertices[grasps_differ(points, vertices)]
    _, best = critical_angles(grasps_at(mesh, points, differing, 1), threads=threads)
    angles[1, differing] = np.minimum(angles[1, differing], best)
    partners, normals = np.full((2, count, model.fingers - 1, 3), math.nan)
    partners[vertices], normals[vertices] = grasps.points[:, 1:], grasps.normals[:, 1:]
    progress(1.0)
    canonical = mesh.canonical
    vertex_grasps = VertexGrasps.of(
        mesh,
        angles=(angles[0, canonical], angles[1, canonical]),
        partners=partners[canonical],
        partner_normals=normals[canonical],
        partner_points=points,
        grip=0,
        reason=reasons,
        reach=reach,
    )
    report = SearchReport(
        cone, evaluated=found.evaluated, rounds=found.rounds, still_falling=found.still_falling
    )
    return SurfaceLabels(
        vertex_grasps, model, sampling=sampling, mode="label", search=report, reaching=reaching,
        threads=threads,
    )  # fmt: skip


def _reach_of_tips(
    mesh: ObjectMesh, points: SurfacePoints, reasons: Bytes, reaching: Reaching, threads: int
) -> tuple[Bytes, Reach]:
    """The reasons, and how round tips fit at the contacts of each vertex's grasp."""
    tried = np.flatnonzero((reasons == Reason.FOUND) & mesh.on_surface)
    contacts = grasps_at(mesh, points, tried, 0)
    reach = reach_grasps(
        mesh, contacts.points, contacts.normals, reaching.gripper, table=reaching.table,
        threads=threads,
    )  # fmt: skip
    reasons = reasons.copy()
    reasons[tried[~reach.reached]] = Reason.NOT_REACHED
    return reasons, reach.among(len(mesh.vertices), tried)


def _both_grasps(points: SurfacePoints) -> SurfacePoints:
    """Surface points (V, 2, n - 1); a vertex with one of the two grasps gets it as both."""
    missing = (points.faces < 0).any(axis=2)  # (V, 2)
    source = np.where(missing, [[1, 0]], [[0, 1]])[..., None]
    return SurfacePoints(
        np.take_along_axis(points.faces, source, axis=1),
        np.take_along_axis(points.weights, source[..., None], axis=1),
    )
