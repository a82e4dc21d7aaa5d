"""The page on formats of poses has its table and sections from the formats that are registered."""

import inspect

from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment

from grasp3d.formats.format import Format, formats

PAGE, TABLE, SECTIONS = "pose_formats", "<!-- formats -->", "<!-- sections of formats -->"

HANDS = {"gripper": "gripper", "articulated": "hand with joints"}


def rendered(page: str) -> str:
    """The text of the page with what its markers stand for."""
    known = sorted(formats().values(), key=lambda one: one.title.lower())
    head = ["format", "suffix", "`format=`", "frame of the poses", "unit", "needs"]
    rows = [head, ["---"] * len(head), *map(_row, known)]
    table = "\n".join(f"| {' | '.join(row)} |" for row in rows)
    sections = "\n\n".join(f"## {one.title}\n\n{inspect.cleandoc(one.about)}" for one in known)
    return page.replace(TABLE, table).replace(SECTIONS, sections)


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


def _outdated(_app: Sphinx, env: BuildEnvironment, *_names: set[str]) -> list[str]:
    """The page depends on the program, which has no date of change."""
    return [PAGE] if PAGE in env.all_docs else []


def setup(app: Sphinx) -> dict[str, bool]:
    """Fill the page before it is parsed."""
    app.connect("source-read", _write)
    app.connect("env-get-outdated", _outdated)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
