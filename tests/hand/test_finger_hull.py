"""Faces of fingers: known shapes, laws for any shape, and slow oracles of what the jaws touch."""

import math
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from grasp3d import load_mesh
from grasp3d.hand.closing import close_jaws
from grasp3d.hand.finger_hull import (
    MOST_FACES,
    STEEP,
    TOLERANCE,
    Face,
    agreement,
    area,
    clipped,
    common,
    corners_of,
    finger_faces,
    hull_faces,
    rectangle,
)
from grasp3d.hand.hand_geometry import SlidingFinger, SlidingHand, gripper_of_hand
from grasp3d.hand.jaws import AXES, Corners, problem_of_face
from grasp3d.hand.parallel_gripper import ParallelGripper
from tests.helpers.closing_jaws import Floats, pads, random_poses

EXACT = 1e-9
"""Tolerance with which all planes of a hull are used."""

HALF_STROKE = 0.04


def box(low: tuple[float, ...], high: tuple[float, ...]) -> Floats:
    """Triangles of a box, from its corners in millimetres."""
    return np.asarray(trimesh.creation.box(bounds=1e-3 * np.array([low, high])).triangles)


def hull(points: Floats) -> Floats:
    """Triangles of a convex hull."""
    return np.asarray(trimesh.convex.convex_hull(points).triangles)


def hand(
    one: Floats, two: Floats | None = None, *, axes: tuple[str, str] = ("x", "z"), scale: float = 1
) -> SlidingHand:
    """A hand whose fingers have the given shapes in the gripper's frame; finger 2 is mirrored.

    The palm's front is at z = -30 mm, the origin of the hand's frame 70 mm behind that.
    """
    x, z = (np.array(AXES[name]) for name in axes)
    frame = np.stack([x, np.cross(z, x), z])
    fingers = []
    for side, shape in ((1.0, one), (-1.0, one if two is None else two)):
        triangles = (shape + [0.0, 0.0, 0.1]) * [side, 1.0, 1.0] * scale @ frame
        limits = (0.0, scale * HALF_STROKE)
        fingers.append(
            SlidingFinger(f"finger{side:+g}", f"joint{side:+g}", -side * x, limits, triangles)
        )
    palm = scale * box((-60, -30, 0), (60, 30, 70)).reshape(-1, 3) @ frame
    return SlidingHand("hand.urdf", "hand", (fingers[0], fingers[1]), palm)


def as_faces(faces: tuple[Corners, ...]) -> list[Face]:
    """Faces of a gripper, as those that are computed."""
    found = []
    for corners in map(np.array, faces):
        plane = np.linalg.lstsq(np.insert(corners[:, 1:], 0, 1.0, axis=1), corners[:, 0])[0]
        outline = corners[:, 1:]
        found.append(Face(plane, outline if area(outline) > 0.0 else outline[::-1]))
    return found


def tapered(pad: float = 10.0, thickness: float = 15.0) -> Floats:
    """Corners of a finger with a flat pad of 20 x `pad` mm, behind which it is inclined."""
    half = 0.5 * pad
    outline = [[0.0, half], [0.0, -half], [-3.0, -30.0], [-thickness, -30.0], [-thickness, half]]
    return 1e-3 * np.array([[x, y, z] for y in (-10.0, 10.0) for x, z in outline])


@st.composite
def convex_fingers(draw: st.DrawFn) -> Floats:
    """Corners of a convex finger with a flat pad of 8 x 8 mm in front of rounded sides."""
    length = st.floats(0.0, 1.0)
    pad = [[0.0, y, z] for y in (-4.0, 4.0) for z in (-4.0, 4.0)]
    corner = st.tuples(length, st.floats(-8.0, 8.0), st.floats(-20.0, 8.0))
    between = [[-1.0 - 2.0 * u, y, z] for u, y, z in draw(st.lists(corner, min_size=0, max_size=8))]
    rim = [[-4.0 - 3.0 * draw(length), y, z] for y in (-10.0, 10.0) for z in (-30.0, 10.0)]
    back = [[-15.0, y, z] for y in (-10.0, 10.0) for z in (-30.0, 10.0)]
    return (1e-3 * np.array([*pad, *between, *rim, *back])).round(8)


def front_of(pieces: list[Floats], points: Floats) -> Floats:
    """Largest x of convex pieces, given by corners, at points (y, z); -inf outside them."""
    found = np.full(len(points), -np.inf)
    for corners in pieces:
        normals, offsets = np.split(ConvexHull(corners).equations, [3], axis=1)
        slack = -(points @ normals[:, 1:].T + offsets.T)
        ahead, behind, along = normals[:, 0] > 1e-9, normals[:, 0] < -1e-9, np.abs(normals[:, 0])
        high = (slack[:, ahead] / along[ahead]).min(axis=1)
        low = (-slack[:, behind] / along[behind]).max(axis=1)
        beside = (slack[:, ~ahead & ~behind] < 0.0).any(axis=1)
        found = np.maximum(found, np.where((low <= high) & ~beside, high, -np.inf))
    return found


def containing(faces: list[Face], point: Floats, margin: float = 0.0) -> list[Face]:
    """Faces that contain a point (y, z), grown by a margin."""
    tiny = rectangle(point - margin - 1e-12, point + margin + 1e-12)
    return [face for face in faces if len(common(tiny, face.outline)) > 2]


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


def test_a_box_has_one_face_and_a_pad_that_is_all_of_it_none() -> None:
    shape = box((-12, -10, -30), (0, 10, 10))
    (face,) = finger_faces(shape, front=-0.02)
    np.testing.assert_allclose(face.plane, 0.0, atol=1e-12)
    np.testing.assert_allclose(face.outline.min(axis=0), [-0.01, -0.02], atol=1e-12)
    np.testing.assert_allclose(face.outline.max(axis=0), [0.01, 0.01], atol=1e-12)
    whole = gripper_of_hand(hand(shape))
    assert (whole.inner_faces, whole.tip_thickness) == ((), None)
    assert whole.pad_height == pytest.approx(0.04)


def test_a_pad_at_the_end_of_a_flat_side_is_extended_by_the_side() -> None:
    gripper = gripper_of_hand(hand(box((-12, -10, -30), (0, 10, 10))), tcp=0.1)
    assert gripper.pad_height == pytest.approx(0.02)
    (corners,) = np.array(gripper.inner_faces)
    np.testing.assert_array_equal(corners.min(axis=0), [0.0, -0.01, -0.03])
    np.testing.assert_array_equal(corners.max(axis=0), [0.0, 0.01, 0.01])


def test_a_finger_made_from_the_faces_of_a_preset_has_these_faces() -> None:
    """Their hull with a plane behind them; what is behind the palm is left out."""
    franka = ParallelGripper.preset("franka")
    known = np.array([corner for face in franka.inner_faces for corner in face])
    shape = hull(
        np.concatenate([known, np.column_stack([np.full(len(known), -0.0144), known[:, 1:]])])
    )
    found = gripper_of_hand(hand(shape), tcp=0.1)
    expected = [
        Face(face.plane, clipped(face.outline, -0.03 - face.outline[:, 1]))
        for face in as_faces(franka.inner_faces)
    ]
    inner = [face for face in as_faces(found.inner_faces) if face.angle > 1.0]
    assert agreement(inner, expected, 1e-7) == pytest.approx(1.0, abs=1e-6)
    assert sorted(len(face.outline) for face in inner) == [4, 6]  # the others are its sides
    assert found.tip_thickness is None


@pytest.mark.parametrize(("root", "end"), [(25.0, 5.0), (5.0, 25.0)])
def test_an_inclined_finger_has_its_slope_and_the_thickness_at_the_tcp(
    root: float, end: float
) -> None:
    points = tapered()
    points[3::5, 0], points[4::5, 0] = -1e-3 * root, -1e-3 * end
    gripper = gripper_of_hand(hand(hull(points)), tcp=0.1)
    faces = as_faces(gripper.inner_faces)
    slopes = sorted(round(math.degrees(math.pi / 2 - face.angle), 3) for face in faces)
    assert slopes == [0.0, round(math.degrees(math.atan2(3.0, 25.0)), 3)]
    assert gripper.finger_thickness == pytest.approx(0.025)
    assert gripper.tip_thickness == pytest.approx(1e-3 * (end + (root - end) * 5.0 / 35.0))


@pytest.mark.slow
@settings(deadline=None, max_examples=40)
@given(convex_fingers())
def test_faces_of_a_convex_finger_are_its_hull(points: Floats) -> None:
    """They cover the hull seen along x without overlap, at most the tolerance in front of it."""
    seen = ConvexHull(points[:, 1:]).volume
    rows = ConvexHull(points).equations
    for tolerance in (EXACT, TOLERANCE):
        faces = hull_faces(points, tolerance=tolerance)
        corners = np.concatenate([face.corners for face in faces])
        assert (corners @ rows[:, :3].T + rows[:, 3]).max() <= tolerance + 1e-12
        total = sum(area(face.outline) for face in faces)
        assert seen * (1.0 - 1e-9) <= total <= seen + 0.1 * tolerance  # perimeter below 0.1 m
        for face in faces:
            middle = face.outline.mean(axis=0)[None]
            assert face.x(middle)[0] >= front_of([points], middle)[0] - 1e-12
            assert len(containing(faces, middle[0])) == 1
    for tolerance in (1e-5, TOLERANCE):  # those that a gripper may have
        faces = finger_faces(hull(points), tolerance=tolerance)
        stated = [corners for face in faces for corners in corners_of(face)]
        assert [problem_of_face(corners) for corners in stated] == [None] * len(stated)
        assert agreement(as_faces(tuple(stated)), faces, 1e-6) > 0.995


@pytest.mark.slow
@settings(deadline=None, max_examples=25)
@given(
    convex_fingers(),
    st.sampled_from([(a, b) for a in AXES for b in AXES if a[-1] != b[-1]]),
    st.floats(0.5, 2.0),
)
def test_frame_and_size_of_the_hand_and_order_of_its_fingers_change_nothing(
    points: Floats, axes: tuple[str, str], scale: float
) -> None:
    shape = hull(points)
    one = gripper_of_hand(hand(shape), tcp=0.1)
    other = gripper_of_hand(hand(shape, axes=axes), tcp=0.1)
    assert other.tip_thickness == pytest.approx(one.tip_thickness)
    faces = as_faces(one.inner_faces)
    assert agreement(finger_faces(shape, front=-0.03), faces, 1e-6) > 0.99
    limit = 20.0 * TOLERANCE  # along x, of faces inclined by up to 3 degrees
    assert agreement(as_faces(other.inner_faces), faces, 1e-6) > 0.9
    assert agreement(as_faces(other.inner_faces), faces, limit) > 0.97
    larger = gripper_of_hand(hand(shape, scale=scale), tcp=scale * 0.1)
    back = tuple(
        tuple((x / scale, y / scale, z / scale) for x, y, z in face) for face in larger.inner_faces
    )
    assert agreement(as_faces(back), faces, limit / min(scale, 1.0)) > 0.97
    swapped = replace(hand(shape), fingers=hand(shape).fingers[::-1])
    turned = gripper_of_hand(swapped, tcp=0.1)  # by half a turn about z
    assert turned.base_axes == ("-x", "z")
    back = tuple(tuple((x, -y, z) for x, y, z in face) for face in turned.inner_faces)
    assert agreement(as_faces(back), faces, limit) > 0.97


def test_hollows_between_pieces_are_not_filled() -> None:
    """A thin tip in front of a bracket: the step between them is one."""
    tip, bracket = box((-5, -4, -5), (0, 4, 10)), box((-20, -10, -30), (-6, 10, 0))
    shape = np.concatenate([bracket, tip])
    found = finger_faces(shape)
    for front, size in ((0.0, 8 * 15), (-0.006, 20 * 30 - 8 * 5)):
        level = [face for face in found if abs(face.plane[0] - front) < 1e-9]
        assert sum(area(face.outline) for face in level) == pytest.approx(1e-6 * size)
        assert all(np.allclose(face.plane[1:], 0.0, atol=1e-9) for face in level)
    whole = finger_faces(np.delete(shape, 0, axis=0))  # not closed: one piece
    assert max(math.pi / 2 - face.angle for face in whole) > 0.1


def test_of_pieces_in_one_plane_each_part_is_seen_once() -> None:
    """A cross of two boxes, and a third one inside it."""
    upright, level = box((-10, -4, -20), (0, 4, 20)), box((-8, -10, -5), (0, 10, 5))
    inside = box((-9, -3, -3), (0, 3, 3))
    found = finger_faces(np.concatenate([upright, level, inside]))
    assert sum(area(face.outline) for face in found) == pytest.approx(1e-6 * (8 * 40 + 2 * 6 * 10))


def test_fingers_that_are_not_symmetric_keep_their_left_and_right() -> None:
    points = tapered()
    points[2, 0] = -0.006  # at y = -10 mm the inclined side ends farther back
    for axes in (("x", "z"), ("-y", "z"), ("z", "-x")):
        gripper = gripper_of_hand(hand(hull(points), axes=axes), tcp=0.1)
        corners = np.array([corner for face in gripper.inner_faces for corner in face])
        for y, x in ((-0.01, -0.006), (0.01, -0.003)):
            assert corners[corners[:, 1] == y, 0].min() == pytest.approx(x)


def turned_boxes(count: int, seed: int) -> list[Floats]:
    """Corners of boxes of 4 to 12 mm, in any directions, within 1 cm."""
    rng = np.random.default_rng(seed)
    turns = Rotation.random(count, random_state=rng).as_matrix()
    return [
        trimesh.creation.box(rng.uniform(0.004, 0.012, 3)).vertices @ turn
        + rng.uniform(0.0, 0.01, 3)
        for turn in turns
    ]


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(8))
def test_of_pieces_that_overlap_the_front_is_seen_once(seed: int) -> None:
    pieces = turned_boxes(3, seed)
    faces = finger_faces(np.concatenate([hull(piece) for piece in pieces]), tolerance=EXACT)
    points = np.random.default_rng(seed).uniform(-0.005, 0.015, (100, 2))
    for point, front in zip(points, front_of(pieces, points), strict=True):
        found = containing(faces, point)
        if len(containing(faces, point, margin=1e-4)) == len(found):  # beside no edge
            fronts = [face.x(point[None])[0] for face in found]
            assert fronts == ([pytest.approx(front, abs=2e-6)] if np.isfinite(front) else [])


def test_sides_with_a_draft_are_left_out_and_chamfers_kept() -> None:
    for degrees, count in ((2.0, 1), (10.0, 3)):
        wider = 14e-3 * math.tan(math.radians(degrees))
        front = [[0.0, y, z] for y in (-0.01, 0.01) for z in (-0.03, 0.01)]
        back = [[-0.014, y, z] for y in (-0.01 - wider, 0.01 + wider) for z in (-0.03, 0.01)]
        assert len(finger_faces(hull(np.array(front + back)))) == count


@pytest.mark.slow
def test_round_and_scattered_shapes_have_a_limited_number_of_faces() -> None:
    ball = trimesh.creation.icosphere(subdivisions=4, radius=0.03)
    found = finger_faces(np.asarray(ball.triangles))
    assert 30 < len(found) <= MOST_FACES
    assert max(np.linalg.norm(face.corners, axis=1).max() for face in found) < 0.032
    pieces = turned_boxes(25, seed=0)
    found = finger_faces(np.concatenate([hull(piece) for piece in pieces]))
    assert 0 < len(found) <= MOST_FACES
    whole = hull_faces(np.concatenate(pieces))  # together one hull
    assert agreement(found, whole, 1e-9) > 0.9


def test_fingers_that_do_not_mirror_each_other_touch_with_their_pads() -> None:
    one, longer = hull(tapered()), hull(tapered(pad=14.0))
    differ = gripper_of_hand(hand(one, longer), tcp=0.1)
    assert differ.inner_faces == ()
    assert differ.source.endswith("; their inner sides differ: flat pads alone")
    alike = gripper_of_hand(hand(one, hull(tapered() * [1.1, 1.0, 1.0])), tcp=0.1)
    assert len(alike.inner_faces) == 2
    assert "differ" not in alike.source


def test_fingers_without_volume_and_very_large_ones_touch_with_their_pads() -> None:
    flat = np.array([[[0, -0.01, -0.03], [0, 0.01, -0.03], [0, 0.0, 0.01]]])
    assert finger_faces(flat) == []
    large = gripper_of_hand(hand(hull(tapered()), scale=60.0), tcp=6.0)
    assert large.inner_faces == ()


def solid_points(seed: int) -> Floats:
    """Corners of a convex object of about 3 cm."""
    return np.random.default_rng(seed).normal(size=(20, 3)) * 0.008


@pytest.mark.slow
@settings(deadline=None, max_examples=15)
@given(convex_fingers(), st.integers(0, 99))
def test_jaws_touch_where_the_finger_does(points: Floats, seed: int) -> None:
    """The first touch of all faces is that of the hull; those that are read are slightly ahead."""
    shape = hull(points)
    faces = finger_faces(shape, tolerance=EXACT)
    assume(len(faces) == len(hull_faces(points, tolerance=EXACT)))  # none is steep or a sliver
    stated = tuple(corners for face in faces for corners in corners_of(face))
    exact = pads(inner_faces=stated, compliance=0.0, finger_thickness=0.015)
    read = replace(gripper_of_hand(hand(shape), tcp=0.1), compliance=0.0)
    body = trimesh.convex.convex_hull(solid_points(seed))
    mesh = load_mesh(body, unit="m", max_edge=1.0)
    poses = random_poses(6, 0.008, seed)
    found, ahead = close_jaws(mesh, poses, exact), close_jaws(mesh, poses, read)
    for row, matrix in enumerate(poses):
        local = (body.vertices - matrix[:3, 3]) @ matrix[:3, :3]
        ways = [first_touch(points, local * [side, 1.0, 1.0]) for side in (1.0, -1.0)]
        reaches = min(ways) > -HALF_STROKE and sum(ways) < 0.0  # it starts outside the object
        assert found.closed[row] == reaches
        if reaches:
            assert found.opening[row] == pytest.approx(-sum(ways), abs=2e-7)
            assert -2e-7 <= ahead.opening[row] + sum(ways) <= 2.0 * TOLERANCE / math.sin(STEEP)
