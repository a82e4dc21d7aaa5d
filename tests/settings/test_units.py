"""Units in the settings of the Python API: texts become numbers in SI units, once."""

import json
import math
import pickle
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasp3d import (
    GraspModel,
    MeshOptions,
    Sampling,
    evaluate_grasps,
    label_surface,
    load_mesh,
)
from grasp3d.batch.batch_settings import BatchSettings
from grasp3d.batch.labelling import settings_text
from grasp3d.errors import SettingError
from grasp3d.outcomes import SimulationSettings
from grasp3d.settings.parsing import plain_values
from grasp3d.settings.units import (
    METRES,
    Metres,
    describe_length,
    parse_length,
    small_length,
    with_lengths_scaled,
    with_units,
)
from grasp3d.surface.antipodal import OPENING_SLACK
from tests.helpers import shapes


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


@pytest.mark.parametrize(
    ("given", "stored"),
    [("0mm", 0.0), ("0.06", 0.06), ("inf", math.inf), (0.06, 0.06), (80, 80.0), (None, None)],
)
def test_what_has_no_unit_is_a_number(given: Any, stored: Any) -> None:
    length = parse_length("it", given)
    assert (length, type(length)) == (stored, type(stored))


@given(number=st.floats(1e-6, 1e6), unit=st.sampled_from(list(METRES)))
def test_a_length_is_its_text(number: float, unit: Any) -> None:
    length = parse_length("it", f"{number!r} {unit}")
    assert length == pytest.approx(number * METRES[unit], rel=1e-14)
    assert parse_length("it", str(length)) == length
    assert pickle.loads(pickle.dumps(length)) == length  # noqa: S301
    assert str(pickle.loads(pickle.dumps(length))) == str(length)  # noqa: S301


@pytest.mark.parametrize(
    "text",
    [
        "80km", "mm", "80 mm wide", "8,5cm", "", "1e", [3.0], True, None, np.array([0.05, 0.06]),
    ],
)  # fmt: skip
def test_what_is_no_length_is_refused_with_the_units(text: Any) -> None:
    with pytest.raises(SettingError, match=r"max_opening must be a length.*\(m, cm, mm, in\)"):
        Sampling(max_opening=text)


def test_only_lengths_with_that_default_can_be_none() -> None:
    assert MeshOptions(max_edge=None).max_edge is None
    empty: Any = None
    for call in (
        lambda: Sampling(min_opening=empty),
        lambda: Sampling(max_opening=empty),
        lambda: GraspModel(torsion_radius=empty),
    ):
        with pytest.raises(SettingError, match=r"must be a length: .*; got None"):
            call()
    assert Sampling(max_opening=np.float32(0.5)).max_opening == 0.5


def test_every_length_of_the_settings_takes_a_unit_and_is_in_metres() -> None:
    for settings, names in (
        (
            GraspModel(torsion_radius="5mm", location_error="5mm"),
            {"torsion_radius", "location_error"},
        ),
        (Sampling(min_opening="5mm", max_opening="5mm"), {"min_opening", "max_opening"}),
        (MeshOptions(max_edge="5mm"), {"max_edge"}),
    ):
        assert settings.lengths() == dict.fromkeys(names, 0.005)
        assert {name for name, _ in with_units("", settings)} == names
        assert pickle.loads(pickle.dumps(settings)) == settings  # noqa: S301
        assert eval(repr(settings)) == settings  # noqa: S307
        mesh = load_mesh(shapes.box(), max_edge=9.0)
        with pytest.raises(SettingError, match=r"is 5 mm, but the unit of arrays is not known"):
            mesh.check_units(settings)
        load_mesh(shapes.box(), max_edge="9cm", unit="cm").check_units(settings)


def test_lengths_within_settings_are_found() -> None:
    options = MeshOptions(center_of_mass="10mm,0,-2.5mm", region="box:1mm,0,0,2,2,2cm")
    assert options.center_of_mass == (0.01, 0.0, -0.0025)
    assert [one for _, one in with_units("", options)] == [0.01, -0.0025, 0.001, 0.02]
    with pytest.raises(SettingError, match="center_of_mass is 10 mm, but the unit of arrays"):
        load_mesh(shapes.box(), max_edge=9.0, center_of_mass="10mm,0,-2.5mm")


def test_lengths_within_settings_are_named_and_scaled() -> None:
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


def test_limits_are_compared() -> None:
    with pytest.raises(SettingError, match=r"got 9 mm and 3 mm"):
        Sampling(min_opening="9mm", max_opening="0.3cm")
    with pytest.raises(SettingError, match=r"got 5 and 8 mm"):
        Sampling(min_opening=5.0, max_opening="8mm")
    for bad in ({"torsion_radius": "-1mm"}, {"torsion_radius": "inf"}):
        with pytest.raises(SettingError, match="torsion radius must be a finite length"):
            GraspModel(**bad)


def test_fingers_are_soft_with_a_torsion_radius() -> None:
    model = GraspModel(torsion_radius="5mm")
    assert (model.soft, model.tilts, model.epsilon_rank) == (True, "bound", 6)
    assert not GraspModel(torsion_radius="0mm").soft


def test_settings_with_units_have_the_same_identity_as_in_metres() -> None:
    plain = settings_text(BatchSettings(sampling=Sampling(max_opening=0.08)))
    assert plain == settings_text(BatchSettings(sampling=Sampling(max_opening="80 mm")))
    assert json.loads(plain)["sampling"]["max_opening"] == 0.08
    assert json.loads(plain)["mesh"]["max_edge"] is None
    values = plain_values(Sampling())
    assert values == {name: getattr(Sampling(), name) for name in values}


def test_lengths_in_messages_are_in_millimetres_or_as_they_are() -> None:
    assert describe_length(parse_length("it", "3in")) == "76.2 mm"
    assert describe_length(0.5) == "0.5"
    assert small_length(0.00123456, metres=True, digits=2) == "1.2 mm"


def test_a_mesh_takes_single_lengths() -> None:
    box = shapes.box((40.0, 60.0, 80.0))
    mesh = load_mesh(box, unit="mm", max_edge=9.0)
    assert (mesh.length("it", "2cm"), mesh.length("it", 3)) == (0.02, 3.0)
    with pytest.raises(SettingError, match="it is 2cm, but the unit of arrays is not known"):
        load_mesh(box, max_edge=99.0).length("it", "2cm")


@pytest.mark.slow
def test_labels_with_units_are_those_with_metres() -> None:
    box = shapes.box((40.0, 60.0, 80.0))
    mesh = load_mesh(box, MeshOptions(unit="mm", max_edge="4cm"))
    assert mesh.options == MeshOptions(unit="mm", max_edge=0.04)
    model = GraspModel(torsion_radius="0.2cm")
    labels = label_surface(mesh, model, sampling=Sampling(max_opening="50mm"))
    assert labels.model == GraspModel(torsion_radius=0.002)
    assert labels.sampling == Sampling(max_opening=0.05)
    assert labels.relabel(friction=0.4).model.torsion_radius == 0.002
    assert np.nanmax(labels.opening) <= 0.05 + OPENING_SLACK * mesh.size + 1e-12
    grasp = [[[-0.02, 0.0, 0.0], [0.021, 0.0, 0.0]]]
    assert evaluate_grasps(mesh, grasp, model, max_distance="2mm").model.torsion_radius == 0.002
    without = load_mesh(box, max_edge=40.0)
    for call in (
        lambda: label_surface(without, sampling=Sampling(max_opening="5cm")),
        lambda: evaluate_grasps(without, grasp, max_distance="2mm"),
        lambda: load_mesh(box, max_edge="3mm"),
    ):
        with pytest.raises(SettingError, match="but the unit of arrays is not known"):
            call()
