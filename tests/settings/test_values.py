"""Laws of texts and values: what settings make of a text is what its text makes again."""

import math
import pickle
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasp3d import GraspModel, MeshOptions
from grasp3d.errors import SettingError
from grasp3d.quality.loads import Load, TaskText
from grasp3d.settings.grasp_model import friction_interval
from grasp3d.settings.parsing import plain_values, settings_of_texts
from grasp3d.settings.units import METRES, parse_angle, parse_length

UNITS = st.sampled_from(list(METRES))
TEXTS = st.builds("{!r} {}".format, st.floats(1e-6, 1e6), UNITS)
LENGTHS = TEXTS.map(lambda text: parse_length("it", text))
ANGLES = st.floats(0.0, 1.0)
FRICTIONS = st.tuples(st.floats(0.01, 2.0), st.floats(0.01, 2.0)).map(sorted).map(tuple)


@given(angle=st.floats(-10.0, 10.0), space=st.sampled_from(["", " "]))
def test_an_angle_is_its_text_in_every_unit(angle: float, space: str) -> None:
    assert parse_angle("it", f"{angle!r}{space}rad") == angle
    in_radians = math.radians(angle)
    for unit in ("", "deg", "DEG", "degrees", "°"):
        assert parse_angle("it", f"{angle!r}{space}{unit}") == in_radians
    degrees = f"{math.degrees(angle)!r}{space}deg"
    assert parse_angle("it", degrees) == pytest.approx(angle, rel=1e-15, abs=1e-300)


@pytest.mark.parametrize("text", ["", "deg", "steep", "5 furlongs", "15 deg rad", "1,5"])
def test_what_is_no_angle_is_refused(text: str) -> None:
    with pytest.raises(SettingError, match=r"^tilt must be an angle \(a number .*; got"):
        parse_angle("tilt", text)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("axis", range(3))
def test_a_position_is_finite(bad: float, axis: int) -> None:
    position = tuple(bad if one == axis else 0.0 for one in range(3))
    for point in (position, list(position), ",".join(map(str, position))):
        with pytest.raises(SettingError, match="center_of_mass must be 3 finite lengths"):
            MeshOptions(center_of_mass=point)  # type: ignore[arg-type]


@given(ends=FRICTIONS)
def test_an_interval_is_its_text(ends: tuple[float, float]) -> None:
    model = GraspModel(friction=ends)
    assert model == GraspModel(friction="..".join(map(repr, ends)))
    assert model == replace(model) == GraspModel(friction=model.friction)
    assert model.friction_interval == friction_interval(ends) == ends
    assert ends[0] <= model.nominal_friction <= ends[1]


@given(
    radius=st.one_of(st.floats(0.0, 10.0), LENGTHS),
    ends=FRICTIONS,
    fingers=st.integers(2, 5),
)
def test_settings_are_read_from_their_texts(radius: Any, ends: Any, fingers: int) -> None:
    model = GraspModel(torsion_radius=radius, friction=ends, fingers=fingers)
    texts = {name: str(value) for name, value in plain_values(model).items()}
    assert settings_of_texts(GraspModel, texts) == model
    assert pickle.loads(pickle.dumps(model)) == model  # noqa: S301


def test_values_of_files_are_plain() -> None:
    load = Load(task="weight + wrench 1,0,0,0,0,0", mass="500 g")
    values = plain_values(load)
    assert values["task"] == "weight + wrench 1,0,0,0,0,0"
    assert values["mass"] == 0.5
    assert load.task == TaskText.of(values["task"])
    options = plain_values(MeshOptions(center_of_mass="10mm,0,1"))
    assert options["center_of_mass"] == "0.01,0.0,1.0"
