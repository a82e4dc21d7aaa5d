"""Division of polygons into triangles: they cover the polygon, and nothing else."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasp3d.mesh.measures import Triangles
from grasp3d.mesh.mesh_files import as_triangles, read_mesh
from grasp3d.mesh.sources import Source
from tests.helpers import shapes

SOURCE = Source(Path("a.obj"), "obj", "a.obj")


def divided(points: np.ndarray) -> np.ndarray:
    """Triangles (k, 3) of one polygon."""
    count = len(points)
    return as_triangles(SOURCE, points, np.arange(count), np.array([count]))


def area_vectors(points: np.ndarray, faces: np.ndarray) -> np.ndarray:
    one, two, three = np.moveaxis(points[faces], 1, 0)
    return 0.5 * np.cross(two - one, three - one)


def area_of(points: np.ndarray) -> np.ndarray:
    """Area vector of a polygon, by the sum over its edges."""
    return 0.5 * np.cross(points, np.roll(points, -1, axis=0)).sum(axis=0)


def skyline(heights: list[int]) -> np.ndarray:
    """A polygon of columns of these heights, with corners on its straight edges, (n, 3)."""
    corners = [(k, 0) for k in range(len(heights) + 1)]
    for k in reversed(range(len(heights))):
        corners += [(k + 1, heights[k]), (k, heights[k])]
    points = np.array([one for k, one in enumerate(corners) if one != corners[k - 1]], dtype=float)
    return np.column_stack([points, np.zeros(len(points))])


@given(
    st.lists(st.integers(1, 5), min_size=1, max_size=7),
    st.integers(0, 30),
    st.integers(0, 10_000),
)
def test_triangles_cover_a_concave_polygon_once(heights: list[int], first: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    points = np.roll(skyline(heights), first, axis=0) @ shapes.rotation(seed).T + rng.normal(size=3)
    faces, normal = divided(points), area_of(points - points[0])
    assert len(faces) == len(points) - 2
    assert set(faces.ravel().tolist()) == set(range(len(points)))
    areas = area_vectors(points, faces) @ normal / np.linalg.norm(normal)
    assert areas.min() > -1e-9
    assert areas.sum() == pytest.approx(sum(heights))


def test_a_fan_stays_where_it_covers_the_polygon() -> None:
    turns = 2.0 * np.pi * np.arange(7) / 7.0
    convex = np.column_stack([np.cos(turns), np.sin(turns), 0.1 * np.cos(2.0 * turns)])
    dart = np.array([[0.4, 0.4, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 0.0], [2.0, 0.0, 0.0]])
    for points in (convex, dart):  # the first corner of the dart is the one that points inward
        assert divided(points).tolist() == [[0, k, k + 1] for k in range(1, len(points) - 1)]


def test_a_concave_quad_is_divided_along_its_inner_diagonal() -> None:
    for height in (0.0, 0.3):  # also one that is not flat
        dart = np.array([[0, 2, 0], [0, 0, height], [2, 0, 0], [0.4, 0.4, 0]], dtype=float)
        assert sorted(map(sorted, divided(dart).tolist())) == [[0, 1, 3], [1, 2, 3]]


def test_a_polygon_that_crosses_itself_stays_a_fan() -> None:
    bow = np.array([[0, 0, 0], [3, 0, 0], [0, 2, 0], [2, 2, 0]], dtype=float)
    assert divided(bow).tolist() == [[0, 1, 2], [0, 2, 3]]


def test_other_faces_keep_their_place() -> None:
    dart = [[0.0, 2.0, 0.0], [0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.4, 0.4, 0.0]]
    corners, counts = np.array([0, 1, 2, 0, 1, 2, 3, 2, 1, 0]), np.array([3, 4, 3])
    faces = as_triangles(SOURCE, np.array(dart), corners, counts)
    assert faces[[0, -1]].tolist() == [[0, 1, 2], [2, 1, 0]]
    assert sorted(map(sorted, faces[1:3].tolist())) == [[0, 1, 3], [1, 2, 3]]


@pytest.mark.parametrize("suffix", ["obj", "off", "ply"])
def test_an_empty_slot_stays_empty(suffix: str) -> None:
    raw = read_mesh(shapes.shared("cases", "01_concave_polygon", f"bracket.{suffix}"))
    surface = Triangles(raw.vertices, raw.faces)
    assert surface.areas.sum() == pytest.approx(8200.0)
    assert surface.volumes.sum() == pytest.approx(30000.0)


@pytest.mark.parametrize(
    ("case", "name", "volume"),
    [
        ("04_obj_comment_after_face", "box.obj", 24000.0),
        ("06_ply_tristrips", "strips.ply", 24000.0),
        ("15_gltf_normalized_positions", "quant_norm.glb", 1.92e-4),
    ],
)
def test_legal_files_that_few_programs_write_are_read(case: str, name: str, volume: float) -> None:
    raw = read_mesh(shapes.shared("cases", case, name))
    assert Triangles(raw.vertices, raw.faces).volumes.sum() == pytest.approx(volume, rel=1e-4)
