import itertools
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from grasp3d import epsilon_of_wrenches
from grasp3d._kernels.hull import growing_hull, polytope
from grasp3d._kernels.hull.growing_hull import AROUND_ORIGIN
from grasp3d._kernels.hull.polytope import UNKNOWN, Polytope, make_polytope
from grasp3d._kernels.hull.support_functions import ROWS, WrenchSpace
from grasp3d.quality.wrenches import wrenches
from tests.helpers import grasps, oracles

seeds = st.integers(0, 100_000)
dimensions = st.integers(1, 6)
few = settings(max_examples=40, deadline=None)

EXACT = (0.0, 0.0, math.inf)
SIGN = (0.0, 0.0, 1e-8)


class Grown:
    """A polytope grown over rows (n, d) of full rank."""

    def __init__(self, rows: np.ndarray, goal: Any = EXACT, facets: int = 1 << 14) -> None:
        self.dim = rows.shape[1]
        padded = np.pad(rows, ((0, 0), (0, 6 - self.dim)))
        space = WrenchSpace(
            kind=ROWS, spherical=True, soft=False,
            axes=np.ascontiguousarray(padded.T[None]), cones=np.ones((1, 2)),
        )  # fmt: skip
        self.rows = padded
        self.metric = np.ones(6)
        self.polytope: Polytope = make_polytope(facets)
        dims: Any = (0,) * 6 if self.dim == 6 else np.zeros(self.dim, dtype=np.int64)
        self.status, self.lower, self.upper, vertices, used = growing_hull.grow(
            space, dims, self.metric, None, AROUND_ORIGIN, goal, self.polytope
        )
        self.direction = self.polytope.vectors[16, :6].copy()
        self.points = self.polytope.points[:vertices]
        self.facets = np.flatnonzero(~np.isnan(self.polytope.planes[6, :used]))
        self.corners = self.polytope.corners[self.facets, : self.dim].astype(int)


def random_rows(dimension: int, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    off_centre = 0.3 * rng.normal(size=dimension)
    return rng.normal(size=(rng.integers(dimension + 1, 12 * dimension), dimension)) + off_centre


def regular_rows(name: str, edges: int) -> np.ndarray:
    return wrenches(grasps.regular_on_ball(name, torsion_radius=0.3), edges=edges)


def check_boundary(grown: Grown) -> None:
    """The facets bound a polytope: every ridge joins two, and no vertex lies above a facet."""
    corners = np.sort(grown.corners, axis=1)
    assert (np.diff(corners, axis=1) > 0).all()
    if grown.dim > 1:
        ridges = np.concatenate([np.delete(corners, c, axis=1) for c in range(grown.dim)])
        assert set(np.unique(ridges, axis=0, return_counts=True)[1].tolist()) == {2}
    planes = grown.polytope.planes[:, grown.facets]
    np.testing.assert_allclose(np.linalg.norm(planes[:6], axis=0), 1.0, atol=1e-12)
    heights = grown.points @ planes[:6] - planes[6]  # (vertices, facets)
    assert heights.max() < 1e-10
    of_corners = np.take_along_axis(heights, grown.corners.T, axis=0)
    assert np.abs(of_corners).max() < 1e-9
    assert (planes[6] >= -1e-12).all() or grown.upper == 0.0


def check_neighbours(grown: Grown) -> None:
    """Neighbours refer to each other across the ridge that they share."""
    neighbours = grown.polytope.neighbours[:, : grown.dim]
    corners = grown.polytope.corners[:, : grown.dim]
    linked = 0
    for c in range(grown.dim):
        own = grown.facets[neighbours[grown.facets, c] != UNKNOWN]  # not those added last
        other = neighbours[own, c].astype(int)
        assert np.isin(other, grown.facets).all()
        assert ((neighbours[other] == own[:, None]).sum(axis=1) == 1).all()
        ridge = np.delete(corners[own], c, axis=1)
        assert (ridge[:, :, None] == corners[other][:, None]).any(axis=2).all()
        linked += len(own)
    assert linked >= grown.dim or grown.dim == 1


@pytest.mark.slow
@given(dimensions, seeds)
@few
def test_a_grown_polytope_is_closed_and_convex_and_its_vertices_are_wrenches(
    dimension: int, seed: int
) -> None:
    grown = Grown(random_rows(dimension, seed))
    if len(grown.facets):
        check_boundary(grown)
        check_neighbours(grown)
    owners = grown.polytope.owners[: len(grown.points)]
    np.testing.assert_array_equal(grown.points, grown.rows[owners])
    assert len(set(owners.tolist())) == len(owners)


@pytest.mark.slow
@pytest.mark.parametrize("edges", [3, 4, 8, 16])
@pytest.mark.parametrize("name", grasps.REGULAR_SHAPES)
def test_coplanar_wrenches_make_a_closed_polytope_too(name: str, edges: int) -> None:
    grown = Grown(regular_rows(name, edges))
    check_boundary(grown)
    check_neighbours(grown)


@pytest.mark.slow
@pytest.mark.parametrize("dimension", [2, 3, 4, 5, 6])
@pytest.mark.parametrize("goal", [EXACT, (0.1, 0.0, math.inf), (0.01, 0.0, math.inf)])
def test_words_and_walks_find_the_same_neighbours(dimension: int, goal: Any) -> None:
    """Facets of the last vertex, which are not linked yet; also more than a word has bits."""
    rows = np.random.default_rng(3).normal(size=(60 * dimension, dimension))
    sphere = rows / np.linalg.norm(rows, axis=1, keepdims=True)
    most = 0
    for points in (rows, sphere):
        found = Grown(points, goal)
        new = [f for f in found.facets if found.polytope.neighbours[f, 0] == UNKNOWN]
        assert sorted(found.polytope.added[: len(new)].tolist()) == sorted(new)
        before = found.polytope.neighbours.copy()
        polytope.link_new_facets(found.polytope, found.dim, len(new), len(found.points))
        linked = found.polytope.neighbours.copy()
        found.polytope.neighbours[:] = before
        polytope.turn_about_faces(found.polytope, found.dim, len(new))
        np.testing.assert_array_equal(linked, found.polytope.neighbours)
        assert (linked[new, :dimension] != UNKNOWN).all()
        most = max(most, len(new))
    assert most > 64 or dimension < 6


@given(dimensions, seeds)
@few
def test_the_nearest_facet_is_one_of_the_whole_hull(dimension: int, seed: int) -> None:
    """And a test of closure alone agrees with the sign of its distance."""
    rows = random_rows(dimension, seed)
    grown = Grown(rows)
    expected = distance(rows)
    assert grown.status == growing_hull.CONVERGED
    assert grown.lower <= grown.upper + 1e-12
    assert grown.upper == pytest.approx(max(expected, 0.0), abs=1e-10)
    reached = (grown.rows @ grown.direction).max()
    if expected > 1e-9:
        assert np.linalg.norm(grown.direction) == pytest.approx(1.0)
        assert reached == pytest.approx(grown.upper, abs=1e-12)
        assert grown.lower == pytest.approx(expected, abs=1e-10)
    elif expected < -1e-9:
        assert len(grown.facets) == 0
        assert reached <= 1e-11
    tested = Grown(rows, SIGN)
    assert (len(tested.facets) > 0 and tested.lower > 0.0) == (expected > 0.0)


@pytest.mark.slow
@given(seeds, st.integers(1, 3))
@few
def test_wrenches_of_lower_rank_are_evaluated_in_their_span(seed: int, times: int) -> None:
    for dimension in range(1, 7):
        rng = np.random.default_rng(seed + dimension)
        rows = random_rows(dimension, seed)
        turn = np.linalg.qr(rng.normal(size=(6, 6)))[0]
        embedded = np.tile(rows, (times, 1)) @ turn[:dimension]
        found = epsilon_of_wrenches(embedded)
        assert found.rank == dimension
        assert found.value == pytest.approx(max(distance(rows), 0.0), abs=1e-10)


@pytest.mark.parametrize("dimension", [1, 2, 3, 4, 5, 6])
def test_cross_polytopes_and_cubes(dimension: int) -> None:
    """The facets of a cube are not simplices."""
    cross = np.vstack([np.eye(dimension), -np.eye(dimension)])
    cube = np.array(list(itertools.product([-1.0, 1.0], repeat=dimension)))
    for rows, expected in ((cross, 1.0 / math.sqrt(dimension)), (cube, 1.0)):
        grown = Grown(rows)
        assert grown.status == growing_hull.CONVERGED
        assert grown.upper == pytest.approx(expected, abs=1e-14 if rows is cross else 1e-12)
        assert grown.lower == pytest.approx(expected, abs=1e-12)
        check_boundary(grown)


@pytest.mark.slow
@pytest.mark.parametrize("facets", [16, 64, 256])
def test_a_full_polytope_ends_the_growth_with_valid_bounds(facets: int) -> None:
    rows = np.random.default_rng(0).normal(size=(400, 6))
    expected = oracles.epsilon_of_hull(rows)
    grown = Grown(rows, facets=facets)
    assert grown.status == growing_hull.EXHAUSTED
    assert grown.lower <= expected <= grown.upper


def test_growth_stops_at_the_requested_tolerance_and_at_the_cutoff() -> None:
    rows = np.random.default_rng(1).normal(size=(300, 6))
    expected, exact = oracles.epsilon_of_hull(rows), Grown(rows)
    loose = Grown(rows, (0.3, 0.0, math.inf))
    assert loose.lower <= expected <= loose.upper
    assert loose.upper - loose.lower <= 0.3 * loose.upper + 1e-12
    cut = Grown(rows, (0.0, 0.0, 0.5 * expected))
    assert 0.5 * expected <= cut.lower <= expected + 1e-12
    assert max(len(loose.points), len(cut.points)) < len(exact.points)


def distance(rows: np.ndarray) -> float:
    """Distance from the origin to the hull's boundary, negative outside."""
    if rows.shape[1] == 1:
        return float(min(rows.max(), -rows.min()))
    return oracles.epsilon_of_hull(rows)
