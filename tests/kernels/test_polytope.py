"""Neighbours of new facets, of horizons as rounding might leave them: of any visible facets."""

import itertools
from dataclasses import dataclass, field

import numba
import numpy as np
import pytest

from grasp3d._kernels.hull import polytope as kernels
from grasp3d._kernels.hull.polytope import UNKNOWN, Polytope, lowest_bit, make_polytope

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
            kernels.join(self.polytope, self.dim, ridge, new, self.vertices, self.pinched)
            self.used += 1
        self.vertices += 1
        walked = kernels.link_new_facets(self.polytope, self.dim, ridges, self.vertices)
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


@numba.njit
def compiled_lowest_bit(word: np.uint64) -> int:
    return lowest_bit(word)  # type: ignore[no-any-return]


def test_the_lowest_bit() -> None:
    for position, above in itertools.product(range(64), (0, 1, 0b1011)):
        word = np.uint64((1 << position) | (above << (position + 1)) & ((1 << 64) - 1))
        assert lowest_bit(word) == position
        assert compiled_lowest_bit(word) == position
