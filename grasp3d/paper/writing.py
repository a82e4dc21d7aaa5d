"""Recomputation of the whole paper into one folder: figures, labelled surfaces, numbers."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path

from grasp3d.errors import OutputError
from grasp3d.paper.figures import (
    FIGURES,
    PaperSettings,
    ScannedObject,
    load_object,
    object_figure,
    real_object,
    solids,
)
from grasp3d.paper.numbers import numbers_page
from grasp3d.pictures.figures import save_as
from grasp3d.pictures.opengl import can_render
from grasp3d.system.context import report_progress, unreported, within
from grasp3d.system.files import atomic_write, check_writable

NUMBERS = "numbers.md"
SOLIDS = ("sphere", "box", "cylinder")
OBJECT = "object"
"""Name of a real object in the names of files."""
SUFFIXES = (".svg", ".png")

SEARCH = 0.3
"""Part of the duration that the search on a real object takes, for the progress."""


@dataclass(frozen=True)
class Paper:
    """Files that were written."""

    written: tuple[Path, ...]
    notes: tuple[str, ...]
    """What is missing and why, one sentence each."""


def write_paper(output: Path, settings: PaperSettings, *, object_file: Path | None = None) -> Paper:
    """Recompute Wan & Howe 2018: Fig. 4 to 11, their counterparts in space, and all numbers.

    Files of the same names are replaced atomically; other files in the folder are not changed.

    Args:
        output: Folder, made if it is missing.
        settings: Friction and resolutions.
        object_file: A mesh for the counterparts in space.

    Raises:
        SettingError: A setting is outside its range, or no grasp was found on the mesh.
        MeshError: The mesh cannot be read.
        OutputError: The folder cannot be written to.
    """
    names = [f"surface_{name}" for name in (*SOLIDS, *[OBJECT] * (object_file is not None))]
    files = [f"{name}{end}" for name in (*FIGURES, *names) for end in SUFFIXES] + [NUMBERS]
    _check(output, files)
    real = list[ScannedObject]()
    if object_file is not None:
        with within(0.0, SEARCH):
            real.append(real_object(load_object(object_file), object_file.stem, settings))
    output.mkdir(parents=True, exist_ok=True)
    with unreported():
        scanned = [*solids(settings), *real]
    pictures = can_render()
    figures = FIGURES | {
        name: partial(object_figure, one, pictures=pictures)
        for name, one in zip(names, scanned, strict=True)
    }
    for number, (name, draw) in enumerate(figures.items(), start=1):
        with unreported():
            figure = draw(settings)
            for end in SUFFIXES:
                save_as(figure, output / f"{name}{end}")
        report_progress(SEARCH + (1.0 - SEARCH) * number / len(figures))
    with atomic_write(output / NUMBERS) as part:
        part.write_text(numbers_page(settings, scanned), encoding="utf-8")
    notes = []
    if not pictures:
        notes.append(
            f"OpenGL is not available, so {', '.join(names)} show the area fractions without the "
            "labelled surfaces; EGL is enough (on Debian: libegl1 libgl1)"
        )
    if object_file is None:
        notes.append("to add a real object give its mesh: --object FILE")
    return Paper(tuple(output / file for file in files), tuple(notes))


def _check(output: Path, files: list[str]) -> None:
    """Check before the work that the folder, or the one that it will be in, can be written to."""
    folder = next(one for one in (output, *output.absolute().parents) if one.exists())
    if not folder.is_dir():
        raise OutputError(f"{output}: cannot be made, as {folder} is a file; name another folder")
    for file in files:
        check_writable(folder / file)
