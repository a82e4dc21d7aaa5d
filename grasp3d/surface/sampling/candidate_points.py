"""Candidate points of the fingers on a mesh, as arrays for the kernels."""

import math

import numpy as np

from grasp3d._kernels.search.multifinger_grasps import NO_CONTACT, CandidatePoints, ContactDomain
from grasp3d.arrays import Floats, Ints, angles_between, locked, unit_rows
from grasp3d.mesh import ObjectMesh
from grasp3d.mesh.measures import paired_edges
from grasp3d.mesh.surface_points import SurfacePoints
from grasp3d.surface.contacts import SurfaceContacts, vertex_surface_points
from grasp3d.surface.sampling.blue_noise import spread_points, spread_vertices
from grasp3d.surface.sampling.neighbours import neighbours

STEP = math.radians(15.0)
"""Largest angle between samples along the border of a set of normals [rad]."""


def contact_domain(mesh: ObjectMesh, scale: float, *, on_vertices: bool) -> ContactDomain:
    """The arrays of a surface in the normalised frame, scaled by `scale`, for the kernels."""
    surface = mesh.contact_surface
    normal_start, normals = crease_samples(mesh)
    neighbour_start, neighbour_index = neighbours(mesh)
    one, two = paired_edges(mesh.faces)
    adjacent = np.full(3 * len(mesh.faces), -1, dtype=np.int64)
    adjacent[one], adjacent[two] = two // 3, one // 3
    return ContactDomain(
        surface=surface._replace(points=locked(scale * surface.points)),
        sets=mesh.contact_normals,
        adjacent_faces=adjacent.reshape(-1, 3),
        normal_start=normal_start,
        normals=normals,
        neighbour_start=neighbour_start,
        neighbours=neighbour_index,
        on_vertices=on_vertices,
        max_normals=len(normals),
    )


def candidate_vertices(
    mesh: ObjectMesh, count: int, seed: int, scale: float
) -> tuple[CandidatePoints, Ints]:
    """Sample vertices as candidate points; see `candidate_surface_points`."""
    chosen = spread_vertices(mesh, count, seed=seed)
    own = np.full(len(mesh.vertices), NO_CONTACT, dtype=np.int64)
    return _candidate_points(
        mesh, chosen, vertex_surface_points(mesh, chosen), len(chosen), scale
    ), own


def candidate_surface_points(
    mesh: ObjectMesh, count: int, seed: int, scale: float, *, extra: tuple[SurfacePoints, Ints]
) -> tuple[CandidatePoints, Ints]:
    """Sample candidate points evenly over the surface.

    Args:
        mesh: The surface.
        count: Number of points for all vertices.
        seed: Seed of the sample.
        scale: Scale of the normalised frame.
        extra: Points that belong to one vertex each (m,), and these vertices (m,).

    Returns:
        The points, and the index of each vertex's own one, shape (V,); NO_CONTACT: none.
    """
    common, (single, owners) = spread_points(mesh, count, seed=seed), extra
    own = np.full(len(mesh.vertices), NO_CONTACT, dtype=np.int64)
    own[owners] = len(common.faces) + np.arange(len(owners))
    points = SurfacePoints(
        np.concatenate([common.faces, single.faces]),
        np.concatenate([common.weights, single.weights]),
    )
    return _candidate_points(mesh, points.faces, points, len(common.faces), scale), own


def _candidate_points(
    mesh: ObjectMesh, elements: Ints, points: SurfacePoints, common_count: int, scale: float
) -> CandidatePoints:
    contacts = SurfaceContacts(mesh, SurfacePoints(points.faces[:, None], points.weights[:, None]))
    positions = (contacts.points[:, 0] - mesh.center) * (scale / mesh.size)
    return CandidatePoints(
        common_count, positions, elements, points.weights, contacts.normals[:, 0]
    )


def crease_samples(mesh: ObjectMesh) -> tuple[Ints, Floats]:
    """Sample the borders and the centres of the vertices' sets of normals.

    Returns:
        (first, normals): first row of each vertex in `normals` (V + 1,); inward unit normals
        (K, 3), one where the surface is smooth.
    """
    sets = mesh.normal_sets
    several = np.flatnonzero(sets.counts > 1)
    single = np.flatnonzero((sets.counts == 1) | ((sets.counts == 0) & (sets.radii > 0.0)))
    vertex_parts, normal_parts = [single], [sets.normals[sets.start[single]]]
    polygons = several[sets.counts[several] > 2]
    vertex_parts += [polygons]
    normal_parts += [unit_rows(sets.centres[polygons])]
    for vertices, closed in ((several[sets.counts[several] == 2], False), (polygons, True)):
        some_vertices, normals = _borders(mesh, vertices, closed=closed)
        vertex_parts += [some_vertices]
        normal_parts += [normals]
    vertex, normals = np.concatenate(vertex_parts), np.concatenate(normal_parts)
    order = np.argsort(vertex, kind="stable")
    first = np.searchsorted(vertex[order], np.arange(len(mesh.vertices) + 1))
    return first.astype(np.int64), np.ascontiguousarray(normals[order])


def _borders(mesh: ObjectMesh, vertices: Ints, *, closed: bool) -> tuple[Ints, Floats]:
    """(vertex, normal) of samples along arcs, or around polygons, (m,) and (m, 3)."""
    sets = mesh.normal_sets
    counts = sets.counts[vertices]
    sides = counts if closed else np.ones_like(counts)
    vertex = np.repeat(vertices, sides)
    number = np.arange(sides.sum()) - np.repeat(np.cumsum(sides) - sides, sides)
    a = sets.normals[sets.start[vertex] + number]
    b = sets.normals[sets.start[vertex] + (number + 1) % sets.counts[vertex]]
    angles = angles_between(a, b)
    steps = np.maximum(1, np.ceil(angles / STEP - 1e-9)).astype(np.int64)
    samples = steps if closed else steps + 1  # an arc has two ends, a polygon none
    side = np.repeat(np.arange(len(vertex)), samples)
    sample = np.arange(samples.sum()) - np.repeat(np.cumsum(samples) - samples, samples)
    fraction = sample / steps[side]
    turn = angles[side]
    sine = np.maximum(np.sin(turn), 1e-300)
    left, right = np.sin((1.0 - fraction) * turn) / sine, np.sin(fraction * turn) / sine
    return vertex[side], unit_rows(left[:, None] * a[side] + right[:, None] * b[side])
