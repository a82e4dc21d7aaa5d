"""The files of the object library agree with their README and are clean."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

FOLDER = Path(__file__).parents[1] / "meshes"
README = FOLDER / "README.md"
PICTURE = FOLDER / "gallery.png"
FILES = sorted(path for path in FOLDER.iterdir() if path not in {README, PICTURE})


def rows() -> dict[str, list[str]]:
    """Cells of each row of the README's table after the file name, by file name."""
    text = README.read_text(encoding="utf-8")
    table = re.findall(r"^\| (\S+\.\w+) \|(.*)\|$", text, re.MULTILINE)
    return {name: [cell.strip() for cell in rest.split("|")] for name, rest in table}


def test_there_are_many_objects_in_many_formats_all_in_the_readme() -> None:
    endings = [path.suffix for path in FILES]
    assert len(FILES) >= 12
    assert len(set(endings)) >= 5
    assert all(endings.count(ending) >= 2 for ending in endings)
    assert sorted(rows()) == [path.name for path in FILES]
    assert all(path.stat().st_size <= 500_000 for path in (*FILES, PICTURE))


@pytest.mark.slow
@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_one_fine_closed_body_with_normals_outward_as_the_readme_says(path: Path) -> None:
    mesh: Any = trimesh.load_mesh(path)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert (mesh.body_count, mesh.volume > 0.0) == (1, True)
    assert 5_000 <= len(mesh.faces) <= 30_000
    assert np.degrees(mesh.face_angles.min()) >= 20.0  # no slivers
    assert 0.02 <= mesh.extents.max() <= 0.5  # metres
    _, size, triangles, volume, angle, remark = rows()[path.name]
    assert size == " x ".join(f"{1e3 * length:.0f}" for length in mesh.extents)
    assert int(triangles) == len(mesh.faces)
    assert float(volume) == pytest.approx(mesh.volume * 1e6, abs=0.06)
    assert float(angle) == pytest.approx(np.degrees(mesh.face_angles.min()), abs=0.51)
    assert remark
