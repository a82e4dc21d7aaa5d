"""A gripper beside an object: settings, directions, strokes."""

import math
from typing import Any

import numpy as np
import pytest

from grasp3d import GraspModel, Sampling, evaluate_grasps, label_surface, load_mesh
from grasp3d.errors import SettingError
from grasp3d.hand.parallel_gripper import ParallelGripper
from grasp3d.hand.reach_settings import ReachSettings
from grasp3d.hand.scene import Scene
from grasp3d.hand.table import Approach
from grasp3d.settings.units import METRES
from tests.helpers import shapes
from tests.helpers.grippers import HAND, TIPS

BOX = load_mesh(shapes.box((60.0, 40.0, 20.0)), unit="mm", max_edge=9.0)


def test_without_a_gripper_there_is_nothing() -> None:
    assert Scene.of(ReachSettings(), BOX) is None
    assert Scene.given(BOX, None) is None
    with pytest.raises(SettingError, match="apply to grippers only"):
        Scene.given(BOX, None, approach=Approach())


@pytest.mark.parametrize("hand", [HAND.name, ParallelGripper, 0.08])
def test_what_is_no_hand_is_refused(hand: Any) -> None:
    known = r"hand must be a Hand, .* its name \('franka'\) or its file|no gripper is called"
    with pytest.raises(SettingError, match=known):
        Scene.given(BOX, hand)
    with pytest.raises(SettingError, match=known):
        label_surface(BOX, hand=hand)
    with pytest.raises(SettingError, match=known):
        evaluate_grasps(BOX, np.eye(4), hand=hand)


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


def test_without_a_table_up_still_says_where_down_is() -> None:
    scene = Scene.of(ReachSettings(HAND, up="-x", approach_within=0.5), BOX)
    assert scene.table is None
    assert scene.approach.direction == pytest.approx([1.0, 0.0, 0.0])


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({}, []),
        ({"table": "as-is"}, ["up is z (--up)"]),
        ({"up": "-y", "approach_within": 1.0}, ["up is -y (--up)"]),
        ({"table": "stable"}, ["resting pose of probability"]),
    ],
)
def test_words_say_which_way_is_up(settings: dict[str, Any], words: list[str]) -> None:
    scene = Scene.of(ReachSettings(HAND, **settings), BOX)
    assert scene is not None
    own, *others = scene.words
    assert own == f"gripper {HAND.name}"
    assert [text[: len(word)] for text, word in zip(others, words, strict=True)] == words


def test_a_stable_table_is_that_of_the_resting_pose() -> None:
    scene = Scene.of(ReachSettings(HAND, "stable", resting_pose=5), BOX)
    assert abs(scene.table.normal[0]) == pytest.approx(1.0)
    assert scene.approach.direction == pytest.approx(-scene.table.normal)


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


def test_limits_outside_the_stroke_are_refused() -> None:
    with pytest.raises(SettingError, match=r"opens from 0 to 0\.076 m, which contradicts"):
        Scene(HAND).within_stroke(BOX, Sampling(min_opening="77mm"))


def test_grippers_make_no_grasps_of_three_fingers() -> None:
    for hand in (HAND, TIPS):
        hand.check_fingers(2)
        with pytest.raises(SettingError, match="has two fingers, not 3: leave it out"):
            hand.check_fingers(3)


@pytest.mark.parametrize(
    ("settings", "text"),
    [
        ({"table": "as-is"}, "applies to grippers only"),
        ({"hand": HAND, "resting_pose": 2}, "table stable only"),
        ({"hand": HAND, "table": "stable", "up": "x"}, "up does not apply"),
        ({"hand": HAND, "approach_within": 4.0}, "approach_within"),
    ],
)
def test_settings_that_contradict_are_refused(settings: dict, text: str) -> None:
    with pytest.raises(SettingError, match=text):
        ReachSettings(**settings)


def test_the_touch_of_a_gripper_is_that_of_the_model_unless_it_is_given() -> None:
    tactile = ParallelGripper.preset("tactile")
    own, given = GraspModel(), GraspModel(sensor_resolution=math.radians(7.0))
    touched = ReachSettings(tactile).touching(own)
    assert touched.sensor_resolution == tactile.sensor_resolution != own.sensor_resolution
    assert ReachSettings(tactile).touching(given) is given
    assert ReachSettings(HAND).touching(own) == own
    assert ReachSettings().touching(own) is own
