"""Where fingers can stand on a mesh, laid out for the search."""

import numpy as np

from grasp3d._kernels.multifinger_contacts import NOWHERE, Ground, Pool
from grasp3d.arrays import Ints
from grasp3d.mesh import ObjectMesh
from grasp3d.mesh.normals import paired_edges
from grasp3d.mesh.surface_points import SurfacePoints
from grasp3d.surface.contacts import SurfaceContacts, vertex_surface_points
from grasp3d.surface.sampling.antipodal import neighbours
from grasp3d.surface.sampling.blue_noise import spread_points, spread_vertices
from grasp3d.surface.sampling.crease_normals import crease_samples


def ground_of(mesh: ObjectMesh, scale: float, *, on_vertices: bool) -> Ground:
    """The surface in the normalised frame times `scale`, as the kernels take it."""
    surface = mesh.contact_surface
    first, normals = crease_samples(mesh)
    around, beside = neighbours(mesh)
    one, two = paired_edges(mesh.faces)
    across = np.full(3 * len(mesh.faces), -1, dtype=np.int64)
    across[one], across[two] = two // 3, one // 3
    return Ground(
        surface=surface._replace(points=np.ascontiguousarray(scale * surface.points)),
        sets=mesh.contact_normals,
        across=across.reshape(-1, 3),
        first=first,
        normals=normals,
        around=around,
        beside=beside,
        on_vertices=on_vertices,
        most=len(normals),
    )


def vertex_pool(mesh: ObjectMesh, count: int, seed: int, scale: float) -> tuple[Pool, Ints]:
    """Spread vertices; see `surface_pool`."""
    chosen = spread_vertices(mesh, count, seed=seed)
    own = np.full(len(mesh.vertices), NOWHERE, dtype=np.int64)
    return _pool(mesh, chosen, vertex_surface_points(mesh, chosen), len(chosen), scale), own


def surface_pool(
    mesh: ObjectMesh, count: int, seed: int, scale: float, *, extra: tuple[SurfacePoints, Ints]
) -> tuple[Pool, Ints]:
    """Spread points over the surface.

    Args:
        mesh: The surface.
        count: How many points are for all vertices.
        seed: Of their spread.
        scale: Of the normalised frame.
        extra: Places (m,) that are for one vertex each, and these vertices (m,).

    Returns:
        The pool, and the place of it that is each vertex's own, shape (V,); NOWHERE: none.
    """
    spread, (more, held) = spread_points(mesh, count, seed=seed), extra
    own = np.full(len(mesh.vertices), NOWHERE, dtype=np.int64)
    own[held] = len(spread.faces) + np.arange(len(held))
    points = SurfacePoints(
        np.concatenate([spread.faces, more.faces]), np.concatenate([spread.weights, more.weights])
    )
    return _pool(mesh, points.faces, points, len(spread.faces), scale), own


def _pool(
    mesh: ObjectMesh, numbers: Ints, points: SurfacePoints, spread: int, scale: float
) -> Pool:
    contacts = SurfaceContacts(mesh, SurfacePoints(points.faces[:, None], points.weights[:, None]))
    positions = (contacts.points[:, 0] - mesh.center) * (scale / mesh.size)
    return Pool(spread, positions, numbers, points.weights, contacts.normals[:, 0])
