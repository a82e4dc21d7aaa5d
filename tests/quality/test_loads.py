"""Loads: masses, densities and forces with units, and the settings that hold them."""

import pickle
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import grasp3d
from grasp3d.errors import SettingError
from grasp3d.quality import Weight
from grasp3d.quality.loads import Load, load_from, load_settings
from grasp3d.settings.units import DENSITIES, FORCES, MASSES, parse_quantity
from grasp3d.surface.load_case import LoadCase
from tests.helpers import shapes

POSITIVE = st.floats(1e-6, 1e6)


@pytest.mark.parametrize(
    ("field", "text", "number"),
    [
        ("mass", "0.5kg", 0.5), ("mass", "500 g", 0.5), ("mass", "300G", 0.3), ("mass", "2", 2.0),
        ("mass", "1lb", 0.45359237), ("mass", "16 oz", 0.45359237), ("mass", np.float32(0.5), 0.5),
        ("grip_force", "40N", 40.0), ("grip_force", "0.04 kN", 40.0), ("grip_force", 40, 40.0),
        ("grip_force", "10lbf", 44.482216152605), ("density", "7.85 g/cm^3", 7850.0),
        ("density", "7.85g/cm3", 7850.0), ("density", "1e3", 1000.0),
        ("density", "0.1 lb/in^3", 2767.99047102),
    ],
)  # fmt: skip
def test_quantities_are_numbers_in_si_units_or_have_a_unit(
    field: str, text: Any, number: Any
) -> None:
    assert getattr(Load(**{field: text}), field) == pytest.approx(number, rel=1e-11)
    assert type(getattr(Load(**{field: text}), field)) is type(number)


@pytest.mark.parametrize("units", [MASSES, FORCES, DENSITIES])
def test_the_first_unit_is_the_si_unit(units: dict[str, float]) -> None:
    assert next(iter(units.values())) == 1.0
    assert parse_quantity("it", f"3{next(iter(units))}", units) == 3.0


@given(number=POSITIVE, unit=st.sampled_from(sorted(MASSES)))
def test_units_are_multiples(number: float, unit: str) -> None:
    assert Load(mass=f"{number!r} {unit}").mass == pytest.approx(number * MASSES[unit], rel=1e-14)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"mass": "-0.5kg"}, r"mass must be finite and above 0 \[kg\]; got -0.5kg"),
        ({"mass": "1e300"}, r"mass must be at most 1e\+09 \[kg\]; got 1e300"),
        ({"mass": "5N"}, r"mass must be a number \[kg\], or .* \(kg, g, lb, oz\); got '5N'"),
        ({"density": "1000,700"}, "density must be a number .*; got '1000,700'"),
        ({"grip_force": "40kg"}, "grip_force must be a number .* \\(N, kN, lbf\\); got '40kg'"),
        ({"mass": 1.0, "density": 1.0}, "mass and density exclude each other"),
        ({"task": "wieght"}, "no task is called 'wieght'; known: weight, "),
        ({"task": Weight()}, r"no task is called 'Weight\("),
    ],
)
def test_bad_loads_are_refused_in_one_sentence(settings: dict[str, Any], message: str) -> None:
    with pytest.raises(SettingError, match=message) as error:
        Load(**settings)
    assert "\n" not in str(error.value)


def test_a_load_is_a_value() -> None:
    load = Load(mass="500g", task="weight + acceleration 5")
    same = Load(mass=0.5, task=" weight + acceleration 5 ")
    assert load == same
    assert hash(load) == hash(same)
    assert pickle.loads(pickle.dumps(load)) == load  # noqa: S301 - our own
    assert replace(load, mass=None) != load
    assert grasp3d.Load is Load


def test_only_what_differs_from_the_defaults_is_chosen() -> None:
    assert Load().chosen is None
    for load in (Load(mass=1.0), Load(grip_force=1.0), Load(task="acceleration 1")):
        assert load.chosen == load


def test_the_task_is_for_the_mass() -> None:
    load = Load(task="weight + wrench 0,0,0,0,0,0.1")
    weight, wrench = load.task_for(0.5).terms()
    assert weight == Weight(0.5)
    assert wrench.support([0, 0, 0, 0, 0, 1]) == 0.1
    assert load.task_for(None).mass == 1.0


def test_what_needs_the_unit_says_so() -> None:
    mesh, model = grasp3d.load_mesh(shapes.box(), max_edge=9.0), grasp3d.GraspModel()
    assert LoadCase.of(Load(mass=1.0), mesh, model).task == Weight(1.0)  # a weight needs none
    with pytest.raises(SettingError, match="torques of the task are in N m") as error:
        LoadCase.of(Load(task="wrench 0,0,0,0,0,1"), mesh, model)
    assert "the unit of arrays is not known" in str(error.value)
    assert "--unit" in str(error.value)


def test_files_are_read_into_the_text(tmp_path: Path) -> None:
    path = tmp_path / "pushes.csv"
    path.write_text("5,0,0,0,0,0\n")
    load = Load(task=f"weight + {path}")
    assert load.task.files == (path,)
    path.unlink()
    assert str(load.task) == "weight + wrench 5,0,0,0,0,0"
    assert load.chosen == load
    assert load.task_for(1.0).support([1, 0, 0, 0, 0, 0]) == pytest.approx(14.80665)
    with pytest.raises(SettingError, match=r"pushes\.csv': there is no such file"):
        Load(task=str(path))
    assert Load().task.files == ()


@given(
    density=st.one_of(st.none(), POSITIVE),
    force=st.one_of(st.none(), POSITIVE),
    task=st.sampled_from(["weight", "weight within 30 of -z", "wrench 1,2,3,0,0,0.5 + weight"]),
)
def test_stored_loads_are_read_back(density: Any, force: Any, task: str) -> None:
    load = Load(density=density, grip_force=force, task=task)
    stored = {name: str(value) for name, value in load_settings(load).items()}
    assert load_from(stored) == load
    assert not any("\n" in value for value in stored.values())


def test_files_without_a_load_have_none() -> None:
    assert set(load_settings(None).values()) == {None}
    assert list(load_settings(None)) == list(asdict(Load()))
    assert load_from({name: str(value) for name, value in load_settings(None).items()}) is None
    assert load_from({"friction": "0.5"}) is None
    with pytest.raises(SettingError, match="mass must be"):
        load_from({"task": "weight", "mass": "-1"})
