"""Places well spread over a surface: blue noise by sample elimination (Yuksel 2015).

C. Yuksel, 'Sample Elimination for Generating Poisson Disk Sample Sets', Computer Graphics Forum
34(2), 2015. More places than wanted are drawn, and the most crowded is left out again and again.
Going on to half of them, half of those and so on puts them in an order of which every beginning is
well spread.
"""

import heapq
import math

import numpy as np
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from grasp3d.arrays import Floats, Ints
from grasp3d.mesh.measures import face_areas
from grasp3d.mesh.normals import inward_normals
from grasp3d.mesh.object_mesh import ObjectMesh
from grasp3d.mesh.surface_points import SurfacePoints
from grasp3d.settings import whole

DRAWN = 5
"""Places drawn for each that stays."""

INSIDE = 1e-6
"""Smallest barycentric coordinate of a place that is drawn: none lies on an edge."""

SHARPNESS = 8
"""Power by which crowding falls with the distance (Yuksel's alpha)."""

LIMIT, DECLINE = 0.65, 1.5
"""Below which share of the largest spacing distances no longer count, and how that share falls
with the share of samples that stays (Yuksel's beta and gamma)."""

MOST_NEAR = 48
"""Nearest samples looked at about each: more than an even spread has within reach, so only dense
spots are cut short, and the nearest are looked up again whenever half of the samples are gone."""


def spread_points(mesh: ObjectMesh, count: int, *, seed: int = 0) -> SurfacePoints:
    """Spread places evenly over the area of a surface.

    They lie strictly inside faces. Any first so many of them are well spread too. Places whose
    normals look away from each other, as on the two sides of a plate, do not crowd each other.

    Args:
        mesh: The surface.
        count: How many.
        seed: Of the places drawn; the same seed gives the same places.

    Returns:
        The places, shape (count,).

    Raises:
        SettingError: A count below 1, or a negative seed.
    """
    count, seed = whole("count", count, 1), whole("seed", seed, 0)
    rng = np.random.default_rng(seed)
    areas = face_areas(mesh.normalized, mesh.faces)
    drawn = DRAWN * count
    faces = rng.choice(len(areas), drawn, p=areas / areas.sum())
    root, share = np.sqrt(rng.random(drawn)), rng.random(drawn)
    even = np.stack([1.0 - root, root * (1.0 - share), root * share], axis=1)
    weights = INSIDE + (1.0 - 3.0 * INSIDE) * even
    corners = mesh.normalized[mesh.faces[faces]]  # (drawn, 3, 3)
    points = np.einsum("bk,bkj->bj", weights, corners)
    normals = inward_normals(mesh.normalized, mesh.faces[faces])
    chosen = _spread(points, normals, float(areas.sum()), count)
    return SurfacePoints(faces[chosen], weights[chosen])


def spread_vertices(mesh: ObjectMesh, count: int, *, seed: int = 0) -> Ints:
    """Choose vertices spread evenly over the area of a surface, however dense they lie.

    Args:
        mesh: The surface.
        count: How many; all there are when it exceeds them.
        seed: Of the vertices drawn and of ties; the same seed gives the same vertices.

    Returns:
        Distinct canonical vertices on the surface, shape (min(count, how many there are),). Any
        first so many of them are well spread too.

    Raises:
        SettingError: A count below 1, or a negative seed.
    """
    count, seed = whole("count", count, 1), whole("seed", seed, 0)
    rng = np.random.default_rng(seed)
    places = np.unique(mesh.faces)
    areas = mesh.vertex_areas[places] / mesh.vertex_areas[places].max()
    # The largest of u^(1/area) are a draw without return (Efraimidis & Spirakis 2006).
    keys = np.log(rng.random(len(places))) / np.maximum(areas, np.finfo(np.float64).tiny)
    drawn = places[np.argsort(-keys, kind="stable")[: DRAWN * count]]
    area = float(face_areas(mesh.normalized, mesh.faces).sum())
    chosen = _spread(mesh.normalized[drawn], mesh.normals[drawn], area, min(count, len(drawn)))
    return np.asarray(drawn[chosen])


def _spread(points: Floats, normals: Floats, area: float, count: int) -> Ints:
    """Choose samples (m, 3) on a surface of some area; in an order whose beginnings are spread."""
    alive, _ = _eliminate(points, normals, np.arange(len(points)), area, count)
    later = []
    while len(alive) > 1:
        alive, gone = _eliminate(points, normals, alive, area, len(alive) // 2)
        later.append(gone[::-1])
    return np.concatenate([alive, *later[::-1]])


def _eliminate(
    points: Floats, normals: Floats, alive: Ints, area: float, count: int
) -> tuple[Ints, Ints]:
    """Leave out the most crowded of some samples until `count` are left.

    Returns:
        Those that stay, and those that went, in the order in which they did.
    """
    widest = 2.0 * math.sqrt(area / (2.0 * math.sqrt(3.0) * count))  # hexagons filled with discs
    least = widest * LIMIT * (1.0 - (count / len(alive)) ** DECLINE)
    went = []
    while len(alive) > count:
        crowding = _crowding(points[alive], normals[alive], least, widest)
        gone = _most_crowded(crowding, len(alive) - max(count, len(alive) // 2))
        went.append(alive[gone])
        alive = np.delete(alive, gone)
    return alive, np.concatenate([*went, np.zeros(0, dtype=np.int64)])


def _crowding(points: Floats, normals: Floats, least: float, widest: float) -> csr_array:
    """How much every two samples crowd each other, shape (m, m): 1 together, 0 at `widest`."""
    near = min(MOST_NEAR, len(points))
    found = cKDTree(points).query(points, np.arange(2, near + 1), distance_upper_bound=widest)
    distance, other = np.asarray(found[0]), np.asarray(found[1])  # (m, near - 1)
    one, column = np.nonzero(np.isfinite(distance))
    two = other[one, column]
    facing = np.einsum("ij,ij->i", normals[one], normals[two]) >= 0.0
    one, two, column = one[facing], two[facing], column[facing]
    amount = (1.0 - np.maximum(distance[one, column], least) / widest) ** SHARPNESS
    seen = csr_array((amount, (one, two)), shape=(len(points),) * 2)
    return csr_array(seen.maximum(seen.T))


def _most_crowded(crowding: csr_array, count: int) -> Ints:
    """The `count` samples that go, each the most crowded of those then left, in this order."""
    sums = np.asarray(crowding.sum(axis=1)).ravel().tolist()
    first, others = crowding.indptr.tolist(), crowding.indices.tolist()
    amounts = crowding.data.tolist()
    heap = [(-amount, sample) for sample, amount in enumerate(sums)]
    heapq.heapify(heap)
    gone: list[int] = []
    while len(gone) < count:
        key, sample = heap[0]
        if -key > sums[sample]:  # it was more crowded when it was put there
            heapq.heapreplace(heap, (-sums[sample], sample))
            continue
        heapq.heappop(heap)
        gone.append(sample)
        for i in range(first[sample], first[sample + 1]):
            sums[others[i]] -= amounts[i]
    return np.array(gone, dtype=np.int64)
