"""The objects that a viewer can open: a mesh, a labelled PLY, the results of a batch."""

import re
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import TypeVar

from grasp3d.batch.row import Row
from grasp3d.errors import MeshError, SettingError
from grasp3d.mesh import prepare_file
from grasp3d.settings import GraspModel, MeshOptions, Sampling, check_search_settings
from grasp3d.surface.labelling import label_surface
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.system.names import as_unicode, printable
from grasp3d.system.progress import Progress, within
from grasp3d.viewer.session.inspection import warm_up
from grasp3d.viewer.subjects.file_settings import FileSettings
from grasp3d.viewer.subjects.labelled_file import settings_of_file
from grasp3d.viewer.subjects.results import labelled_rows, read_result, settings_of_results
from grasp3d.viewer.subjects.subject import Subject, read_subject, subject_of
from grasp3d.viewer.subjects.subject_cache import SubjectCache

READ = 0.2
"""Fraction of the work of opening a mesh after which it is read and prepared."""

SettingsT = TypeVar("SettingsT")


@dataclass(frozen=True, eq=False)
class Item:
    """One object of a collection."""

    name: str
    open: Callable[[Progress], Subject]
    """Reads the object; called with a function that reports the finished fraction of the work."""


@dataclass(frozen=True, eq=False)
class Collection:
    """At least one object to view, with the initial model and search settings."""

    items: tuple[Item, ...]
    model: GraspModel
    sampling: Sampling
    notes: tuple[str, ...] = ()
    """Sentences for the user, for example that meshes were left out."""

    def __post_init__(self) -> None:
        if not self.items:
            raise SettingError("there is no object to view")


def collection_of(labels: SurfaceLabels) -> Collection:
    """Collection of one surface that is already labelled."""
    subject = subject_of(labels)
    item = Item(as_unicode(subject.name), lambda _: warm_up(subject))
    return Collection((item,), labels.model, labels.sampling or Sampling())


def open_collection(
    target: Path,
    model: GraspModel | None = None,
    sampling: Sampling | None = None,
    options: MeshOptions | None = None,
) -> Collection:
    """Collection of the objects at a path.

    A mesh is labelled when it is opened. A labelled PLY and the results of a batch are shown with
    their stored labels and settings. Settings given here that differ from the defaults override
    the stored ones; if they need other grasps, such as more fingers, these are searched.

    Args:
        target: A mesh, a labelled PLY, or the folder of a batch's results.
        model: Grasp model; None: as in the file, else the default.
        sampling: Search settings; None: as in the file, else the default.
        options: How a mesh is read; only the memory limit applies to labelled files.

    Raises:
        GraspError: The path holds no object to view.
    """
    where, options = printable(str(target)), options or MeshOptions()
    if re.match(r"[A-Za-z][A-Za-z0-9+.-]+:/", str(target)):
        raise MeshError(f"{where}: is an address; copy the file or folder to this machine first")
    if not target.exists():
        raise MeshError(f"{where}: no such file or folder")
    if target.is_dir():
        return _batch_collection(target, model, sampling, options)
    stored = settings_of_file(target, options.max_memory)
    if stored is not None:
        settings = _merged(stored, model, sampling)
        _check(*settings, scan=stored.mode == "scan")
        return _single(target.name, partial(_open_labelled, target, options.max_memory), *settings)
    settings = model or GraspModel(), sampling or Sampling()
    _check(*settings, scan=False)
    return _single(target.name, partial(_open_mesh, target, *settings, options), *settings)


def _single(
    name: str, read: Callable[[Progress], Subject], model: GraspModel, sampling: Sampling
) -> Collection:
    return Collection((Item(as_unicode(name), SubjectCache().cached(read)),), model, sampling)


def _batch_collection(
    folder: Path, model: GraspModel | None, sampling: Sampling | None, options: MeshOptions
) -> Collection:
    """All labelled meshes of a batch, in the order of their names."""
    rows, left_out = labelled_rows(folder)
    stored = settings_of_results(folder, rows, options.max_memory)
    settings = model or GraspModel(), sampling or Sampling()
    if stored is not None:
        settings = _merged(stored, model, sampling)
    _check(*settings, scan=False)
    cache = SubjectCache()
    items = tuple(
        Item(
            as_unicode(row.mesh),
            cache.cached(partial(_open_result, folder, row, options.max_memory)),
        )
        for row in rows
    )
    count = left_out + len(rows)
    note = f"{left_out} of {count} meshes were not labelled; see report/index.html for the reasons"
    return Collection(items, *settings, (note,) if left_out else ())


def _open_result(folder: Path, row: Row, max_memory: float, progress: Progress) -> Subject:
    progress(0.0)
    return read_result(folder, row, max_memory)


def _open_labelled(path: Path, max_memory: float, progress: Progress) -> Subject:
    progress(0.0)
    return read_subject(path, max_memory)


def _open_mesh(
    path: Path, model: GraspModel, sampling: Sampling, options: MeshOptions, progress: Progress
) -> Subject:
    mesh = prepare_file(path, options)
    progress(READ)
    labels = label_surface(mesh, model, sampling=sampling, progress=within(progress, READ, 1.0))
    return warm_up(subject_of(labels, path.name))


def _merged(
    stored: FileSettings, model: GraspModel | None, sampling: Sampling | None
) -> tuple[GraspModel, Sampling]:
    """Stored settings with the given ones over them.

    The stored search angle is dropped, so that it does not limit later searches.
    """
    merged = _overridden(stored.model, model)
    if stored.sampling is None or merged.fingers != stored.model.fingers:
        return merged, sampling or Sampling()
    return merged, _overridden(replace(stored.sampling, search_angle=None), sampling)


def _overridden(stored: SettingsT, given: SettingsT | None) -> SettingsT:
    """Stored settings, replaced where a given value differs from the default."""
    if given is None:
        return stored
    default = type(given)()
    names = [field.name for field in fields(given)]  # type: ignore[arg-type]
    changed = {
        name: getattr(given, name)
        for name in names
        if getattr(given, name) != getattr(default, name)
    }
    return replace(stored, **changed)  # type: ignore[type-var]


def _check(model: GraspModel, sampling: Sampling, *, scan: bool) -> None:
    """Check that a search accepts the settings, before anything is opened."""
    if not scan:
        check_search_settings(model, sampling)
