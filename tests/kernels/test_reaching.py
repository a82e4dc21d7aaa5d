"""Distances, masks of angles and arcs of the kernels that test grippers."""

import math

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

from grasp3d import load_mesh
from grasp3d._kernels.jaws.gripper_parts import (
    all_angles,
    bit,
    make_workspace,
    margin_of,
    widest_arc,
)
from grasp3d._kernels.jaws.reaching import tip_fits, winding_number
from grasp3d._kernels.surface.box_tree import (
    ball_is_free,
    box_tree,
    capsule_is_free,
    segment_distance,
    triangle_distance,
)
from grasp3d.hand.reach import NormalizedScene
from grasp3d.hand.table import Approach
from tests.helpers import shapes
from tests.helpers.grippers import TIPS


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


def test_a_segment_of_no_length_is_a_point() -> None:
    rng = np.random.default_rng(0)
    triangle, point = rng.normal(size=9), rng.normal(size=3)
    found = segment_distance(point, point, triangle)
    assert found == pytest.approx(triangle_distance(point, triangle))


@pytest.mark.slow
@pytest.mark.parametrize("faces", [1, 2, 3, 5, 80, 1280])
def test_boxes_contain_the_faces_of_their_nodes(faces: int) -> None:
    points, all_faces = shapes.sphere(3)
    tree = box_tree(points, all_faces[:faces])
    corners = tree.triangles.reshape(faces, 3, 3)
    assert sorted(map(tuple, corners.sum(axis=1))) == sorted(
        map(tuple, points[all_faces[:faces]].sum(axis=1))
    )
    for level in range(tree.depth + 1):
        for j in range(1 << level):
            box = tree.boxes[(1 << level) - 1 + j]
            own = corners[faces * j >> level : faces * (j + 1) >> level].reshape(-1, 3)
            assert (np.abs(own - box[:3]) <= box[3:6]).all()
            away = own - box[:3]
            assert box[6] == pytest.approx(np.linalg.norm(away, axis=1).max())
            assert np.linalg.norm(box[7:10]) == pytest.approx(1.0)
            heights = away @ box[7:10] - box[10]
            assert (np.abs(heights) <= box[11]).all()
            assert np.abs(heights).max() == pytest.approx(box[11], abs=2e-12)


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


def test_a_tip_that_touches_one_point_fits() -> None:
    mesh = load_mesh(shapes.box((0.06, 0.06, 0.06)), unit="m", max_edge=1.0)
    shape = NormalizedScene.of(mesh, TIPS, None, Approach()).shape
    tree = box_tree(mesh.contact_surface.points, mesh.contact_surface.faces)
    nodes = make_workspace(8).nodes
    top, inward = np.array([0.0, 0.0, 0.03]) / mesh.size, np.array([0.0, 0.0, -1.0])
    assert tip_fits(top, inward, shape, tree, nodes)
    assert tip_fits(top, inward, shape._replace(compliance=0.0), tree, nodes)
    deeper = top + 0.001 / mesh.size * inward
    assert not tip_fits(deeper, inward, shape, tree, nodes)


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
    mask = np.uint64(sum(1 << k for k in range(count) if free[k]))
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


def test_masks_of_all_angles() -> None:
    for count in (8, 32, 63, 64):
        assert int(all_angles(count)) == 2**count - 1
        assert int(bit(count - 1)) == 2 ** (count - 1)
