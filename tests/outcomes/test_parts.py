"""Convex parts of meshes."""

import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.spatial import ConvexHull

from grasp3d import load_mesh
from grasp3d.errors import MeshError, SettingError
from grasp3d.jobs import ClusterSettings
from grasp3d.outcomes import SimulationSettings, convex_parts
from grasp3d.outcomes import simulate as module
from grasp3d.outcomes.simulate import parts_of


@pytest.fixture(autouse=True)
def cache(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    monkeypatch.setenv(module.CACHE, str(tmp_path))
    return tmp_path


@pytest.mark.slow
def test_an_l_shape_has_two_parts_which_are_kept(cache: Path) -> None:
    boxes = [trimesh.creation.box(bounds=[[0, 0, 0], b]) for b in ([3, 1, 1], [1, 3, 1])]
    mesh = load_mesh(trimesh.util.concatenate(boxes), unit="cm", max_edge=9.0)
    found = convex_parts(mesh.vertices, mesh.faces, threshold=0.05)
    assert len(found) == 2
    volumes = [ConvexHull(one).volume for one in found]
    assert sum(volumes) == pytest.approx(mesh.volume, rel=0.02)
    (file,) = (cache / "parts").iterdir()
    again = convex_parts(mesh.vertices, mesh.faces, threshold=0.05)
    for one, other in zip(found, again, strict=True):
        np.testing.assert_array_equal(one, other)
    file.write_bytes(b"damaged")
    assert len(convex_parts(mesh.vertices, mesh.faces, threshold=0.05)) == 2


def test_an_open_mesh_is_refused() -> None:
    box = trimesh.creation.box([1.0, 1.0, 1.0])
    mesh = load_mesh((box.vertices, box.faces[:-2]), unit="cm", repair="none", max_edge=9.0)
    with pytest.raises(MeshError, match="is open, so it bounds no body"):
        parts_of(mesh, SimulationSettings(), ClusterSettings(workers=0))


def test_without_coacd_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "coacd", None)
    box = trimesh.creation.box([1.0, 1.0, 1.1])
    with pytest.raises(SettingError, match=r"needs coacd.*pip install 'grasp3d\[physics\]'"):
        convex_parts(box.vertices, box.faces)
