"""Lengths with units in the settings of the Python API."""

import json
import math
import pickle
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from grasp3d import (
    GraspModel,
    MeshOptions,
    MultifingerSampling,
    Sampling,
    evaluate_grasps,
    label_surface,
    load_mesh,
)
from grasp3d.batch.batch_settings import BatchSettings
from grasp3d.batch.identity import settings_text
from grasp3d.errors import SettingError
from grasp3d.settings.lengths import Measure, parse_length, settings_in_unit
from grasp3d.settings.parsing import plain_values
from grasp3d.surface.sampling.antipodal import OPENING_SLACK
from tests.helpers import shapes


@pytest.mark.parametrize(
    ("text", "stored"),
    [
        ("80mm", Measure(80, "mm")), (" 80 mm ", Measure(80, "mm")), ("3IN", Measure(3, "in")),
        ("0.08 m", Measure(0.08, "m")), ("8.50cm", Measure(8.5, "cm")), ("+5mm", Measure(5, "mm")),
        (".5cm", Measure(0.5, "cm")), ("1e-3m", Measure(0.001, "m")),
        (Measure(5, "m"), Measure(5, "m")),
        ("0mm", 0.0), ("0.06", 0.06), ("inf", math.inf), (0.06, 0.06), (80, 80), (None, None),
    ],
)  # fmt: skip
def test_a_length_is_a_number_or_has_a_unit(text: Any, stored: Any) -> None:
    assert parse_length("it", text) == stored


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
    assert MultifingerSampling(min_separation=None).min_separation is None
    assert MeshOptions(max_edge=None).max_edge is None
    empty: Any = None
    for call in (
        lambda: Sampling(min_opening=empty),
        lambda: MultifingerSampling(max_opening=empty),
        lambda: GraspModel(torsion_radius=empty),
    ):
        with pytest.raises(SettingError, match=r"must be a length: .*; got None"):
            call()
    assert Sampling(max_opening=np.float32(0.5)).max_opening == 0.5


@pytest.mark.parametrize(
    ("unit", "number"), [("m", 0.08), ("cm", 8.0), ("mm", 80.0), ("in", 80.0 / 25.4)]
)
def test_lengths_become_numbers_in_the_unit_of_the_mesh(unit: Any, number: float) -> None:
    given = Sampling(max_opening="80mm", min_opening=0.01)
    (found,) = settings_in_unit(unit, given)
    assert found == Sampling(max_opening=found.max_opening, min_opening=0.01)
    assert found.max_opening == pytest.approx(number, rel=1e-14)
    assert settings_in_unit("in", found, None) == (found, None)
    assert settings_in_unit("in", found)[0] is found
    if unit != "in":
        assert found.max_opening == number  # not a rounding error beside it


def test_every_length_of_the_settings_takes_a_unit() -> None:
    for settings, names in (
        (
            GraspModel(torsion_radius="5mm", location_error="5mm"),
            {"torsion_radius", "location_error"},
        ),
        (Sampling(min_opening="5mm", max_opening="5mm"), {"min_opening", "max_opening"}),
        (
            MultifingerSampling(min_separation="5mm", max_opening="5mm"),
            {"min_separation", "max_opening"},
        ),
        (MeshOptions(max_edge="5mm"), {"max_edge"}),
    ):
        assert settings.lengths() == dict.fromkeys(names, Measure(5.0, "mm"))
        (converted,) = settings_in_unit("cm", settings)
        assert set(converted.lengths().values()) == {0.5}
        assert pickle.loads(pickle.dumps(settings)) == settings  # noqa: S301
        assert eval(repr(settings)) == settings  # noqa: S307
        with pytest.raises(SettingError, match=r"is 5 mm, but the unit of scan\.stl is not known"):
            settings_in_unit(None, settings, source="scan.stl")


def test_limits_are_compared_when_their_unit_is_known() -> None:
    with pytest.raises(SettingError, match=r"got 9 mm and 0\.3 cm"):
        Sampling(min_opening="9mm", max_opening="0.3cm")
    mixed = Sampling(min_opening=5.0, max_opening="8mm")
    assert settings_in_unit("mm", mixed)[0].max_opening == 8.0
    with pytest.raises(SettingError, match=r"got 5 and 0\.8"):
        settings_in_unit("cm", mixed)
    for bad in ({"torsion_radius": "-1mm"}, {"torsion_radius": "inf"}):
        with pytest.raises(SettingError, match="torsion radius must be a finite length"):
            GraspModel(**bad)


def test_fingers_are_soft_whatever_the_unit_of_the_torsion_radius() -> None:
    model = GraspModel(torsion_radius="5mm")
    assert (model.soft, model.tilts, model.epsilon_rank) == (True, "bound", 6)
    assert not GraspModel(torsion_radius="0mm").soft


def test_settings_without_units_have_the_same_identity_as_before() -> None:
    plain = json.loads(settings_text(BatchSettings(sampling=Sampling(max_opening=0.08))))
    assert plain["sampling"]["max_opening"] == 0.08
    assert plain["mesh"]["max_edge"] is None
    values = plain_values(Sampling())
    assert values == {name: getattr(Sampling(), name) for name in values}
    other = json.loads(settings_text(BatchSettings(sampling=Sampling(max_opening="80 mm"))))
    assert other["sampling"].pop("max_opening") == "80 mm"
    plain["sampling"].pop("max_opening")
    assert other == plain


@pytest.mark.slow
def test_labels_with_units_are_those_with_numbers() -> None:
    box = shapes.box((40.0, 60.0, 80.0))
    options = MeshOptions(unit="mm", max_edge=40.0)
    mesh = load_mesh(box, replace(options, max_edge="4cm"))
    assert mesh.options == options
    model = GraspModel(torsion_radius="0.2cm")
    labels = label_surface(mesh, model, sampling=Sampling(max_opening="0.05 m"))
    assert labels.model == GraspModel(torsion_radius=2.0)
    assert labels.sampling == Sampling(max_opening=50.0)
    assert labels.relabel(friction=0.4).model.torsion_radius == 2.0
    assert np.nanmax(labels.opening) <= 50.0 + OPENING_SLACK * mesh.size + 1e-12
    grasp = [[[-20.0, 0.0, 0.0], [21.0, 0.0, 0.0]]]
    assert evaluate_grasps(mesh, grasp, model, max_distance="2mm").model.torsion_radius == 2.0
    without = load_mesh(box, max_edge=40.0)
    for call in (
        lambda: label_surface(without, sampling=Sampling(max_opening="5cm")),
        lambda: evaluate_grasps(without, grasp, max_distance="2mm"),
        lambda: load_mesh(box, max_edge="3mm"),
    ):
        with pytest.raises(SettingError, match="but the unit of arrays is not known"):
            call()
