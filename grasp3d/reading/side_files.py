"""Buffers of a glTF that are embedded as text, or stored in files of its folder."""

import base64
import binascii
import json
import re
import stat
from pathlib import Path
from urllib.parse import unquote, urlsplit

from grasp3d.errors import MeshError
from grasp3d.reading.sources import Source

IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".webp", ".ktx", ".ktx2", ".basis", ".dds")
"""Suffixes of side files that are not read."""

_ADDRESS = re.compile(rb'"uri"\s*:\s*("(?:[^"\\]|\\.){1,1000}")')
_GLB_HEADER = 20


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


def read_address(source: Source, uri: str) -> bytes:
    """Return the content of a buffer that is not part of the file's binary data.

    Args:
        source: The .gltf or .glb file.
        uri: Address of the content.

    Raises:
        MeshError: It is damaged, missing, or outside the folder of the glTF.
    """
    return _embedded(source, uri) if uri[:5].lower() == "data:" else _side_file(source, uri)


def _embedded(source: Source, uri: str) -> bytes:
    head, _, body = uri.partition(",")
    try:
        if head.lower().endswith(";base64"):
            return base64.b64decode(unquote(body), validate=True)
        return unquote(body, encoding="latin-1").encode("latin-1")
    except (binascii.Error, ValueError) as error:
        raise MeshError(
            f"{source.where}: its embedded data are damaged ({error}); export the mesh again"
        ) from error


def _side_file(source: Source, uri: str) -> bytes:
    """Return the content of a side file in the folder of the glTF or below."""
    shown, folder = ascii(uri[:80]), source.path.parent.resolve()
    name = unquote(uri)
    if not _is_plain(uri) or not _is_plain(name):
        raise MeshError(f"{source.where}: refers to {shown}; only files in its own folder are read")
    try:
        path = (folder / name).resolve(strict=True)
        status = path.stat()
    except (OSError, RuntimeError, ValueError) as error:
        raise MeshError(
            f"{source.where}: its side file {shown} is missing; keep it beside the mesh"
        ) from error
    if not path.is_relative_to(folder):
        raise MeshError(
            f"{source.where}: refers to {shown}, which is outside its folder; only files in its "
            "own folder are read"
        )
    if not stat.S_ISREG(status.st_mode):
        raise MeshError(f"{source.where}: its side file {shown} is not a file")
    return path.read_bytes()


def _is_plain(name: str) -> bool:
    """Return whether an address is the relative path of a file in the folder or below."""
    try:
        address = urlsplit(name)
    except ValueError:
        return False
    return (
        bool(name)
        and name.isprintable()
        and not (
            address.scheme
            or address.netloc
            or "\\" in name
            or Path(name).is_absolute()
            or name.startswith("/")
            or ".." in name.split("/")
        )
    )
