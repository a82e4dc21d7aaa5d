"""Diagnoses of meshes with known defects."""

import math
from pathlib import Path

import numpy as np
import pytest
import trimesh

from grasp3d import GraspModel, check_mesh
from grasp3d.errors import MeshError
from grasp3d.mesh.diagnosis import MeshDiagnosis, Trust
from tests.helpers import shapes
from tests.helpers.repairs import inward, joined, moved
from tests.helpers.shapes import Surface


def written(folder: Path, surface: Surface, name: str = "part.ply") -> Path:
    trimesh.Trimesh(*surface, process=False).export(folder / name)
    return folder / name


def test_a_sound_mesh_has_no_warnings(tmp_path: Path) -> None:
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
    assert (found.crossing_faces, found.bodies) == (0, 1)
    assert found.noise < math.radians(0.5)
    assert (found.unit, found.guess.unit) == ("m", "m")
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


def test_repair_none_keeps_the_orientation_and_warns(tmp_path: Path) -> None:
    vertices, faces = shapes.sphere(2)
    found = check_mesh(written(tmp_path, (vertices, faces[:, ::-1])), repair="none")
    assert found.after.volume == found.before.volume
    assert found.trust is not Trust.YES


@pytest.mark.parametrize(("left_out", "trust"), [(8, Trust.CARE), (200, Trust.NO)])
def test_the_area_of_holes_decides_the_trust(tmp_path: Path, left_out: int, trust: Trust) -> None:
    vertices, faces = shapes.sphere(3)
    height = vertices[faces].mean(axis=1)[:, 2]
    kept = faces[np.argsort(height)[: len(faces) - left_out]]
    path = written(tmp_path, (vertices, kept))
    found = check_mesh(path)
    assert found.trust is trust
    assert found.after.volume is None
    assert found.after.boundary_edges > 0
    assert any("--repair full" in warning.message for warning in found.warnings)
    repaired = check_mesh(path, repair="full")
    assert repaired.after.closed
    assert repaired.trust is Trust.CARE  # the filling is a guess
    assert any("closed by a guess" in warning.message for warning in repaired.warnings)


def test_a_sheet_without_interior_is_not_trusted(tmp_path: Path) -> None:
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    found = check_mesh(written(tmp_path, (vertices, np.array([[0, 1, 2], [0, 2, 1]])), "a.off"))
    assert found.trust is Trust.NO


def test_a_self_intersecting_surface_has_a_warning(tmp_path: Path) -> None:
    vertices, faces = shapes.torus(1.0, 0.3)
    folded = vertices.copy()
    folded[:, 0] = np.abs(folded[:, 0] + 0.2) - 0.2  # one half folded into the other
    found = check_mesh(written(tmp_path, (folded, faces)), repair="none")
    assert found.crossing_faces > 0
    assert any("intersect others" in warning.message for warning in found.warnings)


@pytest.mark.parametrize(("sections", "trust"), [(256, Trust.CARE), (16, Trust.NO)])
def test_the_self_intersecting_area_decides_the_trust(
    tmp_path: Path, sections: int, trust: Trust
) -> None:
    """A finer torus of the same shape, folded into itself, has less area of faces that cross."""
    torus = trimesh.creation.torus(1.0, 0.3, major_sections=sections, minor_sections=sections)
    points = torus.vertices.copy()
    points[:, 0] = np.abs(points[:, 0] + 0.2) - 0.2
    found = check_mesh(written(tmp_path, (points, torus.faces)), repair="none")
    trusts = [one.trust for one in found.warnings if "intersect others" in one.message]
    assert trusts == [trust]


def test_degenerate_faces_do_not_open_a_surface(tmp_path: Path) -> None:
    vertices, faces = shapes.box()
    found = check_mesh(written(tmp_path, (vertices, np.append(faces, [[0, 0, 1]], axis=0))))
    assert found.before.closed
    assert (found.before.faces, found.after.faces) == (13, 12)


def noisy(surface: Surface, deviation: float) -> Surface:
    vertices, faces = surface
    noise = np.random.default_rng(5).normal(0.0, deviation, len(vertices))
    return vertices * (1.0 + noise)[:, None], faces


def noise_messages(found: MeshDiagnosis) -> list[str]:
    messages = [warning.message for warning in found.warnings]
    return [message for message in messages if "the surface is rough" in message]


def test_a_rough_surface_has_a_warning(tmp_path: Path) -> None:
    found = check_mesh(written(tmp_path, noisy(shapes.sphere(4), 0.007)))
    assert found.trust is Trust.CARE
    (message,) = noise_messages(found)
    assert f"errors of about {math.degrees(found.noise):.2g} degrees; smooth it" in message
    assert noise_messages(check_mesh(written(tmp_path, noisy(shapes.sphere(4), 0.001)))) == []


def test_separate_bodies_have_a_warning_and_cavities_have_none(tmp_path: Path) -> None:
    ball = shapes.sphere(2, 0.05)
    found = check_mesh(written(tmp_path, joined(ball, moved(ball, (0.2, 0.2, 0.2)))))
    assert (found.bodies, found.trust) == (2, Trust.CARE)
    assert any("separate bodies: 2," in warning.message for warning in found.warnings)
    hollow = joined(ball, inward(shapes.sphere(2, 0.025)))
    found = check_mesh(written(tmp_path, hollow))
    assert (found.bodies, found.trust) == (1, Trust.YES)


def test_a_mesh_that_cannot_be_loaded_cannot_be_checked(tmp_path: Path) -> None:
    (tmp_path / "empty.stl").write_bytes(b"")
    with pytest.raises(MeshError, match="is empty"):
        check_mesh(tmp_path / "empty.stl")


def test_more_fingers_cost_more(tmp_path: Path) -> None:
    path = written(tmp_path, shapes.box())
    two, three = (check_mesh(path, model=GraspModel(fingers=n)).cost for n in (2, 3))
    assert three.seconds > two.seconds
    assert three.memory > two.memory


@pytest.mark.slow
def test_the_diagnosis_does_not_depend_on_position_and_scale(tmp_path: Path) -> None:
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
