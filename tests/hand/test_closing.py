"""Jaws that close on shapes whose contacts are known, and laws that hold for any shape."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from grasp3d import ObjectMesh, load_mesh
from grasp3d.errors import ContactError
from grasp3d.hand.closing import ClosedJaws, Closing, close_jaws
from grasp3d.settings.units import Unit
from grasp3d.system.context import running
from tests.helpers import shapes
from tests.helpers.closing_jaws import Floats, pads, pose, random_poses, sliced_pad, tips

BOX = (0.06, 0.05, 0.03)
DEPTH = 0.001


def mesh_of(solid: trimesh.Trimesh | shapes.Surface, **options: Any) -> ObjectMesh:
    """A prepared mesh in metres that is not refined."""
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


@pytest.mark.parametrize("hand", [pads(), tips()])
def test_pads_and_tips_that_only_graze_an_edge_do_not_touch(box: ObjectMesh, hand: Any) -> None:
    poses = [pose((0.0, y + 0.01, 0.0)) for y in (0.025, 0.024)]
    assert states(close_jaws(box, poses, hand)) == ["NOTHING", "CLOSED"]


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


def test_pads_across_a_cylinder_touch_strips() -> None:
    radius = 0.02
    cylinder = mesh_of(trimesh.creation.cylinder(radius, 0.2, sections=720))
    found = close_jaws(cylinder, pose(), pads(compliance=0.0005))
    half = math.sqrt(radius**2 - (radius - 0.0005) ** 2)
    check(found, extents=[[2.0 * half, 0.01]] * 2, area=2.0 * half * 0.01, rtol=2e-3, atol=0.0)
    np.testing.assert_allclose(found.extents[0, :, 1], 0.01, rtol=1e-6)


def wedge(half_angle: float, height: float = 0.06) -> ObjectMesh:
    """A prism along z whose faces make the half-angle with y, with its apex at y = height / 2."""
    half = height * math.tan(half_angle)
    outline = np.array([[-half, -height / 2], [half, -height / 2], [0.0, height / 2]])
    points = np.array([[*corner, z] for z in (-0.05, 0.05) for corner in outline])
    return mesh_of(trimesh.Trimesh(points, trimesh.convex.convex_hull(points).faces).convex_hull)


def test_rigid_pads_on_a_wedge_touch_at_their_edge() -> None:
    """The pads' edges nearest to the base; the normals are those of the wedge's faces."""
    angle = math.radians(10.0)
    found = close_jaws(wedge(angle), pose(), pads(compliance=0.0))
    check(found, opening=2.0 * (0.03 + 0.01) * math.tan(angle), atol=1e-8)
    x, y = math.cos(angle), -math.sin(angle)
    check(found, y=-0.01, normals=[[x, y, 0.0], [-x, y, 0.0]], atol=1e-6)


def test_compliant_pads_on_a_wedge_touch_a_strip() -> None:
    angle = math.radians(10.0)
    strip = 0.0005 / math.tan(angle)
    found = close_jaws(wedge(angle), pose(), pads(compliance=0.0005))
    check(found, y=-0.01 + strip / 2.0, atol=1e-8)
    check(found, extents=[[strip, 0.01]] * 2, rtol=1e-6, atol=0.0)


@pytest.mark.parametrize(("step", "middle"), [(0.0004, 0.0), (0.0006, 0.005)])
def test_a_step_within_the_compliance_is_touched_on_both_levels(step: float, middle: float) -> None:
    """A box with a lower half for y < 0; the other side is flat."""
    high = trimesh.creation.box(bounds=[[-0.02, 0.0, -0.02], [0.02, 0.03, 0.02]])
    low = trimesh.creation.box(bounds=[[-0.02 + step, -0.03, -0.02], [0.02, 0.0, 0.02]])
    solid = trimesh.boolean.union([high, low])
    found = close_jaws(mesh_of(solid), pose(), pads(compliance=0.0005))
    check(found, opening=0.04, y=[middle, 0.0], atol=1e-8)
    check(found, normals=AHEAD)
    check(found, area=[2e-4 if middle == 0.0 else 1e-4, 2e-4], rtol=1e-5, atol=0.0)


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


def test_a_round_tip_beside_an_edge_touches_the_edge(box: ObjectMesh) -> None:
    """6 mm beyond the edge, a ball of 10 mm has advanced 2 mm more when it touches it."""
    found = close_jaws(box, pose((0.0, 0.031, 0.0)), tips(compliance=0.0))
    check(found, opening=0.06 - 2.0 * 0.002)
    check(found, points=[[-0.03, 0.025, 0], [0.03, 0.025, 0]], atol=1e-5)


def test_where_jaws_touch_nothing_or_start_inside(box: ObjectMesh) -> None:
    centers = [(0.0, 0.1, 0.0), (0.02, 0.0, 0.0), (0.07, 0.0, 0.0), (0.0, 0.0, 0.0)]
    found = close_jaws(box, [pose(center) for center in centers], pads())
    assert states(found) == ["NOTHING", "STARTS_INSIDE", "STARTS_INSIDE", "CLOSED"]
    assert np.isnan(found.points[:3]).all()
    assert np.isnan(found.opening[:3]).all()
    assert (found.area[:3] == 0.0).all()
    np.testing.assert_array_equal(found.closed, [False, False, False, True])


def test_a_finger_wholly_in_a_solid_starts_inside() -> None:
    solid = mesh_of(shapes.box((0.3, 0.3, 0.3)))
    for hand in (pads(), tips()):
        found = close_jaws(solid, [pose(), pose((0.14, 0.0, 0.0))], hand)
        assert states(found) == ["STARTS_INSIDE"] * 2


def test_a_finger_wholly_in_a_cavity_does_not_start_inside() -> None:
    """Both fingers in a hollow box: the jaws meet."""
    outer, inner = (trimesh.creation.box([size] * 3) for size in (0.3, 0.2))
    hollow = trimesh.boolean.difference([outer, inner])
    found = close_jaws(mesh_of(hollow), pose(), pads())
    assert states(found) == ["NOTHING"]


def test_the_wall_of_a_cup_is_between_the_jaws() -> None:
    """One jaw inside, one outside: the far wall is not touched."""
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
    """Part of a blob, at random poses."""
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


def test_of_an_open_sheet_only_the_front_is_touched() -> None:
    points = [[0, -0.03, -0.03], [0, 0.03, -0.03], [0, 0.03, 0.03], [0, -0.03, 0.03]]
    sheet = mesh_of((np.array(points), np.array([[0, 2, 1], [0, 3, 2]])), repair="none")
    found = close_jaws(sheet, pose(), pads())
    assert states(found) == ["ONE_SIDE"]
    assert found.area[0].tolist() == pytest.approx([2e-4, 0.0])
    turned = close_jaws(sheet, pose(turn=Rotation.from_rotvec([0, 0, math.pi])), pads())
    assert turned.area[0].tolist() == pytest.approx([0.0, 2e-4])


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


def test_symmetric_poses_on_a_symmetric_object_have_symmetric_contacts() -> None:
    """A torus about z, whose faces are not quite as symmetric."""
    torus = mesh_of(shapes.torus(0.025, 0.008))
    matrices = [pose((0.0, y, z)) for y in (0.0, 0.004, -0.01) for z in (0.0, 0.003)]
    found = close_jaws(torus, matrices, pads())
    assert found.closed.all()
    np.testing.assert_allclose(found.offset, 0.0, atol=1e-4)
    np.testing.assert_allclose(found.points[:, 0], found.points[:, 1] * [-1, 1, 1], atol=1e-4)
    np.testing.assert_allclose(found.normals[:, 0], found.normals[:, 1] * [-1, 1, 1], atol=1e-4)
    np.testing.assert_allclose(found.area[:, 0], found.area[:, 1], rtol=1e-3)


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


def test_more_compliance_touches_more_and_leaves_the_opening(blob: ObjectMesh) -> None:
    matrices = random_poses(60, 0.005, seed=4)
    soft, softer = (close_jaws(blob, matrices, pads(compliance=c)) for c in (0.0005, 0.001))
    both = soft.closed & softer.closed
    assert both.sum() > 20
    np.testing.assert_allclose(soft.opening[both], softer.opening[both], rtol=1e-12)
    assert (soft.area[both] < softer.area[both]).all()
    assert (softer.area[both] <= 2e-4 * (1.0 + 1e-9)).all()


def test_the_number_of_threads_changes_nothing(blob: ObjectMesh) -> None:
    matrices = random_poses(600, 0.01, seed=5)
    one, two = (running(threads=count)(close_jaws)(blob, matrices, pads()) for count in (1, 2))
    for name, values in arrays(one).items():
        np.testing.assert_array_equal(values, getattr(two, name))


def test_refining_a_mesh_changes_nothing(box: ObjectMesh) -> None:
    matrices = random_poses(60, 0.01, seed=6)
    fine = load_mesh(shapes.box(BOX), unit="m", max_edge=0.004)
    found, again = (close_jaws(mesh, matrices, pads(compliance=0.001)) for mesh in (box, fine))
    assert len(fine.faces) > 50 * len(box.faces)
    np.testing.assert_array_equal(again.state, found.state)
    np.testing.assert_allclose(again.points, found.points, atol=1e-9)
    np.testing.assert_allclose(again.normals, found.normals, atol=1e-8)


def test_poses_of_another_shape_are_refused(box: ObjectMesh) -> None:
    with pytest.raises(ContactError, match=r"shape \(k, 4, 4\); got \(3, 3\)"):
        close_jaws(box, np.eye(3), pads())


def test_no_poses_give_no_contacts(box: ObjectMesh) -> None:
    found = close_jaws(box, np.zeros((0, 4, 4)), replace(pads(), compliance=0.0))
    assert found.points.shape == (0, 2, 3)
