"""Descriptions of grippers: what is refused, what follows from them, and their JSON."""

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from grasp3d.errors import SettingError
from grasp3d.hand.choices import AXES
from grasp3d.hand.hand_files import read_hand, write_hand
from grasp3d.hand.parallel_gripper import ALIASES, PRESETS, ParallelGripper

FLAT: dict[str, Any] = {
    "name": "flat",
    "max_opening": 0.08,
    "finger_thickness": 0.01,
    "finger_width": 0.02,
    "finger_length": 0.045,
    "pad_width": 0.015,
    "pad_height": 0.02,
    "palm_thickness": 0.1,
    "palm_width": 0.06,
    "palm_length": 0.05,
}
ROUND = FLAT | {"name": "round", "pad_width": 0.0, "pad_height": 0.0, "tip_radius": 0.01}


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"max_opening": 0.0}, "max_opening must be above 0"),
        ({"max_opening": 80.0}, "is it in millimetres"),
        ({"min_opening": 0.078}, "larger than the clearance on both sides"),
        ({"pad_width": 0.03}, "pad_width (0.03 m) must be at most finger_width (0.02 m)"),
        ({"palm_thickness": 0.07}, "must be at most palm_thickness (0.07 m)"),
        ({"tip_radius": 0.01}, "either flat pads"),
        ({"name": 3}, "name must be a text; got 3"),
        ({"pad_width": "2 cm"}, 'pad_width must be a number; got "2 cm"'),
        ({"inner_faces": 5}, "inner_faces must be a list of faces"),
        ({"max_force": 0.0}, "max_force must be a finite force above 0"),
        ({"joint_names": ("one",)}, "a number for each of the 1 joint_names"),
        ({"base_axes": ("x", "-x")}, "two axes at right angles"),
        (
            ROUND | {"tip_radius": 0.009, "finger_thickness": 0.019},
            "at most the diameter of the round tips, 0.018",
        ),
    ],
)
def test_impossible_grippers_are_refused(changed: dict[str, Any], words: str) -> None:
    with pytest.raises(SettingError, match=r"gripper ('flat'|'round'|3)") as refused:
        ParallelGripper(**(FLAT | changed))
    assert words in str(refused.value)
    assert "\n" not in str(refused.value)


def test_the_torsion_radius_is_that_of_a_disc_of_the_area_of_the_pad() -> None:
    gripper = ParallelGripper(**FLAT)
    disc = math.sqrt(0.015 * 0.02 / math.pi)
    assert gripper.torsion_radius(0.5) == pytest.approx(2.0 / 3.0 * 0.5 * disc)
    assert ParallelGripper(**ROUND).torsion_radius(0.5) == 0.0


def test_fingers_end_at_the_pads_ends_or_the_centres_of_the_tips() -> None:
    assert ParallelGripper(**FLAT).end == 0.01
    assert ParallelGripper(**ROUND).end == 0.0


@given(st.sampled_from([(a, b) for a in AXES for b in AXES if a[-1] != b[-1]]), st.floats(0.0, 0.5))
def test_the_base_pose_takes_the_axes_of_the_hand_to_those_of_the_gripper(
    axes: tuple[str, str], length: float
) -> None:
    gripper = ParallelGripper(**FLAT, base_axes=axes, base_to_tcp=length)
    pose = gripper.base_pose
    assert np.linalg.det(pose[:3, :3]) == pytest.approx(1.0)
    closing, approach = (np.array([*AXES[name], 0.0]) for name in axes)
    assert (pose @ closing).tolist() == [1.0, 0.0, 0.0, 0.0]
    assert (pose @ approach).tolist() == [0.0, 0.0, 1.0, 0.0]
    tcp = length * np.array(AXES[axes[1]])
    assert np.allclose(pose @ [*tcp, 1.0], [0.0, 0.0, 0.0, 1.0])


PUBLISHED = {  # stroke [mm] and greatest force [N], from the data sheets
    "franka": (80, 70),
    "robotiq_2f85": (85, 235),
    "robotiq_2f140": (140, 125),
    "wsg50": (110, 80),
    "tactile": (100, 40),
}


@pytest.mark.parametrize("name", PRESETS)
def test_presets_have_the_published_stroke_and_force(name: str) -> None:
    gripper = ParallelGripper.preset(name)
    assert (round(1e3 * gripper.max_opening), gripper.max_force) == PUBLISHED[name]
    assert gripper.name == name
    assert gripper.source


@pytest.mark.parametrize("name", PRESETS)
def test_joints_close_and_open(name: str) -> None:
    """At most one metre or radian from closed to open, and the same for both fingers."""
    gripper = ParallelGripper.preset(name)
    values = [
        [closed + scale * opening for opening in (0.0, gripper.max_opening)]
        for closed, scale in zip(gripper.joint_closed, gripper.joint_scale, strict=True)
    ]
    changes = [abs(opened - closed) for closed, opened in values]
    assert all(0.0 < change < 1.0 for change in changes)
    assert np.ptp(changes or [0.0]) == pytest.approx(0.0)
    if name.startswith("robotiq"):
        assert values[0][1] == pytest.approx(0.0, abs=1e-12)


LENGTHS = st.floats(1e-4, 0.05)


@st.composite
def grippers(draw: st.DrawFn) -> ParallelGripper:
    finger, opening = draw(LENGTHS), draw(st.floats(0.01, 0.05))
    is_round = draw(st.booleans())
    joints = draw(st.integers(0, 3))
    numbers = st.floats(-10.0, 10.0)
    return ParallelGripper(
        name=draw(st.text(max_size=10)),
        max_opening=opening,
        finger_thickness=finger,
        finger_width=2.0 * finger,
        finger_length=3.0 * finger,
        pad_width=0.0 if is_round else finger,
        pad_height=0.0 if is_round else 3.0 * finger,
        tip_radius=finger if is_round else 0.0,
        palm_thickness=opening + draw(LENGTHS),
        palm_width=draw(LENGTHS),
        palm_length=draw(LENGTHS),
        max_force=draw(st.none() | st.floats(0.1, 1e4)),
        sensor_resolution=draw(st.none() | st.floats(0.0, 3.0)),
        base_to_tcp=draw(LENGTHS),
        base_axes=draw(st.sampled_from([("x", "z"), ("-y", "x")])),
        joint_names=tuple(f"joint {number}" for number in range(joints)),
        joint_scale=tuple(draw(numbers) for _ in range(joints)),
        joint_closed=tuple(draw(numbers) for _ in range(joints)),
        source=draw(st.text(max_size=10)),
    )


@pytest.mark.slow
@settings(max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(grippers())
def test_what_is_written_is_read_again(tmp_path: Path, gripper: ParallelGripper) -> None:
    write_hand(tmp_path / "g.json", gripper)
    assert read_hand(tmp_path / "g.json") == gripper


def test_a_person_writes_lengths_and_a_name(tmp_path: Path) -> None:
    lengths = {
        "max_opening": 0.08, "finger_thickness": 0.026, "finger_width": 0.021,
        "finger_length": 0.0462, "pad_width": 0.0174, "pad_height": 0.0176,
        "palm_thickness": 0.208, "palm_width": 0.0633, "palm_length": 0.092,
    }  # fmt: skip
    path = tmp_path / "mine.json"
    path.write_text(json.dumps({"name": "mine", **lengths}), encoding="utf-8")
    assert read_hand(path) == ParallelGripper(name="mine", **lengths)


def changed(folder: Path, **values: Any) -> Path:
    """A file of the Franka hand with other values; those that are None are left out."""
    path = folder / "g.json"
    write_hand(path, ParallelGripper.preset("franka"))
    content = json.loads(path.read_text(encoding="utf-8")) | values
    removed = {name for name, value in values.items() if value is None}
    kept = {name: value for name, value in content.items() if name not in removed}
    path.write_text(json.dumps(kept), encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"format": "other"}, 'expected an object with "format": "grasp3d gripper"'),
        ({"version": 2}, "version must be 1; got 2"),
        ({"unit": "mm"}, 'unit must be "m"; got "mm"'),
        ({"max_openning": 0.08}, "no key is called 'max_openning' (did you mean max_opening?)"),
        ({"max_opening": "80 mm"}, 'max_opening must be a number; got "80 mm"'),
        ({"max_opening": 80}, "is it in millimetres?"),
        ({"pad_width": math.nan}, "is not valid JSON: NaN is not a finite number"),
    ],
)
def test_wrong_contents_are_refused_in_one_sentence(
    tmp_path: Path, values: dict[str, Any], words: str
) -> None:
    path = changed(tmp_path, **values)
    with pytest.raises(SettingError) as refused:
        read_hand(path)
    assert str(refused.value).startswith(str(path))
    assert words in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_name_is_a_preset_and_a_path_a_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for name, gripper in PRESETS.items():
        assert read_hand(name) is gripper
    assert ALIASES["panda"] == "franka"
    assert read_hand("panda") is PRESETS["franka"]
    write_hand("mine.json", replace(ParallelGripper.preset("franka"), name="mine"))
    assert read_hand("mine.json").name == "mine"
    assert read_hand(tmp_path / "mine.json").name == "mine"
    with pytest.raises(SettingError, match="no gripper is called 'mine'; known"):
        read_hand("mine")
    with pytest.raises(SettingError, match="there is no such file"):
        read_hand("folder/mine.json")
