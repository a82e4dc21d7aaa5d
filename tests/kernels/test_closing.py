"""Jaws against surfaces cut into pieces: first touch and touched patch."""

import itertools
from typing import Any

import numpy as np
import pytest
import trimesh

from grasp3d import ObjectMesh, load_mesh
from grasp3d._kernels.surface import polygons
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


@pytest.mark.parametrize("limit", [-1.0, 0.0, 0.25, 1.0, 2.0])
def test_a_cut_triangle_has_the_area_below_the_cut(limit: float) -> None:
    """A right triangle with legs of 1 in the y-z plane, cut at a height z."""
    corners = np.array([[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    polygon, cut, mean = np.zeros((12, 6)), np.zeros((12, 6)), np.zeros(6)
    count = polygons.write_triangle(corners, 1.0, polygon)
    count = polygons.clip(polygon, count, (0.0, 0.0, 1.0, limit), cut)
    area = polygons.projected_moments(cut, count, mean)
    height = min(max(limit, 0.0), 1.0)
    assert area == pytest.approx(0.5 * (1.0 - (1.0 - height) ** 2), abs=1e-15)
    if area > 0.0:
        np.testing.assert_allclose(mean[3:] @ corners, mean[:3], atol=1e-15)
        assert mean[3:].sum() == pytest.approx(1.0)
