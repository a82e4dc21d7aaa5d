"""What can be looked at, one after the other: a mesh, a labelled file, the results of a batch."""

import re
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import TypeVar

from grasp3d.batch.row import Row
from grasp3d.errors import MeshError, SettingError
from grasp3d.mesh import prepare_file
from grasp3d.settings import GraspModel, MeshOptions, Sampling, check_searched
from grasp3d.surface.labelling import label_surface
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.system.names import as_unicode, printable
from grasp3d.system.progress import Progress, within
from grasp3d.viewer.session.inspecting import warm_up
from grasp3d.viewer.subjects.file_settings import FileSettings
from grasp3d.viewer.subjects.labelled_file import settings_of_file
from grasp3d.viewer.subjects.results import labelled_rows, read_result, settings_of_results
from grasp3d.viewer.subjects.shelf import Shelf
from grasp3d.viewer.subjects.subject import Subject, read_subject, subject_of

READ = 0.2
"""Of the work of opening a mesh, the share after which it is read and prepared."""

SettingsT = TypeVar("SettingsT")


@dataclass(frozen=True, eq=False)
class Exhibit:
    """An object that can be looked at."""

    name: str
    open: Callable[[Progress], Subject]
    """Makes it ready; takes the share of the work that is done."""


@dataclass(frozen=True, eq=False)
class Album:
    """Objects to look at, at least one, and what is asked of them at first."""

    exhibits: tuple[Exhibit, ...]
    model: GraspModel
    sampling: Sampling
    notes: tuple[str, ...] = ()
    """What else a user should know, such as objects that are left out; a sentence each."""

    def __post_init__(self) -> None:
        if not self.exhibits:
            raise SettingError("nothing to look at")


def album_of(labels: SurfaceLabels) -> Album:
    """Look at labels that are there already."""
    subject = subject_of(labels)
    exhibit = Exhibit(as_unicode(subject.name), lambda _: warm_up(subject))
    return Album((exhibit,), labels.model, labels.sampling or Sampling())


def open_album(
    target: Path,
    model: GraspModel | None = None,
    sampling: Sampling | None = None,
    options: MeshOptions | None = None,
) -> Album:
    """Find out what a path is, and what can be looked at there.

    A mesh is labelled when it is opened. A PLY that grasp3d labelled, and what a batch has written,
    are shown as they are; settings that are asked for and not the usual ones go before those of the
    file. Where they need other grasps, such as more fingers, these are searched then.

    Args:
        target: A mesh, a labelled PLY, or the folder of a batch's results.
        model: What is asked; None: as in the file, or the usual.
        sampling: How grasps are searched; None: likewise.
        options: How a mesh is read; of labelled files the memory alone counts.

    Raises:
        GraspError: There is nothing to look at.
    """
    where, chosen = printable(str(target)), options or MeshOptions()
    if re.match(r"[A-Za-z][A-Za-z0-9+.-]+:/", str(target)):
        raise MeshError(f"{where}: is an address; copy the file or folder to this machine first")
    if not target.exists():
        raise MeshError(f"{where}: no such file or folder")
    if target.is_dir():
        return _of_results(target, model, sampling, chosen)
    told = settings_of_file(target, chosen.max_memory)
    if told is not None:
        asked = _asked(told, model, sampling)
        _check(*asked, scan=told.mode == "scan")
        return _of_one(target.name, partial(_labelled, target, chosen.max_memory), *asked)
    asked = model or GraspModel(), sampling or Sampling()
    _check(*asked, scan=False)
    return _of_one(target.name, partial(_mesh, target, *asked, chosen), *asked)


def _of_one(
    name: str, read: Callable[[Progress], Subject], model: GraspModel, sampling: Sampling
) -> Album:
    return Album((Exhibit(as_unicode(name), Shelf().keeping(read)),), model, sampling)


def _of_results(
    folder: Path, model: GraspModel | None, sampling: Sampling | None, options: MeshOptions
) -> Album:
    """All labelled meshes of a batch, in the order of their names."""
    rows, left_out = labelled_rows(folder)
    settings = settings_of_results(folder, rows, options.max_memory)
    asked = model or GraspModel(), sampling or Sampling()
    if settings is not None:
        asked = _asked(settings, model, sampling)
    _check(*asked, scan=False)
    shelf = Shelf()
    exhibits = tuple(
        Exhibit(
            as_unicode(row.mesh), shelf.keeping(partial(_result, folder, row, options.max_memory))
        )
        for row in rows
    )
    count = left_out + len(rows)
    note = f"{left_out} of {count} meshes were not labelled; report/index.html says why"
    return Album(exhibits, *asked, (note,) if left_out else ())


def _result(folder: Path, row: Row, max_memory: float, progress: Progress) -> Subject:
    progress(0.0)
    return read_result(folder, row, max_memory)


def _labelled(path: Path, max_memory: float, progress: Progress) -> Subject:
    progress(0.0)
    return read_subject(path, max_memory)


def _mesh(
    path: Path, model: GraspModel, sampling: Sampling, options: MeshOptions, progress: Progress
) -> Subject:
    mesh = prepare_file(path, options)
    progress(READ)
    labels = label_surface(mesh, model, sampling=sampling, progress=within(progress, READ, 1.0))
    return warm_up(subject_of(labels, path.name))


def _asked(
    told: FileSettings, model: GraspModel | None, sampling: Sampling | None
) -> tuple[GraspModel, Sampling]:
    """What is asked of a labelled file; how far it was searched is no limit to other searches."""
    asked = _over(told.model, model)
    if told.sampling is None or asked.fingers != told.model.fingers:
        return asked, sampling or Sampling()
    return asked, _over(replace(told.sampling, search_angle=None), sampling)


def _over(of_file: SettingsT, asked: SettingsT | None) -> SettingsT:
    """Settings of a file, but for those that were asked for and are not the usual ones."""
    if asked is None:
        return of_file
    usual = type(asked)()
    names = [field.name for field in fields(asked)]  # type: ignore[arg-type]
    changed = {
        name: getattr(asked, name) for name in names if getattr(asked, name) != getattr(usual, name)
    }
    return replace(of_file, **changed)  # type: ignore[type-var]


def _check(model: GraspModel, sampling: Sampling, *, scan: bool) -> None:
    """Refuse settings that no search would listen to, before anything is opened."""
    if not scan:
        check_searched(model, sampling)
