"""Headers of PLY files: reading, checks against the file size, and reduction to the surface."""

import re
from dataclasses import dataclass, field

from grasp3d.errors import MeshError
from grasp3d.reading.declared_sizes import LONGEST_HEADER, check_count
from grasp3d.reading.sources import Source

_TYPES = {
    "char": "i1", "uchar": "u1", "int8": "i1", "uint8": "u1", "short": "i2", "ushort": "u2",
    "int16": "i2", "uint16": "u2", "int": "i4", "uint": "u4", "int32": "i4", "uint32": "u4",
    "int64": "i8", "uint64": "u8", "float": "f4", "double": "f8", "float32": "f4", "float64": "f8",
}  # fmt: skip
_LENGTHS = ("i1", "u1", "i2", "u2", "i4", "u4")
_FORMATS = {"": "ascii", "<": "binary_little_endian", ">": "binary_big_endian"}
_CORNERS = ("vertex_indices", "vertex_index")
_MIN_TEXT_BYTES = 2
"""Least size of a number and its separator in a text file [bytes]."""


@dataclass(frozen=True)
class Property:
    """A number, or a list of numbers, of each record of an element."""

    name: str
    type_words: tuple[str, ...]
    """The type as the header writes it."""
    type: str
    """NumPy type of one number, without byte order."""
    length: str | None
    """NumPy type of a list's length; None: a single number."""

    @property
    def min_bytes(self) -> int:
        """Least size in a binary file [bytes]."""
        return int((self.length or self.type)[1])


@dataclass(frozen=True)
class Element:
    """An element of the file: a table of records."""

    name: str
    count: int
    properties: list[Property] = field(default_factory=list)

    @property
    def min_bytes(self) -> int:
        """Least size of a record in a binary file [bytes]; exact if there are no lists."""
        return sum(entry.min_bytes for entry in self.properties)

    @property
    def lists(self) -> int:
        """Number of properties that are lists."""
        return sum(entry.length is not None for entry in self.properties)

    def lines(self) -> list[str]:
        """Return the header lines of the element, with neutral names for what is not read."""
        read = {"vertex": ("x", "y", "z"), "face": _CORNERS}.get(self.name, ())
        only = self.name == "face" and len(self.properties) == 1
        found = [f"element {self.name if read else 'other_' + self.name} {self.count}"]
        for number, entry in enumerate(self.properties):
            name = entry.name if entry.name in read or only else f"other_{number}"
            found.append(" ".join(["property", *entry.type_words, name]))
        return found


@dataclass(frozen=True)
class PlyHeader:
    """Header of a PLY file."""

    order: str
    """Byte order in NumPy's notation; empty: the file is text."""
    elements: tuple[Element, ...]
    start: int
    """Position of the first byte of data."""

    def count(self, name: str) -> int:
        """Return the declared number of records of the elements of a name."""
        return sum(element.count for element in self.elements if element.name == name)

    def plain(self) -> bytes:
        """Return the header without comments, colours and textures, which trimesh would read."""
        lines = ["ply", f"format {_FORMATS[self.order]} 1.0"]
        for element in self.elements:
            lines += element.lines() if element.count else []
        return "\n".join([*lines, "end_header\n"]).encode("utf-8", "replace")


def read_ply_header(source: Source) -> PlyHeader:
    """Read the header of a PLY, and check the declared counts against the file size.

    Raises:
        MeshError: It is not a PLY, or declares more than the file can contain.
    """
    found = re.match(rb"ply\s(.*?)\nend_header[ \r]*\n", source.head(LONGEST_HEADER), re.DOTALL)
    if found is None:
        raise MeshError(f"{source.where}: cannot be read as PLY: no header; {source.hint}")
    formats = {name: order for order, name in _FORMATS.items()}
    order, elements = "", list[Element]()
    for line in re.split(r"\r?\n", found[1].decode("utf-8", "replace")):
        words = line.split()
        try:
            if words[:1] == ["format"]:
                order = formats[words[1]]
            elif words[:1] == ["element"]:
                elements.append(Element(words[1], int(words[2])))
            elif words[:1] == ["property"]:
                elements[-1].properties.append(_property(words[1:]))
        except (ValueError, KeyError, IndexError) as error:
            raise MeshError(
                f"{source.where}: a line of its header ({line[:60]!r}) is not valid; "
                "export the mesh again"
            ) from error
    header = PlyHeader(order, tuple(elements), found.end())
    _check_elements(source, header)
    return header


def _property(words: list[str]) -> Property:
    *kind, name = words
    if kind[0] == "list":
        _, length, each = kind
        if _TYPES[length] not in _LENGTHS:
            raise ValueError(length)
        return Property(name, tuple(kind), _TYPES[each], _TYPES[length])
    (each,) = kind
    return Property(name, tuple(kind), _TYPES[each], None)


def _check_elements(source: Source, header: PlyHeader) -> None:
    for element in header.elements:
        names = [entry.name for entry in element.properties]
        broken = element.name == "face" and any(
            entry.length and entry.type[0] == "f" and (entry.name in _CORNERS or len(names) == 1)
            for entry in element.properties
        )
        if len(set(names)) < len(names) or broken:
            raise MeshError(
                f"{source.where}: element {element.name[:20]!r} has a property twice, or "
                "corners that are not whole numbers; export the mesh again"
            )
        least = element.min_bytes if header.order else _MIN_TEXT_BYTES * len(element.properties)
        plurals = {"vertex": "vertices", "face": "faces"}
        what = plurals.get(element.name, f"elements {element.name[:20]!r}")
        check_count(source, what, element.count, max(least, 1), source.size - header.start + 1)
