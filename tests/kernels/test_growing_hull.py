import itertools
import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

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

    def __init__(self, rows: np.ndarray, goal: Any = EXACT) -> None:
        self.dim = rows.shape[1]
        padded = np.pad(rows, ((0, 0), (0, 6 - self.dim)))
        space = WrenchSpace(
            kind=ROWS, spherical=True, soft=False,
            axes=np.ascontiguousarray(padded.T[None]), cones=np.ones((1, 2)),
        )  # fmt: skip
        self.rows = padded
        self.metric = np.ones(6)
        self.polytope: Polytope = make_polytope(1 << 14)
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


@pytest.mark.slow
@given(dimensions, seeds)
@settings(max_examples=20, deadline=None)
def test_a_grown_polytope_is_closed_and_convex_and_its_vertices_are_wrenches(
    dimension: int, seed: int
) -> None:
    grown = Grown(random_rows(dimension, seed))
    if len(grown.facets):
        check_boundary(grown)
    owners = grown.polytope.owners[: len(grown.points)]
    np.testing.assert_array_equal(grown.points, grown.rows[owners])
    assert len(set(owners.tolist())) == len(owners)


@pytest.mark.slow
@pytest.mark.parametrize("edges", [3, 4, 16])
@pytest.mark.parametrize("name", grasps.REGULAR_SHAPES)
def test_coplanar_wrenches_make_a_closed_polytope_too(name: str, edges: int) -> None:
    check_boundary(Grown(wrenches(grasps.regular_on_ball(name, torsion_radius=0.3), edges=edges)))


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


def distance(rows: np.ndarray) -> float:
    """Distance from the origin to the hull's boundary, negative outside."""
    if rows.shape[1] == 1:
        return float(min(rows.max(), -rows.min()))
    return oracles.epsilon_of_hull(rows)


CAPACITY = 600


@dataclass
class Complex:
    """A closed complex of simplices, at first the boundary of a simplex."""

    dim: int
    polytope: Polytope = field(default_factory=lambda: make_polytope(CAPACITY))
    pinched: bool = False
    walks: int = 0

    def __post_init__(self) -> None:
        for i, j in itertools.permutations(range(self.dim + 1), 2):
            position = j if j < i else j - 1
            self.polytope.corners[i, position] = self.polytope.neighbours[i, position] = j
        self.live = set(range(self.dim + 1))
        self.used = self.vertices = self.dim + 1

    def horizon_of(self, visible: set[int]) -> int:
        """Write the horizon of visible facets; returns its number of ridges."""
        ridges = 0
        for v, c in itertools.product(sorted(visible), range(self.dim)):
            if int(self.polytope.neighbours[v, c]) not in visible:
                self.polytope.horizon[ridges] = 8 * v + c
                ridges += 1
        return ridges

    def add_vertex(self, visible: set[int]) -> None:
        """Replace visible facets by those that join their horizon to a new vertex."""
        ridges = self.horizon_of(visible)
        for r in range(ridges):
            self.polytope.added[r] = self.used
            ridge, new = self.polytope.horizon[r], np.uint32(self.used)
            polytope.join(self.polytope, self.dim, ridge, new, self.vertices, self.pinched)
            self.used += 1
        self.vertices += 1
        walked = polytope.link_new_facets(self.polytope, self.dim, ridges, self.vertices)
        self.walks += walked
        self.pinched |= walked
        self.live = self.live - visible | set(self.polytope.added[:ridges].tolist())

    def check(self) -> int:
        """Neighbours share the ridge opposite to one corner of each; how many share several."""
        corners, neighbours = self.polytope.corners, self.polytope.neighbours
        several = 0
        for f in self.live:
            own = neighbours[f, : self.dim].tolist()
            assert UNKNOWN not in own
            assert set(own) <= self.live
            several += len(set(own)) < self.dim
            for c, other in enumerate(own):
                ridge = set(np.delete(corners[f, : self.dim], c).tolist())
                assert ridge <= set(corners[other, : self.dim].tolist())
                back = neighbours[other, : self.dim].tolist()
                assert back.count(f) == own.count(other)
        return several

    def some_visible(self, rng: np.random.Generator, *, connected: bool) -> set[int]:
        """Up to seven facets, of which some may touch each other in a vertex only."""
        count = rng.integers(1, min(8, len(self.live)))
        if not connected:
            return set(rng.choice(sorted(self.live), count, replace=False).tolist())
        visible = {int(rng.choice(sorted(self.live)))}
        for _ in range(4 * count):
            f = rng.choice(sorted(visible))
            visible.add(int(self.polytope.neighbours[f, rng.integers(self.dim)]))
            if len(visible) >= count:
                break
        return visible


@pytest.mark.slow
@pytest.mark.parametrize("connected", [True, False])
@pytest.mark.parametrize("dimension", [2, 3, 4, 5, 6])
def test_neighbours_are_mutual_whatever_is_visible(dimension: int, connected: bool) -> None:
    walks = several = 0
    for seed in range(40 if dimension == 6 else 80):
        rng = np.random.default_rng(seed)
        grown = Complex(dimension)
        for _ in range(12):
            visible = grown.some_visible(rng, connected=connected)
            if grown.used + dimension * len(visible) > CAPACITY:
                break
            grown.add_vertex(visible)
            several += grown.check()
        walks += grown.walks
    assert walks > 0 or (dimension == 2 and connected)
    assert several > 0 or not (connected and 3 <= dimension <= 5)
