"""Grippers as JSON."""

import json
import math
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from grasp3d.errors import SettingError
from grasp3d.hand.hand_files import read_hand, write_hand
from grasp3d.hand.parallel_gripper import PRESETS, ParallelGripper

LENGTHS = st.floats(1e-4, 0.05)


@st.composite
def grippers(draw: st.DrawFn) -> ParallelGripper:
    """Any grippers, with flat pads or round tips."""
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


def test_every_field_is_in_the_file(tmp_path: Path) -> None:
    write_hand(tmp_path / "g.json", ParallelGripper.preset("tactile"))
    found = json.loads((tmp_path / "g.json").read_text(encoding="utf-8"))
    names = {field.name for field in fields(ParallelGripper)}
    assert set(found) == names | {"format", "version", "unit"}
    assert (found["format"], found["version"], found["unit"]) == ("grasp3d gripper", 1, "m")
    assert found["tip_radius"] == 0.01


def test_fields_with_defaults_may_be_missing(tmp_path: Path) -> None:
    path = changed(tmp_path, compliance=None, clearance=None, joint_names=None, joint_scale=None,
                   joint_closed=None)  # fmt: skip
    gripper = read_hand(path)
    expected = replace(
        ParallelGripper.preset("franka"),
        compliance=0.001,
        joint_names=(),
        joint_scale=(),
        joint_closed=(),
    )
    assert gripper == expected


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
        ({"pad_width": math.nan}, "is no JSON: NaN is no finite number"),
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
    write_hand("mine.json", replace(ParallelGripper.preset("franka"), name="mine"))
    assert read_hand("mine.json").name == "mine"
    assert read_hand(tmp_path / "mine.json").name == "mine"
    with pytest.raises(SettingError, match="no gripper is called 'mine'; known"):
        read_hand("mine")
    with pytest.raises(SettingError, match="there is no such file"):
        read_hand("folder/mine.json")
