"""Number of meshes that a 3MF contains: trimesh silently skips some nested parts."""

import re
import zipfile
from dataclasses import dataclass, field
from xml.parsers import expat

from grasp3d.errors import MeshError
from grasp3d.reading.sources import Source

MOST_PARTS = 10_000
"""Largest number of copies of all parts together."""


@dataclass
class _Part:
    meshes: int = 0
    components: list[str] = field(default_factory=list)


def count_parts(source: Source) -> int:
    """Return the number of copies of its meshes that a 3MF builds.

    Raises:
        MeshError: They are too many, nested in a cycle, or in files that are not read.
    """
    with zipfile.ZipFile(source.path) as archive:
        names = {name.lower(): name for name in reversed(archive.namelist())}
        found = [names[name] for name in names if "3d/3dmodel.model" in name]
        if len(found) != 1:
            raise MeshError(f"{source.where}: contains {len(found)} models, not one; {source.hint}")
        parts, built, paths = _structure(archive.read(found[0]))
        _check_paths(source, archive, parts, paths)
    known: dict[str, int] = {}
    count = sum(_copies(source, parts, name, known, ()) for name in built)
    if count > MOST_PARTS:
        raise MeshError(
            f"{source.where}: contains {count:,} copies of its parts, more than the limit of "
            f"{MOST_PARTS:,}; export fewer"
        )
    return count


def _structure(text: bytes) -> tuple[dict[str, _Part], list[str], list[tuple[str, str]]]:
    """Return (objects by id, ids of built objects, files with the ids of the objects in them)."""
    parts, built, paths = dict[str, _Part](), list[str](), list[tuple[str, str]]()
    current = _Part()

    def start_element(name: str, attributes: dict[str, str]) -> None:
        nonlocal current
        kind = name.rpartition(":")[2]
        path = next((v for k, v in attributes.items() if k.endswith("path")), None)
        if path is not None and kind in {"component", "item"}:
            paths.append((path if kind == "component" else "", attributes["objectid"]))
        if kind == "object":
            current = parts.setdefault(attributes["id"], _Part())
        elif kind == "mesh":
            current.meshes += 1
        elif kind == "component":
            current.components.append(attributes["objectid"])
        elif kind == "item":
            built.append(attributes["objectid"])

    parser = expat.ParserCreate()
    parser.StartElementHandler = start_element
    # Vertices and triangles are most of the text and are not needed.
    head, *meshes = text.split(b"<mesh>")
    rest = (b"<mesh/>" + mesh.partition(b"</mesh>")[2] for mesh in meshes)
    parser.Parse(b"".join([head, *rest]), True)  # noqa: FBT003
    return parts, built, paths


def _check_paths(
    source: Source,
    archive: zipfile.ZipFile,
    parts: dict[str, _Part],
    paths: list[tuple[str, str]],
) -> None:
    """Add objects of other files; reject those that trimesh would confuse with others."""
    names = [name for name, _ in paths]
    for name, number in paths:
        try:
            text = archive.read(name.strip("/"))
        except KeyError:
            text = b""
        once = names.count(name) == 1 and number not in parts
        if not once or len(re.findall(rb"<(?:\w+:)?mesh[\s>]", text)) != 1 or b"component" in text:
            raise MeshError(
                f"{source.where}: its objects are in several files, and {ascii(name)[:60]} does "
                "not contain exactly one that is used once; export it as one model, or as STL"
            )
        parts[number] = _Part(meshes=1)


def _copies(
    source: Source,
    parts: dict[str, _Part],
    name: str,
    known: dict[str, int],
    above: tuple[str, ...],
) -> int:
    """Return the number of meshes of an object and its components."""
    part = parts.get(name)
    if part is None or name in above or bool(part.meshes) == bool(part.components):
        raise MeshError(
            f"{source.where}: object {ascii(name)[:20]} is missing, empty, or contains itself; "
            "export the mesh again"
        )
    if name not in known:
        inner = (_copies(source, parts, other, known, (*above, name)) for other in part.components)
        known[name] = sum(inner) or 1
    return known[name]
