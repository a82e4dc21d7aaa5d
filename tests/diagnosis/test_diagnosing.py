"""What a diagnosis says of meshes whose faults are known."""

import math
from pathlib import Path

import numpy as np
import pytest
import trimesh

from grasp3d import GraspModel, Sampling, check_mesh
from grasp3d.diagnosis import MeshDiagnosis, Trust, length_warnings
from grasp3d.diagnosis.mesh_warnings import self_intersection_warnings
from grasp3d.errors import MeshError
from grasp3d.settings import MeshOptions
from tests.helpers import shapes
from tests.helpers.shapes import Surface


def written(folder: Path, surface: Surface, name: str = "part.ply") -> Path:
    trimesh.Trimesh(*surface, process=False).export(folder / name)
    return folder / name


def test_of_a_sound_mesh_nothing_is_doubted(tmp_path: Path) -> None:
    found = check_mesh(written(tmp_path, shapes.box((0.04, 0.06, 0.08))), unit="m")
    assert found.trust is Trust.YES
    assert found.warnings == found.repairs == ()
    assert found.before == found.after
    assert found.after.closed
    assert (found.after.boundary_edges, found.after.crowded_edges) == (0, 0)
    assert found.after.volume == pytest.approx(0.04 * 0.06 * 0.08)
    assert found.after.area == pytest.approx(2.0 * (24e-4 + 32e-4 + 48e-4))
    assert found.after.center_mass == pytest.approx((0.0, 0.0, 0.0), abs=1e-12)
    assert found.extents == pytest.approx((0.04, 0.06, 0.08))
    assert (found.crossing_faces, found.self_intersecting_fraction, found.bodies) == (0, 0.0, 1)
    assert found.noise < math.radians(0.5)
    assert (found.manifold, found.unit, found.guess.unit) == ("NoError", "m", "m")
    assert found.file_bytes == (tmp_path / "part.ply").stat().st_size
    assert found.label_vertices > found.after.vertices  # long edges are divided
    assert 0.2 < found.cost.memory < 0.5
    assert found.cost.seconds > 0.0


def test_an_inside_out_mesh_has_a_negative_volume_before_repair_and_not_after(
    tmp_path: Path,
) -> None:
    vertices, faces = shapes.sphere(3)
    found = check_mesh(written(tmp_path, (vertices, faces[:, ::-1])))
    assert found.before.volume is not None
    assert found.after.volume == pytest.approx(-found.before.volume)
    assert found.before.volume < 0.0
    assert [step.name for step in found.repairs] == ["inverted"]
    assert found.trust is Trust.YES


def test_repair_none_leaves_it_and_says_so(tmp_path: Path) -> None:
    vertices, faces = shapes.sphere(2)
    found = check_mesh(written(tmp_path, (vertices, faces[:, ::-1])), repair="none")
    assert found.after.volume == found.before.volume
    assert found.trust is not Trust.YES


@pytest.mark.parametrize(("left_out", "trust"), [(8, Trust.CARE), (200, Trust.NO)])
def test_how_much_is_missing_decides_the_trust(tmp_path: Path, left_out: int, trust: Trust) -> None:
    vertices, faces = shapes.sphere(3)
    height = vertices[faces].mean(axis=1)[:, 2]
    kept = faces[np.argsort(height)[: len(faces) - left_out]]
    path = written(tmp_path, (vertices, kept))
    found = check_mesh(path)
    assert found.trust is trust
    assert found.after.volume is None
    assert found.after.boundary_edges > 0
    assert any("--repair full" in warning.message for warning in found.warnings)
    assert found.manifold == "NotManifold"
    mended = check_mesh(path, repair="full")
    assert mended.after.closed
    assert mended.manifold == "NoError"
    assert mended.trust is trust  # what closes them is a guess
    assert any("closed by a guess" in warning.message for warning in mended.warnings)


def test_a_sheet_without_inside_is_not_trusted(tmp_path: Path) -> None:
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    found = check_mesh(written(tmp_path, (vertices, np.array([[0, 1, 2], [0, 2, 1]])), "a.off"))
    assert found.trust is Trust.NO


def test_a_surface_that_crosses_itself_is_told(tmp_path: Path) -> None:
    vertices, faces = shapes.torus(1.0, 0.3)
    folded = vertices.copy()
    folded[:, 0] = np.abs(folded[:, 0] + 0.2) - 0.2  # one half folded into the other
    found = check_mesh(written(tmp_path, (folded, faces)), repair="none")
    assert found.crossing_faces > 0
    assert 0.0 < found.self_intersecting_fraction < 1.0
    assert any("cross others" in warning.message for warning in found.warnings)


@pytest.mark.parametrize(
    ("count", "share", "trust"), [(0, 0.0, []), (5, 0.05, [Trust.CARE]), (5, 0.2, [Trust.NO])]
)
def test_how_much_crosses_decides_the_trust(count: int, share: float, trust: list[Trust]) -> None:
    assert [warning.trust for warning in self_intersection_warnings(count, share)] == trust


def test_faces_that_have_collapsed_open_no_surface(tmp_path: Path) -> None:
    vertices, faces = shapes.box()
    found = check_mesh(written(tmp_path, (vertices, np.append(faces, [[0, 0, 1]], axis=0))))
    assert found.before.closed
    assert (found.before.faces, found.after.faces) == (13, 12)


def noisy(surface: Surface, share: float) -> Surface:
    vertices, faces = surface
    noise = np.random.default_rng(5).normal(0.0, share, len(vertices))
    return vertices * (1.0 + noise)[:, None], faces


def told_of_noise(found: MeshDiagnosis) -> list[str]:
    return [warning.message for warning in found.warnings if "normals are off" in warning.message]


def test_a_rough_surface_is_told_with_a_patch_that_calms_it(tmp_path: Path) -> None:
    path = written(tmp_path, noisy(shapes.sphere(4), 0.007))
    found = check_mesh(path)
    assert found.trust is Trust.CARE
    (told,) = told_of_noise(found)
    radius = float(told.split(" patch of ")[1].split()[0])
    assert 0.02 < radius / found.size < 0.1
    assert check_mesh(path, patch_radius=radius).trust is Trust.YES
    (small,) = told_of_noise(check_mesh(path, patch_radius=0.5 * radius))
    assert f"is small for it, {radius:g} may do" in small


def test_of_a_surface_too_rough_for_a_patch_that_is_told(tmp_path: Path) -> None:
    (told,) = told_of_noise(check_mesh(written(tmp_path, noisy(shapes.sphere(4), 0.03))))
    assert "smooth or remesh it" in told
    vertices, faces = shapes.torus(1.0, 0.03)  # a ring of wire, thinner than any patch
    noise = np.random.default_rng(2).normal(0.0, 0.001, vertices.shape)
    (thin,) = told_of_noise(check_mesh(written(tmp_path, (vertices + noise, faces))))
    assert "smooth or remesh it" in thin


def test_separate_bodies_are_told_and_cavities_are_none(tmp_path: Path) -> None:
    vertices, faces = shapes.sphere(2, 0.05)
    two = np.concatenate([vertices, vertices + 0.2]), np.concatenate([faces, faces + len(vertices)])
    found = check_mesh(written(tmp_path, two))
    assert (found.bodies, found.cavities, found.trust) == (2, 0, Trust.CARE)
    assert any("separate bodies, 2," in warning.message for warning in found.warnings)
    hollow = (
        np.concatenate([vertices, 0.5 * vertices]),
        np.concatenate([faces, faces[:, ::-1] + len(vertices)]),
    )
    found = check_mesh(written(tmp_path, hollow))
    assert (found.bodies, found.cavities, found.trust) == (1, 1, Trust.YES)


@pytest.mark.parametrize(("far", "trust"), [(0.2, Trust.CARE), (10.0, Trust.NO)])
def test_strays_that_make_the_object_large_are_told(
    tmp_path: Path, far: float, trust: Trust
) -> None:
    vertices, faces = shapes.sphere(3, 0.05)
    small = 0.01 * vertices + far
    both = np.concatenate([vertices, small]), np.concatenate([faces, faces + len(vertices)])
    found = check_mesh(written(tmp_path, both))
    assert found.trust is trust
    assert any("stray pieces, 1," in warning.message for warning in found.warnings)


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"max_opening": 80.0}, "max_opening 80 is 1,000 times the object's size"),
        ({"max_opening": 0.0004}, "max_opening 0.0004 is 1/200 of"),
        ({"min_opening": 0.1}, "min_opening 0.1 is 1.25 times"),
        ({"max_opening": 0.05}, ""),
        ({"max_opening": 0.3}, ""),
        ({}, ""),
    ],
)
def test_lengths_in_another_unit_are_told(given: dict[str, float], told: str) -> None:
    said = length_warnings(0.08, "m", GraspModel(), Sampling(**given), MeshOptions())  # type: ignore[arg-type]
    assert ([told in line and "in m;" in line for line in said] == [True]) if told else not said


def test_lengths_of_an_unstated_unit_say_so() -> None:
    model = GraspModel(torsion_radius=5.0)
    (said,) = length_warnings(0.08, None, model, Sampling(), MeshOptions())
    assert "which nobody stated" in said


def test_what_cannot_be_loaded_cannot_be_checked(tmp_path: Path) -> None:
    (tmp_path / "empty.stl").write_bytes(b"")
    with pytest.raises(MeshError, match="is empty"):
        check_mesh(tmp_path / "empty.stl")


def test_more_fingers_cost_more(tmp_path: Path) -> None:
    path = written(tmp_path, shapes.box())
    two, three = (check_mesh(path, model=GraspModel(fingers=n)).cost for n in (2, 3))
    assert three.seconds > two.seconds
    assert three.memory > two.memory


def test_moving_and_scaling_change_no_verdict(tmp_path: Path) -> None:
    vertices, faces = shapes.torus(1.0, 0.3)
    kept = faces[5:]
    found = check_mesh(written(tmp_path, (vertices, kept)))
    moved = check_mesh(
        written(tmp_path, (1000.0 * vertices @ shapes.rotation(3).T + 500.0, kept), "moved.ply")
    )
    assert moved.trust is found.trust
    assert moved.size == pytest.approx(1000.0 * found.size)
    assert moved.after.area == pytest.approx(1e6 * found.after.area)
    assert moved.noise == pytest.approx(found.noise, abs=1e-4)
    assert len(moved.warnings) == len(found.warnings)
