"""Grippers, approach fans and tables as triangles."""

import math

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

import grasp3d
from grasp3d.hand.gripper_pose import GripperPose
from grasp3d.hand.parallel_gripper import PRESETS, ParallelGripper
from grasp3d.hand.table import Table
from grasp3d.hand.triangles import Part, Triangles, approach_triangles, table_triangles

POSE = trimesh.transformations.rotation_matrix(0.7, [1.0, 2.0, -0.5], [0.1, 0.0, 0.3])


def part(shape: Triangles, which: Part) -> trimesh.Trimesh:
    return trimesh.Trimesh(shape.vertices, shape.faces[shape.parts == which], process=True)


@pytest.mark.parametrize("name", PRESETS)
def test_parts_have_the_lengths_of_the_description(name: str) -> None:
    gripper = ParallelGripper.preset(name)
    opening = 0.6 * gripper.max_opening
    shape = gripper.shape(opening)
    palm, fingers = part(shape, Part.PALM), part(shape, Part.FINGER)
    sizes = gripper.palm_thickness, gripper.palm_width, gripper.palm_length
    assert palm.extents == pytest.approx(sizes)
    assert palm.bounds[1, 2] == pytest.approx(gripper.end - gripper.finger_length)
    assert fingers.extents[1:] == pytest.approx((gripper.finger_width, gripper.finger_length))
    assert fingers.bounds[1, 2] == pytest.approx(gripper.end)
    touching = part(shape, Part.TIP if gripper.round_tips else Part.PAD)
    gap = touching.vertices[touching.vertices[:, 0] > 0.0, 0].min()
    assert 2.0 * gap == pytest.approx(opening, rel=1e-3)
    if gripper.round_tips:
        assert touching.extents[2] == pytest.approx(2.0 * gripper.tip_radius)
        middle = 0.5 * opening + gripper.tip_radius
        far = middle + 0.5 * gripper.finger_thickness
    else:
        assert touching.extents[1:] == pytest.approx((gripper.pad_width, gripper.pad_height))
        far = 0.5 * opening + gripper.finger_thickness
    assert fingers.bounds[:, 0] == pytest.approx((-far, far))


@pytest.mark.parametrize("name", ["franka", "tactile"])
def test_parts_are_closed_and_face_outward(name: str) -> None:
    shape = ParallelGripper.preset(name).shape(0.03)
    for which in set(shape.parts.tolist()):
        mesh = part(shape, Part(which))
        assert mesh.is_watertight
        assert mesh.volume > 0.0


def test_poses_move() -> None:
    here = ParallelGripper.preset("franka").shape(0.04)
    pose = GripperPose(POSE, 0.04, math.nan, math.nan, math.nan)
    there = pose.triangles(ParallelGripper.preset("franka"))
    assert np.allclose(there.vertices, trimesh.transform_points(here.vertices, POSE))
    assert (there.faces == here.faces).all()


@given(st.floats(0.005, 3.0))
def test_the_fan_covers_the_angles_where_the_gripper_stands(margin: float) -> None:
    """Turned by an angle of the arc, the palm's side of the gripper is in the fan."""
    fan = approach_triangles(POSE, margin, radius=2.0, inner=0.5)
    mesh = trimesh.Trimesh(fan.vertices, fan.faces, process=False)
    area = margin * (2.0**2 - 1.0**2)
    assert mesh.area == pytest.approx(area, rel=1e-3)
    for angle in (-margin, margin):
        turn = trimesh.transformations.rotation_matrix(angle, [1.0, 0.0, 0.0])
        behind = (POSE @ turn @ [0.0, 0.0, -2.0, 1.0])[:3]
        assert np.linalg.norm(fan.vertices - behind, axis=1).min() < 1e-9


@pytest.mark.parametrize("up", ["z", "-y", [1.0, 1.0, 0.5]])
def test_tables_lie_below_the_object(up: object) -> None:
    box = grasp3d.load_mesh(trimesh.creation.box([80.0, 50.0, 30.0]), unit="mm")
    table = Table.below(box, up)  # type: ignore[arg-type]
    plate = table_triangles(table, box)
    heights = plate.vertices @ table.normal
    assert heights.max() < table.offset
    assert heights.max() == pytest.approx(table.offset, abs=1e-3 * box.size)
    assert np.ptp(heights) == pytest.approx(0.01 * box.size)
    mesh = trimesh.Trimesh(plate.vertices, plate.faces)
    assert mesh.is_watertight
    flat = box.vertices - np.outer(box.vertices @ table.normal, table.normal)
    across = plate.vertices - np.outer(heights, table.normal)
    radius = np.linalg.norm(across - across.mean(axis=0), axis=1).max()
    assert np.linalg.norm(flat - across.mean(axis=0), axis=1).max() < radius
