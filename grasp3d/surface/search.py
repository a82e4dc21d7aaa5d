"""The best grasp found through every vertex, as labels."""

import math

import numpy as np

from grasp3d.arrays import locked
from grasp3d.mesh import ObjectMesh
from grasp3d.mesh.surface_points import SurfacePoints
from grasp3d.settings import GraspModel, Sampling, search_cone
from grasp3d.surface.contacts import SurfaceContacts
from grasp3d.surface.critical_angles import critical_angles
from grasp3d.surface.labels import Reason, SearchReport, SurfaceLabels
from grasp3d.surface.sampling.antipodal import best_pairs
from grasp3d.surface.sampling.multifinger import search
from grasp3d.surface.vertex_grasps import grasps_at, grasps_differ, largest_distance
from grasp3d.system.progress import Progress, within

HANDS_SHARE = 0.9
"""Of the search for grasps of three fingers and more, what comes before their exact angles."""


def label_pairs(
    mesh: ObjectMesh, model: GraspModel, sampling: Sampling, threads: int, progress: Progress
) -> SurfaceLabels:
    """Label a surface by the best grasps of two fingers.

    Args:
        mesh: The object's surface.
        model: Friction and sensor resolution; labels of method extremes are made later.
        sampling: How grasps are searched.
        threads: Threads to use.
        progress: Called with the share of the work done, from 0 to 1.
    """
    cone = search_cone(model, sampling)
    grasps = best_pairs(mesh, sampling, cone, threads=threads, progress=progress)
    reason = np.where(mesh.on_surface, grasps.reason, Reason.OFF_SURFACE)
    points = SurfacePoints(
        locked(grasps.partner_points.faces[..., None]),
        locked(grasps.partner_points.weights[..., None, :]),
    )
    held = np.flatnonzero(reason == Reason.FOUND)
    normals = np.full((len(reason), 1, 3), math.nan)
    seconds = SurfacePoints(points.faces[held, 0], points.weights[held, 0])
    normals[held] = SurfaceContacts(mesh, seconds).normals
    partners = grasps.partner[:, None]
    return SurfaceLabels(
        mesh=mesh,
        model=model,
        sampling=sampling,
        mode="label",
        critical_angle=locked(grasps.worst),
        critical_angle_best=locked(grasps.best),
        partners=locked(partners),
        partner_normals=locked(normals),
        partner_points=points,
        opening=locked(largest_distance(mesh.vertices, partners)),
        grip=locked(grasps.grip),
        reason=locked(reason, np.uint8),
        search=SearchReport(
            cone, rays=grasps.rays, rounds=grasps.rounds, still_falling=grasps.still_falling
        ),
        threads=threads,
    )


def label_multifinger(
    mesh: ObjectMesh, model: GraspModel, sampling: Sampling, threads: int, progress: Progress
) -> SurfaceLabels:
    """Label a surface by the best grasps of three fingers and more.

    Args:
        mesh: The object's surface.
        model: Friction and sensor resolution; labels of method extremes are made later.
        sampling: How grasps are searched.
        threads: Threads to use.
        progress: Called with the share of the work done, from 0 to 1.

    Raises:
        SettingError: The mesh has fewer points than fingers.
    """
    cone, count = search_cone(model, sampling), len(mesh.vertices)
    searching, settling = within(progress, 0.0, HANDS_SHARE), within(progress, HANDS_SHARE, 1.0)
    found = search(mesh, model.fingers, sampling, cone, threads=threads, progress=searching)
    points = _both_grasps(found.partner_points)
    reason = np.where(mesh.on_surface, found.reason, Reason.OFF_SURFACE)
    held = np.unique(mesh.canonical[reason == Reason.FOUND])
    grasps = grasps_at(mesh, points, held, 0)
    angles = np.full((2, count), math.inf)
    angles[:, held] = critical_angles(grasps, threads=threads, progress=settling)
    others = held[grasps_differ(points, held)]
    _, best = critical_angles(grasps_at(mesh, points, others, 1), threads=threads)
    angles[1, others] = np.minimum(angles[1, others], best)
    partners, normals = np.full((2, count, model.fingers - 1, 3), math.nan)
    partners[held], normals[held] = grasps.points[:, 1:], grasps.normals[:, 1:]
    progress(1.0)
    canonical = mesh.canonical
    return SurfaceLabels(
        mesh=mesh,
        model=model,
        sampling=sampling,
        mode="label",
        critical_angle=locked(angles[0, canonical]),
        critical_angle_best=locked(angles[1, canonical]),
        partners=locked(partners[canonical]),
        partner_normals=locked(normals[canonical]),
        partner_points=SurfacePoints(locked(points.faces), locked(points.weights)),
        opening=locked(largest_distance(mesh.vertices, partners[canonical])),
        grip=locked(np.zeros(count), np.int8),
        reason=locked(reason, np.uint8),
        search=SearchReport(
            cone, settled=found.settled, rounds=found.rounds, still_falling=found.still_falling
        ),
        threads=threads,
    )


def _both_grasps(points: SurfacePoints) -> SurfacePoints:
    """Places (V, 2, n - 1) where a vertex that has one of its two grasps has it twice."""
    missing = (points.faces < 0).any(axis=2)  # (V, 2)
    number = np.where(missing, [[1, 0]], [[0, 1]])[..., None]
    return SurfacePoints(
        np.take_along_axis(points.faces, number, axis=1),
        np.take_along_axis(points.weights, number[..., None], axis=1),
    )
