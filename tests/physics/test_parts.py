"""Convex parts, and how far they are from their mesh."""

import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh

from grasp3d import load_mesh
from grasp3d.batch import ClusterSettings
from grasp3d.errors import MeshError, SettingError
from grasp3d.physics import ConvexParts, SimulationSettings, convex_parts
from grasp3d.physics import parts as module
from grasp3d.physics.simulate import divided

CUBE = ConvexParts((np.array(trimesh.creation.box([2.0, 2.0, 2.0]).vertices),))


@pytest.fixture(autouse=True)
def cache(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    monkeypatch.setenv(module.CACHE, str(tmp_path))
    return tmp_path


def test_depths_and_normals_of_a_cube() -> None:
    points = np.array([[1.0, 0.2, 0.3], [0.9, 0.0, 0.0], [1.5, 0.0, 0.0], [0.0, 0.0, 0.0]])
    np.testing.assert_allclose(CUBE.depths(points), [0.0, 0.1, -0.5, 1.0], atol=1e-12)
    np.testing.assert_allclose(CUBE.outward(points[:2]), [[1.0, 0.0, 0.0]] * 2, atol=1e-12)


def test_the_deepest_part_counts() -> None:
    two = ConvexParts((CUBE.vertices[0], CUBE.vertices[0] + [1.0, 0.0, 0.0]))
    np.testing.assert_allclose(two.depths(np.array([[1.0, 0.0, 0.0], [2.0, 0.0, 0.0]])), [1.0, 0.0])
    np.testing.assert_allclose(two.outward(np.array([[2.0, 0.1, 0.0]])), [[1.0, 0.0, 0.0]])


@pytest.mark.slow
def test_an_l_shape_has_two_parts_which_are_kept(cache: Path) -> None:
    boxes = [trimesh.creation.box(bounds=[[0, 0, 0], b]) for b in ([3, 1, 1], [1, 3, 1])]
    mesh = load_mesh(trimesh.util.concatenate(boxes), unit="cm", max_edge=9.0)
    found = convex_parts(mesh.vertices, mesh.faces, threshold=0.05)
    assert found.count == 2
    corner = np.array([[0.01, 0.01, 0.005], [0.029, 0.009, 0.009]])
    np.testing.assert_allclose(found.depths(corner)[0], 0.0, atol=5e-4)
    (file,) = (cache / "parts").iterdir()
    again = convex_parts(mesh.vertices, mesh.faces, threshold=0.05)
    for one, other in zip(found.vertices, again.vertices, strict=True):
        np.testing.assert_array_equal(one, other)
    file.write_bytes(b"damaged")
    assert convex_parts(mesh.vertices, mesh.faces, threshold=0.05).count == 2


def test_an_open_mesh_is_refused() -> None:
    box = trimesh.creation.box([1.0, 1.0, 1.0])
    mesh = load_mesh((box.vertices, box.faces[:-2]), unit="cm", repair="none", max_edge=9.0)
    with pytest.raises(MeshError, match="is open, so it bounds no body"):
        divided(mesh, SimulationSettings(), ClusterSettings(workers=0))


def test_without_coacd_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "coacd", None)
    box = trimesh.creation.box([1.0, 1.0, 1.1])
    with pytest.raises(SettingError, match=r"needs coacd.*pip install 'grasp3d\[physics\]'"):
        convex_parts(box.vertices, box.faces)
