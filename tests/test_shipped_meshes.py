"""The files of the object library agree with their README and are clean."""

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh

FOLDER = Path(__file__).parents[1] / "meshes"
README = FOLDER / "README.md"
PICTURE = FOLDER / "gallery.png"
FILES = sorted(path for path in FOLDER.iterdir() if path not in {README, PICTURE})
LEAST_ANGLE_DEG = 20.0
MILLIMETRE = 1e-3


def load(name: str) -> trimesh.Trimesh:
    return trimesh.load_mesh(FOLDER / name)


@pytest.fixture(scope="module", params=FILES, ids=lambda path: path.name)
def path(request: pytest.FixtureRequest) -> Path:
    return request.param


@pytest.fixture(scope="module")
def mesh(path: Path) -> trimesh.Trimesh:
    return load(path.name)


def rows() -> dict[str, list[str]]:
    """Cells of each row of the README's table after the file name, by file name."""
    text = README.read_text(encoding="utf-8")
    table = re.findall(r"^\| (\S+\.\w+) \|(.*)\|$", text, re.MULTILINE)
    return {name: [cell.strip() for cell in rest.split("|")] for name, rest in table}


def test_there_are_many_objects_in_many_formats() -> None:
    assert len(FILES) >= 12
    endings = [path.suffix for path in FILES]
    assert len(set(endings)) >= 5
    assert all(endings.count(ending) >= 2 for ending in endings)


def test_readme_lists_exactly_the_files() -> None:
    assert sorted(rows()) == [path.name for path in FILES]


@pytest.mark.slow
def test_readme_has_size_and_count(path: Path, mesh: trimesh.Trimesh) -> None:
    _, size, triangles, volume, angle, remark = rows()[path.name]
    assert size == " x ".join(f"{length / MILLIMETRE:.0f}" for length in mesh.extents)
    assert int(triangles) == len(mesh.faces)
    assert float(volume) == pytest.approx(mesh.volume * 1e6, abs=0.06)
    assert float(angle) == pytest.approx(np.degrees(mesh.face_angles.min()), abs=0.51)
    assert remark


def test_file_is_small(path: Path) -> None:
    assert path.stat().st_size < 500_000


def test_one_closed_body_with_normals_outward(mesh: trimesh.Trimesh) -> None:
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.body_count == 1
    assert mesh.volume > 0


def test_fine_enough_and_without_slivers(mesh: trimesh.Trimesh) -> None:
    assert 5_000 <= len(mesh.faces) <= 30_000
    assert np.degrees(mesh.face_angles.min()) >= LEAST_ANGLE_DEG


def test_longest_side_fits_metres(mesh: trimesh.Trimesh) -> None:
    assert 0.02 <= mesh.extents.max() <= 0.5


DISTANCES: dict[str, Callable[..., np.ndarray]] = {
    "sphere.stl": lambda x, y, z: np.hypot(np.hypot(x, y), z) - 0.0335,
    "box.obj": lambda *xyz: (np.abs(xyz).T - (0.020, 0.030, 0.050)).max(axis=1),
    "cylinder.ply": lambda x, y, z: np.maximum(np.hypot(x, y) - 0.033, abs(z - 0.055) - 0.055),
    "cone.off": lambda x, y, z: np.maximum(np.hypot(x, y) - 0.030 * (1 - z / 0.080), -z),
    "torus.glb": lambda x, y, z: np.hypot(np.hypot(x, y) - 0.035, z) - 0.010,
}
"""Distance from the surface of a solid, below 0 inside."""


@pytest.mark.parametrize("name", DISTANCES)
def test_a_solid_lies_on_its_surface(name: str) -> None:
    assert abs(DISTANCES[name](*load(name).vertices.T)).max() < 1e-8


@pytest.mark.parametrize(
    ("name", "holes"), [("mug.glb", 1), ("torus.glb", 1), ("tee.glb", 2), ("nut.obj", 1)]
)
def test_holes_go_through(name: str, holes: int) -> None:
    assert load(name).euler_number == 2 - 2 * holes


def test_a_finger_fits_the_handle_of_the_mug() -> None:
    """A bar of 20 mm through the handle, seen as a bundle of rays along y, touches nothing."""
    turn = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    x, z = 0.0525 + 0.010 * np.cos(turn), 0.0475 + 0.010 * np.sin(turn)
    start = np.column_stack((x, np.full_like(turn, -0.1), z))
    along_y = np.tile((0.0, 1.0, 0.0), (len(turn), 1))
    assert not load("mug.glb").ray.intersects_any(start, along_y).any()


def test_gallery_picture_is_small() -> None:
    assert PICTURE.stat().st_size <= 500_000
