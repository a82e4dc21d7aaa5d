from pathlib import Path

import numpy as np
import pytest
import trimesh

from grasp3d import MeshError
from grasp3d.mesh.reading import mesh_suffixes, read_mesh
from tests import shapes


def exported(path: Path) -> tuple[np.ndarray, np.ndarray]:
    vertices, faces = shapes.sphere(2)
    vertices = vertices.astype(np.float32).astype(np.float64)
    trimesh.Trimesh(vertices, faces, process=False).export(path)
    return vertices, faces


@pytest.mark.parametrize("suffix", ["ply", "off", "obj", "glb", "gltf", "3mf"])
def test_indexed_formats_keep_their_own_order(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"ball.{suffix}"
    vertices, faces = shapes.sphere(2)
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    if suffix == "gltf":
        for name, data in trimesh.exchange.gltf.export_gltf(trimesh.Scene(mesh)).items():
            (tmp_path / (path.name if name.endswith(".gltf") else name)).write_bytes(data)
    elif suffix == "obj":
        mesh.export(path, digits=12)
    else:
        mesh.export(path)
    raw = read_mesh(path)
    assert raw.vertices == pytest.approx(vertices, abs=1e-6)
    assert np.array_equal(raw.faces, faces)
    assert raw.format == suffix


def test_an_stl_has_each_place_once_in_the_order_of_the_file(tmp_path: Path) -> None:
    path = tmp_path / "ball.stl"
    vertices, faces = exported(path)
    raw = read_mesh(path)
    assert len(raw.vertices) == len(vertices)
    assert np.array_equal(raw.vertices[raw.faces], vertices[faces])
    first_use = list(dict.fromkeys(raw.faces.ravel().tolist()))
    assert first_use == list(range(len(vertices)))


def test_a_textured_obj_keeps_its_vertices(tmp_path: Path) -> None:
    (tmp_path / "t.obj").write_text(
        "mtllib t.mtl\no part\nv 9 9 9\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n"
        "vt 0 0\nvt 1 0\nvt 0 1\nvn 0 0 1\n"
        "usemtl red\nf 2/1/1 4/2/1 3/3/1\nf 2/2/1 3/1/1 5/3/1\n"
        "usemtl blue\ng other\nf -4//1 -1//1 -2//1\nf 3/1 \\\n4/2 5/3\n",
        encoding="utf-8",
    )
    raw = read_mesh(tmp_path / "t.obj")
    assert raw.vertices.tolist() == [[9, 9, 9], [0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
    assert sorted(map(sorted, raw.faces.tolist())) == [[1, 2, 3], [1, 2, 4], [1, 3, 4], [2, 3, 4]]


def test_relative_indices_count_from_where_they_stand(tmp_path: Path) -> None:
    (tmp_path / "r.obj").write_text(
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\nv 0 0 1\nv 1 0 1\nv 0 1 1\nf -3 -2 -1\n",
        encoding="utf-8",
    )
    assert read_mesh(tmp_path / "r.obj").faces.tolist() == [[0, 1, 2], [3, 4, 5]]


def test_a_scene_becomes_one_mesh_with_each_part_in_its_place(tmp_path: Path) -> None:
    box = trimesh.creation.box()
    scene = trimesh.Scene()
    scene.add_geometry(box)
    moved = trimesh.transformations.translation_matrix([3.0, 0.0, 0.0])
    scene.add_geometry(box, transform=moved)
    scene.export(tmp_path / "two.glb")
    raw = read_mesh(tmp_path / "two.glb")
    assert len(raw.faces) == 24
    assert np.ptp(raw.vertices, axis=0) == pytest.approx([4.0, 1.0, 1.0])
    assert raw.unit == "m"


def test_quads_become_triangles(tmp_path: Path) -> None:
    (tmp_path / "q.off").write_text("OFF\n4 1 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3\n")
    assert len(read_mesh(tmp_path / "q.off").faces) == 2


def test_common_formats_are_read() -> None:
    assert {".stl", ".obj", ".ply", ".off", ".glb", ".gltf", ".3mf"} <= mesh_suffixes()


POINTS = (
    b"ply\nformat ascii 1.0\nelement vertex 1\n"
    b"property float x\nproperty float y\nproperty float z\nend_header\n0 0 0\n"
)
BAD = {
    "empty.stl": (b"", "the file is empty"),
    "prose.stl": (b"This is not a mesh.\n" * 40, "holds no triangles"),
    "prose.obj": (b"f a b c\n", "holds no triangles"),
    "beyond.obj": (b"v 0 0 0\nf 1 2 3\n", "cannot be read as OBJ|uses vertex"),
    "prose.ply": (b"plyx", "cannot be read as PLY"),
    "points.ply": (POINTS, "holds no triangles"),
    "cut.glb": (b"glTF\x02\x00\x00\x00", "cannot be read as GLB"),
    "drawing.dxf": (b"0", r"files named \*\.dxf are not read"),
    "noname": (b"0", "has no suffix"),
}


@pytest.mark.parametrize("name", BAD)
def test_damaged_files_are_refused_with_one_line(tmp_path: Path, name: str) -> None:
    data, message = BAD[name]
    (tmp_path / name).write_bytes(data)
    with pytest.raises(MeshError, match=message) as caught:
        read_mesh(tmp_path / name)
    assert "\n" not in str(caught.value)
    assert name in str(caught.value)


def test_a_missing_file_and_a_folder_are_told_apart(tmp_path: Path) -> None:
    with pytest.raises(MeshError, match="there is no such file"):
        read_mesh(tmp_path / "mug.stl")
    (tmp_path / "folder.stl").mkdir()
    with pytest.raises(MeshError, match="is a folder"):
        read_mesh(tmp_path / "folder.stl")


def test_a_file_that_may_not_be_read_and_a_name_that_no_system_takes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(MeshError, match=r"cannot be opened \(File name too long\)"):
        read_mesh(tmp_path / ("x" * 300 + ".ply"))
    exported(tmp_path / "locked.ply")

    def refuse(path: Path) -> bytes:
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.setattr(Path, "read_bytes", refuse)
    with pytest.raises(MeshError, match=r"cannot be opened \(Permission denied\)"):
        read_mesh(tmp_path / "locked.ply")
