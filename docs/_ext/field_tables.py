"""Tables of the pages on files, made from the declarations of what is in them."""

import math
import re
import tomllib
from collections.abc import Iterable, Sequence
from enum import StrEnum
from inspect import cleandoc
from pathlib import Path
from types import NoneType
from typing import get_args, get_origin, get_type_hints

from generated_pages import replace_markers, write_pages
from sphinx.application import Sphinx

from grasp3d.batch.row import COLUMNS, Row
from grasp3d.formats.format import Format, formats
from grasp3d.formats.surface_files import HIDDEN
from grasp3d.hand.frames import FRAMES, GripperFrame
from grasp3d.surface.fields import (
    CLOSING_SHARE,
    CONTACTS,
    GRASPS,
    HAND_GRASPS,
    Field,
    When,
    given_poses,
)
from grasp3d.surface.vertex_fields import SURFACE, VERTICES

FILES, FRAME_PAGE = "reference/formats", "reference/frames"
FOLDER = "files"
"""Of the pages that are nothing but generated, beside these two."""

_TEXTS = tomllib.loads(Path(__file__).with_name("field_meanings.toml").read_text("utf-8"))
MEANINGS, FRAME_SOURCES = _TEXTS["meanings"], _TEXTS["frames"]

TYPES = {
    "f8": "float64", "f4": "float", "u1": "uint8", "i1": "int8", "i8": "int64", "u8": "uint64",
    "?": "bool", "U": "text", str: "text", int: "int", float: "number", bool: "bool",
}  # fmt: skip
PLY_TYPES = {"f8": "double", "f4": "float", "u1": "uchar"}


def meaning_of(table: str, name: str) -> str:
    """What a field means: in this table, or in all."""
    return MEANINGS.get(f"{table}: {name}") or MEANINGS[name]


def vertex_table(when: When) -> str:
    """What labelled files have of each vertex."""
    head = ["field", "type, shape", "unit", "meaning", "in Parquet and PLY", "PLY"]
    return _table(head, [_vertex_row(field) for field in VERTICES if field.when == when])


def _vertex_row(field: Field) -> list[str]:
    columns = field.column_names(2)
    if not field.array:
        named = "Parquet only"
    else:
        named = _names(columns) * (columns != [field.name]) + " PLY only" * (not field.table)
    return [
        _names([field.name]),
        f"{TYPES[field.kind]} {_shape(('V', *field.shape))}",
        field.unit,
        meaning_of("vertices", field.name),
        named,
        PLY_TYPES[field.ply] if field.ply else "packed" * (field in HIDDEN),
    ]


def surface_table() -> str:
    """The arrays that are not of vertices."""
    rows = [
        [_names([one.name]), f"{TYPES[one.kind]} {_shape(one.shape)}", MEANINGS[one.name]]
        for one in SURFACE
    ]
    return _table(["array", "type, shape", "meaning"], rows)


def column_table(table: str, fields: Iterable[Field], when: When = "always") -> str:
    """Columns of tables of grasps or poses."""
    chosen = [field for field in fields if field.when == when and not field.shape]
    rows = [
        [_names([one.name]), _type(one), one.unit, meaning_of(table, one.name)] for one in chosen
    ]
    return _table(["column", "type", "unit", "meaning"], rows)


def contact_table() -> str:
    """Columns of the first contact of grasps, and their keys in JSON."""
    rows = [
        [
            _names([f"{name}1" for name in one.columns or (one.name,)]),
            _names([one.name]),
            _type(one),
            one.unit,
            meaning_of("contacts", one.name),
        ]
        for one in CONTACTS
    ]
    return _table(["column", "JSON", "type", "unit", "meaning"], rows)


def row_table() -> str:
    """Columns of the rows of a batch; quantiles of one quantity are in one row."""
    hints = get_type_hints(Row)
    rows: dict[str, list[str]] = {}
    for name, one in COLUMNS.items():
        quantity, _, percent = name.rpartition("_p")
        if percent.isdecimal():
            meaning = one.meaning.replace(f"{percent} % quantile", "quantiles")
            row = rows.setdefault(quantity, ["", _row_type(hints[name]), meaning])
        else:
            row = rows[name] = ["", _row_type(hints[name]), one.meaning]
        row[0] = f"{row[0]} `{name}`".lstrip()
    return _table(["column", "type", "meaning"], rows.values())


def _row_type(hint: object) -> str:
    """The type of a column of a row, in a word."""
    kind = next((kind for kind in get_args(hint) if kind is not NoneType), hint)
    if get_origin(hint) is tuple:
        return "list"
    if get_origin(kind) is tuple:
        return f"{len(get_args(kind))} numbers"
    return "text" if isinstance(kind, type) and issubclass(kind, StrEnum) else TYPES[kind]  # type: ignore[index]


def frame_table() -> str:
    """Frames of grippers by name."""
    rows = []
    for name, frame in FRAMES.items():
        used_by, source = FRAME_SOURCES[name]
        rows.append([f"`{name}`", *_frame(frame), f"{used_by}: {source}"])
    return _table(["frame", "approach", "closing", "TCP", "of, stated in"], rows)


def _frame(frame: GripperFrame) -> list[str]:
    """Axes of a frame, and where the TCP is."""
    words = {"tcp": "origin", "base": "base", "ends": "ends"}
    place = words[frame.origin] + (f" + {1000.0 * frame.ahead:g} mm" if frame.ahead else "")
    turned = f", turned by {math.degrees(frame.turn):g}°" if frame.turn else ""
    return [frame.approach or "its own", f"{frame.closing or 'its own'}{turned}", place]


def _formats() -> list[Format]:
    return sorted(formats().values(), key=lambda one: one.title.lower())


def format_table() -> str:
    """The formats of poses, with their frames."""
    hands = {"gripper": "gripper", "articulated": "hand with joints"}
    rows = []
    for one in _formats():
        main, of = "**" * one.main, " or ".join(hands[kind] for kind in one.hands)
        rows.append(
            [
                f"[{one.title}]({FOLDER}/{one.name}.md)",
                " ".join(f"{main}`{suffix}`{main}" for suffix in one.suffixes),
                f"`{one.name}`",
                f"`{one.frame}`{', or stated' * one.states_frame}",
                "metres" if one.unit == "m" else "stated, or that of the mesh's file",
                f"to write: {of}" if one.alone else of,
            ]
        )
    return _table(["format", "suffix", "`format=`", "frame of the poses", "unit", "needs"], rows)


def pages() -> dict[str, str]:
    """The pages of generated tables alone, by file: one on each format of poses among them."""
    of_vertices = (
        f"## {title}\n\n{vertex_table(when)}"
        for title, when in (
            ("Always", "always"),
            ("With a gripper", "gripper"),
            ("With a load", "load"),
        )
    )
    return {
        "vertices.md": "\n\n".join(
            ["# Fields of vertices", "[Where they are stored](../formats.md#labelled-files).",
             *of_vertices, f"## The surface itself, in NPZ and PLY\n\n{surface_table()}"]
        ),
        "rows.md": "# Columns of a batch\n\n[Where they are stored]"
                   f"(../formats.md#columns-of-the-rows).\n\n{row_table()}",
        **{
            f"{one.name}.md": f"# {one.title}\n\n{_relinked(one.about)}\n" for one in _formats()
        },
    }  # fmt: skip


def _relinked(about: str) -> str:
    """The text on a format, with links to other formats and to the page on frames."""
    own = {f"#{name}": f"{name}.md" for name in formats()}
    return re.sub(
        r"\]\((#[\w-]+)\)",
        lambda found: f"]({own.get(found[1], f'../frames.md{found[1]}')})",
        cleandoc(about),
    )


def tree(names: Iterable[str]) -> str:
    """The tree of some of these pages."""
    lines = "\n".join(f"{FOLDER}/{name}" for name in names)
    return f"```{{toctree}}\n:hidden:\n\n{lines}\n```"


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def _names(names: Iterable[str]) -> str:
    return " ".join(f"`{name}`" for name in names)


def _shape(sizes: Iterable[int | str]) -> str:
    texts = [str(size).replace("-", " − ") for size in sizes]
    return f"({', '.join(texts)}{',' * (len(texts) == 1)})"


def _type(field: Field) -> str:
    kinds = {"f": "number", "i": "int", "?": "bool", "U": "text"}
    return "text" if field.texts else kinds[field.kind[0]]


TABLES = {
    "grasps": lambda: column_table("grasps", GRASPS),
    "forces": lambda: column_table("grasps", GRASPS, "load"),
    "contacts": contact_table,
    "poses": lambda: column_table("poses", given_poses()),
    "poses, load": lambda: column_table("poses", given_poses(), "load"),
    "poses, pose error": lambda: column_table("poses", (CLOSING_SHARE,), "pose error"),
    "hands": lambda: column_table("hands", HAND_GRASPS),
    "hands, load": lambda: column_table("hands", HAND_GRASPS, "load"),
    "gripper frames": frame_table,
    "formats": format_table,
    "pages of formats": lambda: tree(one.name for one in _formats()),
    "pages of tables": lambda: tree(["vertices", "rows"]),
}
"""What makes each table, by the name in its marker."""
MARKERS = {"<!-- table: ([\\w, ]+) -->": lambda name: TABLES[name]()}


def _write_pages(app: Sphinx) -> None:
    write_pages(Path(app.srcdir) / "reference" / FOLDER, pages())


def setup(app: Sphinx) -> dict[str, bool]:
    """Fill the pages before they are parsed."""
    app.connect("builder-inited", _write_pages)
    for page in (FILES, FRAME_PAGE):
        replace_markers(app, page, MARKERS)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
