"""Reduction of a glTF or GLB to its nodes, meshes and buffers, which may be in side files."""

import base64
import binascii
import json
import re
import stat
import struct
from pathlib import Path
from urllib.parse import unquote, urlsplit

from grasp3d.reading.gltf_tree import GltfReduction, Tree
from grasp3d.reading.sources import Source
from grasp3d.system.names import reason_of

_JSON, _BINARY = 0x4E4F534A, 0x004E4942

IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".webp", ".ktx", ".ktx2", ".basis", ".dds")
"""Suffixes of side files that are not read."""

_ADDRESS = re.compile(rb'"uri"\s*:\s*("(?:[^"\\]|\\.){1,1000}")')
_GLB_HEADER = 20


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
    buffers = tree["buffers"] if isinstance(tree.get("buffers"), list) else []
    side_files = {
        f"buffer{number}": _side_data(source, buffer["uri"])
        for number, buffer in enumerate(buffers)
        if isinstance(buffer, dict) and "uri" in buffer
    }
    known = {name: len(data) for name, data in side_files.items()}
    if binary:
        known.setdefault("buffer0", len(binary))
    sizes = [known.get(f"buffer{number}") for number in range(len(buffers))]
    stripped = GltfReduction(source, tree, sizes).reduced()
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
        raise source.unexpected("does not begin as a GLB, with glTF")
    if version != 2:
        raise source.error(
            f"is GLB of version {version}, and only version 2 is read; export it as glTF 2.0"
        )
    chunks: dict[int, bytes] = {}
    start, end = 12, min(length, len(data))
    while start + 8 <= end:
        size, kind = struct.unpack_from("<II", data, start)
        if start + 8 + size > len(data):
            raise source.incomplete(
                f"a chunk declares {size:,} bytes, but {len(data) - start - 8:,} are left"
            )
        chunks.setdefault(kind, data[start + 8 : start + 8 + size])
        start += 8 + size
    return chunks.get(_JSON, b""), chunks.get(_BINARY, b"")


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
        raise source.unexpected(f"its JSON cannot be read ({reason_of(error)})") from error
    if not isinstance(tree, dict):
        raise source.unexpected("its JSON is not a glTF")
    return tree


def _side_data(source: Source, uri: object) -> bytes:
    """Return the content of a buffer that is not part of the file's binary data."""
    if not isinstance(uri, str):
        raise source.unexpected("the uri of a buffer is not a text")
    return _embedded(source, uri) if uri[:5].lower() == "data:" else _side_file(source, uri)


def side_names(path: Path) -> list[str]:
    """Return the names of the side files of a glTF that would be read.

    The text is searched by pattern, not parsed, so that the time is bounded for any file.

    Args:
        path: Any mesh file; only .gltf and .glb have side files.

    Returns:
        Paths relative to its folder with `/`, without duplicates; the files need not exist.

    Raises:
        OSError: The file cannot be read.
    """
    if path.suffix.lower() not in {".gltf", ".glb"}:
        return []
    with path.open("rb") as stream:
        size = -1
        if path.suffix.lower() == ".glb":
            size = int.from_bytes(stream.read(_GLB_HEADER)[12:16], "little")
        text = stream.read(size)
    names: dict[str, None] = {}
    for match in _ADDRESS.finditer(text):
        try:
            uri = json.loads(match[1])
        except ValueError:
            continue
        name = unquote(uri)
        if _is_plain(uri) and _is_plain(name) and not name.lower().endswith(IMAGE_SUFFIXES):
            names[name] = None
    return list(names)


def _embedded(source: Source, uri: str) -> bytes:
    head, _, body = uri.partition(",")
    try:
        if head.lower().endswith(";base64"):
            return base64.b64decode(unquote(body), validate=True)
        return unquote(body, encoding="latin-1").encode("latin-1")
    except (binascii.Error, ValueError) as error:
        raise source.damaged(f"its embedded data are damaged ({error})") from error


def _side_file(source: Source, uri: str) -> bytes:
    """Return the content of a side file in the folder of the glTF or below."""
    label, folder = ascii(uri[:80]), source.path.parent.resolve()
    name = unquote(uri)
    if not _is_plain(uri) or not _is_plain(name):
        raise source.error(f"refers to {label}; only files in its own folder are read")
    try:
        path = (folder / name).resolve(strict=True)
        status = path.stat()
    except (OSError, RuntimeError, ValueError) as error:
        raise source.error(f"its side file {label} is missing; keep it beside the mesh") from error
    if not path.is_relative_to(folder):
        raise source.error(
            f"refers to {label}, which is outside its folder; only files in its own folder are read"
        )
    if not stat.S_ISREG(status.st_mode):
        raise source.error(f"its side file {label} is not a file")
    return path.read_bytes()


def _is_plain(name: str) -> bool:
    """Return whether an address is the relative path of a file in the folder or below."""
    try:
        address = urlsplit(name)
    except ValueError:
        return False
    elsewhere = address.scheme or address.netloc or Path(name).is_absolute() or name.startswith("/")
    upward = "\\" in name or ".." in name.split("/")
    return bool(name) and name.isprintable() and not (elsewhere or upward)
