"""Normalisation of text STL files for trimesh."""

import re

from grasp3d.errors import MeshError
from grasp3d.reading.sources import Source

_NAME = re.compile(rb"solid[^\n]*")


def plain_stl(source: Source, data: bytes) -> tuple[bytes, int]:
    """Return a text STL with all its solids as one solid without a name.

    Names may contain keywords of the format, and trimesh misreads several solids.

    Returns:
        (the text, its number of facets).

    Raises:
        MeshError: It is incomplete.
    """
    if b"\n" not in data:
        data = data.replace(b"\r", b"\n")
    data = data.lower()
    ends = data.count(b"endsolid")
    text = _NAME.sub(b"", data).replace(b"normal", b"")  # normals are not read
    facets, corners = text.count(b"endfacet"), text.count(b"vertex")
    started = text.count(b"facet") - facets
    if not facets or not ends or started != facets or corners != 3 * facets:
        reason = f"{started:,} facets with {corners:,} corners, and {ends:,} ends"
        if started == corners == 0:
            reason = "it holds no triangles"
        raise MeshError(f"{source.where}: cannot be read as STL: {reason}; {source.hint}")
    return b"solid\n" + text + b"\nendsolid\n", facets
