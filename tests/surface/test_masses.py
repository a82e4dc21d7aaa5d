"""Masses, and centres of mass that are given or follow from densities."""

import math
from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from grasp3d import Load, MeshOptions, ObjectMesh, check_mesh, load_mesh
from grasp3d.errors import SettingError
from grasp3d.mesh.repair.bodies import Bodies
from grasp3d.mesh.work_bounds import NESTED_BODIES
from grasp3d.settings.lengths import METRES, Measure
from grasp3d.surface import mass_of, with_load
from grasp3d.surface.load_case import loaded_mesh
from tests.helpers import shapes

DENSITY = st.floats(100.0, 20_000.0)


def block(extents: tuple[float, float, float], middle: tuple[float, float, float]) -> Any:
    return trimesh.creation.box(extents).apply_translation(middle)


def mesh_of(*parts: trimesh.Trimesh, **options: Any) -> ObjectMesh:
    whole: Any = trimesh.util.concatenate(parts)
    return load_mesh(whole, MeshOptions(unit="mm", max_edge=math.inf), **options)


HEAD = block((120.0, 30.0, 30.0), (0.0, 0.0, 0.0))
HANDLE = block((20.0, 20.0, 250.0), (0.0, 0.0, -130.0))
"""Its end is within the head."""
LID = block((30.0, 30.0, 10.0), (5.0, 0.0, 5.0))
"""Stands on the base."""
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


def test_each_body_has_its_density_in_the_order_of_the_file() -> None:
    base, lid = (50 * 50 * 10) * 1e-9, (30 * 30 * 10) * 1e-9
    for parts, densities in (((BASE, LID), (7850.0, 700.0)), ((LID, BASE), (700.0, 7850.0))):
        mesh, load = mesh_of(*parts), Load(density=densities)
        assert mesh.report.bodies == 1  # they touch, and were united
        steel, wood = base * 7850.0, lid * 700.0
        assert mass_of(mesh, load) == pytest.approx(steel + wood, rel=1e-12)
        center = np.array([wood * 5.0, 0.0, wood * 5.0 - steel * 5.0]) / (steel + wood)
        moved = with_load(mesh, load)
        np.testing.assert_allclose(moved.center_mass, center, atol=1e-12)
        assert moved.report.center_mass_from == "densities"
        assert mesh.report.center_mass_from == "volume"
        assert moved.torque_scale != mesh.torque_scale
        assert load_mesh(moved, repair="none").center_mass == pytest.approx(center)


@settings(max_examples=15, deadline=None)
@given(density=DENSITY, other=DENSITY)
def test_the_centre_is_between_those_of_the_bodies(density: float, other: float) -> None:
    apart = block((10.0, 10.0, 10.0), (100.0, 0.0, 0.0))
    mesh = mesh_of(BASE, apart)
    same = with_load(mesh, Load(density=(density, density)))
    np.testing.assert_allclose(same.center_mass, mesh.center_mass, atol=1e-9)
    masses = np.array([25_000.0, 1000.0]) * [density, other]
    found = with_load(mesh, Load(density=(density, other))).center_mass
    expected = masses @ np.array([[0.0, 0.0, -5.0], [100.0, 0.0, 0.0]]) / masses.sum()
    np.testing.assert_allclose(found, expected, atol=1e-9)


def test_a_load_is_applied_once_and_another_one_anew() -> None:
    mesh, heavy = mesh_of(BASE, LID), Load(density=(7850, 700))
    once = with_load(mesh, heavy)
    np.testing.assert_array_equal(with_load(once, heavy).center_mass, once.center_mass)
    other = Load(density=(700, 7850))
    anew = with_load(once, other).center_mass
    np.testing.assert_array_equal(anew, with_load(mesh, other).center_mass)
    assert with_load(mesh, Load(mass=1.0)) is mesh
    assert with_load(mesh, Load(density=700.0)) is mesh
    assert loaded_mesh(mesh, None) == (mesh, None)
    radius = Load(mass=1.0, center_of_mass_radius="0.2cm")
    assert loaded_mesh(mesh, radius) == (mesh, Load(mass=1.0, center_of_mass_radius=2.0))


def test_a_cavity_is_part_of_the_body_around_it() -> None:
    outer, inner = block((40.0,) * 3, (0.0,) * 3), block((20.0,) * 3, (5.0, 0.0, 0.0))
    inner.invert()
    mesh = mesh_of(outer, inner, block((10.0,) * 3, (60.0, 0.0, 0.0)))
    assert mesh.solids is not None
    volumes = mesh.solids.volumes * mesh.size**3
    np.testing.assert_allclose(volumes, [40.0**3 - 20.0**3, 1000.0], rtol=1e-12)
    hollow = mesh.solids.centers[0] * mesh.size + mesh.center
    np.testing.assert_allclose(hollow, [-5.0 * 8.0 / 56.0, 0.0, 0.0], atol=1e-12)


@pytest.mark.parametrize(
    ("mesh", "load", "words"),
    [
        (
            mesh_of(BASE, LID),
            Load(density=(1, 2, 3)),
            r"3 values, .* but trimesh.* has 2 \(volumes",
        ),
        (mesh_of(BASE), Load(density=(1, 2)), "2 values, .* has 1: give one density"),
        (
            mesh_of(HEAD, HANDLE),
            Load(density=(1, 2)),
            r"bodies overlap \(their volumes add to 1\.0",
        ),
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
        with_load(mesh, load)
    assert mesh.report.source in str(error.value)
    assert "\n" not in str(error.value)


def test_an_open_mesh_needs_mass_and_centre_of_mass() -> None:
    mesh = load_mesh(OPEN, unit="cm", center_of_mass="1mm,0,-2mm", max_edge=1.0)
    np.testing.assert_allclose(mesh.center_mass, [0.1, 0.0, -0.2], atol=1e-15)
    assert mesh.report.center_mass_from == "given"
    assert not any("centre of mass" in warning for warning in mesh.report.warnings)
    assert with_load(mesh, Load(mass=1.0)) is mesh


def test_many_bodies_have_no_densities_of_their_own() -> None:
    cubes = [block((1.0,) * 3, (2.0 * k, 0.0, 0.0)) for k in range(65)]
    mesh = mesh_of(*cubes)
    with pytest.raises(SettingError, match=r"65 values, .* has too many: give one density"):
        with_load(mesh, Load(density=tuple(range(1, 66))))
    assert mass_of(mesh, Load(density=1e9)) == pytest.approx(65.0)
    fewer = mesh_of(*cubes[:64])
    assert mass_of(fewer, Load(density=(1e9,) * 64)) == pytest.approx(64.0)


@pytest.mark.parametrize(
    ("given_center", "stored"),
    [
        ("10mm,0,-2.5mm", (Measure(10.0, "mm"), 0.0, Measure(-2.5, "mm"))),
        (" 1 , 2,3", (1.0, 2.0, 3.0)),
        ((1, 2.5, "3cm"), (1.0, 2.5, Measure(3.0, "cm"))),
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
    with pytest.raises(SettingError, match="center_of_mass must be three finite lengths, x,y,z"):
        MeshOptions(center_of_mass=bad)


def test_the_centre_is_in_the_frame_and_unit_of_the_mesh() -> None:
    box = shapes.box((40.0, 40.0, 40.0))
    mesh = load_mesh((box[0] + 100.0, box[1]), unit="mm", center_of_mass="10.1cm,100,99")
    np.testing.assert_allclose(mesh.center_mass, [101.0, 100.0, 99.0], atol=1e-12)
    assert mesh.options.center_of_mass == (101.0, 100.0, 99.0)
    assert mesh.torque_scale == pytest.approx(math.sqrt(21.0**2 + 20.0**2 + 21.0**2))
    with pytest.raises(SettingError, match=r"center_of_mass is 10\.1 cm, but the unit .* not"):
        load_mesh(box, center_of_mass="10.1cm,100,99")


def test_a_centre_outside_the_object_is_warned_about_and_a_far_one_refused() -> None:
    box = shapes.box((40.0, 40.0, 40.0))
    inside = load_mesh(box, center_of_mass=(19.9, 0.0, 0.0))
    assert not inside.report.warnings
    outside = load_mesh(box, center_of_mass=(30.0, 0.0, 0.0))
    assert any("outside the object's bounding box" in one for one in outside.report.warnings)
    assert any("bounding box" in one.message for one in check_mesh(outside).warnings)
    with pytest.raises(SettingError, match=r"center_of_mass is .* times the object's size away"):
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


def test_bodies_without_a_mass_have_no_densities(monkeypatch: pytest.MonkeyPatch) -> None:
    outer = block((10.0,) * 3, (0.0,) * 3)
    cavities = [block((9.0,) * 3, (shift, 0.0, 0.0)) for shift in (-0.2, 0.2)]
    for cavity in cavities:
        cavity.invert()
    whole: Any = trimesh.util.concatenate([outer, *cavities])
    assert Bodies(whole.vertices, whole.faces).solids() is None

    def refuse(_bodies: Bodies) -> None:
        NESTED_BODIES.check(1e12)

    monkeypatch.setattr(Bodies, "solids", refuse)
    mesh = mesh_of(BASE)  # a mesh is not refused for it
    assert mesh.solids is None
    assert mass_of(mesh, Load(density=1000.0)) == pytest.approx(0.025)
