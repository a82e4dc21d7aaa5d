import math

import numpy as np
import pytest

from grasp3d._kernels.hull.certificates import _largest_across_edges, _margin
from grasp3d._kernels.hull.support_functions import LINEAR, TOTAL, WrenchSpace


@pytest.mark.parametrize("edges", [3, 4, 8, 16])
def test_the_largest_component_across_the_edges_of_a_polygon(edges: int) -> None:
    rng = np.random.default_rng(edges)
    phase = rng.uniform(0.0, 2.0 * math.pi)
    angles = phase + 2.0 * math.pi * np.arange(edges) / edges
    rim = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    across = angles + math.pi / edges
    for vector in rng.normal(size=(50, 2)):
        expected = (np.cos(across) * vector[0] + np.sin(across) * vector[1]).max()
        found = _largest_across_edges(rim, math.cos(math.pi / edges), *vector)
        assert found == pytest.approx(expected, abs=1e-14)


def test_torsion_either_way_takes_its_part_of_the_normal_force() -> None:
    none = np.zeros((1, 4, 6)), np.array([[1.0, 0.5]]), np.zeros((0, 2))
    space = WrenchSpace(TOTAL, False, LINEAR, *none)  # noqa: FBT003 - fields of a named tuple
    free, one, other = (
        _margin(space, 0, np.array([[2.0, 0.3, -0.2, twist]])) for twist in (0.0, 0.7, -0.7)
    )
    assert one == other
    assert 0.0 < one < free
