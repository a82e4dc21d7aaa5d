import csv
from typing import get_args

import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasp3d import check_mesh, load_mesh
from grasp3d.mesh.diagnosis import Trust
from grasp3d.mesh.plausible_units import (
    PLAUSIBLE,
    USUAL,
    guess_unit,
    length_text,
    unit_warning,
)
from grasp3d.settings.units import METRES, Unit
from tests.helpers import shapes

SIZES = st.floats(-7.0, 7.0).map(lambda exponent: 10.0**exponent)


@pytest.mark.parametrize(
    ("size", "unit"),
    [
        (120.0, "mm"), (0.12, "m"), (50.0, "mm"), (1500.0, "mm"), (0.004, "m"), (1.35, None),
        (0.7, None), (1e5, None),
    ],
)  # fmt: skip
def test_the_unit_is_guessed(size: float, unit: str | None) -> None:
    assert guess_unit(size).unit == unit


def test_the_reason_has_the_size_in_each_unit() -> None:
    sizes = "120 m if m, 1.2 m if cm, 12 cm if mm, 3 m if in"
    assert guess_unit(120.0).reason == f"largest extent 120: {sizes}"


@given(SIZES)
def test_guessed_units_are_plausible_and_none_is_returned_only_if_necessary(size: float) -> None:
    guess = guess_unit(size)
    held = {unit for unit in get_args(Unit) if within(size * METRES[unit], PLAUSIBLE)}
    usual = {unit for unit in ("m", "mm") if within(size * METRES[unit], USUAL)}
    assert guess.unit is None or guess.unit in held
    assert "\n" not in guess.reason
    if usual:
        assert {guess.unit} == usual
    if guess.unit is None:
        assert len(held) != 1


def within(metres: float, limits: tuple[float, float]) -> bool:
    return limits[0] * (1.0 - 1e-9) <= metres <= limits[1] * (1.0 + 1e-9)


@given(SIZES, st.sampled_from(get_args(Unit)))
def test_a_stated_unit_gives_a_warning_only_if_it_is_implausible(size: float, unit: Unit) -> None:
    assert (unit_warning(size, unit) == "") == within(size * METRES[unit], PLAUSIBLE)


def test_the_warning_lists_plausible_units() -> None:
    assert unit_warning(120.0, "m") == (
        "the object is 120 m large if its unit is m: is the unit right? "
        "If its unit were mm it would be 12 cm"
    )
    assert "If its unit were cm or mm or in it would be 6 cm or 6 mm or 15 cm" in unit_warning(
        6.0, "m"
    )
    assert "no unit (m, cm, mm, in) makes it one that a hand may hold" in unit_warning(1e6, "cm")


def test_a_mesh_has_a_warning_about_its_unit() -> None:
    vertices, faces = shapes.sphere(1)
    mesh = load_mesh((60.0 * vertices, faces), unit="m")
    assert mesh.report.warnings == (unit_warning(mesh.size, "m"),)
    assert "If its unit were mm it would be 12 cm" in mesh.report.warnings[0]
    assert load_mesh((60.0 * vertices, faces), unit="mm").report.warnings == ()
    assert load_mesh((60.0 * vertices, faces)).report.warnings == ()


@pytest.mark.parametrize(
    ("metres", "text"),
    [(120.0, "120 m"), (0.996, "1 m"), (0.0994, "9.9 cm"), (0.01, "1 cm"), (9.9e-3, "9.9 mm")],
)
def test_lengths_are_written_in_their_own_unit(metres: float, text: str) -> None:
    assert length_text(metres) == text


def test_units_of_real_meshes_are_guessed_or_undecided() -> None:
    """A known unit is guessed, or listed as one of several."""
    with shapes.shared("meshes", "manifest.csv").open(encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    hits = 0
    for row in rows:
        guess = guess_unit(max(map(float, row["extents"].split())))
        known = row["unit_guess"].replace("inch", "in").replace("arbitrary; mm plausible", "mm")
        unit = known.split()[0]
        hits += guess.unit == (None if unit == "arbitrary" else unit)
        assert guess.unit in {None, unit}
        assert guess.unit or unit == "arbitrary" or f" if {unit}" in guess.reason
    assert hits >= len(rows) - 2


def test_an_object_that_no_unit_explains_has_a_warning_for_its_stated_unit() -> None:
    vertices, faces = shapes.sphere(1)
    found = check_mesh((1e36 * vertices, faces), unit="m")
    assert found.trust is Trust.CARE
    assert any("no unit (m, cm, mm, in) makes it" in item.message for item in found.warnings)
