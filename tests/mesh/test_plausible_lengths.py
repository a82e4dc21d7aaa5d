import math
import re
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasp3d import ParallelGripper, load_mesh
from grasp3d.errors import SettingError
from grasp3d.hand.scene import Scene
from grasp3d.mesh import ObjectMesh
from grasp3d.mesh.plausible_lengths import (
    Purpose,
    length_warnings,
    object_warnings,
    refuse_lengths,
)
from grasp3d.quality.loads import Load
from grasp3d.settings.units import METRES, parse_length
from grasp3d.surface.load_case import input_warnings
from tests.helpers import shapes

REFUSED: dict[str, tuple[dict[str, float | str], float, Any, str]] = {
    "mm for m": ({"max_opening": 80.0}, 0.144, "m", "if it is in mm, give --max-opening 80mm"),
    "mesh in mm": ({"max_opening": 80.0}, 144.0, "mm", "if it is in mm, give --max-opening 80mm"),
    "no unit": ({"max_opening": 80.0}, 0.144, None, "give --unit m and --max-opening 80mm"),
    "unit of the mesh": ({"location_error": "2 mm"}, 0.144, "mm", "in m, not in mm, give --unit m"),
    "given": ({"location_error": "500 mm"}, 0.144, "m", "check its number and its unit, and that"),
    "no guess": ({"max_opening": 1e9}, 0.144, "m", "give it with its unit, such as 80mm"),
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
    with pytest.raises(SettingError) as caught:
        refuse_lengths(ball(size, unit), **parsed(lengths))
    message = str(caught.value)
    assert remedy in message
    assert "of arrays, " in message or "the size of arrays" in message
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


def test_a_length_that_is_refused_has_a_warning_as_well() -> None:
    for lengths, size, unit, _ in REFUSED.values():
        assert len(length_warnings(parsed(lengths), ball(size, unit))) == 1


def test_a_longest_edge_that_divides_none_is_refused_where_another_unit_is_likely() -> None:
    body = shapes.box((0.06, 0.04, 0.02))
    with pytest.raises(SettingError, match="if it is in mm, give --max-edge 3mm, or accept it"):
        refuse_lengths(load_mesh(body, unit="m", max_edge=3.0))
    for edge in (0.003, "3m", math.inf, 1e9):  # meant as it is
        refuse_lengths(load_mesh(body, unit="m", max_edge=edge))
    refuse_lengths(load_mesh(body, max_edge=3.0))


def test_the_message_has_the_length_with_its_unit() -> None:
    with pytest.raises(SettingError, match=r"^location_error is 500 mm, 3.47 times the size of a"):
        refuse_lengths(ball(0.144, "m"), **parsed({"location_error": "50 cm"}))
    refuse_lengths(ball(0.144, "m"), **parsed({"location_error": "100 mm"}))
    with pytest.raises(SettingError, match="a length is 1 mm, but the unit of"):
        refuse_lengths(ball(0.144, None), **parsed({"location_error": "1 mm"}))


def open_box(side: float) -> Any:
    """A cube without one of its twelve faces."""
    vertices, faces = shapes.box((side, side, side))
    return vertices, faces[1:]


def warnings_of(surface: Any, unit: Any, **purpose: Any) -> list[str]:
    mesh = load_mesh(surface, unit=unit, max_edge=1e9)
    return [text for text in object_warnings(mesh, Purpose(**purpose)) if "large" in text]


FRANKA = {"pad": 0.017, "stroke": 0.08}

IMPLAUSIBLE: dict[str, tuple[tuple[float, float, float], Any, dict[str, Any], list[str]]] = {
    "boot in cm": ((0.36, 0.1, 0.2), "cm", {"mass": 0.8}, ["more than any", "with --unit m it is"]),
    "nut": ((0.03, 0.03, 0.01), "m", {"mass": 200.0}, ["more than", "if its mass is 200 g, give"]),
    "below the pads": ((1.0, 0.5, 0.5), "mm", FRANKA, ["1.2 mm large: a pad", "with --unit cm it"]),
    "above the strokes": ((80.0, 50.0, 30.0), "cm", FRANKA, ["ten strokes", "with --unit mm it"]),
    "a density": ((0.1, 0.1, 0.1), "m", {"mass": 30.0, "has_density": True}, ["is its unit right"]),
    "all at once": ((200.0, 50.0, 50.0), "m", {"mass": 0.5, **FRANKA}, ["foil, and it is", "mm"]),
}


@pytest.mark.parametrize("name", IMPLAUSIBLE)
def test_an_implausible_object_is_named_once_with_what_would_explain_it(name: str) -> None:
    extents, unit, purpose, words = IMPLAUSIBLE[name]
    (text,) = warnings_of(shapes.box(extents), unit, **purpose)
    assert all(word in text for word in words), text


def test_a_part_is_judged_as_the_whole() -> None:
    """A balloon of half the mass that would be plausible, with contacts on a part of it only."""
    balloon = load_mesh(shapes.sphere(3, 0.15), unit="m", max_edge=1e9)
    part = load_mesh(balloon, region="box:0.05,-0.1,-0.1,0.25,0.1,0.1")
    assert part.area == balloon.area == pytest.approx(4.0 * math.pi * 0.15**2, rel=0.02)
    assert part.allowed_fraction < 0.2
    purpose = Purpose(mass=0.01 * balloon.area)
    texts = [list(object_warnings(mesh, purpose)) for mesh in (balloon, part)]
    assert texts[0] == texts[1]
    assert "less than foam or foil" in texts[0][0]


PLAUSIBLE: dict[str, tuple[Any, dict[str, Any]]] = {
    "foam": (shapes.box((0.3, 0.2, 0.1)), {"mass": 20.0 * 0.006, **FRANKA}),
    "tungsten": (shapes.box((0.03, 0.03, 0.03)), {"mass": 19_300 * 2.7e-5, **FRANKA}),
    "balloon": (shapes.sphere(3, 0.15), {"mass": 0.0201 * 4.0 * math.pi * 0.15**2}),
    "open scan": (open_box(0.1), {"mass": 1e-4}),
    "open scan of lead": (open_box(0.1), {"mass": 11.0}),
    "bag": (shapes.tube(0.1, 0.1 - 2e-5, 0.3), {"mass": 0.0036}),
    "needle": (shapes.box((0.1, 0.001, 0.001)), {"mass": 8e-4, **FRANKA}),
}


@pytest.mark.parametrize("name", PLAUSIBLE)
def test_nothing_is_said_of_what_there_is(name: str) -> None:
    surface, purpose = PLAUSIBLE[name]
    assert warnings_of(surface, "m", **purpose) == []


def test_an_open_surface_is_judged_by_the_ball_around_it() -> None:
    (text,) = warnings_of(open_box(0.01), "m", mass=0.8)
    assert "more than any material" in text


@pytest.mark.slow
@given(size=st.floats(1e-3, 10.0), mass=st.floats(1e-5, 1e3), unit=st.sampled_from(list(METRES)))
def test_what_is_advised_is_plausible(size: float, mass: float, unit: Any) -> None:
    extents = (size, 0.5 * size, 0.4 * size)
    for text in warnings_of(shapes.box(extents), unit, mass=mass, **FRANKA):
        if match := re.search(r"--unit (\w+)", text):
            assert warnings_of(shapes.box(extents), match[1], mass=mass, **FRANKA) == []
        if match := re.search(r"--mass (\S+)", text):
            meant = Load(mass=match[1]).mass  # type: ignore[arg-type]
            assert warnings_of(shapes.box(extents), unit, mass=meant, **FRANKA) == []


MESHES = [path for path in shapes.LIBRARY.iterdir() if path.suffix not in {".md", ".png"}]


@pytest.mark.slow
@pytest.mark.parametrize("path", MESHES[::3], ids=lambda path: path.stem)
@pytest.mark.parametrize("gripper", ["franka", "robotiq_2f85", None])
def test_nothing_is_said_of_the_shipped_meshes(path: Path, gripper: str | None) -> None:
    mesh = load_mesh(path, unit="m", max_edge=1e9)
    scene = None if gripper is None else Scene(ParallelGripper.preset(gripper))
    most = 0.05 if math.isnan(mesh.volume) else min(2.0, 8000.0 * mesh.volume)
    for mass in (min(0.05, most), most):
        assert input_warnings(mesh, scene, Load(mass=mass)) == mesh.report.warnings
