"""Other grasps through one vertex of a labelled surface."""

from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np

from grasp3d.arrays import Bools, Floats, Ints, locked
from grasp3d.errors import SettingError
from grasp3d.mesh.surface_points import SurfacePoints
from grasp3d.settings import Sampling
from grasp3d.surface.contacts import SurfaceContacts, vertex_surface_points
from grasp3d.surface.critical_angles import critical_angles
from grasp3d.surface.grasp_numbers import located_angles_of
from grasp3d.surface.grasp_table import GraspTable
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.surface.sampling.pair_limits import Ranking, largest_cost, pair_limits
from grasp3d.surface.sampling.reachable import ReachSearch
from grasp3d.surface.vertex_grasps import Reason

TESTS_PER_GRASP = 16
"""Opposing contacts that are tested and not reached, for each grasp that is asked for, before the
search ends."""


def alternatives_at(labels: SurfaceLabels, vertex: int, count: int) -> GraspTable:
    """Distinct grasps through a vertex that the gripper reaches, best first.

    Opposing contacts differ by half a finger's width at least. The first grasp is that of the
    vertex; the others come from a search of the whole surface, for fingers that squeeze.

    Args:
        labels: Labels of two fingers with a gripper.
        vertex: Number of the vertex.
        count: Largest number of grasps; there may be fewer, or none.

    Returns:
        The grasps, with `reach` and their poses.

    Raises:
        SettingError: There is no gripper or no such vertex, or the count is below 1.

    Example:
        >>> import trimesh
        >>> import grasp3d
        >>> from grasp3d.grasps import alternatives_at
        >>> box = trimesh.creation.box([0.08, 0.05, 0.03])
        >>> mesh = grasp3d.load_mesh(box, unit="m", max_edge=0.01)
        >>> hand = grasp3d.ParallelGripper.preset("franka")
        >>> labels = grasp3d.label_surface(mesh, hand=hand)
        >>> grasps = alternatives_at(labels, 60, 3)
        >>> grasps.size, bool(grasps.reach.reached.all())
        (2, True)
    """
    scene, mesh = labels.scene, labels.mesh
    if scene is None or scene.jaws is None or labels.model.fingers > 2:
        raise SettingError("alternatives are grasps of two fingers with a gripper; give a gripper")
    if not 0 <= vertex < len(mesh.vertices):
        raise SettingError(f"vertex must be from 0 to {len(mesh.vertices) - 1}; got {vertex}")
    if count < 1:
        raise SettingError(f"the number of grasps must be at least 1; got {count}")
    own = int(mesh.canonical[vertex])
    known = _known(labels, own)
    given = labels.sampling if isinstance(labels.sampling, Sampling) else Sampling()
    limited = scene.within_stroke(mesh, given)
    with ThreadPoolExecutor(1) as executor:
        cone, ranking = labels.search.cone, Ranking.of(labels.model)
        limits = pair_limits(mesh, limited, cone, ranking)
        most = largest_cost(cone, ranking)
        search = ReachSearch(mesh, scene, cone, limits, executor, most)
        found = search.partners_of(np.array([own]), count, TESTS_PER_GRASP * count)
    signs = np.concatenate([known.signs, np.ones(count, dtype=np.int64)])
    faces = np.concatenate([known.points.faces, found.faces[0]])
    weights = np.concatenate([known.points.weights, found.weights[0]])
    positions = SurfacePoints(np.maximum(faces, 0), weights).positions(mesh)
    kept = _different(positions, faces >= 0, search.spacing * mesh.size)[:count]
    return _grasps(labels, own, SurfacePoints(faces[kept], weights[kept]), signs[kept])


class _Known(NamedTuple):
    """The grasp that a vertex has, if any."""

    points: SurfacePoints
    signs: Ints


def _known(labels: SurfaceLabels, vertex: int) -> _Known:
    """The opposing contact of a vertex's grasp (0 or 1,)."""
    found = slice(0, int(labels.likely_reason[vertex] == Reason.FOUND))
    points = labels.partner_points
    return _Known(
        SurfacePoints(points.faces[vertex, 0][found], points.weights[vertex, 0][found]),
        labels.grip[vertex : vertex + 1][found].astype(np.int64),
    )


def _different(positions: Floats, exists: Bools, spacing: float) -> Ints:
    """Rows of positions (n, 3) that are not near an earlier one."""
    kept: list[int] = []
    for row in np.flatnonzero(exists):
        gaps = np.linalg.norm(positions[kept] - positions[row], axis=1)
        if (gaps >= spacing).all():
            kept.append(int(row))
    return np.array(kept, dtype=np.int64)


def _grasps(labels: SurfaceLabels, vertex: int, points: SurfacePoints, signs: Ints) -> GraspTable:
    """The grasps of a vertex and opposing contacts (k,) that are reached, best first."""
    scene, mesh, count = labels.scene, labels.mesh, len(signs)
    assert scene is not None
    own = vertex_surface_points(mesh, np.full(count, vertex))
    contacts = SurfaceContacts(
        mesh,
        SurfacePoints(
            np.stack([own.faces, points.faces], axis=1),
            np.stack([own.weights, points.weights], axis=1),
        ),
    )
    reach = scene.reach(mesh, contacts.points, contacts.normals, grip=signs, threads=1)
    worst, best = critical_angles(contacts, threads=1)
    located, _ = located_angles_of(contacts, (worst, best), labels.model, threads=1)
    order = np.argsort(located, kind="stable")
    order = order[reach.reached[order]]
    return GraspTable(
        contacts=contacts.take(order),
        model=labels.model,
        critical_angle=locked(worst[order]),
        critical_angle_best=locked(best[order]),
        scene=scene,
        reach=reach.take(order),
        load=labels.load,
        threads=labels.threads,
    )
