import math

import numba
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from grasp3d._kernels.search.descent import best_of_face, make_scratch, rank
from grasp3d._kernels.search.face_contacts import NONE, PairDomain, cosine_at
from grasp3d._kernels.surface.polygons import REGION_CORNERS, centroid, cut, stays_inside
from grasp3d.arrays import Floats
from grasp3d.mesh import ObjectMesh, load_mesh
from tests.helpers import shapes
from tests.helpers.pair_search import domain_of, own_normals, read

SHAPES = {"blob": shapes.lopsided(), "box": shapes.box(), "cone": shapes.cone(0.3)}
MESHES: dict[str, ObjectMesh] = {}


def mesh_of(shape: str) -> ObjectMesh:
    return MESHES.setdefault(shape, load_mesh(SHAPES[shape]))


@numba.njit
def cosines(
    points: Floats, lines: Floats, normals: Floats, own: Floats, domain: PairDomain
) -> Floats:
    """`cosine_at` points of a face, compiled with the loop, shape (k,)."""
    found = np.empty(len(points))
    for k in range(len(points)):
        w0, w1, w2 = points[k]
        found[k] = cosine_at((w0, w1, w2), 0, 0, lines, normals, own, domain)
    return found


@numba.njit
def largest_rank(
    row: int, vertex: int, own: Floats, domain: PairDomain, cosine: float, sine: float
) -> float:
    """Largest `rank` of the nodes above a row of the tree, compiled with the loop."""
    size, largest = len(domain.tree.order), -np.inf
    for level in range(domain.tree.depth + 1):
        for k in range(1 << level):
            if size * k >> level <= row < size * (k + 1) >> level:
                node = (1 << level) - 1 + k
                largest = max(largest, rank(node, vertex, own, domain, cosine, sine))
    return largest


def sampled(
    rng: np.random.Generator, lines: Floats, normals: Floats, own: Floats, domain: PairDomain
) -> float:
    """Largest cosine at random points of a face, ever nearer to the best one."""
    best, centre, radius = NONE, np.full(3, 1.0 / 3.0), 1.0
    for _ in range(12):
        points = centre + radius * (rng.dirichlet(np.ones(3), 150) - centre)
        points = np.maximum(points, 2e-9)
        points /= points.sum(axis=1, keepdims=True)
        found = cosines(points, lines, normals, own, domain)
        if found.max() > best:
            best, centre = float(found.max()), points[found.argmax()]
        radius *= 0.5
    return best


@pytest.mark.slow
@settings(deadline=None, max_examples=25)
@given(
    st.integers(0, 2**32 - 1), st.sampled_from(list(SHAPES)),
    st.sampled_from(["", "smallest", "largest"]),
)  # fmt: skip
@example(3426968002, "box", "smallest")
def test_no_point_of_a_face_is_better_than_the_best_one(seed: int, shape: str, limit: str) -> None:
    """Nor is the result worse than its own point, and with a limit below it nothing is found."""
    rng = np.random.default_rng(seed)
    mesh = mesh_of(shape)
    surface, scratch, tried = mesh.contact_surface, make_scratch(), 0
    while tried < 3:
        vertex, face = int(rng.integers(len(mesh.vertices))), int(rng.integers(len(surface.faces)))
        own, (lines, normals) = own_normals(mesh, vertex), read(mesh, face, vertex)
        middle = float(np.linalg.norm(lines.mean(axis=0)))
        domain = domain_of(mesh, **{limit: middle} if limit else {})
        best = sampled(rng, lines, normals, own, domain)
        if best < 0.2:
            continue
        tried += 1
        found = best_of_face(face, vertex, 0.0, own, domain, scratch)
        if found == 0.0:  # no exit there: the line enters the object
            centre = surface.points[surface.faces[face]].mean(axis=0) - surface.points[vertex]
            one, two, three = surface.points[surface.faces[face]]
            assert np.cross(two - one, three - one) @ centre < 1e-9
            continue
        angle = math.acos(min(found, 1.0))
        assert angle <= math.acos(min(best, 1.0)) + 5e-7
        again = cosine_at(scratch[0], vertex, face, lines, normals, own, domain)
        assert again == pytest.approx(found, abs=1e-12)
        below = math.cos(max(angle - 1e-6, 0.0))
        assert best_of_face(face, vertex, below, own, domain, scratch) == below


@pytest.mark.slow
@settings(deadline=None, max_examples=25)
@given(st.integers(0, 2**32 - 1), st.sampled_from(list(SHAPES)))
def test_a_node_with_a_good_contact_is_not_left_out(seed: int, shape: str) -> None:
    """Where a contact is within the limit, no node above its face is ranked as useless."""
    rng = np.random.default_rng(seed)
    mesh = mesh_of(shape)
    domain = domain_of(mesh)
    tree = domain.tree
    for _ in range(40):
        vertex, row = int(rng.integers(len(mesh.vertices))), int(rng.integers(len(tree.order)))
        lines, normals = read(mesh, tree.order[row], vertex)
        weights = rng.dirichlet(np.ones(3))
        own = own_normals(mesh, vertex)
        found = cosine_at(weights, vertex, tree.order[row], lines, normals, own, domain)
        if found <= 0.0:
            continue
        limit = math.acos(min(found, 1.0)) + 1e-9
        if limit <= math.pi / 2.0:
            assert largest_rank(row, vertex, own, domain, math.cos(limit), math.sin(limit)) < 0.0


@pytest.mark.slow
@settings(deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_a_cut_polygon_contains_what_is_on_the_right_side_of_all_lines(seed: int) -> None:
    rng = np.random.default_rng(seed)
    polygon = np.empty((2 * REGION_CORNERS, 3))
    polygon[:3, :2] = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]
    size, points = 3, rng.dirichlet(np.ones(3), 200)[:, :2]
    kept = np.ones(len(points), dtype=bool)
    for _ in range(6):
        a, b = rng.normal(size=2)
        c = -np.array([a, b]) @ rng.dirichlet(np.ones(3))[:2] - 0.05
        values = points @ [a, b] + c
        size, least = cut(polygon, size, a, b, c)
        assert least <= values[kept].min(initial=math.inf) + 1e-12
        kept &= values <= 0.0
        if size < 3:
            assert not kept.any()
            return
    inside = [stays_inside(polygon, size, *point) for point in points]
    assert np.array_equal(inside, kept)
    assert stays_inside(polygon, size, *centroid(polygon, size))
