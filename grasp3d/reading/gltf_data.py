"""Checks of the accessors, buffer views and buffers of a glTF, before its numbers are read."""

from typing import Any

from grasp3d.errors import MeshError
from grasp3d.reading.sources import Source

Tree = dict[str, Any]

BYTES = {5120: 1, 5121: 1, 5122: 2, 5123: 2, 5125: 4, 5126: 4}
"""Size of a number by the componentType of an accessor."""

COLUMNS = {"SCALAR": 1, "VEC3": 3}
"""Numbers of an entry by the type of an accessor."""

_VIEW = ("byteOffset", "byteStride")
_ACCESSOR = ("byteOffset",)


def checked_accessor(
    source: Source, tree: Tree, number: int, sizes: list[int | None]
) -> tuple[Tree, Tree]:
    """Return an accessor and its buffer view, after checking that its entries are there.

    Args:
        source: The file.
        tree: Its JSON.
        number: The accessor, whose type and componentType are known.
        sizes: Size of each buffer [bytes]; None: its data are missing.

    Raises:
        MeshError: Its numbers are not whole, or it ends beyond its view, or that beyond its buffer.
    """
    what = f"accessor {number}"
    accessor: Tree = tree["accessors"][number]
    check_whole(source, what, accessor, _ACCESSOR, required=("bufferView", "count"))
    if accessor["count"] == 0:
        raise MeshError(f"{source.where}: {what} has no entries; export the mesh again")
    view = _checked_view(source, tree, what, accessor["bufferView"], sizes)
    entry = BYTES[accessor["componentType"]] * COLUMNS[accessor["type"]]
    stride = view.get("byteStride", entry)
    if stride == 0:
        raise MeshError(
            f"{source.where}: the bufferView of {what} states a byteStride of 0; export the mesh "
            "again"
        )
    start = accessor.get("byteOffset", 0)
    end = start + (accessor["count"] - 1) * stride + entry
    if end > view["byteLength"]:
        raise MeshError(
            f"{source.where}: {what} declares {accessor['count']:,} entries up to byte {end:,} of "
            f"bufferView {accessor['bufferView']}, which has {view['byteLength']:,}; "
            "is the file complete?"
        )
    return accessor, view


def check_whole(
    source: Source, what: str, entry: Tree, names: tuple[str, ...], required: tuple[str, ...] = ()
) -> None:
    """Refuse numbers that are not whole or negative.

    Args:
        source: The file.
        what: Name of the entry, for errors.
        entry: The entry of the JSON.
        names: Names of numbers that may be left out.
        required: Names of numbers that must be there.
    """
    for name in (*required, *names):
        if name in required and name not in entry:
            raise MeshError(f"{source.where}: {what} states no {name}; export the mesh again")
        value = entry.get(name, 0)
        if type(value) is not int or value < 0:
            raise MeshError(
                f"{source.where}: {name} of {what} is not a whole number; export the mesh again"
            )


def _checked_view(
    source: Source, tree: Tree, accessor: str, number: int, sizes: list[int | None]
) -> Tree:
    views = tree.get("bufferViews", [])
    if number >= len(views):
        raise MeshError(
            f"{source.where}: {accessor} uses bufferView {number}, but there are {len(views)}; "
            "export the mesh again"
        )
    view: Tree = views[number]
    what = f"bufferView {number}"
    check_whole(source, what, view, _VIEW, required=("buffer", "byteLength"))
    if view["buffer"] >= len(sizes):
        raise MeshError(
            f"{source.where}: {what} uses buffer {view['buffer']}, but there are {len(sizes)}; "
            "export the mesh again"
        )
    size = sizes[view["buffer"]]
    if size is None:
        raise MeshError(
            f"{source.where}: buffer {view['buffer']} has no data; is the file complete?"
        )
    end = view.get("byteOffset", 0) + view["byteLength"]
    if end > size:
        raise MeshError(
            f"{source.where}: {what} ends at byte {end:,} of buffer {view['buffer']}, which has "
            f"{size:,}; is the file complete?"
        )
    return view
