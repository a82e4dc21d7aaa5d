import math
from pathlib import Path
from typing import Any

import pytest

from grasp3d import ParallelGripper, load_mesh
from grasp3d.errors import SettingError
from grasp3d.hand.scene import Scene
from grasp3d.mesh import ObjectMesh
from grasp3d.mesh.plausible_lengths import length_warnings, object_warnings, refuse_lengths
from grasp3d.quality.loads import Load
from grasp3d.settings.units import parse_length
from grasp3d.surface.load_case import input_warnings
from tests.helpers import shapes

REFUSED: dict[str, tuple[dict[str, float | str], float, Any, str]] = {
    "mm for m": ({"max_opening": 80.0}, 0.144, "m", "if it is in mm, give --max-opening 80mm"),
    "mesh in mm": (
        {"max_opening": 80.0},
        144.0,
        "mm",
        "if it is in mm, give --max-opening 80mm",
    ),
    "no unit": ({"max_opening": 80.0}, 0.144, None, "give --unit m and --max-opening 80mm, or"),
    "unit of the mesh": (
        {"location_error": "2 mm"},
        0.144,
        "mm",
        "mesh is in m, give --unit m",
    ),
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
    with pytest.raises(SettingError) as caught:
        refuse_lengths(ball(size, unit), **parsed(lengths))
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


def test_a_length_that_is_refused_has_a_warning_as_well() -> None:
    for lengths, size, unit, _ in REFUSED.values():
        assert len([*length_warnings(ball(size, unit), **parsed(lengths))]) == 1


def test_a_longest_edge_that_divides_none_is_refused_where_another_unit_is_likely() -> None:
    body = shapes.box((0.06, 0.04, 0.02))
    with pytest.raises(SettingError, match="if it is in mm, give --max-edge 3mm, or"):
        refuse_lengths(load_mesh(body, unit="m", max_edge=3.0))
    for edge in (0.003, "3m", math.inf, 1e9):  # meant as it is
        refuse_lengths(load_mesh(body, unit="m", max_edge=edge))
    refuse_lengths(load_mesh(body, max_edge=1e9))
    with pytest.raises(SettingError, match="give --unit m and --max-edge 3mm, or"):
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
    return [*object_warnings(mesh, **purpose)]


FRANKA = {"pad": 0.017, "stroke": 0.08}

IMPLAUSIBLE: dict[str, tuple[tuple[float, float, float], Any, dict[str, Any], str]] = {
    "boot in cm": ((0.36, 0.1, 0.2), "cm", {"mass": 0.8}, "more than any material: are its mass"),
    "nut": ((0.03, 0.03, 0.01), "m", {"mass": 200.0}, "more than any material: are its mass"),
    "below the pads": ((2.0, 0.5, 0.5), "mm", {"pad": 0.03, "stroke": 0.08}, "pads, 3 cm: is its"),
    "above the strokes": ((80.0, 50.0, 30.0), "cm", FRANKA, "ten strokes of the gripper, 8 cm"),
    "foil": ((1.0, 0.5, 0.5), "m", {"mass": 0.01, **FRANKA}, "0.04 kg/m^3, less than foam or foil"),
}


@pytest.mark.parametrize("name", IMPLAUSIBLE)
def test_an_implausible_object_is_named_once(name: str) -> None:
    extents, unit, purpose, words = IMPLAUSIBLE[name]
    texts = warnings_of(shapes.box(extents), unit, **purpose)
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
