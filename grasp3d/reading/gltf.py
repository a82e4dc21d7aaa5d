"""Reduction of a glTF or GLB to its nodes, meshes and buffers."""

import json
import struct

from grasp3d.errors import MeshError
from grasp3d.reading.gltf_tree import Tree, stripped_tree
from grasp3d.reading.side_files import read_address
from grasp3d.reading.sources import Source

_JSON, _BINARY = 0x4E4F534A, 0x004E4942


def stripped_gltf(source: Source) -> tuple[bytes, dict[str, bytes]]:
    """Remove images, materials, animations and cameras from a glTF, and read its side files.

    Args:
        source: A .gltf or .glb file.

    Returns:
        (the reduced file, in its own format; the contents of its side files by name).

    Raises:
        MeshError: It is damaged, its nodes form a cycle, it is compressed, its numbers do not
            match its data, or it refers to files outside its folder.
    """
    data, binary = source.path.read_bytes(), b""
    if source.kind == "glb":
        data, binary = _chunks(source, data)
    tree = _tree(source, data)
    buffers = tree.get("buffers", [])
    side_files = {
        f"buffer{number}": _side_data(source, buffer)
        for number, buffer in enumerate(buffers if isinstance(buffers, list) else [])
        if isinstance(buffer, dict) and "uri" in buffer
    }
    count = len(buffers) if isinstance(buffers, list) else 0
    sizes = [
        len(side_files[name]) if (name := f"buffer{number}") in side_files else None
        for number in range(count)
    ]
    if binary and sizes and sizes[0] is None:
        sizes[0] = len(binary)
    stripped = stripped_tree(source, tree, sizes)
    for number, size in enumerate(sizes):
        if size is None:  # no mesh uses it
            buffers[number]["uri"] = f"buffer{number}"
            side_files[f"buffer{number}"] = b""
    for number, buffer in enumerate(stripped.get("buffers", [])):
        if "uri" in buffer:  # trimesh must not open another file
            buffer["uri"] = f"buffer{number}"
    text = json.dumps(stripped).encode()
    return (_glb(text, binary) if source.kind == "glb" else text), side_files


def _chunks(source: Source, data: bytes) -> tuple[bytes, bytes]:
    """Return the JSON and the binary data of a GLB."""
    magic, version, length = struct.unpack_from("<4sII", data.ljust(12, b"\0"))
    if magic != b"glTF":
        raise MeshError(f"{source.where}: does not begin as a GLB, with glTF; {source.hint}")
    if version != 2:
        raise MeshError(
            f"{source.where}: is GLB of version {version}, and only version 2 is read; export it "
            "as glTF 2.0"
        )
    found: dict[int, bytes] = {}
    start, end = 12, min(length, len(data))
    while start + 8 <= end:
        size, kind = struct.unpack_from("<II", data, start)
        if start + 8 + size > len(data):
            raise MeshError(
                f"{source.where}: a chunk declares {size:,} bytes, but "
                f"{len(data) - start - 8:,} are left; is the file complete?"
            )
        found.setdefault(kind, data[start + 8 : start + 8 + size])
        start += 8 + size
    return found.get(_JSON, b""), found.get(_BINARY, b"")


def _glb(text: bytes, binary: bytes) -> bytes:
    """Return a GLB with this JSON and binary data."""
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), _JSON) + text
    if binary:
        chunks += struct.pack("<II", len(binary), _BINARY) + binary
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def _tree(source: Source, data: bytes) -> Tree:
    try:
        tree = json.loads(data)
    except (ValueError, RecursionError) as error:
        reason = " ".join(str(error).split())
        raise MeshError(
            f"{source.where}: its JSON cannot be read ({reason}); {source.hint}"
        ) from error
    if not isinstance(tree, dict):
        raise MeshError(f"{source.where}: its JSON is not a glTF; {source.hint}")
    return tree


def _side_data(source: Source, buffer: Tree) -> bytes:
    if not isinstance(buffer["uri"], str):
        raise MeshError(f"{source.where}: the uri of a buffer is not a text; {source.hint}")
    return read_address(source, buffer["uri"])
