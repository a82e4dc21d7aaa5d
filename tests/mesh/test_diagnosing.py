"""Diagnoses of meshes with known defects, and the noise of surfaces."""

import math
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import ConvexHull

from grasp3d import check_mesh, load_mesh
from grasp3d.mesh.diagnosis import MeshDiagnosis, Trust, normal_noise
from grasp3d.mesh.measures import Triangles
from grasp3d.mesh.normals import corner_normals
from grasp3d.settings.mesh_options import Repair
from tests.helpers import shapes
from tests.helpers.repairs import inward, joined, moved
from tests.helpers.shapes import Surface

MESHES = [path for path in shapes.LIBRARY.iterdir() if path.suffix not in {".md", ".png"}]


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


@pytest.mark.parametrize("level", ["safe", "none"])
def test_what_repair_changes_is_told_from_what_it_finds(tmp_path: Path, level: Repair) -> None:
    vertices, faces = shapes.sphere(3)
    broken = np.append(faces[:, ::-1], [[0, 0, 1]], axis=0)  # inside out, with a face of no area
    found = check_mesh(written(tmp_path, (vertices, broken)), repair=level)
    assert found.before.closed
    assert (found.before.faces, found.after.faces) == (len(broken), len(faces))
    assert found.before.volume is not None
    assert found.before.volume < 0.0
    turned = level == "safe"
    assert found.after.volume == pytest.approx((-1.0 if turned else 1.0) * found.before.volume)
    assert [step.name for step in found.repairs] == ["collapsed"] + ["inverted"] * turned
    assert (found.trust is Trust.YES) == turned


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


@pytest.mark.parametrize(("sections", "trust"), [(128, Trust.CARE), (16, Trust.NO)])
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


def roughened(surface: Surface, deviation: float) -> Surface:
    vertices, faces = surface
    noise = np.random.default_rng(5).normal(0.0, deviation, len(vertices))
    return vertices * (1.0 + noise)[:, None], faces


def noise_messages(found: MeshDiagnosis) -> list[str]:
    messages = [warning.message for warning in found.warnings]
    return [message for message in messages if "the surface is rough" in message]


def test_a_rough_surface_has_a_warning(tmp_path: Path) -> None:
    found = check_mesh(written(tmp_path, roughened(shapes.sphere(4), 0.007)))
    assert found.trust is Trust.CARE
    (message,) = noise_messages(found)
    assert f"errors of about {math.degrees(found.noise):.2g} degrees; smooth it" in message
    assert noise_messages(check_mesh(written(tmp_path, roughened(shapes.sphere(4), 0.001)))) == []


def test_separate_bodies_have_a_warning_and_cavities_have_none(tmp_path: Path) -> None:
    ball = shapes.sphere(2, 0.05)
    found = check_mesh(written(tmp_path, joined(ball, moved(ball, (0.2, 0.2, 0.2)))))
    assert (found.bodies, found.trust) == (2, Trust.CARE)
    assert any("separate bodies: 2," in warning.message for warning in found.warnings)
    found = check_mesh(written(tmp_path, joined(ball, inward(shapes.sphere(2, 0.025)))))
    assert (found.bodies, found.trust) == (1, Trust.YES)


@pytest.mark.slow
@pytest.mark.parametrize("path", MESHES[::5], ids=lambda path: path.stem)
def test_shipped_meshes_are_trusted(path: Path) -> None:
    """They are smooth, closed, of one body, and cross themselves nowhere."""
    found = check_mesh(path, unit="m")
    assert (found.trust, found.crossing_faces, found.bodies) == (Trust.YES, 0, 1)
    assert found.noise < math.radians(1.5)


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


HALF_DEGREE = math.radians(0.5)


def uneven_sphere(count: int) -> Surface:
    """A sphere of triangles of all sizes."""
    points = np.random.default_rng(0).normal(size=(count, 3))
    points /= np.linalg.norm(points, axis=1)[:, None]
    faces = ConvexHull(points).simplices.astype(np.int64)
    a, b, c = points[faces].swapaxes(0, 1)
    inside_out = (np.cross(b - a, c - a) * a).sum(axis=1) < 0.0
    faces[inside_out] = faces[inside_out][:, ::-1]
    return points, faces


def cylinder_side(stretch: float) -> Surface:
    """An open cylinder of 96 by 30 quadrangles of an aspect ratio."""
    angle = np.linspace(0.0, 2.0 * np.pi, 96, endpoint=False)
    height = np.arange(30)[:, None] * stretch * 2.0 * np.pi / 96.0
    grid = np.broadcast_arrays(np.cos(angle)[None], np.sin(angle)[None], height)
    i, j = np.meshgrid(np.arange(29) * 96, np.arange(96), indexing="ij")
    a, b = i + j, i + (j + 1) % 96
    faces = [np.stack([a, b, b + 96], -1), np.stack([a, b + 96, a + 96], -1)]
    return np.stack(grid, axis=-1).reshape(-1, 3), np.concatenate(faces).reshape(-1, 3)


def true_normals(name: str, points: np.ndarray) -> np.ndarray:
    """Outward normals of the smooth shape."""
    normals = points.copy()
    if "cylinder" in name:
        normals[:, 2] = 0.0
    if "torus" in name:
        normals[:, :2] *= 1.0 - 1.0 / np.linalg.norm(points[:, :2], axis=1)[:, None]
    return normals / np.linalg.norm(normals, axis=1)[:, None]


def noisy(shape: Surface, sigma: float) -> np.ndarray:
    """Move each vertex by a Gaussian error, in units of the usual edge length."""
    points, faces = shape
    edge = np.median(np.linalg.norm(points[faces[:, 0]] - points[faces[:, 1]], axis=1))
    moved: np.ndarray = points + sigma * edge * np.random.default_rng(1).normal(size=points.shape)
    return moved


def weighted_median(values: np.ndarray, weights: np.ndarray) -> float:
    order = np.argsort(values)
    total = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(total, total[-1] / 2.0)])


ROUND = {
    "sphere": shapes.sphere(4),
    "uneven sphere": uneven_sphere(2000),
    "cylinder": cylinder_side(1.0),
    "long cylinder": cylinder_side(4.0),
    "torus": shapes.torus(),
}


@pytest.mark.parametrize("sigma", [0.03, 0.2, 0.5])
@pytest.mark.parametrize("name", ROUND)
def test_added_noise_is_measured(name: str, sigma: float) -> None:
    points, faces = noisy(ROUND[name], sigma), ROUND[name][1]
    found = corner_normals(Triangles(points, faces), math.pi)
    cosine = -(found.normals * true_normals(name, ROUND[name][0])[found.vertices]).sum(axis=1)
    weights = np.bincount(found.corners.ravel()).astype(np.float64)
    truth = weighted_median(np.arccos(np.clip(cosine, -1.0, 1.0)), weights)
    assert 0.75 * truth < normal_noise(Triangles(points, faces)) < 1.15 * truth


FLAT = {
    "box": shapes.box(),
    "plate": shapes.box((1.0, 0.1, 0.02)),
    "cylinder of 32": shapes.arrays(trimesh.creation.cylinder(0.5, 2.0, sections=32)),
    "cone": shapes.cone(0.3),
    "tube": shapes.tube(),
    "one triangle": (np.eye(3), np.array([[0, 1, 2]])),
}


SMOOTH = {name: shape for name, shape in ROUND.items() if name != "uneven sphere"}


@pytest.mark.parametrize("shape", [*FLAT.values(), *SMOOTH.values(), shapes.lopsided()])
def test_shapes_without_noise_have_none_coarse_or_refined(shape: Surface) -> None:
    mesh = load_mesh(shape)
    for surface in (Triangles(*shape), Triangles(mesh.vertices, mesh.faces)):
        assert normal_noise(surface) < HALF_DEGREE


@pytest.mark.parametrize("sigma", [2.0, 10.0])
def test_very_strong_noise_is_reported_as_large(sigma: float) -> None:
    surface = Triangles(noisy(ROUND["sphere"], sigma), ROUND["sphere"][1])
    assert normal_noise(surface) > math.radians(60.0)


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**32), exponent=st.integers(-6, 6))
def test_noise_is_independent_of_size_rotation_and_order(seed: int, exponent: int) -> None:
    rng = np.random.default_rng(seed)
    points, faces = noisy((shapes.sphere(2)), 0.05), shapes.sphere(2)[1]
    order = rng.permutation(len(points))
    moved = np.empty_like(points)
    moved[order] = points @ shapes.rotation(seed).T * 10.0**exponent
    mixed = np.roll(order[faces], 1, axis=1)[rng.permutation(len(faces))]
    again = normal_noise(Triangles(moved, mixed))
    assert again == pytest.approx(normal_noise(Triangles(points, faces)), rel=1e-6)
