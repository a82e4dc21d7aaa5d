"""Candidate points of the fingers on a mesh, as arrays for the kernels."""

import numpy as np

from grasp3d._kernels.multifinger_contacts import NO_CONTACT, CandidatePoints, ContactDomain
from grasp3d.arrays import Ints, locked
from grasp3d.mesh import ObjectMesh
from grasp3d.mesh.measures import paired_edges
from grasp3d.mesh.surface_points import SurfacePoints
from grasp3d.surface.contacts import SurfaceContacts, vertex_surface_points
from grasp3d.surface.sampling.blue_noise import spread_points, spread_vertices
from grasp3d.surface.sampling.crease_normals import crease_samples
from grasp3d.surface.sampling.neighbours import neighbours


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
