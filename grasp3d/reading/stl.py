"""The text of an STL, checked and cleared of what its reader could mistake for numbers."""

import re

from grasp3d.errors import MeshError
from grasp3d.reading.sources import Source

_NAME = re.compile(rb"solid[^\n]*")


def plain_stl(source: Source, data: bytes) -> tuple[bytes, int]:
    """Make one solid without a name out of all the solids of a text STL.

    Names may hold any word of the format, and trimesh joins the corners of several solids.

    Returns:
        (the text, how many facets it holds).

    Raises:
        MeshError: It is incomplete.
    """
    if b"\n" not in data:
        data = data.replace(b"\r", b"\n")
    data = data.lower()
    ends = data.count(b"endsolid")
    text = _NAME.sub(b"", data).replace(b"normal", b"")  # normals are not read
    facets, corners = text.count(b"endfacet"), text.count(b"vertex")
    begun = text.count(b"facet") - facets
    if not facets or not ends or begun != facets or corners != 3 * facets:
        told = f"{begun:,} facets with {corners:,} corners, and {ends:,} ends"
        if begun == corners == 0:
            told = "it holds no triangles"
        raise MeshError(f"{source.where}: cannot be read as STL: {told}; {source.hint}")
    return b"solid\n" + text + b"\nendsolid\n", facets
