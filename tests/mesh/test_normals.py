"""Half-edges by their edge."""

from collections import defaultdict

import numpy as np
import pytest

from grasp3d.mesh.measures import crowded_edges, paired_edges


def half_edges(faces: np.ndarray) -> dict[frozenset[int], list[int]]:
    """Half-edges 3 f + i, opposite to corner i of face f, of each edge in ascending order."""
    found = defaultdict(list)
    for f, face in enumerate(faces.tolist()):
        for i in range(3):
            found[frozenset((face[(i + 1) % 3], face[(i + 2) % 3]))].append(3 * f + i)
    return found


@pytest.mark.parametrize("vertices", [4, 12, 400])
def test_half_edges_are_paired_or_crowded_in_ascending_order(vertices: int) -> None:
    rng = np.random.default_rng(vertices)
    some = [rng.choice(vertices, 3, replace=False) for _ in range(60)]
    faces = np.array([*some, *some[:5], *(face[::-1] for face in some[5:9])])
    edges = half_edges(faces)
    one, two = paired_edges(faces)
    pairs = sorted(tuple(rows) for rows in edges.values() if len(rows) == 2)
    assert sorted(zip(one.tolist(), two.tolist(), strict=True)) == pairs
    crowds = sorted(row for rows in edges.values() if len(rows) > 2 for row in rows)
    assert sorted(crowded_edges(faces).tolist()) == crowds
    assert pairs or vertices == 4
    assert crowds or vertices == 400
    none = np.zeros((0, 3), dtype=np.int64)
    assert [len(rows) for rows in (*paired_edges(none), crowded_edges(none))] == [0, 0, 0]
