"""Points of a surface where other fingers may be put, evenly spread: blue noise (Yuksel 2015).

C. Yuksel, 'Sample Elimination for Generating Poisson Disk Sample Sets', Computer Graphics Forum
34(2), 2015. More samples than wanted are drawn, and the most crowded one is eliminated repeatedly.
Eliminating further, to half of them, to a quarter and so on, gives an order in which every initial
part of the sequence is evenly spread.

The module also has the neighbours of vertices and reference directions there, for searches.
"""

import heapq
import math

import numpy as np
from scipy.sparse import coo_array, csr_array
from scipy.spatial import cKDTree

from grasp3d._kernels.search.multifinger_grasps import NO_CONTACT, CandidatePoints, ContactDomain
from grasp3d._kernels.surface.face_tree import FaceTree, face_tree
from grasp3d._kernels.surface.surface_contacts import Surface
from grasp3d.arrays import Floats, Ints, locked, unit_rows
from grasp3d.mesh import ObjectMesh
from grasp3d.mesh.measures import Triangles, face_areas, paired_edges
from grasp3d.mesh.surface_points import SurfacePoints
from grasp3d.settings import whole_number
from grasp3d.surface.contacts import SurfaceContacts, vertex_surface_points


def contact_tree(mesh: ObjectMesh, surface: Surface) -> FaceTree:
    """Make a tree over the faces in which contacts may be, to search for opposing contacts."""
    faces, turns = mesh.contact_faces, surface.turns
    if turns.error > 0.0:
        turns = turns._replace(least=locked(turns.least[faces]))
    part = surface._replace(
        faces=locked(surface.faces[faces]), corners=locked(surface.corners[faces]), turns=turns
    )
    tree: FaceTree = face_tree(part)
    return tree._replace(order=faces[tree.order])


def places_in_tree(count: int, surface: Surface, tree: FaceTree) -> Ints:
    """First position of each of `count` vertices in the order of a tree, shape (V,).

    In this order neighbours mostly follow one another.
    """
    used, first = np.unique(surface.faces[tree.order], return_index=True)
    place = np.full(count, len(surface.faces) * 3)
    place[used] = first
    return place


def neighbours(mesh: ObjectMesh) -> tuple[Ints, Ints]:
    """(first, index): the adjacent vertices of each vertex, grouped by vertex, for the kernels.

    Vertices where no contact may be are left out.
    """
    one, two = mesh.faces[:, [0, 1, 2]].ravel(), mesh.faces[:, [1, 2, 0]].ravel()
    allowed = mesh.allowed[one] & mesh.allowed[two]
    one, two = one[allowed], two[allowed]
    links = coo_array(
        (
            np.ones(2 * len(one), dtype=np.int8),
            (np.concatenate([one, two]), np.concatenate([two, one])),
        ),
        shape=(len(mesh.vertices),) * 2,
    ).tocsr()
    return links.indptr.astype(np.int64), links.indices.astype(np.int64)


MIN_LENGTH = 1e-3
"""Length of a reference vector's part orthogonal to the normal above which it is used."""

SYMMETRIC = 1e-9
"""Third moment, in object sizes cubed, below which the object is symmetric along an axis."""


def tangents(mesh: ObjectMesh) -> Floats:
    """A unit vector orthogonal to each vertex's normal that turns with the object, shape (V, 3).

    Rotating, moving or scaling the object or reordering its vertices changes no search direction,
    because references come from the mesh: the vector from the centre to the vertex; if that is
    parallel to the normal, the third moments of the surface, its principal axes, and finally, for
    objects as regular as a ball, an edge.
    """
    centres = mesh.normal_centres
    points = mesh.normalized
    weights = mesh.vertex_areas / mesh.vertex_areas.sum()
    squares = np.einsum("ij,ij->i", points, points)
    moments = (points * weights[:, None]).T @ points
    third_moment = ((weights * squares)[:, None] * points).sum(axis=0)
    _, axes = np.linalg.eigh(moments)
    skew = ((points @ axes) ** 3 * weights[:, None]).sum(axis=0)
    signs = np.where(np.abs(skew) > SYMMETRIC, np.sign(skew), 0.0)
    edge = np.zeros_like(points)
    for k in (2, 1, 0):
        edge[mesh.faces[:, k]] = points[mesh.faces[:, (k + 1) % 3]] - points[mesh.faces[:, k]]
    references = [third_moment, axes[:, 2] * signs[2], axes[:, 0] * signs[0]]
    result = np.zeros_like(points)
    missing = np.ones(len(points), dtype=bool)
    for reference in (points, *references, unit_rows(edge)):
        across = reference - (reference * centres).sum(axis=1, keepdims=True) * centres
        clear = missing & (np.linalg.norm(across, axis=1) > MIN_LENGTH)
        result[clear] = across[clear]
        missing &= ~clear
    return unit_rows(result)


def contact_domain(
    mesh: ObjectMesh,
    surface: Surface,
    scale: float,
    candidates: CandidatePoints,
    *,
    on_vertices: bool,
) -> ContactDomain:
    """The arrays of a surface in the normalised frame, scaled by `scale`, for the kernels."""
    start, index = neighbours(mesh)
    links = np.ones(len(index), dtype=np.int64)
    around = csr_array((links, index, start), shape=(len(start) - 1,) * 2)
    if not on_vertices:  # pass vertices on creases, whose grasps suit no other vertices
        around = csr_array(around + around @ around)
        around.sort_indices()
    one, two = paired_edges(mesh.faces)
    adjacent = np.full(3 * len(mesh.faces), -1, dtype=np.int64)
    adjacent[one], adjacent[two] = two // 3, one // 3
    adjacent[~np.isin(adjacent, mesh.contact_faces)] = -1
    return ContactDomain(
        surface=surface._replace(points=locked(scale * surface.points)),
        sets=mesh.contact_normals,
        adjacent_faces=adjacent.reshape(-1, 3),
        centres=mesh.normal_centres,
        radii=mesh.normal_radii,
        neighbour_start=around.indptr.astype(np.int64),
        neighbours=around.indices.astype(np.int64),
        on_vertices=on_vertices,
        candidates=candidates,
    )


def candidate_points(
    mesh: ObjectMesh,
    count: int,
    seed: int,
    scale: float,
    opposing: tuple[SurfacePoints, Ints] | None,
) -> CandidatePoints:
    """Sample candidate points evenly over a surface.

    Args:
        mesh: The surface.
        count: Number of points for all vertices.
        seed: Seed of the sample.
        scale: Scale of the normalised frame.
        opposing: Points (m,), each for one vertex only, and these vertices (m,); None: candidate
            points are vertices.
    """
    own = np.full(len(mesh.vertices), NO_CONTACT, dtype=np.int64)
    if opposing is None:
        elements = spread_vertices(mesh, count, seed=seed)
        points, common_count = vertex_surface_points(mesh, elements), len(elements)
    else:
        common, (single, owners) = spread_points(mesh, count, seed=seed), opposing
        points = SurfacePoints(
            np.concatenate([common.faces, single.faces]),
            np.concatenate([common.weights, single.weights]),
        )
        elements, common_count = points.faces, len(common.faces)
        own[owners] = common_count + np.arange(len(owners))
    contacts = SurfaceContacts(mesh, SurfacePoints(points.faces[:, None], points.weights[:, None]))
    positions = (contacts.points[:, 0] - mesh.center) * (scale / mesh.size)
    return CandidatePoints(
        common_count, positions, elements, points.weights, contacts.normals[:, 0], own
    )


SURPLUS = 5
"""Samples drawn per sample that remains."""

INSIDE = 1e-6
"""Smallest barycentric coordinate of a sample, so that none lies on an edge."""

SHARPNESS = 8
"""Exponent with which the weight of a sample falls with the distance (Yuksel's alpha)."""

MIN_FRACTION, DECLINE = 0.65, 1.5
"""Fraction of the largest spacing to which smaller distances are raised, and the exponent with
which it falls with the fraction of the samples that remain (Yuksel's beta and gamma)."""

SAME_PLACE = 2**40
"""Weight of two samples at one place."""

MAX_NEIGHBOURS = 48
"""Nearest samples that are weighted: more than evenly spread samples have within the radius, so
only dense regions are truncated. They are found anew whenever half of the samples are gone."""


def spread_points(mesh: ObjectMesh, count: int, *, seed: int = 0) -> SurfacePoints:
    """Sample points evenly spread over the area of a surface.

    They lie strictly inside faces. Every initial part of the sequence is evenly spread too. Points
    whose normals differ by more than 90 degrees, as on the two sides of a plate, are independent.

    Args:
        mesh: The surface.
        count: Number of points.
        seed: Seed of the random numbers; the same seed gives the same points.

    Returns:
        The points, shape (count,).

    Raises:
        SettingError: A count below 1, or a negative seed.
    """
    count, seed = whole_number("count", count, 1), whole_number("seed", seed, 0)
    rng = np.random.default_rng(seed)
    allowed, samples = mesh.contact_faces, SURPLUS * count
    areas = np.zeros(len(mesh.faces))
    areas[allowed] = face_areas(mesh.normalized, mesh.faces[allowed])
    faces = rng.choice(len(areas), samples, p=areas / areas.sum())
    root, uniform = np.sqrt(rng.random(samples)), rng.random(samples)
    even = np.stack([1.0 - root, root * (1.0 - uniform), root * uniform], axis=1)
    weights = INSIDE + (1.0 - 3.0 * INSIDE) * even
    corners = mesh.normalized[mesh.faces[faces]]  # (samples, 3, 3)
    points = np.einsum("bk,bkj->bj", weights, corners)
    normals = Triangles(mesh.normalized, mesh.faces[faces]).normals
    rows = _choose(points, normals, float(areas.sum()), count)
    return SurfacePoints(faces[rows], weights[rows])


def spread_vertices(mesh: ObjectMesh, count: int, *, seed: int = 0) -> Ints:
    """Choose vertices evenly spread over the area of a surface, independently of their density.

    Args:
        mesh: The surface.
        count: Number of vertices; all where there are fewer.
        seed: Seed of the random numbers; the same seed gives the same vertices.

    Returns:
        Distinct canonical vertices on the surface, shape (k,), k the smaller of `count` and their
        number. Every initial part of the sequence is evenly spread too.

    Raises:
        SettingError: A count below 1, or a negative seed.
    """
    count, seed = whole_number("count", count, 1), whole_number("seed", seed, 0)
    rng = np.random.default_rng(seed)
    candidates = mesh.contact_vertices
    areas = mesh.vertex_areas[candidates] / mesh.vertex_areas[candidates].max()
    # The largest u^(1/area) are a weighted sample without replacement (Efraimidis & Spirakis 2006).
    keys = np.log(rng.random(len(candidates))) / np.maximum(areas, np.finfo(np.float64).tiny)
    samples = candidates[np.argsort(-keys, kind="stable")[: SURPLUS * count]]
    area = float(face_areas(mesh.normalized, mesh.faces[mesh.contact_faces]).sum())
    rows = _choose(mesh.normalized[samples], mesh.normals[samples], area, min(count, len(samples)))
    return np.asarray(samples[rows])


def _choose(points: Floats, normals: Floats, area: float, count: int) -> Ints:
    """Choose samples (m, 3), in an order of which every initial part is evenly spread."""
    alive, _ = _eliminate(points, normals, np.arange(len(points)), area, count)
    later = []
    while len(alive) > 1:
        alive, eliminated = _eliminate(points, normals, alive, area, len(alive) // 2)
        later.append(eliminated[::-1])
    return np.concatenate([alive, *later[::-1]])


def _eliminate(
    points: Floats, normals: Floats, alive: Ints, area: float, count: int
) -> tuple[Ints, Ints]:
    """Eliminate the most crowded samples until `count` remain.

    Returns:
        The remaining samples, and the eliminated ones in the order of their elimination.
    """
    widest = 2.0 * math.sqrt(area / (2.0 * math.sqrt(3.0) * count))  # densest packing of discs
    clipped_distance = widest * MIN_FRACTION * (1.0 - (count / len(alive)) ** DECLINE)
    removed = []
    while len(alive) > count:
        crowding = _crowding(points[alive], normals[alive], clipped_distance, widest)
        eliminated = _most_crowded(crowding, len(alive) - max(count, len(alive) // 2))
        removed.append(alive[eliminated])
        alive = np.delete(alive, eliminated)
    return alive, np.concatenate([*removed, np.zeros(0, dtype=np.int64)])


def _crowding(points: Floats, normals: Floats, clipped_distance: float, widest: float) -> csr_array:
    """Weights of all pairs of samples (m, m), 0 for distances from `widest` on.

    They are whole numbers, because rounding errors would decide between equally crowded samples.
    """
    near = min(MAX_NEIGHBOURS, len(points))
    hits = cKDTree(points).query(points, np.arange(2, near + 1), distance_upper_bound=widest)
    distance, other = np.asarray(hits[0]), np.asarray(hits[1])  # (m, near - 1)
    one, column = np.nonzero(np.isfinite(distance))
    two = other[one, column]
    facing = np.einsum("ij,ij->i", normals[one], normals[two]) >= 0.0
    one, two, column = one[facing], two[facing], column[facing]
    amount = (1.0 - np.maximum(distance[one, column], clipped_distance) / widest) ** SHARPNESS
    whole = np.rint(SAME_PLACE * amount).astype(np.int64)
    crowding = csr_array((whole, (one, two)), shape=(len(points),) * 2)
    return csr_array(crowding.maximum(crowding.T))


def _most_crowded(crowding: csr_array, count: int) -> Ints:
    """The next `count` samples to eliminate, in order: each is the most crowded one remaining."""
    sums = np.asarray(crowding.sum(axis=1)).ravel().tolist()
    first, others = crowding.indptr.tolist(), crowding.indices.tolist()
    amounts = crowding.data.tolist()
    heap = [(-amount, sample) for sample, amount in enumerate(sums)]
    heapq.heapify(heap)
    eliminated: list[int] = []
    while len(eliminated) < count:
        key, sample = heap[0]
        if -key > sums[sample]:  # the entry is outdated: neighbours were eliminated since
            heapq.heapreplace(heap, (-sums[sample], sample))
            continue
        heapq.heappop(heap)
        eliminated.append(sample)
        for i in range(first[sample], first[sample + 1]):
            sums[others[i]] -= amounts[i]
    return np.array(eliminated, dtype=np.int64)
