"""Mesh formats: positions and faces in the order of the file, and errors of damaged files."""

import os
import struct
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from grasp3d.errors import MeshError
from grasp3d.mesh.measures import Triangles
from grasp3d.mesh.mesh_files import as_triangles, read_mesh
from grasp3d.mesh.sources import Source
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
EDGE = "element edge 1\nproperty int vertex1\nproperty int vertex2\nend_header"
LAST = "v 0.0 0.0 1.0"
GOOD: dict[str, str | bytes] = {
    "capitals.stl": STL.upper(),
    "old_mac.stl": mesh_files.stl_text(end="\r"),
    "vertex.stl": mesh_files.stl_text("vertex 1 2 3 facet normal outer loop"),
    "latin.stl": STL.encode().replace(b"part", "Müller".encode("latin-1")),
    "two_solids.stl": STL[:HALF] + "endsolid part\nsolid Other\n" + STL[HALF:],
    "nameless.stl": STL.replace(" part", ""),
    "binary_solid.stl": mesh_files.stl_binary(b"solid exported facet normal"),
    "coloured.stl": mesh_files.stl_binary(b"COLOR=\x80\x80\x80\xff", attribute=0x83FF),
    "trailing.stl": mesh_files.stl_binary(b"solid", tail=b"\0"),
    "comments.off": OFF.replace("OFF", "OFF # kind\n# counts:").replace("\n3", " # x\n3"),
    "ends.off": OFF.replace("\n", " # a 1 2\n").replace("4 4 6", "4 # vertices\n4 # faces\n6"),
    "between.off": OFF.replace("\n", "\n# 7 8 9\n\n"),
    "counts.off": OFF.replace("OFF\n4 4 6", "off 4\n4"),
    "marked.off": "\ufeff" + OFF,
    "normals.off": OFF.replace("OFF", "NOFF").replace(".0\n", ".0 0 0 1 # up\n"),
    "coloured.off": OFF.replace("\n", " 255 0 0\n").replace("OFF 255 0 0", "OFF", 1),
    "first_line.off": OFF.replace("OFF\n", "COFF  "),
    "windows.off": OFF.replace("\n", "\r\n").rstrip(),
    "windows.obj": OBJ.replace("\n", "\r\n").rstrip(),
    "continued.obj": OBJ.replace("f 1 3 2", "f 1 \\\n3 \\\n2"),
    "negative.obj": OBJ.replace("f 1 3 2\n", "").replace(LAST, "f -3 -1 -2\n" + LAST),
    "others.obj": "o a\ng b\ns off\nvp 1 2\n" + OBJ.replace("v 0.0", "v\t0.0") + "l 1 2\np 1\n",
    "weights.obj": OBJ.replace("v 1.0 0.0 0.0", "v 1.0 0.0 0.0 1.0 0.5 0.5"),
    "windows.ply": PLY.replace("\n", "\r\n"),
    "comment.ply": PLY.replace("element face", "comment the end_header comes\nelement face"),
    "latin.ply": PLY.encode().replace(b"element", "comment für\nelement".encode("latin-1"), 1),
    "blank_lines.ply": PLY.replace("\n3", "\n\n3"),
    "edges.ply": PLY.replace("end_header", EDGE) + "0 1\n",
}


@pytest.mark.parametrize("name", GOOD)
def test_every_variant_of_a_tetrahedron_is_read(tmp_path: Path, name: str) -> None:
    assert np.array_equal(face_corners(written(tmp_path, name, GOOD[name])), TETRAHEDRON)


POLYGONS = [[0, 1, 2, 3], [3, 4, 0], [0, 4, 3, 2, 1]]
"""Twelve corners, as of three quads: trimesh assumes that all faces are like the first."""


def fans(polygons: list[list[int]]) -> np.ndarray:
    rows = [[p[0], p[k], p[k + 1]] for p in polygons for k in range(1, len(p) - 1)]
    return sorted_faces(SIX[np.array(rows)])


@pytest.mark.parametrize(("order", "number"), [("<", "float"), (">", "double")])
@pytest.mark.parametrize("polygons", [POLYGONS, POLYGONS[1:2], POLYGONS[2:]])
def test_a_binary_ply_of_any_polygons(
    tmp_path: Path, order: str, number: str, polygons: list[list[int]]
) -> None:
    data = mesh_files.ply_binary(polygons, order, number)
    assert np.array_equal(face_corners(written(tmp_path, "a.ply", data)), fans(polygons))
    plyfile = shapes.reader("plyfile")
    found = plyfile.PlyData.read(tmp_path / "a.ply")
    assert [row.tolist() for row in found["face"]["vertex_indices"]] == polygons


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


FIRST = "\n3 0 2 1"
"""The first face of a text."""
HEAD = PLY.index("element face")
BAD: dict[str, tuple[str | bytes, str]] = {
    "empty.stl": (b"", "the file is empty"),
    "prose.stl": ("This is not a mesh.\n" * 40, "cannot be read as STL: its triangles"),
    "cut.stl": (STL[:300], "cannot be read as STL: its triangles"),
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
    "corners.off": (OFF.replace(FIRST, "\n4 0 2 1"), "a face has fewer corners than"),
    "letters.off": (OFF.replace(FIRST, "\nx 0 2 1"), "cannot be read as OFF .*: b'x'"),
    "cut.off": (OFF[:-9], "4 vertices and 4 faces on 7 lines"),
    "bomb.off": (OFF.replace("4 4 6", "4 99999999999 6"), "99,999,999,999 faces on 8"),
    "prose.ply": (b"plyx", "cannot be read as PLY"),
    "points.ply": (PLY[:HEAD] + "end_header\n" + "0 0 0\n" * 4, "holds no triangles"),
    "unknown.ply": (PLY.replace("double", "number", 1), "is not valid"),
    "length.ply": (PLY.replace("list uchar", "list float"), "is not valid"),
    "twice.ply": (PLY.replace("double y", "double x"), "is not valid"),
    "less.ply": (PLY.replace("face 4", "face -4"), "is not valid"),
    "nothing.ply": (PLY.replace("element vertex 4", "comment"), "more numbers than its header"),
    "shift.ply": (PLY.replace(FIRST, "\n4 0 2 1"), "more numbers than its header"),
    "real.ply": (PLY.replace(FIRST, "\n3 0 2 1.5"), "corners that are no whole numbers"),
    "word.ply": (PLY.replace(FIRST, "\nthree 0 2 1"), "string to float: b'three'"),
    "before.ply": (PLY.replace(FIRST, "\n3 0 2 -1"), "face 0 uses vertex -1"),
    "bomb.ply": (PLY.replace("vertex 4", "vertex 999999999999"), "no data for 999,999,999,999 rec"),
    "cut_faces.ply": (mesh_files.ply_binary(POLYGONS)[:-30], "read as PLY .buffer is smaller"),
    "line.ply": (mesh_files.ply_binary([[0, 1, 2], [0, 1]]), "face 1 has 2 corners"),
    "drawing.dxf": (b"0", r"unsupported format \.dxf"),
    "noname": (b"0", "has no suffix"),
    "other.obj": (mesh_files.stl_binary(), "holds no triangles"),
    "other.off": (PLY, "is its suffix right"),
}  # fmt: skip


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


def test_what_cannot_be_opened_has_an_error_of_its_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "folder.stl").mkdir()
    names = {
        "mug.stl": "there is no such file",
        "m\0g.stl": "cannot be opened",
        "folder.stl": "is a folder",
        "x" * 300 + ".ply": r"cannot be opened \(File name too long\)",
    }
    if os.name == "posix":
        os.mkfifo(tmp_path / "pipe.stl")  # is not waited for
        names["pipe.stl"] = "is a pipe or a device, not a file"
    for name, message in names.items():
        with pytest.raises(MeshError, match=message):
            read_mesh(tmp_path / name)
    exported(tmp_path / "locked.ply")
    monkeypatch.setattr(os, "access", lambda *_: False)
    with pytest.raises(MeshError, match=r"cannot be opened \(Permission denied\)"):
        read_mesh(tmp_path / "locked.ply")


@pytest.mark.skipif(os.name != "posix", reason="file names are bytes on POSIX only")
def test_a_message_is_one_line_for_any_file_name(tmp_path: Path) -> None:
    path = tmp_path / os.fsdecode(b"two\nlines \xff \xc3\xbc.stl")
    path.write_text("nothing")
    with pytest.raises(MeshError, match=r"two\\nlines \\udcff ü\.stl: cannot") as caught:
        read_mesh(path)
    assert "\n" not in str(caught.value)


# Division of polygons into triangles: they cover the polygon, and nothing else


SOURCE = Source(Path("a.obj"), "obj", "a.obj")


def divided(points: np.ndarray) -> np.ndarray:
    """Triangles (k, 3) of one polygon."""
    count = len(points)
    return as_triangles(SOURCE, points, np.arange(count), np.array([count]))


def area_vectors(points: np.ndarray, faces: np.ndarray) -> np.ndarray:
    one, two, three = np.moveaxis(points[faces], 1, 0)
    return 0.5 * np.cross(two - one, three - one)


def area_of(points: np.ndarray) -> np.ndarray:
    """Area vector of a polygon, by the sum over its edges."""
    return 0.5 * np.cross(points, np.roll(points, -1, axis=0)).sum(axis=0)


def skyline(heights: list[int]) -> np.ndarray:
    """A polygon of columns of these heights, with corners on its straight edges, (n, 3)."""
    corners = [(k, 0) for k in range(len(heights) + 1)]
    for k in reversed(range(len(heights))):
        corners += [(k + 1, heights[k]), (k, heights[k])]
    points = np.array([one for k, one in enumerate(corners) if one != corners[k - 1]], dtype=float)
    return np.column_stack([points, np.zeros(len(points))])


@given(
    st.lists(st.integers(1, 5), min_size=1, max_size=7), st.integers(0, 30), st.integers(0, 10_000)
)
def test_triangles_cover_a_concave_polygon_once(heights: list[int], first: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    points = np.roll(skyline(heights), first, axis=0) @ shapes.rotation(seed).T + rng.normal(size=3)
    faces, normal = divided(points), area_of(points - points[0])
    assert len(faces) == len(points) - 2
    assert set(faces.ravel().tolist()) == set(range(len(points)))
    areas = area_vectors(points, faces) @ normal / np.linalg.norm(normal)
    assert areas.min() > -1e-9
    assert areas.sum() == pytest.approx(sum(heights))


def test_a_fan_stays_where_it_covers_the_polygon() -> None:
    turns = 2.0 * np.pi * np.arange(7) / 7.0
    convex = np.column_stack([np.cos(turns), np.sin(turns), 0.1 * np.cos(2.0 * turns)])
    dart = np.array([[0.4, 0.4, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 0.0], [2.0, 0.0, 0.0]])
    for points in (convex, dart):  # the first corner of the dart is the one that points inward
        assert divided(points).tolist() == [[0, k, k + 1] for k in range(1, len(points) - 1)]


def test_a_concave_quad_is_divided_along_its_inner_diagonal() -> None:
    for height in (0.0, 0.3):  # also one that is not flat
        dart = np.array([[0, 2, 0], [0, 0, height], [2, 0, 0], [0.4, 0.4, 0]], dtype=float)
        assert sorted(map(sorted, divided(dart).tolist())) == [[0, 1, 3], [1, 2, 3]]


def test_a_polygon_that_crosses_itself_stays_a_fan() -> None:
    bow = np.array([[0, 0, 0], [3, 0, 0], [0, 2, 0], [2, 2, 0]], dtype=float)
    assert divided(bow).tolist() == [[0, 1, 2], [0, 2, 3]]


@pytest.mark.parametrize(
    ("case", "name", "volume"),
    [
        *(("01_concave_polygon", f"bracket.{suffix}", 30000.0) for suffix in ("obj", "off", "ply")),
        ("04_obj_comment_after_face", "box.obj", 24000.0),
        ("06_ply_tristrips", "strips.ply", 24000.0),
        ("15_gltf_normalized_positions", "quant_norm.glb", 1.92e-4),
    ],
)
def test_legal_files_that_few_programs_write_are_read(case: str, name: str, volume: float) -> None:
    raw = read_mesh(shapes.shared("cases", case, name))
    surface = Triangles(raw.vertices, raw.faces)
    assert surface.volumes.sum() == pytest.approx(volume, rel=1e-4)
    if name.startswith("bracket"):
        assert surface.areas.sum() == pytest.approx(8200.0)  # its slot is empty
