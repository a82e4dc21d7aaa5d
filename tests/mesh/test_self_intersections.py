import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from grasp3d import load_mesh
from grasp3d.mesh.measures import Triangles
from grasp3d.mesh.surface_points import crossing_faces
from tests.helpers import shapes
from tests.helpers.repairs import joined, moved
from tests.helpers.shapes import Surface

ROUNDED = 1e-6
SURE = 1e-4
"""Distance of an edge's ends from a face from which the crossing must be found in 32 bits."""


def normalised(shape: Surface) -> Surface:
    vertices, faces = shape
    used = vertices[np.unique(faces)]
    middle = used.mean(axis=0)
    return (vertices - middle) / (2.0 * np.linalg.norm(used - middle, axis=1).max()), faces


def slow_crossings(shape: Surface) -> dict[tuple[int, int], float]:
    """Pairs of faces without a common vertex of which an edge passes through the other.

    With how far it reaches beyond the face on both sides, or passes from its border, if less.
    """
    points, faces = shape
    triangles = points[faces]
    sides = np.roll(triangles, -1, axis=1) - triangles
    normals = np.cross(sides[:, 0], sides[:, 1])
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    inward = np.cross(normals[:, None], sides)
    inward /= np.linalg.norm(inward, axis=2)[..., None]
    heights = points @ normals.T - (triangles[:, 0] * normals).sum(axis=1)  # (V, F)
    found: dict[tuple[int, int], float] = {}
    for face, corners in enumerate(faces):
        for a, b in zip(corners, np.roll(corners, -1), strict=True):
            above, below = heights[a], heights[b]
            (others,) = np.nonzero(above * below < 0.0)
            fraction = above[others] / (above[others] - below[others])
            crossing = points[a] + fraction[:, None] * (points[b] - points[a])
            depths = ((crossing[:, None] - triangles[others]) * inward[others]).sum(axis=2)
            reach = np.minimum(np.abs(above[others]), np.abs(below[others]))
            least = np.minimum(depths.min(axis=1), reach)
            for other, depth in zip(others[least > 0.0], least[least > 0.0], strict=True):
                if not set(corners) & set(faces[other]):
                    pair = min(face, int(other)), max(face, int(other))
                    found[pair] = max(float(depth), found.get(pair, 0.0))
    return found


def crossings(points: np.ndarray, faces: np.ndarray) -> list[int]:
    """The faces that are found to cross others."""
    found: list[int] = crossing_faces(Triangles(points, faces)).tolist()
    assert found == sorted(set(found))
    return found


def check(found: list[int], shape: Surface) -> dict[int, float]:
    """Check that all sure crossings are found and no false ones; return the depth of each face."""
    deepest: dict[int, float] = {}
    for pair, depth in slow_crossings(shape).items():
        for face in pair:
            deepest[face] = max(depth, deepest.get(face, 0.0))
    assert min((deepest.get(face, 0.0) for face in found), default=1.0) > 0.9 * ROUNDED
    assert {face for face, depth in deepest.items() if depth > SURE} <= set(found)
    return deepest


@pytest.mark.slow
@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32), count=st.integers(2, 40), size=st.floats(0.1, 1.0))
def test_crossings_of_random_triangles_are_true_and_no_sure_one_is_missed(
    seed: int, count: int, size: float
) -> None:
    rng = np.random.default_rng(seed)
    middles = rng.uniform(-0.3, 0.3, (count, 1, 3))
    points = (middles + rng.uniform(-size / 3.0, size / 3.0, (count, 3, 3))).reshape(-1, 3)
    shape = points, np.arange(3 * count).reshape(-1, 3)
    found = crossings(*shape)
    check(found, shape)
    order = rng.permutation(count)
    turned = shape[1][order][:, ::-1]
    assert sorted(order[crossings(points, turned)].tolist()) == found


def two_spheres() -> Surface:
    vertices, faces = shapes.sphere(3)
    other = vertices @ shapes.rotation(1).T + (0.9, 0.3, 0.2)
    return normalised(joined((vertices, faces), (other, faces)))


def test_crossings_of_known_shapes_are_found_nearly_all() -> None:
    found = crossings(*two_spheres())
    known = [depth for depth in check(found, two_spheres()).values() if depth > ROUNDED]
    assert len(known) > 50
    assert len(found) >= 0.99 * len(known)


CLEAN = {
    "thin plate": shapes.box((1.0, 1.0, 2e-5)),
    "tube": shapes.tube(),
    "touching boxes": joined(shapes.box(), moved(shapes.box(), (1.0, 0.3, 0.2))),
    "boxes on an edge": joined(shapes.box(), moved(shapes.box(), (1.0, 1.0, 0.0))),
    "ball inside": joined(shapes.sphere(3), moved(shapes.sphere(3), (0.0, 0.0, 0.0), 0.999)),
}


@pytest.mark.parametrize("name", CLEAN)
def test_clean_surfaces_cross_nowhere_refined_or_rounded(name: str) -> None:
    points, faces = normalised(CLEAN[name])
    mesh = load_mesh((points, faces))
    turned = points @ shapes.rotation(3).T
    rounded = (turned + 0.3).astype(np.float32).astype(np.float64) - 0.3
    for shape in ((points, faces), (mesh.normalized, mesh.faces), (rounded, faces)):
        assert len(crossings(*shape)) == 0


def test_vertices_are_identified_by_position() -> None:
    """Triangles with separate vertices do not cross at their common corners."""
    points, faces = normalised(shapes.sphere(3))
    soup = points[faces].reshape(-1, 3), np.arange(faces.size).reshape(-1, 3)
    assert len(crossings(*soup)) == 0
    shape = two_spheres()
    soup = shape[0][shape[1]].reshape(-1, 3), np.arange(shape[1].size).reshape(-1, 3)
    assert crossings(*soup) == crossings(*shape)


def test_faces_with_a_common_vertex_do_not_count() -> None:
    """The far side of the second face passes through the first."""
    points = np.array([[0, 0, 0], [0.4, -0.2, 0], [0.4, 0.2, 0], [0.2, 0, -0.1], [0.3, 0, 0.1]])
    faces = np.array([[0, 1, 2], [0, 3, 4]])
    assert len(crossings(points, faces)) == 0
    assert len(crossings(points[faces].reshape(-1, 3), np.arange(6).reshape(-1, 3))) == 0
    points = np.concatenate([points, [[0.0, 0.0, 0.01]]])
    assert crossings(points, np.array([[0, 1, 2], [5, 3, 4]])) == [0, 1]


def test_faces_too_small_for_32_bits_are_ignored() -> None:
    points = np.concatenate([1e-8 * np.eye(3), 1e-8 * (1.0 - np.eye(3))])
    assert len(crossings(points, np.array([[0, 1, 2], [3, 4, 5]]))) == 0
