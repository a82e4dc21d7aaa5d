"""glTF, GLB and 3MF: scenes whose parts must all be read, with their transforms."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from grasp3d.errors import MeshError
from grasp3d.mesh.mesh_files import read_mesh
from grasp3d.mesh.sources import RawMesh
from tests.helpers import mesh_files
from tests.helpers.mesh_files import (
    DATA,
    FACES,
    VERTICES,
    Tree,
    written,
    xml_components,
    xml_object,
)


def scene(tmp_path: Path, change: Callable[[Tree], None], data: bytes = DATA) -> RawMesh:
    tree = mesh_files.tree()
    change(tree)
    return read_mesh(written(tmp_path, "a.glb", mesh_files.glb(tree, data)))


def primitive(tree: Tree) -> Tree:
    part: Tree = tree["meshes"][0]["primitives"][0]
    return part


def at(path: str, value: object) -> Callable[[Tree], None]:
    """Return a function that sets one entry, such as `nodes.0.mesh`."""

    def change(tree: Tree) -> None:
        *parents, last = (int(key) if key.isdigit() else key for key in path.split("."))
        entry = tree
        for key in parents:
            entry = entry[key]  # type: ignore[index]
        entry[last] = value  # type: ignore[index]

    return change


PART = "meshes.0.primitives.0"


def test_a_glb_and_a_gltf_with_side_files_or_embedded_data(tmp_path: Path) -> None:
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "my data.bin").write_bytes(DATA)
    for uri in ("parts/my%20data.bin", "./parts/my data.bin", mesh_files.embedded()):
        raw = read_mesh(written(tmp_path, "a.gltf", mesh_files.gltf(mesh_files.tree(), uri)))
        assert np.array_equal(raw.vertices[raw.faces], VERTICES[FACES])
    tree = mesh_files.tree()
    tree["buffers"][0]["uri"] = "parts/my data.bin"
    raw = read_mesh(written(tmp_path, "b.glb", mesh_files.glb(tree, b"")))
    assert np.array_equal(raw.vertices, VERTICES)
    assert (raw.format, raw.unit) == ("glb", "m")


def test_nodes_transform_their_mesh_and_their_children(tmp_path: Path) -> None:
    half = [0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)]  # a quarter turn about z, as x y z w

    def change(tree: Tree) -> None:
        tree["nodes"] = [
            {"children": [1, 2], "translation": [10, 0, 0], "camera": 0, "name": "world"},
            {"mesh": 0, "rotation": half, "scale": [2, 2, 2], "name": "world"},
            {"mesh": 0, "matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 5, 0, 1]},
            {"mesh": 0},
        ]
        tree["cameras"] = [{"type": "perspective", "perspective": {"yfov": 1, "znear": 0.1}}]

    raw = scene(tmp_path, change)
    turned = VERTICES[:, [1, 0, 2]] * (-2, 2, 2) + (10, 0, 0)
    expected = np.vstack([turned, VERTICES + (10, 5, 0)])
    assert sorted_rows(raw.vertices) == pytest.approx(sorted_rows(expected))
    assert len(raw.faces) == 8


def sorted_rows(rows: np.ndarray) -> np.ndarray:
    return np.array(sorted(rows.round(9).tolist()))


def test_a_mirrored_part_keeps_its_orientation(tmp_path: Path) -> None:
    raw = scene(tmp_path, lambda tree: tree["nodes"][0].update(scale=[-1, 1, 1]))
    a, b, c = (raw.vertices[raw.faces[:, k]] for k in range(3))
    assert np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0 == pytest.approx(1.0 / 6.0)


def test_strips_and_corners_without_indices(tmp_path: Path) -> None:
    raw, strip = scene(tmp_path, at(f"{PART}.mode", 5)), FACES.ravel()
    rows = [strip[[k, k + 1, k + 2][:: 1 if k % 2 == 0 else -1]] for k in range(len(strip) - 2)]
    assert rotated(raw.faces.tolist()) == rotated([row.tolist() for row in rows])

    def plain(tree: Tree) -> None:  # and a strip of two corners, which has no triangle
        del primitive(tree)["indices"]
        tree["accessors"][0]["count"] = 3
        tree["accessors"].append({**tree["accessors"][0], "count": 2})
        tree["meshes"][0]["primitives"].append({"attributes": {"POSITION": 2}, "mode": 5})

    assert scene(tmp_path, plain).faces.tolist() == [[0, 1, 2]]


def rotated(faces: list[list[int]]) -> list[list[int]]:
    """Sorted faces without degenerate ones, each starting with its smallest vertex number."""
    rows = (row for row in faces if len(set(row)) == 3)
    return sorted(row[row.index(min(row)) :] + row[: row.index(min(row))] for row in rows)


def test_interleaved_positions_and_quantized_ones(tmp_path: Path) -> None:
    wide = np.zeros((4, 6), dtype="<f4")
    wide[:, :3], wide[:, 3:] = VERTICES, 7.0

    def stride(tree: Tree) -> None:
        tree["bufferViews"][0].update(byteLength=96, byteStride=24)
        tree["bufferViews"][1]["byteOffset"] = 96

    assert np.array_equal(scene(tmp_path, stride, wide.tobytes() + DATA[48:]).vertices, VERTICES)

    def small(tree: Tree) -> None:
        tree["bufferViews"][0].update(byteLength=30, byteStride=8)
        tree["accessors"][0]["componentType"] = 5122
        tree["extensionsRequired"] = ["KHR_mesh_quantization"]
        tree["nodes"][0]["scale"] = [0.5, 0.5, 0.5]

    short = np.zeros((4, 4), dtype="<i2")
    short[:, :3] = 2 * VERTICES
    data = short.tobytes().ljust(48, b"\0") + DATA[48:]
    assert np.array_equal(scene(tmp_path, small, data).vertices, VERTICES)

    def normalized(tree: Tree) -> None:
        small(tree)
        tree["accessors"][0]["normalized"] = True
        tree["nodes"][0]["scale"] = [32767.0 / 2.0] * 3

    assert scene(tmp_path, normalized, data).vertices == pytest.approx(VERTICES)


def test_lines_points_and_materials_are_ignored(tmp_path: Path) -> None:
    def change(tree: Tree) -> None:
        tree["meshes"][0]["primitives"] += [
            {"attributes": {"POSITION": 0}, "mode": mode} for mode in range(4)
        ]
        part = primitive(tree)
        part["material"] = 5
        part["attributes"] |= {"TEXCOORD_0": 2}
        part["extensions"] = {"KHR_draco_mesh_compression": {"bufferView": 9}}
        tree["accessors"].append({"componentType": 5126, "count": 3, "type": "MAT4", "sparse": {}})
        tree["images"] = [{"uri": "/etc/passwd"}, {"uri": "http://127.0.0.1/a.png"}]
        tree["extensionsUsed"] = tree["extensionsRequired"] = ["KHR_materials_unlit"]

    assert np.array_equal(scene(tmp_path, change).faces, FACES)


POSED = "is posed by a skeleton, by morph targets or by instancing, which is not supported"
SHORT = {"count": 12, "type": "SCALAR", "componentType": 5123}
THIN: Tree = {"scale": [1e-5, 1, 1]}
MISREAD: dict[str, tuple[Callable[[Tree], None], str]] = {
    "fans": (at(f"{PART}.mode", 6), "has triangle fans"),
    "sparse": (at("accessors.0.sparse", {"count": 1}), "has sparse or compressed numbers"),
    "compressed": (at("accessors.1", SHORT), "has sparse or compressed numbers"),
    "needed": (at("extensionsRequired", ["KHR_draco_mesh_compression"]), "the extension 'KHR_"),
    "skin": (at("nodes.0.skin", 0), POSED),
    "weights": (at("nodes.0.weights", [0.5]), POSED),
    "morph": (at("meshes.0.weights", [0, 0.5]), POSED),
    "many": (at("nodes.0.extensions", {"EXT_mesh_gpu_instancing": {}}), POSED),
    "from the end": (at("nodes.0.mesh", -1), "shows 1 parts, of which 0 can be read"),
    "short": (at("accessors.0.count", 5), "cannot be read as GLB"),
    "no view": (at("accessors.1.bufferView", 2), "its parts do not fit together"),
    "flattened": (at("nodes.0.scale", [1, 0, 1]), "node '0' flattens its mesh"),
    "flattened above": (
        at("nodes", [{**THIN, "children": [1]}, {**THIN, "mesh": 0}]), "node '1' flattens its mesh"
    ),
    "twice": (at("nodes", [{"mesh": 0, "children": [1, 1]}, {}]), "node 1 has two parents"),
    "circle": (at("nodes", [{"mesh": 0, "children": [1]}, {"children": [0]}]), "form a cycle"),
    "empty": (at("scenes.0.nodes", []), "holds no triangles"),
}  # fmt: skip


@pytest.mark.parametrize("name", MISREAD)
def test_content_that_trimesh_misreads_is_rejected_with_one_line(tmp_path: Path, name: str) -> None:
    change, message = MISREAD[name]
    with pytest.raises(MeshError, match=message) as caught:
        scene(tmp_path, change)
    assert "\n" not in str(caught.value)


def test_an_index_beyond_its_part_does_not_refer_to_the_next_part(tmp_path: Path) -> None:
    def change(tree: Tree) -> None:
        tree["meshes"].append(tree["meshes"][0])
        tree["nodes"] = [{"mesh": 0}, {"mesh": 1}]
        tree["scenes"][0]["nodes"] = [0, 1]

    data = DATA[:48] + np.array([0, 2, 5], dtype="<u2").tobytes() + DATA[54:]
    with pytest.raises(MeshError, match="face 0 uses vertex 5, but there are 4"):
        scene(tmp_path, change, data)


def test_a_damaged_container_is_rejected(tmp_path: Path) -> None:
    good = mesh_files.glb(mesh_files.tree())
    for data, message in (
        (good[:-5], "cannot be read as GLB"),
        (good.replace(b"glTF\x02", b"glTF\x01"), "does not begin as glTF 2.0"),
        (good.replace(b'{"asset"', b'["asset"'), "cannot be read as GLB"),
    ):
        with pytest.raises(MeshError, match=message):
            read_mesh(written(tmp_path, "a.glb", data))
    with pytest.raises(MeshError, match="its parts do not fit together"):
        read_mesh(written(tmp_path, "a.gltf", json.dumps([1])))


@pytest.mark.parametrize(
    "uri",
    [
        "../secret.bin", "a/../../secret.bin", "%2e%2e/secret.bin", "/etc/passwd", "out.bin",
        "file:///etc/passwd", "http://127.0.0.1:9/a.bin", "good.bin\0", "", "folder", "gone.bin",
    ],
)  # fmt: skip
def test_a_gltf_cannot_read_files_outside_its_folder(tmp_path: Path, uri: str) -> None:
    folder = tmp_path / "folder"
    (folder / "folder").mkdir(parents=True)
    (tmp_path / "secret.bin").write_bytes(DATA)
    (folder / "out.bin").symlink_to(tmp_path / "secret.bin")
    path = written(folder, "a.gltf", mesh_files.gltf(mesh_files.tree(), uri))
    with pytest.raises(MeshError, match=r"cannot be read as GLTF|is not in its folder") as caught:
        read_mesh(path)
    assert "\n" not in str(caught.value)


ITEM = '<item objectid="{}"/>'.format
MOVED = 'transform="0 2 0 -2 0 0 0 0 2 5 6 7"'


def test_a_3mf_with_components_transforms_and_units(tmp_path: Path) -> None:
    objects = xml_object(1) + xml_components(2, f'objectid="1" {MOVED}', 'objectid="1"')
    build = '<item objectid="2" transform="1 0 0 0 1 0 0 0 1 100 0 0"/>' + ITEM(1)
    raw = read_mesh(written(tmp_path, "a.3mf", mesh_files.three_mf(objects, build)))
    turned = VERTICES[:, [1, 0, 2]] * (-2, 2, 2) + (105, 6, 7)
    expected = np.vstack([turned, VERTICES + (100, 0, 0), VERTICES])
    assert sorted_rows(raw.vertices) == pytest.approx(sorted_rows(expected))
    assert (raw.format, raw.unit) == ("3mf", "in")
    for declared, unit in (("millimeter", "mm"), ("meter", "m")):
        data = mesh_files.three_mf(objects, build, declared)
        assert read_mesh(written(tmp_path, "a.3mf", data)).unit == unit
    path = written(tmp_path, "a.3mf", mesh_files.three_mf(objects, build, "micron"))
    with pytest.raises(MeshError, match="the unit 'micron', which is none of m, cm, mm, in; scale"):
        read_mesh(path)


def test_an_object_in_another_file_of_a_3mf(tmp_path: Path) -> None:
    outer = xml_components(7, 'p:path="/3D/part.model" objectid="1"')
    inner = mesh_files.xml_model(xml_object(1), "")
    raw = read_mesh(written(tmp_path, "a.3mf", mesh_files.three_mf(outer, ITEM(7), part=inner)))
    assert np.array_equal(raw.vertices, VERTICES)


def doubled(times: int) -> str:
    rows = [xml_object(1)]
    for k in range(1, times + 1):
        second = f'objectid="{k}" transform="1 0 0 0 1 0 0 0 1 {2**k} 0 0"'
        rows.append(xml_components(k + 1, f'objectid="{k}"', second))
    return "".join(rows)


INNER = mesh_files.xml_model(xml_object(1) + xml_object(2), "")
TWO = xml_components(7, 'p:path="/3D/part.model" objectid="1"')
CIRCLE = xml_components(1, 'objectid="2"') + xml_components(2, 'objectid="1"')
ELSEWHERE = '<item objectid="1" p:path="/3D/part.model"/>'
BEYOND = xml_object(1, mesh_files.xml_mesh(faces=FACES + 4))
LETTERS = xml_object(1).replace('x="1.0"', 'x="l"')
BAD_3MF: dict[str, tuple[bytes, str]] = {
    "nested": (mesh_files.three_mf(doubled(10), ITEM(11)), "declares 4,096 triangles, of which"),
    "missing": (mesh_files.three_mf(xml_object(1), ITEM(1) + ITEM(2)), "do not fit together"),
    "empty": (mesh_files.three_mf(xml_object(1, " "), ITEM(1)), "do not fit together"),
    "circle": (mesh_files.three_mf(CIRCLE, ITEM(1)), "recursion depth exceeded"),
    "two": (mesh_files.three_mf(TWO, ITEM(7), part=INNER), "declares 4 triangles, of which 8"),
    "production": (mesh_files.three_mf("", ELSEWHERE, part=INNER), "4 triangles, of which 0"),
    "beyond": (mesh_files.three_mf(BEYOND, ITEM(1)), "face 0 uses vertex 4"),
    "models": (mesh_files.zipped({"a.model": ""}), "cannot be read as 3MF"),
    "letters": (mesh_files.three_mf(LETTERS, ITEM(1)), "read to its"),
}


@pytest.mark.parametrize("name", BAD_3MF)
def test_a_3mf_that_trimesh_misreads_is_rejected(tmp_path: Path, name: str) -> None:
    data, message = BAD_3MF[name]
    with pytest.raises(MeshError, match=message) as caught:
        read_mesh(written(tmp_path, "a.3mf", data))
    assert "\n" not in str(caught.value)
