"""Jaws that close on shapes whose contacts are known, and laws that hold for any shape."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import trimesh
from scipy.optimize import linprog
from scipy.spatial.transform import Rotation

from grasp3d import ObjectMesh, load_mesh
from grasp3d.hand.closing import ClosedJaws, Closing, close_jaws
from grasp3d.settings.units import Unit
from tests.helpers import shapes
from tests.helpers.closing_jaws import Floats, pads, pose, random_poses, sliced_pad, tips

BOX = (0.06, 0.05, 0.03)
DEPTH = 0.001


def mesh_of(solid: trimesh.Trimesh | shapes.Surface, **options: Any) -> ObjectMesh:
    return load_mesh(solid, unit="m", max_edge=1.0, **options)


@pytest.fixture(scope="module")
def box() -> ObjectMesh:
    return mesh_of(shapes.box(BOX))


def blob_mesh(motion: Floats | None = None, scale: float = 1.0, unit: Unit = "m") -> ObjectMesh:
    """A blob of 5 cm without symmetry, which may be moved, in another unit."""
    vertices, faces = shapes.lopsided()
    matrix = np.eye(4) if motion is None else motion
    moved = 0.025 * vertices @ matrix[:3, :3].T + matrix[:3, 3]
    return load_mesh((scale * moved, faces), unit=unit, max_edge=scale)


@pytest.fixture(scope="module")
def blob() -> ObjectMesh:
    return blob_mesh()


def states(found: ClosedJaws) -> list[str]:
    return [Closing(code).name for code in found.state]


def arrays(found: ClosedJaws) -> dict[str, Floats]:
    return {name: getattr(found, name) for name in ("points", "normals", "area", "extents")}


AHEAD = [[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]]
"""Normals of contacts on opposite sides across x."""


def check(found: ClosedJaws, rtol: float = 0.0, atol: float = 1e-9, **expected: Any) -> None:
    """Check what both jaws touch: fields of `ClosedJaws`, points also as columns x, y and z."""
    assert states(found) == ["CLOSED"]
    columns = dict(zip("xyz", found.points[0].T, strict=True))
    for name, values in expected.items():
        own = columns[name] if name in columns else getattr(found, name)[0]
        np.testing.assert_allclose(own, values, rtol, atol, err_msg=name)


def test_pads_on_the_faces_of_a_box(box: ObjectMesh) -> None:
    found = close_jaws(box, pose((0.004, 0.001, -0.002)), pads())
    points = [[-0.03, 0.001, -0.002], [0.03, 0.001, -0.002]]
    check(found, points=points, normals=AHEAD, extents=[[0.02, 0.01]] * 2, offset=-0.004)
    check(found, opening=0.06, atol=1e-12)
    check(found, area=0.02 * 0.01, rtol=1e-6, atol=0.0)


def test_a_pad_edge_over_the_edge_of_a_box_touches_the_part_on_the_box(box: ObjectMesh) -> None:
    """Of each pad 4 mm in y and 3 mm in z lie on the face, at its corner."""
    found = close_jaws(box, pose((0.0, 0.031, 0.017)), pads())
    check(found, y=0.023, z=0.0135, extents=[[0.004, 0.003]] * 2)
    check(found, area=12e-6, rtol=1e-5, atol=0.0)


def test_pads_on_a_ball_touch_caps_of_the_depth_of_the_compliance() -> None:
    radius = 0.03
    ball = mesh_of(trimesh.creation.icosphere(5, radius))
    found = close_jaws(ball, pose(), pads(compliance=DEPTH, pad_height=0.02))
    cap = math.pi * (radius**2 - (radius - DEPTH) ** 2)
    check(found, area=cap, extents=2.0 * math.sqrt(cap / math.pi), rtol=0.01, atol=0.0)
    # On average over its area seen along x, a shallow cap is half as deep.
    check(found, x=[0.5e-3 - radius, radius - 0.5e-3], atol=2e-5)
    check(found, y=0.0, z=0.0, atol=1e-6)
    check(found, normals=AHEAD, atol=1e-4)
    check(found, opening=2.0 * radius, rtol=1e-3, atol=0.0)


def wedge(half_angle: float, height: float = 0.06) -> ObjectMesh:
    """A prism along z whose faces make the half-angle with y, with its apex at y = height / 2."""
    half = height * math.tan(half_angle)
    outline = np.array([[-half, -height / 2], [half, -height / 2], [0.0, height / 2]])
    points = np.array([[*corner, z] for z in (-0.05, 0.05) for corner in outline])
    return mesh_of(trimesh.Trimesh(points, trimesh.convex.convex_hull(points).faces).convex_hull)


def test_pads_on_a_wedge_touch_at_their_edge_or_a_strip_beside_it() -> None:
    """The pads' edges nearest to the base; the normals are those of the wedge's faces."""
    angle = math.radians(10.0)
    found = close_jaws(wedge(angle), pose(), pads(compliance=0.0))
    check(found, opening=2.0 * (0.03 + 0.01) * math.tan(angle), atol=1e-8)
    x, y = math.cos(angle), -math.sin(angle)
    check(found, y=-0.01, normals=[[x, y, 0.0], [-x, y, 0.0]], atol=1e-6)
    strip = 0.0005 / math.tan(angle)
    soft = close_jaws(wedge(angle), pose(), pads(compliance=0.0005))
    check(soft, y=-0.01 + strip / 2.0, atol=1e-8)
    check(soft, extents=[[strip, 0.01]] * 2, rtol=1e-6, atol=0.0)


@pytest.mark.parametrize("compliance", [0.0, 0.0005])
def test_a_pad_on_a_vertex_has_the_mean_of_its_normals(compliance: float) -> None:
    """A cube that stands on a corner, between the pads."""
    solid = trimesh.creation.box((0.03, 0.03, 0.03))
    turn, _ = Rotation.align_vectors([[1.0, 0.0, 0.0]], [[1.0, 1.0, 1.0]])
    found = close_jaws(mesh_of(solid), pose(turn=turn.inv()), pads(compliance=compliance))
    corner = 0.015 * np.ones(3)
    depth = 0.001 if compliance else 1e-6
    np.testing.assert_allclose(found.points[0], [-corner, corner], atol=depth)
    diagonal = np.ones(3) / math.sqrt(3.0)
    np.testing.assert_allclose(found.normals[0], [diagonal, -diagonal], atol=1e-6)
    assert found.opening[0] == pytest.approx(0.03 * math.sqrt(3.0))
    # The section of a cube's corner at depth d is a triangle of area 3 sqrt(3) / 2 d^2.
    depth = max(compliance, 1e-9)
    assert found.area[0, 0] == pytest.approx(1.5 * math.sqrt(3.0) * depth**2, rel=1e-4, abs=1e-12)


def test_a_round_tip_on_a_face_touches_a_disc(box: ObjectMesh) -> None:
    found = close_jaws(box, pose(), tips(compliance=DEPTH))
    square = 0.01**2 - (0.01 - DEPTH) ** 2
    check(found, area=math.pi * square, extents=2.0 * math.sqrt(square), rtol=1e-9, atol=0.0)
    check(found, points=[[-0.03, 0.0, 0.0], [0.03, 0.0, 0.0]], opening=0.06, atol=1e-12)


def test_round_tips_on_a_wedge_touch_with_their_sides() -> None:
    """A tip touches a face with the point of its surface that faces it."""
    angle = math.radians(20.0)
    found = close_jaws(wedge(angle, 0.04), pose(), tips(compliance=0.0))
    y, x = -0.01 * math.sin(angle), math.cos(angle)
    check(found, y=y, atol=1e-6)
    check(found, normals=[[x, -math.sin(angle), 0.0], [-x, -math.sin(angle), 0.0]])
    check(found, opening=2.0 * ((0.02 - y) * math.tan(angle) - 0.01 * (1.0 - x)), atol=1e-8)


def test_where_jaws_touch_nothing_or_start_inside(box: ObjectMesh) -> None:
    centers = [(0.0, 0.1, 0.0), (0.02, 0.0, 0.0), (0.07, 0.0, 0.0), (0.0, 0.0, 0.0)]
    found = close_jaws(box, [pose(center) for center in centers], pads())
    assert states(found) == ["NOTHING", "STARTS_INSIDE", "STARTS_INSIDE", "CLOSED"]
    assert np.isnan(found.points[:3]).all()
    assert np.isnan(found.opening[:3]).all()
    assert (found.area[:3] == 0.0).all()
    solid = mesh_of(shapes.box((0.3, 0.3, 0.3)))
    for hand in (pads(), tips()):
        assert (
            states(close_jaws(solid, [pose(), pose((0.14, 0.0, 0.0))], hand))
            == ["STARTS_INSIDE"] * 2
        )
    outer, inner = (trimesh.creation.box([size] * 3) for size in (0.3, 0.2))
    hollow = trimesh.boolean.difference([outer, inner])  # both fingers are in its cavity
    assert states(close_jaws(mesh_of(hollow), pose(), pads())) == ["NOTHING"]


def test_the_wall_of_a_cup_is_between_the_jaws() -> None:
    cup = mesh_of(trimesh.creation.annulus(0.035, 0.04, 0.1, sections=256))
    found = close_jaws(cup, pose((0.0375, 0.0, 0.045)), pads(compliance=0.0, max_opening=0.03))
    # The inner pad is stopped by its corners.
    check(found, opening=0.04 - math.sqrt(0.035**2 - 0.01**2), atol=1e-5)
    check(found, y=0.0, atol=1e-4)


def test_an_object_thinner_than_the_smallest_opening_is_not_held() -> None:
    plate = mesh_of(shapes.box((0.004, 0.05, 0.05)))
    assert states(close_jaws(plate, pose(), pads(min_opening=0.005))) == ["NOTHING"]
    assert states(close_jaws(plate, pose(), pads(min_opening=0.004))) == ["CLOSED"]


@pytest.mark.slow
@pytest.mark.parametrize("kept", [0.3, 0.5, 0.7])
@pytest.mark.parametrize("compliance", [1e-6, 5e-4])
def test_both_jaws_touch_an_open_mesh_where_it_is_on_both_sides(
    kept: float, compliance: float
) -> None:
    vertices, faces = shapes.lopsided()
    along = vertices[faces].mean(axis=1) @ Rotation.random(random_state=3).as_matrix()[0]
    blob = (0.025 * vertices, faces[along < np.quantile(along, kept)])
    mesh, hand = mesh_of(blob, repair="none"), pads(compliance=compliance)
    poses = random_poses(100, 0.008, seed=int(10 * kept))
    found = close_jaws(mesh, poses, hand)
    rest = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    for matrix, state in zip(poses, states(found), strict=True):
        touched = [sliced_pad(rest, matrix, hand, finger) is not None for finger in (0, 1)]
        assert state not in ("CLOSED", "ONE_SIDE") or all(touched) == (state == "CLOSED")
    assert len(set(states(found))) > 1


def test_jaws_that_close_beside_their_middle_hold_the_object_without_collision(
    box: ObjectMesh,
) -> None:
    poses, hand = pose((0.008, 0.0, 0.005))[None], pads()
    found = close_jaws(box, poses, hand)
    assert found.offset == pytest.approx(-0.008)
    held = np.array([True])
    assert not hand.blocked(box, poses, found, held=held)
    opposite = replace(found, positions=-found.positions[:, ::-1])
    assert opposite.offset == pytest.approx(0.008)
    assert hand.blocked(box, poses, opposite, held=held)


@pytest.mark.parametrize("hand", [pads(), tips()])
def test_turning_the_gripper_by_half_a_turn_exchanges_the_jaws(blob: ObjectMesh, hand: Any) -> None:
    matrices = random_poses(60, 0.01, seed=1)
    half = np.diag([-1.0, -1.0, 1.0, 1.0])
    one, two = (close_jaws(blob, poses, hand) for poses in (matrices, matrices @ half))
    assert one.closed.sum() > 20
    np.testing.assert_array_equal(one.state, two.state)
    np.testing.assert_allclose(one.opening, two.opening, atol=1e-12)
    for name, values in arrays(one).items():
        np.testing.assert_allclose(values, getattr(two, name)[:, ::-1], atol=1e-9, err_msg=name)


@pytest.mark.slow
@pytest.mark.parametrize("hand", [pads(), tips()])
def test_units_and_motions_of_everything_change_nothing(blob: ObjectMesh, hand: Any) -> None:
    matrices = random_poses(40, 0.01, seed=2)
    found = close_jaws(blob, matrices, hand)
    motion = pose((0.3, -1.0, 0.2), Rotation.from_rotvec([0.3, 1.0, -0.4]))
    turn, moved = motion[:3, :3], motion @ matrices
    for unit, scale in (("m", 1.0), ("mm", 1000.0)):
        again = close_jaws(blob_mesh(motion, scale, unit), moved, hand)
        np.testing.assert_array_equal(again.state, found.state)
        np.testing.assert_allclose(again.opening, found.opening, atol=1e-7)
        expected = found.points @ turn.T + motion[:3, 3]
        np.testing.assert_allclose(again.points, expected, atol=1e-7)
        np.testing.assert_allclose(again.normals, found.normals @ turn.T, atol=1e-6)
        np.testing.assert_allclose(again.area, found.area, atol=1e-10)


HALF_STROKE = 0.04

OUTLINE = 1e-3 * np.array([[0, 5], [0, -5], [-3, -30], [-15, -30], [-15, 5]])
"""Corners (x, z) of a finger of 20 mm with a pad of 10 mm, behind which it is inclined."""

FINGER = np.array([[x, y, z] for y in (-0.01, 0.01) for x, z in OUTLINE])


def first_touch(finger: Floats, solid: Floats) -> float:
    """How far a convex body moves along x until it touches another one, by linear programming.

    Both are the hulls of points. Of all pairs of their points that are on one line along x, that
    with the smallest distance touches; inf: there is none.
    """
    m, n = len(finger), len(solid)
    costs = np.concatenate([-finger[:, 0], solid[:, 0]])
    across = np.concatenate([finger[:, 1:], -solid[:, 1:]]).T
    sums = np.zeros((2, m + n))
    sums[0, :m] = sums[1, m:] = 1.0
    found = linprog(1e3 * costs, A_eq=np.vstack([1e3 * across, sums]), b_eq=[0, 0, 1, 1])
    return math.inf if found.fun is None else 1e-3 * float(found.fun)


@pytest.mark.parametrize("seed", range(4))
def test_jaws_touch_where_the_finger_does(seed: int) -> None:
    faces = tuple(
        ((x, -0.01, z), (x, 0.01, z), (to, 0.01, end), (to, -0.01, end))
        for (x, z), (to, end) in zip(OUTLINE[:2].tolist(), OUTLINE[1:3].tolist(), strict=True)
    )
    hand = pads(inner_faces=faces, compliance=0.0, finger_thickness=0.015)
    body = trimesh.convex.convex_hull(np.random.default_rng(seed).normal(size=(20, 3)) * 0.008)
    poses = random_poses(12, 0.008, seed)
    found = close_jaws(load_mesh(body, unit="m", max_edge=1.0), poses, hand)
    assert found.closed.any()
    for row, matrix in enumerate(poses):
        local = (body.vertices - matrix[:3, 3]) @ matrix[:3, :3]
        ways = [first_touch(FINGER, local * [side, 1.0, 1.0]) for side in (1.0, -1.0)]
        reaches = min(ways) > -HALF_STROKE and sum(ways) < 0.0  # it starts outside the object
        assert found.closed[row] == reaches
        if reaches:
            assert found.opening[row] == pytest.approx(-sum(ways), abs=2e-7)
