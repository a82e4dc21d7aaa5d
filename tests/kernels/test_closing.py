"""Jaws against surfaces cut into pieces, and the distances and arcs that reaching needs."""

import itertools
import math
from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

from grasp3d import ObjectMesh, load_mesh
from grasp3d._kernels.jaws.gripper_parts import (
    all_angles,
    bit,
    make_workspace,
    margin_of,
    widest_arc,
)
from grasp3d._kernels.jaws.reaching import winding_number
from grasp3d._kernels.surface import polygons
from grasp3d._kernels.surface.box_tree import (
    ball_is_free,
    box_tree,
    capsule_is_free,
    segment_distance,
    triangle_distance,
)
from grasp3d.arrays import Floats
from grasp3d.hand.closing import ClosedJaws, Closing, close_jaws
from tests.helpers import shapes
from tests.helpers.closing_jaws import pads, random_poses, sampled_ball, sliced_pad, tips

POSES = 500


def flat(surface: shapes.Surface, size: float = 0.05) -> ObjectMesh:
    """A surface of a given size in metres, with the normals of its faces."""
    vertices, faces = surface
    scaled = vertices * size / np.ptp(vertices, axis=0).max()
    return load_mesh((scaled, faces), unit="m", crease_angle=0.0, max_edge=1.0, repair="none")


def solid_of(mesh: ObjectMesh) -> trimesh.Trimesh:
    return trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)


SHAPES = {
    "blob": shapes.arrays(trimesh.creation.icosphere(2)),
    "finned": shapes.finned(),
    "tube": shapes.tube(sections=24),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", SHAPES)
def test_flat_pads_touch_what_cut_meshes_say(name: str) -> None:
    mesh, hand = flat(SHAPES[name]), pads(compliance=0.001)
    solid, count = solid_of(mesh), POSES // len(SHAPES) + 1
    matrices = random_poses(count, 0.012)
    found = close_jaws(mesh, matrices, hand)
    closed = 0
    for k in np.flatnonzero(found.state != Closing.STARTS_INSIDE):
        expected = [sliced_pad(solid, matrices[k], hand, finger) for finger in range(2)]
        if found.state[k] == Closing.NOTHING:
            one, two = expected
            assert one is None or two is None or one["position"] > two["position"]
            continue
        closed += 1
        for finger, what in enumerate(expected):
            assert what is not None
            assert_same(found, int(k), finger, what, 1e-8)
    assert closed > count / 3


def assert_same(
    found: ClosedJaws, k: int, finger: int, what: dict[str, Any], tolerance: float
) -> None:
    """The same patch within a tolerance [m]; areas by as much times the size of a pad."""
    at = k, finger
    assert found.positions[at] == pytest.approx(what["position"], abs=tolerance)
    assert found.area[at] == pytest.approx(what["area"], abs=0.05 * tolerance)
    np.testing.assert_allclose(found.points[at], what["point"], atol=50.0 * tolerance)
    np.testing.assert_allclose(found.normals[at], what["normal"], atol=1e3 * tolerance)
    if "extents" in what:
        np.testing.assert_allclose(found.extents[at], what["extents"], atol=50.0 * tolerance)


@pytest.mark.slow
def test_round_tips_touch_what_small_triangles_say() -> None:
    """Points of the surface never touch earlier, and fine triangles nearly as early."""
    coarse = flat(shapes.arrays(trimesh.creation.icosphere(1)))
    fine = solid_of(coarse)
    for _ in range(5):
        fine = fine.subdivide()
    hand, matrices = tips(compliance=0.001), random_poses(150, 0.008)
    found = close_jaws(coarse, matrices, hand)
    closed = np.flatnonzero(found.closed)
    assert len(closed) > 40
    for k in closed:
        for finger in range(2):
            what = sampled_ball(fine, matrices[k], hand, finger)
            assert what is not None
            later = (1.0 - 2.0 * finger) * (what["position"] - found.positions[k, finger])
            assert -1e-12 < later < 1e-5
            assert found.area[k, finger] == pytest.approx(what["area"], rel=0.06)
            np.testing.assert_allclose(found.points[k, finger], what["point"], atol=1e-4)
            np.testing.assert_allclose(found.normals[k, finger], what["normal"], atol=0.03)


def disc_moments(corners: list[list[float]], radius: float) -> Floats:
    """Area and first moments of what of a disc about the origin is in a polygon."""
    totals = np.zeros(3)
    for a, b in itertools.pairwise([*corners, corners[0]]):
        polygons.disc_moments(*a, *b, radius, totals)
    return totals


def test_parts_of_a_disc_add_up() -> None:
    """Within a square that contains a disc, half of one, and in a triangle that lies in it."""
    square = [[-2.0, -1.5], [2.5, -1.5], [2.5, 1.8], [-2.0, 1.8]]
    np.testing.assert_allclose(disc_moments(square, 1.0), [np.pi, 0.0, 0.0], atol=1e-14)
    half = [[0.0, -3.0], [4.0, -3.0], [4.0, 3.0], [0.0, 3.0]]
    expected = [2.0 * np.pi, 2.0 / 3.0 * 8.0, 0.0]
    np.testing.assert_allclose(disc_moments(half, 2.0), expected, atol=1e-13)
    triangle = np.array([[0.1, 0.2], [0.6, 0.1], [0.3, 0.5]])
    area = 0.5 * np.linalg.det(triangle[1:] - triangle[0])
    expected = [area, *(area * triangle.mean(axis=0))]
    np.testing.assert_allclose(disc_moments(triangle.tolist(), 1.0), expected, atol=1e-15)


def nearest_in_triangle(triangle: np.ndarray, start: np.ndarray, end: np.ndarray) -> float:
    """Smallest distance of points of a triangle from a segment, by a general minimiser."""
    corners = triangle.reshape(3, 3)

    def distance(x: np.ndarray) -> float:
        point = corners[0] + x[0] * (corners[1] - corners[0]) + x[1] * (corners[2] - corners[0])
        return float(((point - start - x[2] * (end - start)) ** 2).sum())

    inside = {"type": "ineq", "fun": lambda x: 1.0 - x[0] - x[1]}
    bounds = [(0.0, 1.0)] * 3
    found = [
        minimize(distance, start_at, bounds=bounds, constraints=inside, tol=1e-14).fun
        for start_at in ((0.2, 0.2, 0.5), (0.8, 0.1, 0.0), (0.1, 0.8, 1.0))
    ]
    return math.sqrt(max(min(found), 0.0))


@pytest.mark.slow
def test_distances_of_points_from_triangles() -> None:
    rng = np.random.default_rng(0)
    triangles = rng.normal(size=(300, 3, 3))
    triangles[::10, 2] = triangles[::10, 0]  # no area
    points = 2.0 * rng.normal(size=(300, 3))
    right = np.linalg.norm(trimesh.triangles.closest_point(triangles, points) - points, axis=1)
    for i in range(300):
        found = math.sqrt(triangle_distance(points[i], triangles[i].ravel()))
        assert found == pytest.approx(right[i], abs=1e-9)


@pytest.mark.slow
def test_distances_of_segments_from_triangles() -> None:
    rng = np.random.default_rng(0)
    crossing = 0
    for _ in range(60):
        triangle, ends = rng.normal(size=9), 1.5 * rng.normal(size=(2, 3))
        found = math.sqrt(segment_distance(ends[0], ends[1], triangle))
        assert found == pytest.approx(nearest_in_triangle(triangle, *ends), abs=2e-4)
        crossing += found == 0.0
    assert 2 < crossing < 30


@pytest.mark.slow
def test_balls_and_capsules_are_free_up_to_the_nearest_face() -> None:
    rng = np.random.default_rng(0)
    points, faces = shapes.lopsided()
    tree = box_tree(points, faces)
    nodes = make_workspace(8).nodes
    for _ in range(20):
        start = 2.0 * rng.normal(size=3)
        end = start + 0.2 * rng.normal(size=3)
        least = min(
            math.sqrt(segment_distance(start, end, triangle)) for triangle in tree.triangles
        )
        assert capsule_is_free(start, end, least - 1e-9, tree, nodes)
        assert not capsule_is_free(start, end, least + 1e-9, tree, nodes) or least == 0.0
        point = min(math.sqrt(triangle_distance(start, triangle)) for triangle in tree.triangles)
        assert ball_is_free(*start, point - 1e-9, tree, nodes)
        assert not ball_is_free(*start, point + 1e-9, tree, nodes)
    assert ball_is_free(*points[0], 0.0, tree, nodes)


def test_the_winding_number_is_one_inside() -> None:
    points, faces = shapes.torus()
    triangles = points[faces].reshape(-1, 9)
    assert winding_number(1.0, 0.0, 0.1, triangles) == pytest.approx(1.0)
    assert winding_number(0.0, 0.0, 0.0, triangles) == pytest.approx(0.0, abs=1e-9)
    assert winding_number(3.0, 1.0, 0.0, triangles) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.slow
@given(count=st.integers(8, 64), data=st.data())
@settings(max_examples=200, deadline=None)
def test_the_widest_arc(count: int, data: st.DataObject) -> None:
    """Its middle is free, and no other angle has free ones farther to both sides."""
    free = data.draw(st.lists(st.booleans(), min_size=count, max_size=count).filter(any))
    mask = np.uint64(sum(int(bit(k)) for k in range(count) if free[k]))
    assert int(all_angles(count)) == 2**count - 1
    middle, length = widest_arc(mask, count)
    if all(free):
        assert (middle, length) == (0, count)
        assert margin_of(length, count) == math.pi
        return
    sides = [
        min(
            next(j for j in range(count + 1) if not free[(k + sign * j) % count])
            for sign in (1, -1)
        )
        for k in range(count)
    ]
    assert sides[middle] == max(sides)
    margin = margin_of(length, count)
    assert margin == pytest.approx((sides[middle] - 1) * 2.0 * math.pi / count)
