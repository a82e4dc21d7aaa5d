import itertools
import math
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from grasp3d import ObjectMesh, Sampling, load_mesh
from grasp3d._kernels.search.antipodal_candidates import TIE, PairLimits
from grasp3d._kernels.search.face_contacts import NONE, PairDomain, cosine_at, upper_bound
from grasp3d.settings.sampling import Grip
from grasp3d.surface import antipodal
from grasp3d.surface.antipodal import best_pairs
from grasp3d.surface.contacts import grasps_at
from grasp3d.system.context import running
from tests.helpers import oracles, shapes
from tests.helpers.pair_search import domain_of, own_normals, read


def exhaustive(mesh: ObjectMesh, vertex: int, cone: float, smallest: float) -> float:
    """Best critical angle of a smooth vertex over the centres of all faces, squeezing.

    A point whose normal is at less than 90 degrees to the closing line is an exit of that line, so
    no ray needs to be traced.
    """
    point, normal = mesh.vertices[vertex], mesh.normals[vertex]
    corners = mesh.corner_normals
    points = mesh.vertices[mesh.faces].mean(axis=1)
    normals = corners.normals[corners.corners].mean(axis=1)
    d = points - point
    openings = np.linalg.norm(d, axis=1)
    d /= openings[:, None]
    phi1 = np.arctan2(np.linalg.norm(np.cross(normal, d), axis=1), d @ normal)
    phi2 = np.arctan2(
        np.linalg.norm(np.cross(normals, -d), axis=1), np.einsum("ij,ij->i", normals, -d)
    )
    worst = np.maximum(phi1, phi2)
    worst[(phi1 > cone) | (phi2 > math.pi / 2.0) | (openings < smallest)] = math.inf
    return float(worst.min())


@pytest.mark.slow
@pytest.mark.parametrize(
    ("shape", "part"),
    [(shapes.torus(), 0.0), (shapes.cone(0.3, sections=48), 0.3), (shapes.finned(), 0.3)],
    ids=["torus", "cone", "finned"],
)
def test_the_search_finds_the_grasps_of_an_exhaustive_search(
    shape: shapes.Surface, part: float
) -> None:
    mesh = load_mesh(shape)
    cone, smallest = 1.0, part * mesh.size
    grasps = best_pairs(mesh, Sampling(min_opening=smallest), cone)
    smooth = np.flatnonzero(mesh.contact_normals.counts == 1)
    chosen = np.random.default_rng(4).choice(smooth, 150, replace=False)
    shortfalls = []
    for vertex in chosen:
        oracle = exhaustive(mesh, vertex, cone, smallest)
        if oracle < cone:
            shortfalls.append(grasps.worst[vertex] - oracle)
    assert len(shortfalls) > 100
    assert max(shortfalls) < 1e-6
    found = smooth[grasps.reason[smooth] == 0]
    openings = np.linalg.norm(
        grasps.partner_points.positions(mesh)[found, 0] - mesh.vertices[found], axis=1
    )
    assert openings.min() >= smallest - 2.0 * antipodal.OPENING_SLACK * mesh.size


@pytest.mark.slow
def test_the_grasp_found_is_real_and_its_angle_exact() -> None:
    """The opposing contact lies on the surface and the critical angle equals the definition's."""
    mesh = load_mesh(shapes.tube(), max_edge=0.1)
    grasps = best_pairs(mesh, Sampling(grip="both"), 0.8)
    smooth = np.flatnonzero((mesh.contact_normals.counts == 1) & (grasps.reason == 0))
    assert len(smooth) > 1000
    normals = grasps_at(mesh, grasps.partner_points, smooth).normals[:, 1]
    partners, gaps = grasps.partner_points.positions(mesh)[:, 0], []
    for vertex, normal in zip(smooth, normals, strict=True):
        point, partner = mesh.vertices[vertex], partners[vertex]
        angle = oracles.critical_angle(
            point, mesh.normals[vertex], partner, normal, int(grasps.grip[vertex])
        )
        gaps.append(grasps.worst[vertex] - angle)
        radius, height = math.hypot(partner[0], partner[1]), abs(partner[2])
        on_wall = min(abs(radius - 0.4), abs(radius - 0.5)) < 1e-3 or height == pytest.approx(0.5)
        assert on_wall
    # On a crease the opposing contact has worse normals too.
    assert min(gaps) >= -1e-12
    assert np.mean(np.array(gaps) < 1e-9) > 0.98


@pytest.mark.slow
def test_the_result_does_not_depend_on_the_number_of_threads() -> None:
    mesh = load_mesh(shapes.lopsided(), max_edge=9.0)
    one, three = (running(threads=n)(best_pairs)(mesh, Sampling(), 0.7) for n in (1, 3))
    for name in ("worst", "best", "grip", "reason"):
        assert np.array_equal(getattr(one, name), getattr(three, name), equal_nan=True)
    assert one.rays == three.rays


@cache
def searched(shape: str) -> tuple[ObjectMesh, PairDomain]:
    arrays = {"blob": shapes.lopsided(), "box": shapes.box(), "cone": shapes.cone(0.3)}[shape]
    mesh = load_mesh(arrays)
    return mesh, domain_of(mesh)


@pytest.mark.slow
@settings(deadline=None, max_examples=40)
@given(st.integers(0, 2**32 - 1), st.sampled_from(["blob", "box", "cone"]))
def test_no_grasp_is_better_than_the_bound_of_its_node(seed: int, shape: str) -> None:
    """At every node the bound is below the angles of grasps with random points on its faces."""
    rng = np.random.default_rng(seed)
    mesh, domain = searched(shape)
    tree = domain.tree
    level = int(rng.integers(tree.depth + 1))
    number, faces = int(rng.integers(1 << level)), len(tree.order)
    node = (1 << level) - 1 + number
    inside = tree.order[faces * number >> level : faces * (number + 1) >> level]
    for _ in range(20):
        vertex, face = int(rng.integers(len(mesh.vertices))), int(rng.choice(inside))
        weights = rng.dirichlet(np.full(3, 0.5))
        lines, normals = read(mesh, face, vertex)
        opening = float(np.linalg.norm(weights @ lines))
        near, far = opening * (1.0 - 1e-9), opening * (1.0 + 1e-9)
        own = own_normals(mesh, vertex)
        for limits in itertools.product((0.0, near), (math.inf, far)):
            limited = domain._replace(limits=PairLimits(*limits))
            found = cosine_at(weights, vertex, face, lines, normals, own, limited)
            bound = upper_bound(node, vertex, own, limited, NONE)
            assert NONE < found <= bound + 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("grip", ["squeeze", "both"])
def test_progress_increases_to_one(grip: Grip) -> None:
    fractions: list[float] = []
    with running(progress=fractions.append):
        best_pairs(load_mesh(shapes.lopsided()), Sampling(grip=grip), 0.7)
    assert fractions == sorted(fractions)
    assert 0.0 < fractions[0] < fractions[-1] == 1.0
    # Branch and bound takes most of the time: a user who cancels must not wait for its end.
    assert sum(0.1 < fraction < 0.6 for fraction in fractions) > 5


@pytest.mark.slow
def test_both_grips_are_the_better_one_at_each_vertex() -> None:
    mesh = load_mesh(shapes.tube(), max_edge=0.1)
    squeeze, expand, both = (
        best_pairs(mesh, Sampling(grip=grip), 0.7) for grip in ("squeeze", "expand", "both")
    )
    least = np.minimum(squeeze.worst, expand.worst)
    assert both.worst == pytest.approx(least, abs=2.0 * TIE)
    inside = both.grip == -1
    assert inside.any()
    np.testing.assert_array_equal(both.best[inside], expand.best[inside])
    np.testing.assert_array_equal(both.best[~inside], squeeze.best[~inside])
    assert both.rays == expand.rays > squeeze.rays == 0
