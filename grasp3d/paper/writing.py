"""Recomputation of the whole paper into one folder: figures, labelled surfaces, numbers."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from matplotlib.figure import Figure

from grasp3d.errors import OutputError
from grasp3d.paper.figures import (
    FIGURES,
    ScannedObject,
    load_object,
    object_figure,
    real_object,
    solids,
)
from grasp3d.paper.numbers import numbers_page
from grasp3d.paper.paper_settings import PaperSettings
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


def write_paper(
    output: Path, settings: PaperSettings | None = None, *, object_file: Path | None = None
) -> Paper:
    """Recompute Wan & Howe 2018: Fig. 4 to 11, their counterparts in space, and all numbers.

    Files of the same names are replaced atomically; other files in the folder are not changed.

    Args:
        output: Folder, made if it is missing.
        settings: Friction and resolutions; None: the paper's.
        object_file: A mesh for the counterparts in space.

    Raises:
        SettingError: A setting is outside its range, or no grasp was found on the mesh.
        MeshError: The mesh cannot be read.
        OutputError: The folder cannot be written to.
    """
    own = settings or PaperSettings()
    names = [*SOLIDS, *([OBJECT] if object_file is not None else [])]
    _check(output, [*FIGURES, *(f"surface_{name}" for name in names)])
    real = list[ScannedObject]()
    if object_file is not None:
        with within(0.0, SEARCH):
            real.append(real_object(load_object(object_file), object_file.stem, own))
    output.mkdir(parents=True, exist_ok=True)
    with unreported():
        scanned = [*solids(own), *real]
    pictures = can_render()
    figures: dict[str, Callable[[PaperSettings], Figure]] = dict(FIGURES)
    for name, one in zip(names, scanned, strict=True):
        figures[f"surface_{name}"] = partial(object_figure, one, pictures=pictures)
    paths = list[Path]()
    for number, (name, draw) in enumerate(figures.items(), start=1):
        with unreported():
            paths += _saved(draw(own), output / name)
        report_progress(SEARCH + (1.0 - SEARCH) * number / len(figures))
    with atomic_write(output / NUMBERS) as part:
        part.write_text(numbers_page(own, scanned), encoding="utf-8")
    paths.append(output / NUMBERS)
    return Paper(tuple(paths), tuple(_notes(names, pictures=pictures, real=bool(real))))


def _saved(figure: Figure, path: Path) -> list[Path]:
    """Write a figure as vector graphics and as a picture."""
    paths = [path.with_suffix(suffix) for suffix in SUFFIXES]
    for one in paths:
        save_as(figure, one)
    return paths


def _check(output: Path, names: list[str]) -> None:
    """Check before the work that the folder, or the one that it will be in, can be written to."""
    folder = next(one for one in (output, *output.absolute().parents) if one.exists())
    if not folder.is_dir():
        raise OutputError(f"{output}: cannot be made, as {folder} is a file; name another folder")
    for name in (NUMBERS, *(f"{name}{end}" for name in names for end in SUFFIXES)):
        check_writable(folder / name)


def _notes(names: list[str], *, pictures: bool, real: bool) -> Iterator[str]:
    if not pictures:
        files = ", ".join(f"surface_{name}" for name in names)
        yield (
            f"OpenGL is not available, so {files} show the area fractions without the labelled "
            "surfaces; EGL is enough (on Debian: libegl1 libgl1)"
        )
    if not real:
        yield "to add a real object give its mesh: --object FILE"
