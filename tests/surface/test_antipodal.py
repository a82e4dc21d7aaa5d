import itertools
import math
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from grasp3d import ObjectMesh, Sampling, load_mesh
from grasp3d._kernels.search.antipodal_candidates import PairLimits
from grasp3d._kernels.search.face_contacts import (
    NONE,
    PairDomain,
    cosine_at,
    move_on_face,
    own_cosine,
    turning_speed,
    upper_bound,
)
from grasp3d._kernels.surface.surface_contacts import smallest_angle
from grasp3d.mesh.surface_points import SurfacePoints
from grasp3d.surface.sampling import antipodal
from grasp3d.surface.sampling.antipodal import best_pairs
from grasp3d.surface.sampling.vertices import tangents
from grasp3d.surface.vertex_grasps import grasps_at
from grasp3d.system.context import running
from tests.helpers import oracles, shapes
from tests.helpers.pair_search import domain_of, own_normals, read


def exhaustive(mesh: ObjectMesh, vertex: int, cone: float) -> float:
    """Best critical angle of a smooth vertex over the centres of all faces, squeezing.

    A point whose normal is at less than 90 degrees to the closing line is an exit of that line, so
    no ray needs to be traced.
    """
    point, normal = mesh.vertices[vertex], mesh.normals[vertex]
    corners = mesh.corner_normals
    points = mesh.vertices[mesh.faces].mean(axis=1)
    normals = corners.normals[corners.corners].mean(axis=1)
    d = points - point
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    phi1 = np.arctan2(np.linalg.norm(np.cross(normal, d), axis=1), d @ normal)
    phi2 = np.arctan2(
        np.linalg.norm(np.cross(normals, -d), axis=1), np.einsum("ij,ij->i", normals, -d)
    )
    worst = np.maximum(phi1, phi2)
    worst[(phi1 > cone) | (phi2 > math.pi / 2.0)] = math.inf
    return float(worst.min())


@pytest.mark.slow
@pytest.mark.parametrize(
    "shape",
    [shapes.lopsided(), shapes.torus(), shapes.cone(0.3, sections=48), shapes.finned()],
)
def test_the_search_finds_the_grasps_of_an_exhaustive_search(shape: shapes.Surface) -> None:
    mesh = load_mesh(shape)
    cone = 1.0
    grasps = best_pairs(mesh, Sampling(), cone)
    smooth = np.flatnonzero(mesh.contact_normals.counts == 1)
    chosen = np.random.default_rng(4).choice(smooth, 150, replace=False)
    shortfalls = []
    for vertex in chosen:
        oracle = exhaustive(mesh, vertex, cone)
        if oracle < cone:
            shortfalls.append(grasps.worst[vertex] - oracle)
    assert len(shortfalls) > 100
    assert max(shortfalls) < antipodal.GAIN
    assert np.median(shortfalls) <= 1e-4


@pytest.mark.slow
@pytest.mark.parametrize("grip", ["squeeze", "expand", "both"])
def test_the_grasp_found_is_real_and_its_angle_exact(grip: str) -> None:
    """The opposing contact lies on the surface and the critical angle equals the definition's."""
    mesh = load_mesh(shapes.tube(), max_edge=0.1)
    grasps = best_pairs(mesh, Sampling(grip=grip), 0.8)  # type: ignore[arg-type]
    smooth = np.flatnonzero((mesh.contact_normals.counts == 1) & (grasps.reason == 0))
    assert len(smooth) > 1000
    points = SurfacePoints(
        grasps.partner_points.faces[..., None], grasps.partner_points.weights[..., None, :]
    )
    normals = grasps_at(mesh, points, smooth, 0).normals[:, 1]
    gaps = []
    for vertex, normal in zip(smooth, normals, strict=True):
        point, partner = mesh.vertices[vertex], grasps.partner[vertex]
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
    for name in ("worst", "best", "partner", "grip", "reason"):
        assert np.array_equal(getattr(one, name), getattr(three, name), equal_nan=True)
    assert one.rays == three.rays


@pytest.mark.slow
def test_more_rays_find_no_worse_grasps() -> None:
    mesh = load_mesh(shapes.torus())
    few = best_pairs(mesh, Sampling(rays=16), 0.7).worst
    many = best_pairs(mesh, Sampling(rays=256), 0.7).worst
    few, many = np.minimum(few, 0.7), np.minimum(many, 0.7)  # inf: no grasp
    assert np.mean(many) <= np.mean(few) + 1e-4
    assert np.mean(many > few + 2e-3) < 0.01


@pytest.mark.slow
def test_refining_several_grasps_finds_better_ones_than_refining_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    mesh = load_mesh(shapes.LIBRARY / "mug.glb")
    several = best_pairs(mesh, Sampling(grip="expand"), 0.66)
    monkeypatch.setattr(antipodal, "EXPLORING_ROUNDS", 0)
    one = best_pairs(mesh, Sampling(grip="expand"), 0.66)
    gain = np.minimum(one.worst, 2.0) - np.minimum(several.worst, 2.0)
    assert gain.mean() > 2e-4
    assert np.mean(gain > 0.01) > 2.0 * np.mean(gain < -0.01)


@cache
def searched(shape: str) -> tuple[ObjectMesh, PairDomain]:
    arrays = {"blob": shapes.lopsided(), "box": shapes.box(), "cone": shapes.cone(0.3)}[shape]
    mesh = load_mesh(arrays)
    return mesh, domain_of(mesh)


@pytest.mark.slow
@settings(deadline=None)
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
        for worst, longest in itertools.product((True, False), (math.inf, opening * (1.0 + 1e-9))):
            limits = PairLimits(0.0, longest)
            own = own_normals(mesh, vertex, worst=worst)
            found = cosine_at(weights, lines, normals, own, limits)
            bound = upper_bound(node, vertex, own, domain._replace(limits=limits), NONE)
            assert NONE < found <= bound + 1e-9


@pytest.mark.slow
@settings(deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from(["blob", "box", "cone"]))
def test_moves_on_a_face_do_not_end_before_they_reach_the_limit(seed: int, shape: str) -> None:
    """Moves that would improve the limit, if only just, are the same as without an early end."""
    rng = np.random.default_rng(seed)
    mesh, domain = searched(shape)
    tree = domain.tree
    for _ in range(20):
        vertex, leaf = int(rng.integers(len(mesh.vertices))), int(rng.integers(1 << tree.depth))
        face = tree.order[len(tree.order) * leaf >> tree.depth]
        lines, normals = read(mesh, face, vertex)
        weights = 0.99 * rng.dirichlet(np.ones(3)) + 0.01 / 3.0
        cosine_of_leaf = tree.bounds[(1 << tree.depth) - 1 + leaf, 7]
        limits = PairLimits(0.0, math.inf)
        turning = turning_speed(weights, lines, normals, cosine_of_leaf)
        for worst in (True, False):
            others = lines, normals, own_normals(mesh, vertex, worst=worst), limits
            cosine = cosine_at(weights, *others)
            moved, ended = weights.copy(), weights.copy()
            reached = move_on_face(moved, cosine, math.inf, 0.0, *others)
            limit = math.acos(max(-1.0, min(reached, 1.0))) + 1e-9
            assert move_on_face(ended, cosine, turning, limit, *others) == reached
            assert np.array_equal(ended, moved)


@pytest.mark.slow
@settings(deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_cosines_to_the_best_and_worst_normals_of_creases(seed: int) -> None:
    """They are those of the exact angles."""
    rng = np.random.default_rng(seed)
    mesh = load_mesh(shapes.box())
    sets = mesh.contact_normals
    for vertex in rng.choice(np.flatnonzero(sets.counts > 0), 20):
        line = rng.normal(size=3)
        count = sets.counts[vertex]
        arguments = sets.normals, sets.start[vertex], count, *line
        best, worst = (
            own_cosine(own_normals(mesh, vertex, worst=worst), line) for worst in (False, True)
        )
        assert best == pytest.approx(math.cos(smallest_angle(*arguments)), abs=1e-12)
        assert worst == pytest.approx(
            min(sets.normals[sets.start[vertex] :][:count] @ line) / np.linalg.norm(line), abs=1e-12
        )


@pytest.mark.slow
def test_search_directions_turn_with_the_object() -> None:
    vertices, faces = shapes.lopsided()
    turn = shapes.rotation(7)
    original, rotated = (
        load_mesh((vertices, faces)),
        load_mesh((vertices @ turn.T, faces)),
    )
    assert tangents(rotated) == pytest.approx(tangents(original) @ turn.T, abs=1e-9)
    assert np.einsum("ij,ij->i", tangents(original), original.normals) == pytest.approx(
        0.0, abs=1e-9
    )
    assert np.linalg.norm(tangents(original), axis=1) == pytest.approx(1.0)


def test_every_vertex_of_a_regular_ball_has_a_tangent() -> None:
    mesh = load_mesh(shapes.sphere(3))
    assert np.linalg.norm(tangents(mesh), axis=1) == pytest.approx(1.0)


@pytest.mark.slow
def test_progress_increases_to_one() -> None:
    fractions: list[float] = []
    with running(progress=fractions.append):
        best_pairs(load_mesh(shapes.lopsided()), Sampling(), 0.7)
    assert fractions == sorted(fractions)
    assert 0.0 < fractions[0] < fractions[-1] == 1.0
    # Branch and bound takes most of the time: a user who cancels must not wait for its end.
    assert sum(0.45 < fraction < 0.65 for fraction in fractions) >= antipodal.CHUNKS - 1
