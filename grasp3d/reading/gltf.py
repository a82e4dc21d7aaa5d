"""glTF and GLB: their JSON, and their buffers, which may be in side files."""

import base64
import binascii
import json
import re
import stat
import struct
from pathlib import Path
from urllib.parse import unquote, urlsplit

from grasp3d.arrays import Floats, Ints
from grasp3d.reading.gltf_tree import GltfScene, Tree
from grasp3d.reading.sources import Source
from grasp3d.system.names import reason_of

_JSON, _BINARY = 0x4E4F534A, 0x004E4942

IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".webp", ".ktx", ".ktx2", ".basis", ".dds")
"""Suffixes of side files that are not read."""

_ADDRESS = re.compile(rb'"uri"\s*:\s*("(?:[^"\\]|\\.){1,1000}")')
_GLB_HEADER = 20


def read_gltf(source: Source) -> tuple[Floats, Ints]:
    """Read the vertices (V, 3) and faces (F, 3) of a glTF, also of its side files.

    Images, materials, animations and cameras are passed over.

    Args:
        source: A .gltf or .glb file.

    Raises:
        MeshError: It is damaged, its nodes form a cycle, it is compressed, its numbers do not
            match its data, or it refers to files outside its folder.
    """
    data, binary = source.path.read_bytes(), b""
    if source.kind == "glb":
        data, binary = _chunks(source, data)
    tree = _tree(source, data)
    listed = tree["buffers"] if isinstance(tree.get("buffers"), list) else []
    buffers = [
        _side_data(source, buffer["uri"]) if isinstance(buffer, dict) and "uri" in buffer else None
        for buffer in listed
    ]
    if binary and buffers and buffers[0] is None:
        buffers[0] = binary
    return GltfScene(source, tree, buffers).surface()


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
