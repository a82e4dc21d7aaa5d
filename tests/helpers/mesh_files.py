"""Mesh files of known content, written without the libraries with which the package reads them."""

import base64
import copy
import io
import json
import struct
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

Tree = dict[str, Any]

VERTICES = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype=np.float64)
FACES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
DATA = VERTICES.astype("<f4").tobytes() + FACES.astype("<u2").tobytes()
"""Binary data of a glTF with the tetrahedron: positions, then indices."""


def tree() -> Tree:
    """JSON of a glTF with the tetrahedron."""
    return copy.deepcopy(_TREE)


_TREE: Tree = {
    "asset": {"version": "2.0"},
    "scene": 0,
    "scenes": [{"nodes": [0]}],
    "nodes": [{"mesh": 0}],
    "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
    "accessors": [
        {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"},
        {"bufferView": 1, "componentType": 5123, "count": 12, "type": "SCALAR"},
    ],
    "bufferViews": [
        {"buffer": 0, "byteOffset": 0, "byteLength": 48},
        {"buffer": 0, "byteOffset": 48, "byteLength": 24},
    ],
    "buffers": [{"byteLength": 72}],
}


def glb(content: Tree, data: bytes = DATA) -> bytes:
    text = json.dumps(content).encode()
    text += b" " * (-len(text) % 4)
    data += b"\0" * (-len(data) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text
    chunks += struct.pack("<II", len(data), 0x004E4942) + data
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def gltf(content: Tree, uri: str) -> bytes:
    content["buffers"][0]["uri"] = uri
    return json.dumps(content).encode()


def embedded(data: bytes = DATA) -> str:
    return "data:application/octet-stream;base64," + base64.b64encode(data).decode()


def xml_mesh(vertices: np.ndarray = VERTICES, faces: np.ndarray = FACES) -> str:
    corners = "".join(f'<vertex x="{x}" y="{y}" z="{z}"/>' for x, y, z in vertices.tolist())
    rows = "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in faces.tolist())
    return f"<mesh><vertices>{corners}</vertices><triangles>{rows}</triangles></mesh>"


def xml_object(number: int, content: str = "") -> str:
    return f'<object id="{number}" type="model">{content or xml_mesh()}</object>'


def xml_components(number: int, *components: str) -> str:
    inner = "".join(f"<component {component}/>" for component in components)
    return xml_object(number, f"<components>{inner}</components>")


def xml_model(objects: str, build: str, unit: str = "inch") -> str:
    space = "http://schemas.microsoft.com/3dmanufacturing"
    return (
        f'<?xml version="1.0" encoding="UTF-8"?><model unit="{unit}" '
        f'xmlns="{space}/core/2015/02" xmlns:p="{space}/production/2015/06">'
        f"<resources>{objects}</resources><build>{build}</build></model>"
    )


def zipped(files: dict[str, str | bytes], method: int = zipfile.ZIP_DEFLATED) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", method) as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return stream.getvalue()


def three_mf(objects: str, build: str, unit: str = "inch", **more: str) -> bytes:
    """A 3MF; `more` are further model files, by name without suffix."""
    further = {f"3D/{name}.model": content for name, content in more.items()}
    return zipped({"3D/3dmodel.model": xml_model(objects, build, unit), **_PACKAGE, **further})


_SPACE = "http://schemas.openxmlformats.org/package/2006"
_KIND = "application/vnd"
_PACKAGE = {
    "[Content_Types].xml": f'<?xml version="1.0" encoding="UTF-8"?><Types xmlns="{_SPACE}'
    f'/content-types"><Default Extension="rels" ContentType="{_KIND}.openxmlformats-package.'
    f'relationships+xml"/><Default Extension="model" ContentType="{_KIND}.ms-package.'
    '3dmanufacturing-3dmodel+xml"/></Types>',
    "_rels/.rels": f'<?xml version="1.0" encoding="UTF-8"?><Relationships xmlns="{_SPACE}'
    '/relationships"><Relationship Target="/3D/3dmodel.model" Id="rel0" '
    'Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/></Relationships>',
}


def stl_text(name: str = "part", end: str = "\n") -> str:
    lines = [f"solid {name}"]
    for face in FACES.tolist():
        lines += ["  facet normal 0 0 1", "    outer loop"]
        lines += ["      vertex {:e} {:e} {:e}".format(*VERTICES[i]) for i in face]
        lines += ["    endloop", "  endfacet"]
    return end.join([*lines, f"endsolid {name}", ""])


def stl_binary(header: bytes = b"", tail: bytes = b"", attribute: int = 0) -> bytes:
    rows = [
        struct.pack("<12fH", 0, 0, 1, *VERTICES[face].ravel(), attribute) for face in FACES.tolist()
    ]
    return header.ljust(80, b"\0") + struct.pack("<I", len(rows)) + b"".join(rows) + tail


def off_text() -> str:
    return "\n".join(["OFF", "4 4 6", *_rows(VERTICES), *(f"3 {row}" for row in _rows(FACES)), ""])


def obj_text() -> str:
    rows = [f"v {row}" for row in _rows(VERTICES)] + [f"f {row}" for row in _rows(FACES + 1)]
    return "\n".join([*rows, ""])


def ply_text() -> str:
    head = ["ply", "format ascii 1.0", "element vertex 4", *(f"property double {x}" for x in "xyz")]
    head += ["element face 4", "property list uchar int vertex_indices", "end_header"]
    return "\n".join([*head, *_rows(VERTICES), *(f"3 {row}" for row in _rows(FACES)), ""])


def ply_binary(polygons: list[list[int]], order: str = "<", number: str = "float") -> bytes:
    """A PLY of six vertices, with colours and with elements and properties that are not read."""
    kind = {"<": "little", ">": "big"}[order]
    head = [
        "ply", f"format binary_{kind}_endian 1.0", "comment no generator", "element material 2",
        "property uchar shine", "element vertex 6", *(f"property {number} {x}" for x in "xyz"),
        "property uchar red", "property uchar green", "property uchar blue",
        f"element face {len(polygons)}", "property uchar kind",
        "property list uchar int vertex_indices", "property short flag", "element edge 1",
        "property int vertex1", "property int vertex2", "end_header", "",
    ]  # fmt: skip
    data = b"\1\2"
    for position in SIX.tolist():
        data += struct.pack(f"{order}3{number[0]}3B", *position, 9, 8, 7)
    for corners in polygons:
        data += struct.pack(f"{order}BB{len(corners)}ih", 5, len(corners), *corners, 6)
    return "\n".join(head).encode() + data + struct.pack(f"{order}2i", 0, 1)


SIX = np.array([[0, 0, 0], [1, 0, 0], [1.5, 1, 0], [1, 2, 0], [0, 2, 0], [-0.5, 1, 0.5]])


def written(folder: Path, name: str, content: str | bytes) -> Path:
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def _rows(table: np.ndarray) -> list[str]:
    return [" ".join(map(repr, row)) for row in table.tolist()]
