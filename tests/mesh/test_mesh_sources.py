"""Files, arrays and objects of other libraries give one mesh, through one set of checks."""

from collections.abc import Callable
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import pyvista
import trimesh

from grasp3d import (
    Label,
    MeshOptions,
    check_mesh,
    evaluate_grasps,
    label_surface,
    load_mesh,
    scan_surface,
)
from grasp3d.errors import MeshError
from grasp3d.mesh.mesh_files import read_mesh
from grasp3d.mesh.sources import RawMesh
from tests.helpers import shapes

MESHES = Path(__file__).parents[2] / "meshes"
FILE = MESHES / "nut.obj"


def legacy_open3d(raw: RawMesh) -> Any:
    open3d = shapes.reader("open3d")
    vertices = open3d.utility.Vector3dVector(raw.vertices)
    triangles = open3d.utility.Vector3iVector(raw.faces.astype(np.int32))
    return open3d.geometry.TriangleMesh(vertices, triangles)


def as_trimesh(raw: RawMesh) -> trimesh.Trimesh:
    return trimesh.Trimesh(raw.vertices, raw.faces, process=False)


SOURCES: dict[str, Callable[[RawMesh], Any]] = {
    "arrays": lambda raw: (raw.vertices, raw.faces),
    "trimesh.Trimesh": as_trimesh,
    "trimesh.Scene": lambda raw: as_trimesh(raw).scene(),
    "pyvista.PolyData": lambda raw: pyvista.PolyData.from_regular_faces(raw.vertices, raw.faces),
    "open3d.TriangleMesh": legacy_open3d,
}
SLOW = pytest.mark.slow  # Open3D takes seconds to import


def each(names: dict[str, Any]) -> list[Any]:
    return [pytest.param(name, marks=SLOW if "open3d" in name else ()) for name in names]


@pytest.mark.parametrize("name", each(SOURCES))
def test_every_kind_of_mesh_has_the_same_surface_report_and_diagnosis(name: str) -> None:
    raw = read_mesh(FILE)
    broken = RawMesh(raw.vertices, raw.faces[:-1, ::-1], "", None)  # inside out, with a hole
    source = SOURCES[name](broken)
    options = MeshOptions(max_edge=1.0, unit="m")
    mesh, expected = load_mesh(source, options), load_mesh((broken.vertices, broken.faces), options)
    np.testing.assert_array_equal(mesh.vertices, expected.vertices)
    np.testing.assert_array_equal(mesh.faces, expected.faces)
    found = mesh.report
    assert (found.source, found.format) == (name, name.partition(".")[0])
    assert [str(step) for step in found.repairs] == [*map(str, expected.report.repairs)] != []
    assert found.warnings == expected.report.warnings
    diagnosis = check_mesh(source, options=options)
    assert (diagnosis.mesh, diagnosis.format, diagnosis.file_bytes) == (name, found.format, None)
    assert (diagnosis.before.closed, diagnosis.before.faces) == (False, len(broken.faces))


def test_transforms_of_a_scene_are_applied() -> None:
    scene, box = trimesh.Scene(), as_trimesh(RawMesh(*shapes.box(), "", None))
    for x in (0.0, 5.0):
        scene.add_geometry(box, transform=trimesh.transformations.translation_matrix([x, 0, 0]))
    mesh = load_mesh(scene, max_edge=9.0)
    assert mesh.report.bodies == 2
    assert np.ptp(mesh.vertices[:, 0]) == pytest.approx(6.0)


@pytest.mark.parametrize(
    ("stated", "unit"), [("millimeters", "mm"), ("Inches", "in"), ("meter", "m"), ("cm", "cm")]
)
def test_the_unit_of_a_trimesh_is_that_of_the_mesh(stated: str, unit: str) -> None:
    box = trimesh.creation.box([0.1, 0.1, 0.1])
    box.units = stated
    for source in (box, box.scene()):
        mesh = load_mesh(source, max_edge=9.0)
        assert (mesh.file_unit, mesh.unit) == (unit, "m")
        assert load_mesh(source, max_edge=9.0, unit="m").unit == "m"


def test_other_units_and_parts_of_different_ones_are_refused() -> None:
    parts = trimesh.creation.box(), trimesh.creation.box()
    parts[0].units = "mm"
    with pytest.raises(MeshError, match="the unit 'mm and none', which is none of m, cm, mm, in"):
        load_mesh(trimesh.Scene(parts), max_edge=9.0)
    parts[0].units = "feet"
    with pytest.raises(MeshError, match=r"trimesh\.Trimesh: states the unit 'feet', which is none"):
        load_mesh(parts[0], max_edge=9.0)


def test_faces_with_more_corners_are_divided_into_triangles() -> None:
    cube = pyvista.Cube().clean()
    assert not cube.is_all_triangles
    mesh = load_mesh(cube, max_edge=9.0)
    assert mesh.volume == pytest.approx(1.0)
    strips = pyvista.Sphere(theta_resolution=8, phi_resolution=8).strip()
    assert load_mesh(strips, max_edge=9.0).report.closed


def test_a_prepared_mesh_stays_unless_other_options_are_given() -> None:
    mesh = load_mesh(shapes.box(), unit="cm", max_edge="5mm")
    assert load_mesh(mesh) is mesh
    assert load_mesh(mesh, mesh.options) is mesh
    again = load_mesh(mesh, crease_angle=0.1)
    options = again.options
    assert (again.file_unit, options.crease_angle, options.max_edge) == ("cm", 0.1, 0.005)
    np.testing.assert_array_equal(again.vertices, mesh.vertices)
    diagnosis = check_mesh(mesh)
    assert diagnosis.after.volume == pytest.approx(1e-6)
    assert diagnosis.label_vertices == len(mesh.vertices)


def test_functions_on_surfaces_take_any_mesh() -> None:
    surface = shapes.sphere(1)
    mesh, poles = load_mesh(surface), np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]])
    for one in (scan_surface(surface, fixed=poles[0]), label_surface(surface)):
        np.testing.assert_array_equal(one.mesh.vertices, mesh.vertices)
    assert evaluate_grasps(surface, poles, max_distance=0.2).label[0] == Label.S


class Tensor:
    """Stands for a tensor of PyTorch, which is not installed."""

    __module__ = "torch"

    def __array__(self, *_: object) -> object:
        raise TypeError("can't convert cuda:0 device type tensor to numpy")


def open3d_object(kind: str) -> Any:
    return attrgetter(kind)(shapes.reader("open3d"))()


def quads() -> Any:
    return shapes.box()[0], np.zeros((6, 4), dtype=int)


WRONG: dict[str, tuple[Callable[[], Any], str]] = {
    "nothing": (lambda: None, "type NoneType is not a mesh; give a path, an ObjectMesh, a trimesh"),
    "a list of paths": (lambda: ["a.stl", "b.stl"], "vertices must be real numbers of shape"),
    "vertices alone": (lambda: shapes.box()[0], "an object of type numpy.ndarray is not a mesh"),
    "quadrilaterals": (quads, r"of shape \(F, 3\), the corners of triangles; got int64 \(6, 4\)"),
    "a tensor": (Tensor, "an object of type torch.Tensor is not a mesh"),
    "a point cloud": (
        lambda: trimesh.PointCloud(np.eye(3)),
        "type trimesh.PointCloud is not a mesh",
    ),
    "an empty scene": (trimesh.Scene, "trimesh.Scene: holds no triangles"),
    "lines": (lambda: pyvista.lines_from_points(np.eye(3)), "points and lines alone are no mesh"),
    "bad corners": (
        lambda: trimesh.Trimesh(np.eye(3), [[0, 1, 7]], process=False),
        "trimesh.Trimesh: face 0 uses vertex 7, but there are 3",
    ),
    "open3d: a point cloud": (
        lambda: open3d_object("geometry.PointCloud"),
        "type open3d.PointCloud is not a mesh",
    ),
}


@pytest.mark.parametrize("name", each(WRONG))
def test_what_is_no_mesh_is_refused_with_a_sentence(name: str) -> None:
    make, message = WRONG[name]
    source = make()
    for function in (load_mesh, check_mesh, label_surface):
        with pytest.raises(MeshError, match=message):
            function(source)
