"""Mesh formats: positions and faces in the order of the file, and errors of damaged files."""

import os
import struct
from pathlib import Path

import numpy as np
import pytest
import trimesh

from grasp3d.errors import MeshError
from grasp3d.mesh.mesh_files import read_mesh
from tests.helpers import mesh_files, shapes
from tests.helpers.mesh_files import FACES, SIX, VERTICES, written


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


def test_an_stl_has_each_position_once_in_the_order_of_the_file(tmp_path: Path) -> None:
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


def test_relative_indices_count_from_their_line(tmp_path: Path) -> None:
    (tmp_path / "r.obj").write_text(
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\nv 0 0 1\nv 1 0 1\nv 0 1 1\nf -3 -2 -1\n",
        encoding="utf-8",
    )
    assert read_mesh(tmp_path / "r.obj").faces.tolist() == [[0, 1, 2], [3, 4, 5]]


def face_corners(path: Path) -> np.ndarray:
    """Sorted corner positions of each face, each face starting with its smallest corner."""
    raw = read_mesh(path)
    return sorted_faces(raw.vertices[raw.faces])


def sorted_faces(corners: np.ndarray) -> np.ndarray:
    faces = []
    for face in corners.tolist():
        start = min(range(3), key=lambda k: face[k])
        faces.append([face[(start + k) % 3] for k in range(3)])
    return np.array(sorted(faces))


TETRAHEDRON = sorted_faces(VERTICES[FACES])
STL = mesh_files.stl_text()
OFF = mesh_files.off_text()
OBJ = mesh_files.obj_text()
PLY = mesh_files.ply_text()
HALF = STL.index("  facet", 20)
GOOD: dict[str, str | bytes] = {
    "plain.stl": STL,
    "capitals.stl": STL.upper(),
    "windows.stl": mesh_files.stl_text(end="\r\n"),
    "old_mac.stl": mesh_files.stl_text(end="\r"),
    "cut_newline.stl": STL.rstrip(),
    "solid.stl": mesh_files.stl_text("my solid part"),
    "endsolid.stl": mesh_files.stl_text("endsolid"),
    "vertex.stl": mesh_files.stl_text("vertex 1 2 3 facet normal outer loop"),
    "latin.stl": STL.encode().replace(b"part", "Müller".encode("latin-1")),
    "two_solids.stl": STL[:HALF] + "endsolid part\nsolid Other\n" + STL[HALF:],
    "nameless.stl": STL.replace(" part", ""),
    "binary.stl": mesh_files.stl_binary(),
    "binary_solid.stl": mesh_files.stl_binary(b"solid exported facet normal"),
    "coloured.stl": mesh_files.stl_binary(b"COLOR=\x80\x80\x80\xff", attribute=0x83FF),
    "trailing.stl": mesh_files.stl_binary(b"solid", tail=b"\0"),
    "plain.off": OFF,
    "comments.off": "# top\n"
    + OFF.replace("OFF", "OFF # kind\n# counts:").replace("\n3", " # x\n3"),
    "late_comment.off": OFF.replace("\n3", "\n# faces\n3", 1),
    "ends.off": OFF.replace("\n", " # a 1 2\n").replace("4 4 6", "4 # vertices\n4 # faces\n6"),
    "between.off": OFF.replace("\n", "\n# 7 8 9\n\n"),
    "counts.off": OFF.replace("OFF\n4 4 6", "off 4\n4"),
    "long_comment.off": "# " + 70_000 * "x" + "\n" + OFF,
    "marked.off": "\ufeff" + OFF,
    "normals.off": OFF.replace("OFF", "NOFF").replace(".0\n", ".0 0 0 1 # up\n"),
    "colours.off": OFF.replace("OFF", "COFF # rgba").replace(".0\n", ".0 1 0 0 1\n"),
    "coloured.off": OFF.replace("\n", " 255 0 0\n").replace("OFF 255 0 0", "OFF", 1),
    "first_line.off": OFF.replace("OFF\n", "COFF  "),
    "blank_lines.off": OFF.replace("\n", "\n\n"),
    "windows.off": OFF.replace("\n", "\r\n").rstrip(),
    "plain.obj": OBJ,
    "windows.obj": OBJ.replace("\n", "\r\n").rstrip(),
    "continued.obj": OBJ.replace("f 1 3 2", "f 1 \\\n3 \\\n2"),
    "negative.obj": OBJ.replace("f 1 3 2", "f -4 -2 -3"),
    "others.obj": "o a\ng b\ns off\nvp 1 2\n" + OBJ.replace("v 0.0", "v\t0.0") + "l 1 2\np 1\n",
    "weights.obj": OBJ.replace("v 1.0 0.0 0.0", "v 1.0 0.0 0.0 1.0 0.5 0.5"),
    "plain.ply": PLY,
    "windows.ply": PLY.replace("\n", "\r\n"),
    "comment.ply": PLY.replace("element face", "comment the end_header comes\nelement face"),
    "latin.ply": PLY.encode().replace(b"element", "comment für\nelement".encode("latin-1"), 1),
    "blank_lines.ply": PLY.replace("\n3", "\n\n3"),
    "texture.ply": PLY.replace("ply\n", "ply\n", 1).replace(
        "end", "comment TextureFile a.png\nend"
    ),
    "edges.ply": PLY.replace(
        "end_header", "element edge 1\nproperty int vertex1\nproperty int vertex2\nend_header"
    )
    + "0 1\n",
}


@pytest.mark.parametrize("name", GOOD)
def test_every_variant_of_a_tetrahedron_is_read(tmp_path: Path, name: str) -> None:
    assert np.array_equal(face_corners(written(tmp_path, name, GOOD[name])), TETRAHEDRON)


POLYGONS = [[0, 1, 2, 3], [3, 4, 0], [0, 4, 3, 2, 1]]
"""Twelve corners, as of three quads: trimesh assumes that all faces are like the first."""


def fans(polygons: list[list[int]]) -> np.ndarray:
    rows = [[p[0], p[k], p[k + 1]] for p in polygons for k in range(1, len(p) - 1)]
    return sorted_faces(SIX[np.array(rows)])


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("number", ["float", "double"])
@pytest.mark.parametrize("polygons", [POLYGONS, POLYGONS[:2], POLYGONS[1:2], POLYGONS[2:]])
def test_a_binary_ply_of_any_polygons(
    tmp_path: Path, order: str, number: str, polygons: list[list[int]]
) -> None:
    data = mesh_files.ply_binary(polygons, order, number)
    assert np.array_equal(face_corners(written(tmp_path, "a.ply", data)), fans(polygons))
    plyfile = shapes.reader("plyfile")
    found = plyfile.PlyData.read(tmp_path / "a.ply")
    assert [row.tolist() for row in found["face"]["vertex_indices"]] == polygons


@pytest.mark.parametrize("name", ["a.off", "a.obj", "a.ply"])
def test_polygons_of_a_text_file_become_fans(tmp_path: Path, name: str) -> None:
    rows = [" ".join(map(str, row)) for row in SIX.tolist()]
    faces = [f"{len(p)} " + " ".join(map(str, p)) for p in POLYGONS]
    if name == "a.off":
        lines = ["OFF 6 3 0", *rows, *faces]
    elif name == "a.obj":
        lines = [f"v {row}" for row in rows]
        lines += ["f " + " ".join(str(i + 1) for i in p) for p in POLYGONS]
    else:
        head = PLY.replace("vertex 4", "vertex 6").replace("face 4", "face 3")
        lines = [head[: head.index("end_header") + 10], *rows, *faces]
    path = written(tmp_path, name, "\n".join(lines))
    found, expected = face_corners(path), fans(POLYGONS)
    assert len(found) == 6
    assert area_vector(found) == pytest.approx(area_vector(expected))


def area_vector(faces: np.ndarray) -> np.ndarray:
    normals: np.ndarray = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
    return normals.sum(axis=0)


@pytest.mark.parametrize("suffix", ["stl", "ply", "obj", "off"])
def test_another_reader_reads_the_same(tmp_path: Path, suffix: str) -> None:
    pymeshlab = shapes.reader("pymeshlab")
    path = tmp_path / f"ball.{suffix}"
    exported(path)
    meshes = pymeshlab.MeshSet()
    meshes.load_new_mesh(str(path))
    found = meshes.current_mesh()
    corners = found.vertex_matrix()[found.face_matrix()]
    assert face_corners(path) == pytest.approx(sorted_faces(corners), abs=1e-7)


BAD: dict[str, tuple[str | bytes, str]] = {
    "empty.stl": (b"", "the file is empty"),
    "prose.stl": (
        "This is not a mesh.\n" * 40,
        "cannot be read as STL: its triangles",
    ),
    "cut.stl": (STL[:300], "cannot be read as STL: its triangles"),
    "corner.stl": (STL.replace("vertex", "vortex", 1), "cannot be read as STL"),
    "digits.stl": (STL.replace("1.0", "1,0", 1), "cannot be read as STL"),
    "cut_binary.stl": (mesh_files.stl_binary()[:-51], "complete neither in binary nor as text"),
    "many.stl": (bytes(80) + b"\xff" * 54, "complete neither in binary nor as text"),
    "nan.stl": (mesh_files.stl_binary().replace(b"\x80\x3f\0\0", b"\xc0\x7f\0\0"), "not a finite"),
    "prose.obj": ("f a b c\n", "cannot be read as OBJ .*: b'a'.; is the file"),
    "beyond.obj": ("v 0 0 0\nf 1 2 3\n", "face 0 uses vertex 1, but there are 1"),
    "zero.obj": (OBJ + "f 0 1 2\n", "there is no vertex 0"),
    "flat.obj": ("v 0 0\n" + OBJ, "cannot be read as OBJ .*expected 3, got 2"),
    "long.obj": (OBJ + "f " + "1 2 3 " * 400, "face 4 has 1,200 corners; 3 to 1,000 are allowed"),
    "prose.off": ("OFF of the record", "cannot be read as OFF"),
    "corners.off": (
        OFF.replace("\n3 0 2 1", "\n4 0 2 1"),
        "a face has fewer corners than",
    ),
    "letters.off": (OFF.replace("\n3 0 2 1", "\nx 0 2 1"), "cannot be read as OFF .*: b'x'"),
    "beyond.off": (OFF.replace("\n3 0 2 1", "\n3 0 2 9"), "face 0 uses vertex 9, but there are 4"),
    "cut.off": (OFF[:-9], "4 vertices and 4 faces on 7 lines"),
    "bomb.off": (
        OFF.replace("4 4 6", "4 99999999999 6"),
        "99,999,999,999 faces on 8",
    ),
    "prose.ply": (b"plyx", "cannot be read as PLY"),
    "points.ply": (
        PLY[: PLY.index("element face")] + "end_header\n" + "0 0 0\n" * 4,
        "holds no triangles",
    ),
    "unknown.ply": (PLY.replace("double", "number", 1), "is not valid"),
    "length.ply": (PLY.replace("list uchar", "list float"), "is not valid"),
    "nothing.ply": (PLY.replace("element vertex 4", "comment"), "more numbers than its header"),
    "twice.ply": (PLY.replace("double y", "double x"), "is not valid"),
    "real.ply": (PLY.replace("\n3 0 2 1", "\n3 0 2 1.5"), "corners that are no whole numbers"),
    "shift.ply": (PLY.replace("\n3 0 2 1", "\n4 0 2 1"), "more numbers than its header"),
    "word.ply": (
        PLY.replace("\n3 0 2 1", "\nthree 0 2 1"),
        "string to float: b'three'",
    ),
    "wide.ply": (PLY + "7\n", "more numbers than its header declares"),
    "beyond.ply": (PLY.replace("\n3 0 2 1", "\n3 0 2 9"), "face 0 uses vertex 9, but there are 4"),
    "before.ply": (PLY.replace("\n3 0 2 1", "\n3 0 2 -1"), "face 0 uses vertex -1"),
    "bomb.ply": (
        PLY.replace("vertex 4", "vertex 999999999999"),
        "no data for 999,999,999,999 records",
    ),
    "less.ply": (PLY.replace("face 4", "face -4"), "is not valid"),
    "cut_faces.ply": (
        mesh_files.ply_binary(POLYGONS)[:-30],
        "cannot be read as PLY .buffer is smaller",
    ),
    "line.ply": (mesh_files.ply_binary([[0, 1, 2], [0, 1]]), "face 1 has 2 corners"),
    "cut.glb": (b"glTF\x02\x00\x00\x00", "cannot be read as GLB"),
    "drawing.dxf": (b"0", r"unsupported format \.dxf"),
    "noname": (b"0", "has no suffix"),
    "other.obj": (mesh_files.stl_binary(), "holds no triangles"),
    "other.off": (PLY, "is its suffix right"),
}


@pytest.mark.parametrize("name", BAD)
def test_damaged_files_are_rejected_with_one_line(tmp_path: Path, name: str) -> None:
    data, message = BAD[name]
    with pytest.raises(MeshError, match=message) as caught:
        read_mesh(written(tmp_path, name, data))
    assert "\n" not in str(caught.value)
    assert name in str(caught.value)


TWO_LISTS = PLY.replace("end_header", "property list uchar float weights\nend_header")


def test_other_lists_of_differing_lengths_are_read(tmp_path: Path) -> None:
    text = TWO_LISTS[: TWO_LISTS.index("\n3") + 1]
    rows = [f"3 {a} {b} {c} {n} " + "0.5 " * n for n, (a, b, c) in enumerate(FACES.tolist())]
    assert np.array_equal(
        face_corners(written(tmp_path, "a.ply", text + "\n".join(rows))), TETRAHEDRON
    )
    head = TWO_LISTS[: TWO_LISTS.index("end_header")] + "end_header\n"
    head = head.replace("ascii", "binary_little_endian").replace(
        "element vertex", "element strip 2\nproperty list int short corners\nelement vertex"
    )
    data = struct.pack("<i2hi3h", 2, 7, 8, 3, 7, 8, 9) + VERTICES.astype("<f8").tobytes()
    data += b"".join(
        struct.pack(f"<B3iB{n}f", 3, *face, n, *[0.5] * n) for n, face in enumerate(FACES.tolist())
    )
    path = written(tmp_path, "b.ply", head.encode() + data)
    assert np.array_equal(face_corners(path), TETRAHEDRON)
    with pytest.raises(MeshError, match="buffer is smaller than requested size"):
        read_mesh(written(tmp_path, "c.ply", head.encode() + data[:-1]))


def test_a_missing_file_and_a_folder_have_different_errors(tmp_path: Path) -> None:
    with pytest.raises(MeshError, match="there is no such file"):
        read_mesh(tmp_path / "mug.stl")
    with pytest.raises(MeshError, match="cannot be opened"):
        read_mesh(tmp_path / "m\0g.stl")
    (tmp_path / "folder.stl").mkdir()
    with pytest.raises(MeshError, match="is a folder"):
        read_mesh(tmp_path / "folder.stl")


@pytest.mark.skipif(os.name != "posix", reason="named pipes exist on POSIX only")
def test_a_named_pipe_is_rejected_without_waiting(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.stl")
    with pytest.raises(MeshError, match="is a pipe or a device, not a file"):
        read_mesh(tmp_path / "pipe.stl")


@pytest.mark.skipif(os.name != "posix", reason="file names are bytes on POSIX only")
def test_a_message_is_one_line_for_any_file_name(tmp_path: Path) -> None:
    path = tmp_path / os.fsdecode(b"two\nlines \xff \xc3\xbc.stl")
    path.write_text("nothing")
    with pytest.raises(MeshError, match=r"two\\nlines \\udcff ü\.stl: cannot") as caught:
        read_mesh(path)
    assert "\n" not in str(caught.value)


def test_an_unreadable_file_and_an_invalid_name_are_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(MeshError, match=r"cannot be opened \(File name too long\)"):
        read_mesh(tmp_path / ("x" * 300 + ".ply"))
    exported(tmp_path / "locked.ply")
    monkeypatch.setattr(os, "access", lambda *_: False)
    with pytest.raises(MeshError, match=r"cannot be opened \(Permission denied\)"):
        read_mesh(tmp_path / "locked.ply")
