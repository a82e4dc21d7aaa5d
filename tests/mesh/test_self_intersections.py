import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from grasp3d import load_mesh
from grasp3d.mesh.measures import Triangles
from grasp3d.mesh.mesh_files import read_mesh
from grasp3d.mesh.repair import repair_surface
from grasp3d.mesh.surface_points import crossing_faces
from tests.helpers import shapes
from tests.helpers.repairs import joined
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
    moved = vertices @ shapes.rotation(1).T + (0.9, 0.3, 0.2)
    return normalised(joined((vertices, faces), (moved, faces)))


def folded_sheet() -> Surface:
    """An open sheet bent so far that its end passes through its beginning."""
    u, v = np.meshgrid(np.linspace(0.0, 1.0, 40), np.linspace(-0.5, 0.5, 21), indexing="ij")
    angle = 1.7 * np.pi * u
    radius = 0.5 - 0.25 * u
    points = np.stack([radius * np.cos(angle), radius * np.sin(angle), v], axis=-1)
    points += 0.5 * (u**6)[..., None] * np.array([1.0, 0.7, 0.1])
    i, j = np.meshgrid(np.arange(39), np.arange(20), indexing="ij")
    a = i * 21 + j
    faces = np.concatenate(
        [np.stack([a, a + 21, a + 1], -1), np.stack([a + 21, a + 22, a + 1], -1)]
    )
    return normalised((points.reshape(-1, 3), faces.reshape(-1, 3)))


@pytest.mark.slow
@pytest.mark.parametrize("shape", [two_spheres(), folded_sheet()])
def test_crossings_of_known_shapes_are_found_nearly_all(shape: Surface) -> None:
    found = crossings(*shape)
    known = [depth for depth in check(found, shape).values() if depth > ROUNDED]
    assert len(known) > 50
    assert len(found) >= 0.99 * len(known)


def test_the_faces_found_are_those_that_meshlab_selects() -> None:
    pymeshlab = shapes.reader("pymeshlab")
    points, faces = two_spheres()
    meshes = pymeshlab.MeshSet()
    meshes.add_mesh(pymeshlab.Mesh(points, faces.astype(np.int32)))
    meshes.compute_selection_by_self_intersections_per_face()
    selected = np.asarray(meshes.current_mesh().face_selection_array()).astype(bool)
    found = np.isin(np.arange(len(faces)), crossings(points, faces))
    assert not (found & ~selected).any()
    assert found.sum() >= 0.99 * selected.sum()


CLEAN = {
    "sphere": shapes.sphere(3),
    "torus": shapes.torus(),
    "box": shapes.box(),
    "thin plate": shapes.box((1.0, 1.0, 2e-5)),
    "tube": shapes.tube(),
    "cone": shapes.cone(0.1),
    "touching boxes": joined(shapes.box(), (shapes.box()[0] + (1.0, 0.3, 0.2), shapes.box()[1])),
    "boxes on an edge": joined(shapes.box(), (shapes.box()[0] + (1.0, 1.0, 0.0), shapes.box()[1])),
    "ball inside": joined(shapes.sphere(3), (0.999 * shapes.sphere(3)[0], shapes.sphere(3)[1])),
    "one triangle": (np.eye(3), np.array([[0, 1, 2]])),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", CLEAN)
def test_clean_surfaces_cross_nowhere_refined_or_rounded(name: str) -> None:
    points, faces = normalised(CLEAN[name])
    mesh = load_mesh((points, faces))
    turned = points @ shapes.rotation(3).T
    rounded = (turned + 0.3).astype(np.float32).astype(np.float64) - 0.3
    for shape in ((points, faces), (mesh.normalized, mesh.faces), (rounded, faces)):
        assert len(crossings(*shape)) == 0


@pytest.mark.slow
def test_shipped_meshes_cross_nowhere() -> None:
    for path in sorted(shapes.LIBRARY.glob("*.*"))[::3]:
        if path.suffix not in {".md", ".png"}:
            raw = read_mesh(path)
            surface = repair_surface(raw.vertices, raw.faces, "safe", path.name)
            assert len(crossings(*normalised((surface.vertices, surface.faces)))) == 0


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


def test_an_edge_of_three_faces_crosses_with_all_three() -> None:
    points = np.array(
        [
            [-0.3, -0.3, 0.0], [0.3, -0.3, 0.0], [0.0, 0.4, 0.0],
            [0.0, 0.0, -0.2], [0.0, 0.0, 0.2], [0.5, 0.1, 0.1], [-0.5, 0.1, 0.1], [0.1, -0.5, 0.1],
        ]
    )  # fmt: skip
    faces = np.array([[0, 1, 2], [3, 4, 5], [3, 4, 6], [4, 3, 7]])
    assert crossings(points, faces) == [0, 1, 2, 3]
    assert crossings(points, faces[1:]) == []


def test_an_edge_through_many_leaves_crosses_each_of_them() -> None:
    heights = np.linspace(-0.2, 0.2, 50)
    leaves = np.array([[[-0.3, -0.3, z], [0.3, -0.3, z], [0.0, 0.4, z]] for z in heights])
    needle = np.array([[[0.01, 0.0, -0.4], [0.0, 0.01, 0.4], [0.5, 0.5, 0.45]]])
    points = np.concatenate([leaves, needle]).reshape(-1, 3)
    assert crossings(points, np.arange(len(points)).reshape(-1, 3)) == list(range(51))


@pytest.mark.slow
def test_the_shells_of_a_real_mesh_cross_where_they_meet() -> None:
    raw = read_mesh(shapes.shared("meshes", "classic_teapot.obj"))
    surface = repair_surface(raw.vertices, raw.faces, "safe", "teapot")
    shape = normalised((surface.vertices, surface.faces))
    found = crossings(*shape)
    check(found, shape)
    assert len(found) > 150
