"""Where fingers can stand on a mesh, laid out for the search."""

import numpy as np

from grasp3d._kernels.standing import NOWHERE, Ground, Pool
from grasp3d.arrays import Ints
from grasp3d.mesh import ObjectMesh
from grasp3d.mesh.normals import paired_edges
from grasp3d.mesh.places import SurfacePlaces
from grasp3d.sampling.antipodal import neighbours
from grasp3d.sampling.crease_samples import crease_samples
from grasp3d.sampling.spread import spread_places, spread_vertices
from grasp3d.surface_contacts import SurfaceContacts, vertex_places


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
    return _pool(mesh, chosen, vertex_places(mesh, chosen), len(chosen), scale), own


def surface_pool(
    mesh: ObjectMesh, count: int, seed: int, scale: float, *, extra: tuple[SurfacePlaces, Ints]
) -> tuple[Pool, Ints]:
    """Spread places over the surface.

    Args:
        mesh: The surface.
        count: How many places are for all vertices.
        seed: Of their spread.
        scale: Of the normalised frame.
        extra: Places (m,) that are for one vertex each, and these vertices (m,).

    Returns:
        The pool, and the place of it that is each vertex's own, shape (V,); NOWHERE: none.
    """
    spread, (more, held) = spread_places(mesh, count, seed=seed), extra
    own = np.full(len(mesh.vertices), NOWHERE, dtype=np.int64)
    own[held] = len(spread.faces) + np.arange(len(held))
    places = SurfacePlaces(
        np.concatenate([spread.faces, more.faces]), np.concatenate([spread.weights, more.weights])
    )
    return _pool(mesh, places.faces, places, len(spread.faces), scale), own


def _pool(
    mesh: ObjectMesh, numbers: Ints, places: SurfacePlaces, spread: int, scale: float
) -> Pool:
    contacts = SurfaceContacts(mesh, SurfacePlaces(places.faces[:, None], places.weights[:, None]))
    points = (contacts.points[:, 0] - mesh.center) * (scale / mesh.size)
    return Pool(spread, points, numbers, places.weights, contacts.normals[:, 0])
