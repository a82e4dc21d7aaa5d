"""Masses, and centres of mass that are given."""

import math
from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import strategies as st

from grasp3d import GraspModel, Load, MeshOptions, ObjectMesh, check_mesh, load_mesh
from grasp3d.errors import SettingError
from grasp3d.settings.units import METRES
from grasp3d.surface import mass_of
from grasp3d.surface.load_case import LoadCase
from tests.helpers import shapes

DENSITY = st.floats(100.0, 20_000.0)


def block(extents: tuple[float, float, float], middle: tuple[float, float, float]) -> Any:
    return trimesh.creation.box(extents).apply_translation(middle)


def mesh_of(*parts: trimesh.Trimesh, **options: Any) -> ObjectMesh:
    whole: Any = trimesh.util.concatenate(parts)
    return load_mesh(whole, MeshOptions(unit="mm", max_edge=math.inf), **options)


BASE = block((50.0, 50.0, 10.0), (0.0, 0.0, -5.0))
FLAT = shapes.box((1.0, 1.0, 1.0))
OPEN = (FLAT[0], FLAT[1][:-2])


@pytest.mark.parametrize("unit", list(METRES))
def test_the_mass_is_density_times_volume_in_any_unit(unit: Any) -> None:
    size = 0.1 / METRES[unit]
    mesh = load_mesh(shapes.box((size, size, size)), unit=unit, max_edge=math.inf)
    assert mass_of(mesh, Load(density=1000.0)) == pytest.approx(1.0, rel=1e-12)
    assert mass_of(mesh, Load(mass=0.5)) == 0.5
    assert mass_of(mesh, Load()) is None


@pytest.mark.parametrize(
    ("mesh", "load", "words"),
    [
        (mesh_of(BASE, unit=None), Load(density=1.0), r"density is in kg/m\^3, but the unit of"),
        (load_mesh(OPEN, unit="m"), Load(mass=1.0), "is open, so its centre of mass is not known"),
        (load_mesh(OPEN, unit="m"), Load(density=1.0), r"is open, so a density gives .*--mass"),
        (load_mesh(OPEN, unit="m"), Load(grip_force=1.0), r"is open, .*--center-of-mass"),
        (
            load_mesh(OPEN, unit="m", center_of_mass=(0, 0, 0)),
            Load(density=1.0),
            r"is open, so a density gives no mass: give the mass \(--mass\)",
        ),
        (
            load_mesh((FLAT[0] * [1, 1, 0], FLAT[1]), repair="none"),
            Load(mass=1.0),
            "encloses no volume, so its centre of mass",
        ),
    ],
)
def test_what_a_load_needs_is_said_in_one_sentence(
    mesh: ObjectMesh, load: Load, words: str
) -> None:
    with pytest.raises(SettingError, match=words) as error:
        LoadCase.of(load, mesh, GraspModel())
    assert mesh.report.source in str(error.value)
    assert "\n" not in str(error.value)


def test_an_open_mesh_needs_mass_and_centre_of_mass() -> None:
    mesh = load_mesh(OPEN, unit="cm", center_of_mass="1mm,0,-2mm", max_edge=1.0)
    np.testing.assert_allclose(mesh.center_mass, [0.001, 0.0, -0.002], atol=1e-15)
    assert mesh.report.center_mass_from == "given"
    assert not any("centre of mass" in warning for warning in mesh.report.warnings)
    assert LoadCase.of(Load(mass=1.0), mesh, GraspModel()).mass == 1.0


@pytest.mark.parametrize(
    ("given_center", "stored"),
    [
        ("10mm,0,-2.5mm", (0.01, 0.0, -0.0025)),
        (" 1 , 2,3", (1.0, 2.0, 3.0)),
        ((1, 2.5, "3cm"), (1.0, 2.5, 0.03)),
        (np.array([1.0, 2.0, 3.0]), (1.0, 2.0, 3.0)),
        (None, None),
    ],
)
def test_a_centre_of_mass_is_three_lengths(given_center: Any, stored: Any) -> None:
    options = MeshOptions(center_of_mass=given_center)
    assert options.center_of_mass == stored
    assert MeshOptions(center_of_mass=options.center_of_mass) == options
    assert hash(options) == hash(MeshOptions(center_of_mass=stored))


@pytest.mark.parametrize(
    "bad", ["1,2", "1,2,3,4", "a,b,c", "1,2,inf", "", 5.0, (1, 2, None), (1, 2, math.nan), "1 2 3"]
)
def test_what_is_no_centre_of_mass_is_refused(bad: Any) -> None:
    with pytest.raises(SettingError, match="center_of_mass must be 3 finite lengths"):
        MeshOptions(center_of_mass=bad)


def test_the_centre_is_in_the_frame_and_unit_of_the_mesh() -> None:
    box = shapes.box((40.0, 40.0, 40.0))
    mesh = load_mesh((box[0] + 100.0, box[1]), unit="mm", center_of_mass="10.1cm,0.1,99mm")
    np.testing.assert_allclose(mesh.center_mass, [0.101, 0.1, 0.099], atol=1e-15)
    assert mesh.options.center_of_mass == (0.101, 0.1, 0.099)
    assert mesh.torque_scale == pytest.approx(1e-3 * math.sqrt(21.0**2 + 20.0**2 + 21.0**2))
    with pytest.raises(SettingError, match=r"center_of_mass is 101 mm, but the unit .* not"):
        load_mesh(box, center_of_mass="10.1cm,100,99")


def test_a_centre_outside_the_object_is_warned_about_and_a_far_one_refused() -> None:
    box = shapes.box((40.0, 40.0, 40.0))
    inside = load_mesh(box, center_of_mass=(19.9, 0.0, 0.0))
    assert not inside.report.warnings
    outside = load_mesh(box, center_of_mass=(30.0, 0.0, 0.0))
    assert any("outside the object's bounding box" in one for one in outside.report.warnings)
    assert any("bounding box" in one.message for one in check_mesh(outside).warnings)
    with pytest.raises(SettingError, match=r"outside the object's bounding box by .* is it in"):
        load_mesh(box, center_of_mass=(1e6, 0.0, 0.0))


def test_a_surface_that_crosses_itself_may_have_its_centre_outside() -> None:
    vertices, faces = shapes.box((40.0, 20.0, 20.0))
    turned = np.where(vertices[:, :1] > 0.0, [1.0, -0.9, 1.0], 1.0)
    mesh = load_mesh((vertices * turned, faces))
    # Two wedges that meet at an edge; the smaller one is inside out:
    edge = 40.0 / 1.9
    areas = np.array([10.0 * edge, -9.0 * (40.0 - edge)])
    x = areas @ [edge / 3.0, 40.0 - (40.0 - edge) / 3.0] / areas.sum() - 20.0
    np.testing.assert_allclose(mesh.center_mass, [x, 0.0, 0.0], atol=1e-9)
    (warning,) = mesh.report.warnings
    beyond = (-20.0 - x) / mesh.size
    assert f"outside the object's bounding box by {beyond:.3g} of its size: the surface" in warning
