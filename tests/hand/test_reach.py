"""Which grasps a gripper reaches: known shapes, laws, and poses that are free."""

import math
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from grasp3d import ObjectMesh, load_mesh
from grasp3d._kernels.jaws.gripper_parts import make_workspace
from grasp3d._kernels.jaws.reaching import can_reach
from grasp3d.hand.parallel_gripper import ParallelGripper
from grasp3d.hand.reach import ANGLES, NormalizedScene, Reach, Reachability, collides, reach_grasps
from grasp3d.hand.table import Approach, Table
from grasp3d.settings.units import METRES, Unit
from tests.helpers import shapes
from tests.helpers.collisions import Oracle
from tests.helpers.grippers import GRIPPERS, HAND, SLIM, TIPS, normalized_poses, opposed

BOX = (60.0, 40.0, 20.0)
"""Sides of a block [mm]."""

MM = 1e-3


def block() -> ObjectMesh:
    return load_mesh(shapes.box(BOX), unit="mm", max_edge=9.0)


def reach_of(
    mesh: ObjectMesh, points: np.ndarray, normals: np.ndarray, hand: ParallelGripper, **options: Any
) -> Reach:
    """What is reached of contacts in millimetres, with lengths in millimetres."""
    reach = reach_grasps(mesh, MM * points, normals, hand, **options)
    poses = reach.poses.copy()
    poses[:, :3, 3] /= MM
    lengths = {name: getattr(reach, name) / MM for name in ("opening", "pregrasp_opening", "depth")}
    return replace(reach, poses=poses, **lengths)


def across(axis: int, at: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> tuple:
    """Contacts on two opposite sides of the block, and their inward normals."""
    points, normals = np.tile(np.array(at), (2, 1)), np.zeros((2, 3))
    points[:, axis] = -0.5 * BOX[axis], 0.5 * BOX[axis]
    normals[:, axis] = 1.0, -1.0
    return points[None], normals[None]


def names(reach: Reach) -> list[str]:
    return [Reachability(state).name for state in reach.state]


def directions(reach: Reach) -> np.ndarray:
    """Approach directions of the first grasp at its angles, whose first one is a pose's."""
    y, z = reach.poses[0, :3, 1], reach.poses[0, :3, 2]
    free = reach.free[0]
    turns = 2.0 * np.pi * np.arange(len(free)) / len(free)
    return np.outer(np.cos(turns), z) - np.outer(np.sin(turns), y)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_block_is_reached_from_all_around_each_pair_of_its_sides(axis: int) -> None:
    reach = reach_of(block(), *across(axis), HAND)
    # The palm is 36 mm behind the contacts, and meets corners only, those of the large side.
    assert names(reach) == ["REACHED"]
    assert reach.opening[0] == pytest.approx(BOX[axis])
    assert reach.pregrasp_opening[0] == pytest.approx(BOX[axis] + 4.0)
    assert reach.depth[0] == pytest.approx(9.0)
    sides = np.delete(0.5 * np.array(BOX), axis)
    toward = np.abs(np.delete(np.array(directions(reach)), axis, axis=1))
    assert (reach.free[0] == (toward @ sides < 36.0)).all()
    assert reach.free.all() == (axis != 2)
    assert reach.approach_margin[0] == pytest.approx(math.pi if axis != 2 else math.pi / 4)
    assert reach.poses[0, :3, 3] == pytest.approx(np.zeros(3), abs=1e-9)


def test_the_pose_is_the_grasps_frame() -> None:
    points, normals = across(1, (2.0, 0.0, -1.5))
    reach = reach_of(block(), points, normals, HAND, table=None)
    pose = reach.poses[0]
    assert pose[:3, 0] == pytest.approx((points[0, 1] - points[0, 0]) / BOX[1])
    assert np.linalg.det(pose[:3, :3]) == pytest.approx(1.0)
    assert pose[:3, 3] == pytest.approx(points[0].mean(axis=0))
    # All around is free: the approach is toward the centre of the object.
    assert reach.free.all()
    assert pose[:3, 2] == pytest.approx([-0.8, 0.0, 0.6])


def test_beside_a_table_a_block_is_reached_from_above_only(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("grasp3d.hand.reach.ANGLES", 64)
    mesh = block()
    reach = reach_of(mesh, *across(1), HAND, table=Table.below(mesh))
    # The fingers' lower corners are 9 mm below and 10 mm beside the contacts, which are 10 mm up.
    turn = math.atan2(10.0, 9.0) - math.acos(10.0 / math.hypot(9.0, 10.0))
    count = int(turn / (2.0 * math.pi / 64))
    assert reach.free[0, [*range(count + 1), *range(-count, 0)]].all()
    assert reach.free.sum() == 2 * count + 1 == 3
    assert reach.poses[0, :3, 2] == pytest.approx([0.0, 0.0, -1.0])
    assert reach.approach_margin[0] == pytest.approx(2.0 * math.pi / 64)
    assert names(reach_of(mesh, *across(2), HAND, table=Table.below(mesh))) == ["TABLE"]
    # A finger cannot go into a deep hole beside a table either.
    tube = load_mesh(shapes.tube(5.0, 15.0, 200.0), unit="mm", max_edge=9.0)
    points = np.array([[[5.0, 0.0, 0.0], [15.0, 0.0, 0.0]]])
    for table in (None, Table.below(tube)):
        reach = reach_of(tube, points, across(0)[1], HAND, table=table)
        assert names(reach) == ["BLOCKED"]


def test_approach_limits() -> None:
    mesh = block()
    down = Approach(np.array([0.0, 0.0, -1.0]), within=math.radians(30.0))
    reach = reach_of(mesh, *across(1), HAND, approach=down)
    step = 2.0 * math.pi / ANGLES
    assert reach.free.sum() == 2 * int(math.radians(30.0) / step) + 1
    assert reach.poses[0, :3, 2] == pytest.approx([0.0, 0.0, -1.0])
    none = reach_of(mesh, *across(2), HAND, approach=down)
    assert names(none) == ["DIRECTION"]
    assert np.isnan(none.poses).all()
    assert np.isnan(none.approach_margin).all()


@pytest.mark.parametrize(
    ("radius", "state", "depth"),
    [(10.0, "REACHED", 9.0), (38.0, "REACHED", 4.5), (38.01, "WIDTH", math.nan)],
)
def test_a_ball_in_the_gap(radius: float, state: str, depth: float) -> None:
    """Balls of more than 36 mm radius touch the palm unless the fingers reach less far."""
    mesh = load_mesh(shapes.sphere(3, radius), unit="mm", max_edge=9.0)
    top = mesh.file_points[mesh.vertices[:, 0].argmax()]
    points, normals = np.stack([-top, top])[None], np.stack([top, -top])[None]
    reach = reach_of(mesh, points, normals, HAND)
    assert names(reach) == [state]
    assert reach.depth[0] == pytest.approx(depth, nan_ok=True)


@pytest.mark.parametrize(("beside", "state"), [(7.4, "TIP"), (7.6, "REACHED"), (20.0, "REACHED")])
def test_a_round_tip_in_an_inner_corner(beside: float, state: str) -> None:
    """A wall nearer than the radius of 8 mm less the compliance is touched before the base."""
    base, wall = trimesh.creation.box((100, 60, 10)), trimesh.creation.box((10, 60, 60))
    wall.apply_translation((45.0, 0.0, 25.0))
    profile = trimesh.boolean.union([base, wall], engine="manifold")
    mesh = load_mesh((profile.vertices, profile.faces), unit="mm", max_edge=9.0)
    x = 40.0 - beside
    points = np.array([[[x, 0.0, -5.0], [x, 0.0, 5.0]]])
    normals = np.array([[[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]])
    reach = reach_of(mesh, points, normals, TIPS)
    assert names(reach) == [state]
    if state == "REACHED":
        assert reach.opening[0] == pytest.approx(10.0)
        assert reach.depth[0] == pytest.approx(8.0)


def test_a_round_tip_must_open_freely() -> None:
    """Two walls: the tip fits beside one of them, but the other is nearer than the clearance."""
    walls = [trimesh.creation.box((60, 60, 10)) for _ in range(2)]
    for gap, state in ((16.0 + 1.0, "TIP"), (16.0 + 3.0, "REACHED")):
        far = walls[1].copy()
        far.apply_translation((0.0, 0.0, 10.0 + gap))
        both = trimesh.util.concatenate([walls[0], far])
        mesh = load_mesh((both.vertices, both.faces), unit="mm", max_edge=9.0)
        points = np.array([[[20.0, 0.0, -5.0], [20.0, 0.0, 5.0]]])
        normals = np.array([[[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]])
        thin = replace(TIPS, finger_thickness=0.004, palm_thickness=0.08)
        assert names(reach_of(mesh, points, normals, thin))[0] == state


def test_a_ring_is_held_from_inside() -> None:
    mesh = load_mesh(shapes.tube(30.0, 40.0, 20.0), unit="mm", max_edge=9.0)
    points = np.array([[[-30.0, 0.0, 0.0], [30.0, 0.0, 0.0]]])
    normals = np.array([[[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]])
    reach = reach_of(mesh, points, normals, SLIM, grip=-1)
    assert names(reach) == ["REACHED"]
    # The commanded opening is that between the fingers' inner faces.
    assert reach.opening[0] == pytest.approx(60.0 - 2 * 4.0)
    assert reach.pregrasp_opening[0] == pytest.approx(60.0 - 2 * 4.0 - 4.0)
    assert abs(reach.poses[0, 2, 2]) == pytest.approx(1.0)  # along the axis of the ring
    found = reach_grasps(mesh, MM * points, normals, SLIM, grip=-1)
    assert not collides(mesh, found.poses, found.opening, SLIM, grip=-1).any()
    assert collides(mesh, found.poses, found.opening + 3.0 * MM, SLIM, grip=-1).all()
    # Fingers of 20 mm width do not fit to the curve, and of 30 mm thickness do not fit at all.
    assert names(reach_of(mesh, points, normals, HAND, grip=-1)) == ["BLOCKED"]
    thick = replace(SLIM, finger_thickness=0.029)
    assert names(reach_of(mesh, points, normals, thick, grip=-1)) == ["WIDTH"]


@cache
def blob() -> ObjectMesh:
    vertices, faces = shapes.lopsided()
    return load_mesh((25.0 * vertices, faces), unit="mm", max_edge=9.0)


@pytest.fixture(scope="module")
def held() -> tuple[ObjectMesh, np.ndarray, np.ndarray]:
    mesh = blob()
    return mesh, *opposed(mesh, 60, seed=0)


@pytest.mark.parametrize("hand", GRIPPERS, ids=lambda hand: hand.name)
@pytest.mark.parametrize("stands", [False, True])
def test_poses_are_free(held: tuple, hand: ParallelGripper, stands: bool) -> None:
    mesh, points, normals = held
    table = Table.below(mesh) if stands else None
    reach = reach_grasps(mesh, points, normals, hand, table=table)
    ok = reach.reached
    assert 0 < ok.sum() < len(ok)
    assert not collides(mesh, reach.poses[ok], reach.opening[ok], hand, table=table).any()
    scale = 1.0 / mesh.size
    oracle = Oracle(mesh.contact_surface.points, mesh.contact_surface.faces)
    poses = normalized_poses(mesh, reach.poses[ok])
    for pose, opening in zip(poses, reach.opening[ok] / mesh.size, strict=True):
        assert oracle.collides(pose, opening, hand, scale) is not True


@pytest.mark.parametrize("hand", GRIPPERS, ids=lambda hand: hand.name)
def test_every_angle_is_blocked_or_free_as_its_own_pose(held: tuple, hand: ParallelGripper) -> None:
    mesh, points, normals = held
    reach = reach_grasps(mesh, points, normals, hand)
    step = 2.0 * np.pi / 32
    for i in np.flatnonzero(reach.reached)[:8]:
        pose, free = reach.poses[i], reach.free[i]
        turned = np.tile(pose, (32, 1, 1))
        for k in range(32):
            c, s = math.cos(step * k), math.sin(step * k)
            turned[k, :3, 1] = c * pose[:3, 1] + s * pose[:3, 2]
            turned[k, :3, 2] = c * pose[:3, 2] - s * pose[:3, 1]
            turned[k, :3, 3] = points[i].mean(axis=0)
            if hand.round_tips:
                turned[k, :3, 3] = pose[:3, 3]
            else:
                offset = (pose[:3, 3] - points[i].mean(axis=0)) @ pose[:3, 2]
                turned[k, :3, 3] += offset * turned[k, :3, 2]
        hit = collides(mesh, turned, reach.opening[i], hand)
        assert any((np.roll(free, -k) == ~hit).all() for k in range(32))


@pytest.mark.parametrize("hand", GRIPPERS, ids=lambda hand: hand.name)
@pytest.mark.parametrize("stands", [False, True])
def test_one_free_angle_is_found_exactly_where_there_is_any(
    held: tuple, hand: ParallelGripper, stands: bool
) -> None:
    mesh, points, normals = held
    table = Table.below(mesh) if stands else None
    reached = reach_grasps(mesh, points, normals, hand, table=table).reached
    scene, workspace = NormalizedScene.of(mesh, hand, table, Approach()), make_workspace(32)
    inner = (points - mesh.center) / mesh.size
    found = [can_reach(*one, 1, *scene, workspace) for one in zip(inner, normals, strict=True)]
    assert (reached == found).all()
    back = reach_grasps(mesh, points[::-1], normals[::-1], hand, table=table)
    assert (back.reached[::-1] == reached).all()


@pytest.mark.slow
@settings(deadline=None, max_examples=8)
@given(
    seed=st.integers(0, 10_000),
    scale=st.floats(0.5, 20.0),
    shift=st.tuples(*[st.floats(-0.5, 0.5)] * 3),
    unit=st.sampled_from(["mm", "cm"]),
)
def test_moving_and_scaling_everything_changes_nothing(
    seed: int, scale: float, shift: tuple, unit: Unit
) -> None:
    mesh = blob()
    points, normals = opposed(mesh, 12, seed=3)
    turn = shapes.rotation(seed)
    moved = scale * mesh.vertices @ turn.T + shift
    moved_mesh = load_mesh((moved / METRES[unit], mesh.faces), unit=unit, max_edge=1e6)
    large = replace(
        HAND,
        **{
            name: scale * getattr(HAND, name)
            for name in (
                "max_opening", "finger_thickness", "finger_width", "finger_length", "pad_width",
                "pad_height", "palm_thickness", "palm_width", "palm_length", "compliance",
                "clearance",
            )
        },
    )  # fmt: skip
    table = Table.below(mesh)
    moved_table = Table(turn @ table.normal, scale * table.offset + turn @ table.normal @ shift)
    one = reach_grasps(mesh, points, normals, HAND, table=table)
    two = reach_grasps(
        moved_mesh, scale * points @ turn.T + shift, normals @ turn.T, large, table=moved_table
    )
    assert (one.state == two.state).all()
    assert (one.free == two.free).all()
    ok = one.reached
    assert two.opening == pytest.approx(scale * one.opening, nan_ok=True)
    assert np.allclose(two.poses[ok, :3, :3], turn @ one.poses[ok, :3, :3], atol=1e-6)
    expected = scale * one.poses[ok, :3, 3] @ turn.T + shift
    assert np.allclose(two.poses[ok, :3, 3], expected, atol=1e-8 * scale)
