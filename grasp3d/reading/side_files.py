"""The data that a glTF keeps elsewhere: embedded in it, or in files of its own folder."""

import base64
import binascii
import json
import re
import stat
from pathlib import Path
from urllib.parse import unquote, urlsplit

from grasp3d.errors import MeshError
from grasp3d.reading.sources import Source

PICTURES = (".png", ".jpg", ".jpeg", ".webp", ".ktx", ".ktx2", ".basis", ".dds")
"""Side files that are not read."""

_ADDRESS = re.compile(rb'"uri"\s*:\s*("(?:[^"\\]|\\.){1,1000}")')
_GLB_HEADER = 20


def side_names(path: Path) -> list[str]:
    """Names of the files that a glTF asks for and that would be read.

    The text is searched and not understood, so that no file can make this take long.

    Args:
        path: Any mesh file; only .gltf and .glb ask for others.

    Returns:
        Paths below its folder with `/`, each once, whether the files are there or not.

    Raises:
        OSError: It cannot be read.
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
        if _is_plain(uri) and _is_plain(name) and not name.lower().endswith(PICTURES):
            names[name] = None
    return list(names)


def read_address(source: Source, uri: str) -> bytes:
    """Content of a buffer that is not part of the file's binary data.

    Args:
        source: The .gltf or .glb file.
        uri: Where it says that the content lies.

    Raises:
        MeshError: It is damaged, missing, or not in the folder of the glTF or below.
    """
    return _embedded(source, uri) if uri[:5].lower() == "data:" else _beside(source, uri)


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


def _beside(source: Source, uri: str) -> bytes:
    """Read the file that an address names, if it lies in the folder of the glTF or below."""
    shown, folder = ascii(uri[:80]), source.path.parent.resolve()
    name = unquote(uri)
    if not _is_plain(uri) or not _is_plain(name):
        raise MeshError(f"{source.where}: asks for {shown}; only files in its own folder are read")
    try:
        path = (folder / name).resolve(strict=True)
        status = path.stat()
    except (OSError, RuntimeError, ValueError) as error:
        raise MeshError(
            f"{source.where}: its side file {shown} is missing; keep it beside the mesh"
        ) from error
    if not path.is_relative_to(folder):
        raise MeshError(
            f"{source.where}: asks for {shown}, which leads out of its folder; only files in its "
            "own folder are read"
        )
    if not stat.S_ISREG(status.st_mode):
        raise MeshError(f"{source.where}: its side file {shown} is no file")
    return path.read_bytes()


def _is_plain(name: str) -> bool:
    """Tell the name of a file in this folder or below from all other addresses."""
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
