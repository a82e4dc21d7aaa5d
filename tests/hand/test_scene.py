"""A gripper beside an object: settings, strokes, tables and resting poses, and all as triangles."""

import math
from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

import grasp3d
from grasp3d import GraspModel, ObjectMesh, Sampling, evaluate_grasps, label_surface, load_mesh
from grasp3d.errors import SettingError
from grasp3d.hand.gripper_pose import GripperPose
from grasp3d.hand.parallel_gripper import PRESETS, ParallelGripper
from grasp3d.hand.reach_settings import ReachSettings
from grasp3d.hand.scene import Scene
from grasp3d.hand.table import Approach, Table
from grasp3d.hand.triangles import Part, Triangles, approach_triangles, table_triangles
from grasp3d.settings.units import METRES
from tests.helpers import shapes
from tests.helpers.grippers import HAND, TIPS

BOX = load_mesh(shapes.box((60.0, 40.0, 20.0)), unit="mm", max_edge=9.0)


@pytest.mark.parametrize("hand", [HAND.name, ParallelGripper, 0.08])
def test_what_is_no_hand_is_refused(hand: Any) -> None:
    known = r"hand must be a Hand, .* its name \('franka'\) or its file|no gripper is called"
    with pytest.raises(SettingError, match=known):
        Scene.given(BOX, hand)
    with pytest.raises(SettingError, match=known):
        label_surface(BOX, hand=hand)
    with pytest.raises(SettingError, match=known):
        evaluate_grasps(BOX, np.eye(4), hand=hand)
    with pytest.raises(SettingError, match="apply to grippers only"):
        Scene.given(BOX, None, approach=Approach())
    with pytest.raises(SettingError, match="up does not apply"):
        ReachSettings(HAND, "stable", "x")
    assert Scene.of(ReachSettings(), BOX) is None
    with pytest.raises(SettingError, match="has two fingers, not 3"):
        HAND.check_fingers(3)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        (ReachSettings(HAND), ()),
        (ReachSettings(HAND, up="-y", approach_within=1.0), ("up is -y (--up)",)),
        (ReachSettings(HAND, "stable"), ("resting pose of probability 32 %",)),
        (ReachSettings(HAND, pose_error="5mm,3deg"), ("poses wrong by up to 5 mm and 3 deg",)),
    ],
)
def test_words_say_which_way_is_up_and_how_wrong_poses_are(
    settings: ReachSettings, words: tuple[str, ...]
) -> None:
    scene = Scene.of(settings, BOX)
    assert scene is not None
    assert scene.words == (f"gripper {HAND.name}", *words)


def test_a_table_is_below_and_the_approach_into_it() -> None:
    for up, axis, offset in (("z", 2, -0.01), ("y", 1, -0.02)):
        settings = ReachSettings(HAND, "as-is", up, approach_within=1.0)
        scene = Scene.of(settings, BOX)
        assert scene.table.normal[axis] == 1.0
        assert scene.table.offset == pytest.approx(offset)
        assert scene.approach.direction == pytest.approx(-scene.table.normal)
        assert scene.approach.within == 1.0
    same = Scene.given(BOX, scene.hand, scene.table, scene.approach)
    assert vars(same) == vars(scene)
    rests = Scene.of(ReachSettings(HAND, "stable", resting_pose=5), BOX)
    assert abs(rests.table.normal[0]) == pytest.approx(1.0)
    assert rests.approach.direction == pytest.approx(-rests.table.normal)
    without = Scene.of(ReachSettings(HAND, up="-x", approach_within=0.5), BOX)
    assert without.table is None
    assert without.approach.direction == pytest.approx([1.0, 0.0, 0.0])


@pytest.mark.parametrize("unit", ["mm", "cm", "m", "in"])
def test_openings_are_limited_to_the_stroke_whatever_the_unit_of_the_file(unit: str) -> None:
    scale = 0.001 / METRES[unit]
    vertices, faces = shapes.box((60.0, 40.0, 20.0))
    mesh = load_mesh((scale * vertices, faces), unit=unit, max_edge=9.0)
    limited = Scene(HAND).within_stroke(mesh, Sampling())
    assert limited.max_opening == pytest.approx(0.076)
    assert limited.min_opening == 0.0
    narrow = Scene(HAND).within_stroke(mesh, Sampling(max_opening="30mm"))
    assert narrow.max_opening == 0.03
    # Round tips may touch at an angle.
    tips = Scene(TIPS).within_stroke(mesh, Sampling())
    assert tips.max_opening == pytest.approx(0.076 + 0.016)
    with pytest.raises(SettingError, match=r"opens from 0 to 0\.076 m, which contradicts"):
        Scene(HAND).within_stroke(mesh, Sampling(min_opening="77mm"))


def test_the_touch_of_a_gripper_is_that_of_the_model_unless_it_is_given() -> None:
    tactile = ParallelGripper.preset("tactile")
    own, given = GraspModel(), GraspModel(sensor_resolution=math.radians(7.0))
    touched = ReachSettings(tactile).touching(own)
    assert touched.sensor_resolution == tactile.sensor_resolution != own.sensor_resolution
    assert ReachSettings(tactile).touching(given) is given
    assert ReachSettings(HAND).touching(own) == own
    assert ReachSettings().touching(own) is own


def block(unit: str = "mm") -> ObjectMesh:
    return load_mesh(shapes.box((60.0, 40.0, 20.0)), unit=unit, max_edge=9.0)


@pytest.mark.parametrize(
    ("up", "height"),
    [("z", -0.01), ("-z", -0.01), ("y", -0.02), ("x", -0.03), ((0.0, 0.0, 5.0), -0.01),
     ((0.0, 1.0, 1.0), -0.03 / math.sqrt(2.0))],
)  # fmt: skip
def test_an_object_stands_on_its_lowest_points(up: object, height: float) -> None:
    table = Table.below(block(), up)
    assert np.linalg.norm(table.normal) == pytest.approx(1.0)
    assert table.offset == pytest.approx(height)
    assert table.probability is None
    vertices, faces = shapes.box((60.0, 40.0, 20.0))
    loose = np.concatenate([vertices, [[0.0, 0.0, -500.0]]])  # of no face
    assert Table.below(load_mesh((loose, faces), unit="mm"), up).offset == pytest.approx(height)


def test_resting_poses_are_on_the_faces_of_a_block_the_largest_first() -> None:
    mesh = block()
    tables = [Table.resting(mesh, number) for number in range(1, 7)]
    chances = [table.probability for table in tables]
    assert chances == sorted(chances, reverse=True)
    assert sum(chances) == pytest.approx(1.0, abs=0.01)
    assert {round(abs(table.offset), 6) for table in tables[:2]} == {0.01}
    assert {round(abs(table.offset), 6) for table in tables[4:]} == {0.03}
    assert np.abs([table.normal for table in tables]).max(axis=1) == pytest.approx(1.0)
    # The chance is the solid angle of the face from the centre of mass, by its closed form.
    x, y, z = 30.0, 20.0, 10.0
    angle = 4.0 * math.atan(x * y / (z * math.sqrt(x * x + y * y + z * z))) / (4.0 * math.pi)
    assert chances[0] == pytest.approx(angle, rel=0.01)
    with pytest.raises(SettingError, match="resting pose must be from 1 to 6"):
        Table.resting(mesh, 7)
    with pytest.raises(SettingError, match="resting pose must be from 1 to 6"):
        Table.resting(mesh, 0)


@pytest.mark.parametrize("vector", [(0.0, 0.0, 0.0), (0.0, math.nan, 1.0), (0.0, 1.0)])
def test_what_is_no_direction_is_refused(vector: tuple) -> None:
    with pytest.raises(SettingError, match="normal"):
        Table(np.array(vector), 0.0)
    with pytest.raises(SettingError, match="approach direction"):
        Approach(np.array(vector))


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
    for which in set(shape.parts.tolist()):
        assert part(shape, Part(which)).is_watertight
        assert part(shape, Part(which)).volume > 0.0
    there = GripperPose(POSE, opening, math.nan, math.nan, math.nan).triangles(gripper)
    assert np.allclose(there.vertices, trimesh.transform_points(shape.vertices, POSE))


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
