"""Texts and values of settings: units become SI, once; what is made of a text is its text again."""

import json
import math
import pickle
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasp3d import GraspModel, MeshOptions, Sampling, evaluate_grasps, label_surface, load_mesh
from grasp3d.batch.batch_settings import BatchSettings
from grasp3d.batch.labelling import settings_text
from grasp3d.errors import SettingError
from grasp3d.outcomes import SimulationSettings
from grasp3d.quality.loads import Load, TaskText
from grasp3d.settings.grasp_model import friction_interval
from grasp3d.settings.parsing import plain_values, settings_of_texts
from grasp3d.settings.units import (
    METRES,
    Metres,
    describe_length,
    parse_angle,
    parse_length,
    small_length,
    with_lengths_scaled,
    with_units,
)
from grasp3d.surface.antipodal import OPENING_SLACK
from tests.helpers import shapes

UNITS = st.sampled_from(list(METRES))
TEXTS = st.builds("{!r} {}".format, st.floats(1e-6, 1e6), UNITS)
LENGTHS = TEXTS.map(lambda text: parse_length("it", text))
FRICTIONS = st.tuples(st.floats(0.01, 2.0), st.floats(0.01, 2.0)).map(sorted).map(tuple)


@given(number=st.floats(1e-6, 1e6), unit=UNITS)
def test_a_length_is_its_text(number: float, unit: Any) -> None:
    length = parse_length("it", f"{number!r} {unit}")
    assert length == pytest.approx(number * METRES[unit], rel=1e-14)
    assert parse_length("it", str(length)) == length
    again = pickle.loads(pickle.dumps(length))  # noqa: S301
    assert (again, str(again)) == (length, str(length))


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


@pytest.mark.parametrize("bad", [math.nan, -math.inf])
def test_a_position_is_finite(bad: float) -> None:
    for point in ((bad, 0.0, 0.0), [0.0, bad, 0.0], f"0,0,{bad}"):
        with pytest.raises(SettingError, match="center_of_mass must be 3 finite lengths"):
            MeshOptions(center_of_mass=point)  # type: ignore[arg-type]


@given(ends=FRICTIONS)
def test_an_interval_is_its_text(ends: tuple[float, float]) -> None:
    model = GraspModel(friction=ends)
    assert model == GraspModel(friction="..".join(map(repr, ends)))
    assert model == replace(model) == GraspModel(friction=model.friction)
    assert model.friction_interval == friction_interval(ends) == ends
    assert ends[0] <= model.nominal_friction <= ends[1]


@given(radius=st.one_of(st.floats(0.0, 10.0), LENGTHS), ends=FRICTIONS, fingers=st.integers(2, 5))
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


@pytest.mark.parametrize(
    ("text", "metres"),
    [
        ("80mm", 0.08), (" 80 mm ", 0.08), ("3IN", 0.0762), ("0.08 m", 0.08), ("8.50cm", 0.085),
        ("+5mm", 0.005), (".5cm", 0.005), ("1e-3m", 0.001), ("-2mm", -0.002),
    ],
)  # fmt: skip
def test_a_text_with_a_unit_is_in_metres(text: str, metres: float) -> None:
    length = parse_length("it", text)
    assert (length, type(length)) == (metres, Metres)
    assert parse_length("it", length) is length
    for plain, stored in (("0mm", 0.0), ("0.06", 0.06), ("inf", math.inf), (80, 80.0)):
        length = parse_length("it", plain)  # without a unit, or of any
        assert (length, type(length)) == (stored, float)


@pytest.mark.parametrize(
    "text",
    [
        "80km", "mm", "80 mm wide", "8,5cm", "", "1e", [3.0], True, None, np.array([0.05, 0.06]),
    ],
)  # fmt: skip
def test_what_is_no_length_is_refused_with_the_units(text: Any) -> None:
    with pytest.raises(SettingError, match=r"max_opening must be a length.*\(m, cm, mm, in\)"):
        Sampling(max_opening=text)


def test_every_length_of_the_settings_takes_a_unit_and_is_in_metres() -> None:
    for kind, names in (
        (GraspModel, {"torsion_radius", "location_error"}),
        (Sampling, {"min_opening", "max_opening"}),
        (MeshOptions, {"max_edge"}),
    ):
        settings = kind(**dict.fromkeys(names, "5mm"))
        assert settings.lengths() == dict.fromkeys(names, 0.005)
        assert {name for name, _ in with_units("", settings)} == names
        assert pickle.loads(pickle.dumps(settings)) == settings  # noqa: S301
        assert eval(repr(settings)) == settings  # noqa: S307
        mesh = load_mesh(shapes.box(), max_edge=9.0)
        with pytest.raises(SettingError, match=r"is 5 mm, but the unit of arrays is not known"):
            mesh.check_units(settings)
        load_mesh(shapes.box(), max_edge="9cm", unit="cm").check_units(settings)


def test_lengths_within_settings_are_named_and_scaled() -> None:
    options = MeshOptions(center_of_mass="10mm,0,-2.5mm", region="box:1mm,0,0,2,2,2cm")
    assert [one for _, one in with_units("", options)] == [0.01, -0.0025, 0.001, 0.02]
    settings = SimulationSettings(pose_error="5mm,3deg", give_way=2.0)
    assert [name for name, _ in with_units("", settings)] == ["pose_error"]
    scaled = with_lengths_scaled(settings, 1e-3)
    assert (scaled.give_way, scaled.pose_error.position) == (0.002, 5e-6)
    assert scaled.pose_error.angle == settings.pose_error.angle
    assert scaled.pad_stiffness == settings.pad_stiffness
    box = with_lengths_scaled(MeshOptions(region="box:1,0,0,2,2,20"), 1e-3).region
    assert str(box) == "box:0.001,0.0,0.0,0.002,0.002,0.02"


@pytest.mark.parametrize("unit", list(METRES))
def test_the_error_of_an_unknown_unit_names_the_plausible_one(unit: Any) -> None:
    """Whatever the file's unit was: of a box of 14 cm it is clear in m and mm."""
    side = 0.14 / METRES[unit]
    mesh = load_mesh(shapes.box((side, 0.5 * side, 0.5 * side)), max_edge=9.0 * side)
    with pytest.raises(SettingError, match="it needs metres, but the unit of arrays is not") as e:
        mesh.needs_metres("it needs metres")
    if unit in {"m", "mm"}:
        assert f"): add --unit {unit} (in Python unit='{unit}')" in str(e.value)
        assert f"14 cm if {unit}" in str(e.value)
    load_mesh(mesh, unit=unit).needs_metres("it needs metres")


def test_settings_with_units_have_the_same_identity_as_in_metres() -> None:
    plain = settings_text(BatchSettings(sampling=Sampling(max_opening=0.08)))
    assert plain == settings_text(BatchSettings(sampling=Sampling(max_opening="80 mm")))
    assert json.loads(plain)["sampling"]["max_opening"] == 0.08
    assert json.loads(plain)["mesh"]["max_edge"] is None


def test_lengths_in_messages_are_in_millimetres_or_as_they_are() -> None:
    assert describe_length(parse_length("it", "3in")) == "76.2 mm"
    assert describe_length(0.5) == "0.5"
    assert small_length(0.00123456, metres=True, digits=2) == "1.2 mm"


def test_labels_with_units_are_those_with_metres() -> None:
    box = shapes.box((40.0, 60.0, 80.0))
    mesh = load_mesh(box, MeshOptions(unit="mm", max_edge="4cm"))
    assert mesh.options == MeshOptions(unit="mm", max_edge=0.04)
    assert (mesh.length("it", "2cm"), mesh.length("it", 3)) == (0.02, 3.0)
    model = GraspModel(torsion_radius="0.2cm")
    labels = label_surface(mesh, model, sampling=Sampling(max_opening="50mm"))
    assert labels.model == GraspModel(torsion_radius=0.002)
    assert labels.sampling == Sampling(max_opening=0.05)
    assert np.nanmax(labels.opening) <= 0.05 + OPENING_SLACK * mesh.size + 1e-12
    grasp = [[[-0.02, 0.0, 0.0], [0.021, 0.0, 0.0]]]
    assert evaluate_grasps(mesh, grasp, model, max_distance="2mm").model == labels.model
    without = load_mesh(box, max_edge=40.0)
    for call in (
        lambda: label_surface(without, sampling=Sampling(max_opening="5cm")),
        lambda: evaluate_grasps(without, grasp, max_distance="2mm"),
        lambda: load_mesh(box, max_edge="3mm"),
        lambda: without.length("it", "2cm"),
    ):
        with pytest.raises(SettingError, match="but the unit of arrays is not known"):
            call()
