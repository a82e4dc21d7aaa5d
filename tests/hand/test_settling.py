"""Free objects that settle between closing jaws: known shapes, and laws that hold for any shape."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from grasp3d import ObjectMesh, best_grasps, label_surface, load_mesh
from grasp3d._kernels.jaws.settling import lowest_point
from grasp3d.hand.closing import ClosedJaws, Closing, centres_of_pressure, close_jaws
from grasp3d.hand.parallel_gripper import ParallelGripper
from tests.helpers import shapes
from tests.helpers.closing_jaws import Floats, pads, pose, random_poses

BOX = (0.04, 0.05, 0.03)


def mesh_of(solid: trimesh.Trimesh | shapes.Surface) -> ObjectMesh:
    return load_mesh(solid, unit="m", max_edge=1.0)


def about(axis: str, degrees: float) -> Rotation:
    return Rotation.from_euler(axis, degrees, degrees=True)


def free(
    mesh: ObjectMesh, poses: Any, hand: ParallelGripper | None = None, **options: Any
) -> ClosedJaws:
    return close_jaws(mesh, poses, hand or pads(), object_motion="free", **options)


@pytest.fixture(scope="module")
def box() -> ObjectMesh:
    return mesh_of(shapes.box(BOX))


@pytest.mark.parametrize("axis", ["y", "z"])
@pytest.mark.parametrize("degrees", [-8.0, 3.0, 12.0])
def test_a_box_turns_until_it_is_flush_with_the_pads(
    box: ObjectMesh, axis: str, degrees: float
) -> None:
    found = free(box, pose(turn=about(axis, degrees)), friction=0.0)
    assert found.opening[0] == pytest.approx(BOX[0], abs=2e-6)
    assert np.degrees(found.turn[0]) == pytest.approx(abs(degrees), abs=0.1)
    np.testing.assert_allclose(np.abs(found.normals[0, :, 0]), 1.0, atol=1e-6)


def wedge(half_angle: float, thin: float, **options: Any) -> ObjectMesh:
    """A prism along y of 25 mm height whose thin end is at z = 0 and its wide one above [deg]."""
    half = [0.5 * thin, 0.5 * thin + 0.025 * math.tan(math.radians(half_angle))]
    corners = zip((0.0, 0.0, 0.025, 0.025), (-half[0], half[0], -half[1], half[1]), strict=True)
    points = [[x, y, z] for z, x in corners for y in (-0.02, 0.02)]
    return load_mesh(trimesh.Trimesh(points).convex_hull, unit="m", **options)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("thin", "half_angles", "max_edge"),
    [
        (0.004, (1.0, 3.0, 8.0, 12.0, 20.0, 30.0, 40.0), 1.0),
        # Of fine meshes edges within the faces are parallel to the pads', and the end is passed.
        (0.0, (5.0, 15.0, 30.0, 40.0), None),
        (0.01, (5.0, 30.0), None),
    ],
)
def test_a_wedge_slips_out_where_its_half_angle_exceeds_that_of_friction(
    thin: float, half_angles: tuple[float, ...], max_edge: float | None
) -> None:
    poses = [
        pose((0.0, 0.0, height), about("x", around) * about("y", tilt))
        for height in (0.0, 0.003, 0.006)
        for around, tilt in ((0.0, 0.0), (0.0, 0.5), (90.0, 0.0), (180.0, 0.0))
    ]
    for half_angle in half_angles:
        mesh = wedge(half_angle, thin, **({"max_edge": max_edge} if max_edge else {}))
        for friction in (0.1, 0.2, 0.3, 0.5, 0.7, 1.0):
            steep = math.tan(math.radians(half_angle)) > friction
            for compliance in (0.0, 0.0005, 0.002):
                found = free(mesh, poses, pads(compliance=compliance), friction=friction)
                expected = Closing.SLIPS_OUT if steep else Closing.CLOSED
                assert (found.state == expected).all(), (half_angle, friction, compliance)
                reached = np.linalg.norm(found.poses[:, :3, 3] - np.array(poses)[:, :3, 3], axis=1)
                if steep:  # the thin end is at the edges of the pads, or slid past them
                    assert (reached > 0.003).all()


def test_a_rim_on_an_inclined_face_rests_at_the_angle_of_friction() -> None:
    """A tilted wedge turns until its steeper face is inclined by the angle of friction."""
    tested = 0
    for half_angle in (5.0, 8.0, 12.0, 17.0, 22.0):
        mesh = wedge(half_angle, 0.02, max_edge=1.0)
        for friction in (0.15, 0.2, 0.3, 0.4, 0.5):
            rest = math.degrees(math.atan(friction)) - half_angle
            tilts = [fraction * half_angle for fraction in (0.5, 0.8, 0.95)]
            tilts = [tilt for tilt in tilts if 0.3 < rest < tilt]
            if not tilts:
                continue
            tested += len(tilts)
            poses = [pose((0.0, 0.0, 0.009), about("y", tilt)) for tilt in tilts]
            axes = free(mesh, poses, friction=friction).poses[:, [0, 2], 2]
            angles = np.degrees(np.arctan2(axes[:, 0], axes[:, 1]))
            np.testing.assert_allclose(angles, rest, atol=0.1)
    assert tested >= 20


def opening_after(
    mesh: ObjectMesh, found: ClosedJaws, row: int, turn: Floats, shift: Floats
) -> float:
    """Opening after a motion of the object, by rigid jaws."""
    moved = found.poses[row].copy()
    middle = found.points[row].mean(axis=0)
    rotation = moved[:3, :3] @ Rotation.from_rotvec(-turn).as_matrix()
    local = moved[:3, :3].T @ (middle - moved[:3, 3])
    moved[:3, 3] = middle - rotation @ (local + shift)
    moved[:3, :3] = rotation
    rigid = pads(compliance=0.0)
    start = min(found.opening[row] + 0.008, rigid.max_opening)
    return float(close_jaws(mesh, moved, replace(rigid, max_opening=start)).opening[0])


@pytest.mark.slow
def test_in_equilibrium_no_small_motion_pays() -> None:
    """Opening plus friction times slips, for random motions of up to 0.3 degrees and 0.1 mm."""
    vertices, faces = shapes.lopsided()
    mesh, friction = mesh_of((0.025 * vertices, faces)), 0.4
    found = free(mesh, random_poses(60, 0.006, seed=5), pads(compliance=0.0), friction=friction)
    rows = np.flatnonzero(found.closed)
    assert len(rows) > 30
    assert (found.turn[rows] > 0.02).sum() > 5
    rng = np.random.default_rng(0)
    pays = 0
    for row in rows:
        for _ in range(8):
            turn, shift = np.zeros(3), np.zeros(3)
            turn[1:], shift[1:] = rng.normal(0, 0.002, 2), rng.normal(0, 5e-5, 2)
            half = 0.5 * found.opening[row] * np.array([turn[2], -turn[1]])
            slips = np.linalg.norm(shift[1:] + half) + np.linalg.norm(shift[1:] - half)
            after = opening_after(mesh, found, row, turn, shift)
            pays += after + friction * slips < found.opening[row] - 5e-6
    assert pays <= 0.01 * 8 * len(rows)


@pytest.mark.slow
def test_rounding_does_not_choose_what_is_touched_of_a_symmetric_object() -> None:
    """Faces that lie flat on a pad, and equal motions to either side, are tied."""
    mesh, hand = load_mesh(shapes.LIBRARY / "bulb.glb"), ParallelGripper.preset("franka")
    labels = label_surface(mesh, hand=hand)
    poses = best_grasps(labels, 60).poses
    expected, rng = free(mesh, poses, hand), np.random.default_rng(1)
    for _ in range(3):
        noise = rng.normal(0.0, 1e-14 * mesh.size, mesh.vertices.shape)
        found = free(replace(mesh, vertices=mesh.vertices + noise), poses, hand)
        np.testing.assert_array_equal(found.state, expected.state)
        np.testing.assert_allclose(found.points, expected.points, atol=1e-9 * mesh.size)
        np.testing.assert_allclose(found.normals, expected.normals, atol=1e-8)


def test_what_closes_does_not_start_inside_where_it_comes_to_rest() -> None:
    vertices, faces = shapes.lopsided()
    mesh, given = mesh_of((0.025 * vertices, faces)), random_poses(100, 0.012, seed=7)
    found, fixed = free(mesh, given), close_jaws(mesh, given, pads())
    outside = fixed.state != Closing.STARTS_INSIDE
    assert 20 < outside.sum() < 100
    assert (found.state[outside] != Closing.STARTS_INSIDE).all()


def test_a_recessed_face_touches_what_stands_out() -> None:
    """Behind the pad is a face 2 mm back, on which a wider part of the object lies."""
    pad = ((0.0, -0.01, -0.005), (0.0, 0.01, -0.005), (0.0, 0.01, 0.005), (0.0, -0.01, 0.005))
    back = tuple((-0.002, y, z - 0.01) for _, y, z in pad)
    thin = trimesh.creation.box(bounds=[[-0.01, -0.01, -0.004], [0.01, 0.01, 0.004]])
    wide = trimesh.creation.box(bounds=[[-0.014, -0.01, -0.014], [0.014, 0.01, -0.006]])
    neck = trimesh.creation.box(bounds=[[-0.002, -0.01, -0.007], [0.002, 0.01, -0.003]])
    mesh = mesh_of(trimesh.boolean.union([thin, neck, wide]))
    found = close_jaws(mesh, np.eye(4), pads(inner_faces=(pad, back), compliance=0.0))
    assert found.opening[0] == pytest.approx(0.028 - 0.004, abs=1e-9)
    assert found.points[0, 0, 2] == pytest.approx(-0.01, abs=1e-3)


def test_centres_of_pressure_are_on_one_line_where_patches_overlap() -> None:
    points = np.array([[[-1.0, 0.0, 0.0], [1.0, 0.4, 0.0]]])
    low, high = np.array([[[-0.5, -1], [0.2, -1]]]), np.array([[[0.3, 1], [0.8, 1]]])
    identity = np.eye(4)[None, :3]
    found = centres_of_pressure(points, low, high, identity)
    np.testing.assert_allclose(found[0, :, 1], 0.2)
    np.testing.assert_allclose(found[0, :, 0], [-1.0, 1.0])
    apart = centres_of_pressure(
        points, low + [[[0, 0], [1, 0]]], high + [[[0, 0], [1, 0]]], identity
    )
    np.testing.assert_allclose(apart[0, :, 1], [0.3, 1.2])


@pytest.mark.slow
@given(
    st.lists(st.tuples(*[st.floats(-1.0, 1.0) for _ in range(3)]), min_size=1, max_size=6),
    st.floats(0.0, 1.0),
)
@settings(deadline=None, max_examples=60)
def test_the_lowest_point_is_lower_than_all_others(rows: Any, slope: float) -> None:
    planes = np.array(rows)
    value, u, v = lowest_point(planes, len(planes), 1.0, slope)
    grid = np.linspace(-1.0, 1.0, 41)
    x, y = (axis.ravel() for axis in np.meshgrid(grid, grid))
    heights = (planes[:, :1] + planes[:, 1:2] * x + planes[:, 2:] * y).max(axis=0)
    heights += slope * np.hypot(x, y)
    assert value <= heights.min() + 1e-9
    own = (planes[:, 0] + planes[:, 1] * u + planes[:, 2] * v).max() + slope * math.hypot(u, v)
    assert own == pytest.approx(value, abs=1e-12)
