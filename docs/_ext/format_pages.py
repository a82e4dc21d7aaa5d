"""Tables of the pages on files come from what the program declares.

The formats of poses are those that are registered, the columns of rows the fields of a row.
"""

import inspect
from enum import StrEnum
from types import NoneType
from typing import get_args, get_origin, get_type_hints

from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment

from grasp3d.batch.row import COLUMNS, Row
from grasp3d.formats.format import Format, formats

PAGE, TABLE, SECTIONS = "pose_formats", "<!-- formats -->", "<!-- sections of formats -->"

FILES, ROWS = "formats", "<!-- columns of the rows -->"
TYPES = {str: "text", int: "int", float: "number", bool: "bool"}

HANDS = {"gripper": "gripper", "articulated": "hand with joints"}


def rendered(page: str) -> str:
    """The text of the page with what its markers stand for."""
    known = sorted(formats().values(), key=lambda one: one.title.lower())
    head = ["format", "suffix", "`format=`", "frame of the poses", "unit", "needs"]
    rows = [head, ["---"] * len(head), *map(_row, known)]
    table = "\n".join(f"| {' | '.join(row)} |" for row in rows)
    sections = "\n\n".join(f"## {one.title}\n\n{inspect.cleandoc(one.about)}" for one in known)
    return page.replace(TABLE, table).replace(SECTIONS, sections)


def with_rows(page: str) -> str:
    """The text of the page on files, with a line for each column of the rows."""
    hints = get_type_hints(Row)
    rows = (f"| `{name}` | {_type(hints[name])} | {one.meaning} |" for name, one in COLUMNS.items())
    return page.replace(ROWS, "\n".join(["| column | type | |", "|---|---|---|", *rows]))


def _type(hint: object) -> str:
    """The type of a column, in a word."""
    kinds = [kind for kind in get_args(hint) if kind is not NoneType] or [hint]
    kind = kinds[0]
    if get_origin(hint) is tuple:
        return "list"
    if get_origin(kind) is tuple:
        return f"{len(get_args(kind))} numbers"
    return "text" if isinstance(kind, type) and issubclass(kind, StrEnum) else TYPES[kind]  # type: ignore[index]


def _row(form: Format) -> list[str]:
    stated = ", or stated" * form.states_frame
    hands = " or ".join(HANDS[kind] for kind in form.hands)
    main = "**" * form.main
    return [
        f"[{form.title}](#{form.title.lower().replace(' ', '-').replace('/', '')})",
        " ".join(f"{main}`{suffix}`{main}" for suffix in form.suffixes),
        f"`{form.name}`",
        f"`{form.frame}`{stated}",
        "metres" if form.unit == "m" else "stated, or that of the mesh's file",
        f"to write: {hands}" if form.alone else hands,
    ]


def _write(_app: Sphinx, name: str, source: list[str]) -> None:
    if name == PAGE:
        source[0] = rendered(source[0])
    if name == FILES:
        source[0] = with_rows(source[0])


def _outdated(_app: Sphinx, env: BuildEnvironment, *_names: set[str]) -> list[str]:
    """The pages depend on the program, which has no date of change."""
    return [name for name in (PAGE, FILES) if name in env.all_docs]


def setup(app: Sphinx) -> dict[str, bool]:
    """Fill the page before it is parsed."""
    app.connect("source-read", _write)
    app.connect("env-get-outdated", _outdated)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
