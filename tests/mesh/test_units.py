"""Units, lengths and masses that somebody may mean, and warnings about the others."""

import csv
import math
from typing import Any, get_args

import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasp3d import check_mesh, load_mesh
from grasp3d.errors import SettingError
from grasp3d.mesh import ObjectMesh
from grasp3d.mesh.diagnosis import Trust
from grasp3d.mesh.plausible_lengths import length_warnings, object_warnings, refuse_lengths
from grasp3d.mesh.plausible_units import PLAUSIBLE, USUAL, guess_unit, length_text, unit_warning
from grasp3d.settings.units import METRES, Unit, parse_length
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


@pytest.mark.parametrize(
    ("size", "unit", "words"),
    [
        (120.0, "m", "the object measures 120 m if its unit is m: is the unit right? "),
        (120.0, "m", "If its unit were mm it would be 12 cm"),
        (6.0, "m", "If its unit were cm or mm or in it would be 6 cm or 6 mm or 15 cm"),
        (1e6, "cm", "no unit (m, cm, mm, in) makes it one that a hand may hold"),
    ],
)
def test_the_warning_lists_plausible_units(size: float, unit: Unit, words: str) -> None:
    assert words in unit_warning(size, unit)


def test_a_mesh_has_a_warning_about_its_unit() -> None:
    vertices, faces = shapes.sphere(1)
    mesh = load_mesh((60.0 * vertices, faces), unit="m")
    assert mesh.report.warnings == (unit_warning(mesh.size, "m"),)
    assert load_mesh((60.0 * vertices, faces), unit="mm").report.warnings == ()
    assert load_mesh((60.0 * vertices, faces)).report.warnings == ()
    found = check_mesh((1e36 * vertices, faces), unit="m")
    assert found.trust is Trust.CARE
    assert any("no unit (m, cm, mm, in) makes it" in item.message for item in found.warnings)


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


REFUSED: dict[str, tuple[dict[str, float | str], float, Any, str]] = {
    "mm for m": ({"max_opening": 80.0}, 0.144, "m", "if it is in mm, give --max-opening 80mm"),
    "mesh in mm": ({"max_opening": 80.0}, 144.0, "mm", "if it is in mm, give --max-opening 80mm"),
    "no unit": ({"max_opening": 80.0}, 0.144, None, "give --unit m and --max-opening 80mm, or"),
    "of the mesh": ({"location_error": "2 mm"}, 0.144, "mm", "mesh is in m, give --unit m"),
    "given": ({"location_error": "500 mm"}, 0.144, "m", "check its number and its unit, or"),
    "no guess": ({"max_opening": 1e9}, 0.144, "m", "check its number and its unit, or"),
}


def parsed(lengths: dict[str, float | str]) -> dict[str, Any]:
    """Lengths as settings hold them."""
    return {name: parse_length(name, one) for name, one in lengths.items()}


def ball(size: float, unit: Any) -> ObjectMesh:
    """A ball of a diameter in a unit."""
    return load_mesh(shapes.sphere(1, 0.5 * size), unit=unit, max_edge=1e9)


@pytest.mark.parametrize("name", REFUSED)
def test_a_length_that_cannot_be_meant_is_refused_with_the_likely_unit(name: str) -> None:
    lengths, size, unit, remedy = REFUSED[name]
    mesh, given = ball(size, unit), parsed(lengths)
    with pytest.raises(SettingError) as caught:
        refuse_lengths(mesh, **given)
    assert len([*length_warnings(mesh, **given)]) == 1
    message = str(caught.value)
    assert remedy in message
    assert "times the size of arrays, " in message
    assert message.endswith("or accept it with --force (in Python force=True)")


@pytest.mark.parametrize(
    "lengths",
    [
        {"max_opening": 0.001}, {"max_opening": 5.0}, {"max_opening": math.inf},
        {"torsion_radius": 1e-5}, {"min_opening": 1e-6}, {"min_opening": 0.0},
        {"max_edge": 1e9},
        {"max_distance": 1e-9},
    ],
)  # fmt: skip
def test_lengths_that_somebody_may_mean_are_accepted(lengths: dict[str, float | None]) -> None:
    refuse_lengths(ball(0.144, "m"), **lengths)


def test_a_longest_edge_that_divides_none_is_refused_where_another_unit_is_likely() -> None:
    body = shapes.box((0.06, 0.04, 0.02))
    with pytest.raises(SettingError, match="if it is in mm, give --max-edge 3mm, or"):
        refuse_lengths(load_mesh(body, unit="m", max_edge=3.0))
    for edge in (0.003, "3m", math.inf, 1e9):  # meant as it is
        refuse_lengths(load_mesh(body, unit="m", max_edge=edge))
    refuse_lengths(load_mesh(body, max_edge=1e9))
    with pytest.raises(SettingError, match="give --unit m and --max-edge 3mm, or"):
        refuse_lengths(load_mesh(body, max_edge=3.0))


def open_box(side: float) -> Any:
    """A cube without one of its twelve faces."""
    vertices, faces = shapes.box((side, side, side))
    return vertices, faces[1:]


def warnings_of(surface: Any, unit: Any, **purpose: Any) -> list[str]:
    mesh = load_mesh(surface, unit=unit, max_edge=1e9)
    return [*object_warnings(mesh, **purpose)]


FRANKA = {"pad": 0.017, "stroke": 0.08}

DENSE = "more than any material: are its mass"
IMPLAUSIBLE: dict[str, tuple[Any, Any, dict[str, Any], str]] = {
    "boot in cm": (shapes.box((0.36, 0.1, 0.2)), "cm", {"mass": 0.8}, DENSE),
    "nut": (shapes.box((0.03, 0.03, 0.01)), "m", {"mass": 200.0}, DENSE),
    "open scan": (open_box(0.01), "m", {"mass": 0.8}, DENSE),
    "small": (shapes.box((2, 0.5, 0.5)), "mm", {**FRANKA, "pad": 0.03}, "pads, 3 cm: is its"),
    "large": (shapes.box((80, 50, 30)), "cm", FRANKA, "ten strokes of the gripper, 8 cm"),
    "foil": (shapes.box((1, 0.5, 0.5)), "m", {"mass": 0.01}, "0.04 kg/m^3, less than foam or foil"),
}


@pytest.mark.parametrize("name", IMPLAUSIBLE)
def test_an_implausible_object_is_named_once(name: str) -> None:
    surface, unit, purpose, words = IMPLAUSIBLE[name]
    texts = warnings_of(surface, unit, **purpose)
    assert sum(words in text for text in texts) == 1, texts


def test_an_object_whose_unit_is_doubted_already_has_no_further_warning() -> None:
    body = shapes.box((200.0, 50.0, 50.0))
    assert warnings_of(body, "m", mass=0.5, **FRANKA) == []
    assert "If its unit were mm" in load_mesh(body, unit="m", max_edge=1e9).report.warnings[0]
    assert warnings_of(body, None, mass=0.5, **FRANKA) == []


def test_a_part_is_judged_as_the_whole() -> None:
    """A balloon of half the mass that would be plausible, with contacts on a part of it only."""
    balloon = load_mesh(shapes.sphere(3, 0.15), unit="m", max_edge=1e9)
    part = load_mesh(balloon, region="box:0.05,-0.1,-0.1,0.25,0.1,0.1")
    assert part.area == balloon.area == pytest.approx(4.0 * math.pi * 0.15**2, rel=0.02)
    assert part.allowed_fraction < 0.2
    texts = [[*object_warnings(mesh, 0.01 * balloon.area)] for mesh in (balloon, part)]
    assert texts[0] == texts[1]
    assert "less than foam or foil" in texts[0][0]


SENSIBLE: dict[str, tuple[Any, dict[str, Any]]] = {
    "foam": (shapes.box((0.3, 0.2, 0.1)), {"mass": 20.0 * 0.006, **FRANKA}),
    "tungsten": (shapes.box((0.03, 0.03, 0.03)), {"mass": 19_300 * 2.7e-5, **FRANKA}),
    "balloon": (shapes.sphere(3, 0.15), {"mass": 0.0201 * 4.0 * math.pi * 0.15**2}),
    "open scan": (open_box(0.1), {"mass": 1e-4}),
    "open scan of lead": (open_box(0.1), {"mass": 11.0}),
    "bag": (shapes.tube(0.1, 0.1 - 2e-5, 0.3), {"mass": 0.0036}),
    "needle": (shapes.box((0.1, 0.001, 0.001)), {"mass": 8e-4, **FRANKA}),
}


@pytest.mark.parametrize("name", SENSIBLE)
def test_nothing_is_said_of_what_there_is(name: str) -> None:
    surface, purpose = SENSIBLE[name]
    assert warnings_of(surface, "m", **purpose) == []
