"""The objects that a viewer can open: a mesh, a labelled file, the results of a batch."""

import re
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TypeAlias

import numpy as np

from grasp3d.batch.chunks import Library, open_library
from grasp3d.batch.row import Outcome
from grasp3d.errors import MeshError, SettingError
from grasp3d.formats.surfaces.files import READERS, labels_in
from grasp3d.grasps.evaluated_poses import EvaluatedPoses
from grasp3d.hand.reach_settings import ReachSettings
from grasp3d.mesh import ObjectMesh
from grasp3d.pictures.subject import Subject, subject_of, subject_of_poses
from grasp3d.quality.loads import Load
from grasp3d.settings import GraspModel, MeshOptions, Sampling, check_search_settings
from grasp3d.settings.units import Unit
from grasp3d.surface.grasp_table import GraspTable
from grasp3d.surface.labelling import Labelling, label_surface
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.system.context import report_progress, within
from grasp3d.system.documents import is_file, is_folder
from grasp3d.system.names import as_unicode, printable
from grasp3d.viewer.session.searching import scan_of_grasp
from grasp3d.viewer.session.state import OF_MODEL

READ = 0.2
"""Fraction of the work of opening a mesh after which it is read and prepared."""

Search: TypeAlias = tuple[ReachSettings, GraspModel, Sampling]
"""Settings of a search."""


@dataclass(frozen=True, eq=False)
class Item:
    """One object of a collection."""

    name: str
    open: Callable[[], Subject]
    """Reads the object."""


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


class LastOpened:
    """Keeps the object that was opened last; one thread at a time opens one."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._kept: tuple[Callable[[], Subject], Subject] | None = None

    def kept(self, reader: Callable[[], Subject]) -> Callable[[], Subject]:
        """A function that opens an object, unless it is the one that is kept.

        Args:
            reader: Opens the object.
        """

        def read() -> Subject:
            with self._lock:
                if self._kept is None or self._kept[0] is not reader:
                    self._kept = reader, reader()
                return self._kept[1]

        return read


def collection_of(labels: SurfaceLabels) -> Collection:
    """Collection of one surface that is already labelled."""
    subject = subject_of(labels)
    sampling = labels.sampling or Sampling()
    return _single(subject.name, lambda: subject, labels.model, sampling)


def collection_of_mesh(
    mesh: ObjectMesh, model: GraspModel | None = None, sampling: Sampling | None = None
) -> Collection:
    """Collection of one mesh, which is labelled when it is opened.

    Args:
        mesh: The prepared mesh.
        model: Grasp model; None: the default.
        sampling: Search settings; None: the default.

    Raises:
        SettingError: The settings contradict each other.
    """
    settings = model or GraspModel(), sampling or Sampling()
    mesh.check_units(*settings)
    check_search_settings(*settings)
    return _single(mesh.report.source, partial(_label_mesh, mesh, *settings), *settings)


def collection_of_grasps(grasps: GraspTable | EvaluatedPoses) -> Collection:
    """Collection of grasps on one surface, an item for each.

    The surface has the labels that the first finger would have at every vertex, with the others
    fixed; the grasp itself is shown until a vertex is inspected. At poses it has none, and the hand
    has colours.

    Raises:
        SettingError: There are no grasps.
    """
    if not grasps.size:
        raise SettingError("there are no grasps to view")
    last, source = LastOpened(), as_unicode(grasps.mesh.report.source)
    names = [f"grasp {row + 1}" for row in range(grasps.size)]
    if isinstance(grasps, EvaluatedPoses):
        names = [as_unicode(name) for name in grasps.given.names]

    def opened(row: int) -> Subject:
        if isinstance(grasps, EvaluatedPoses):
            return subject_of_poses(grasps.take(np.array([row])))
        return scan_of_grasp(grasps, row)

    items = tuple(
        Item(f"{source}, {name}", last.kept(partial(opened, row))) for row, name in enumerate(names)
    )
    return Collection(items, grasps.model, Sampling())


def open_collection(
    target: Path,
    model: GraspModel | None = None,
    sampling: Sampling | None = None,
    options: MeshOptions | None = None,
    *,
    force: bool = True,
    reach: ReachSettings | None = None,
    load: Load | None = None,
) -> Collection:
    """Collection of the objects at a path.

    A mesh is labelled when it is opened. A labelled file and the results of a batch are shown with
    their stored labels and settings; friction, resolution and fingers that differ from the defaults
    are the first choices instead.

    Args:
        target: A mesh, a labelled file, or the folder of a batch's results.
        model: Grasp model; None: as in the file, else the default.
        sampling: Search settings of a mesh; None: the default.
        options: How a mesh is read; of labelled files only the memory limit is used, and the unit
            if the file states none.
        force: Accept lengths that cannot be meant for an object of this size.
        reach: For a mesh: the gripper that must reach each grasp, and the table; None: none.
        load: For a mesh: what each grasp must hold; None: nothing.

    Raises:
        GraspError: The path holds no object to view; a length has a unit, but that of the object is
            not known; or settings are given that stored labels do not depend on.
    """
    where, options = printable(str(target)), options or MeshOptions()
    model, sampling = model or GraspModel(), sampling or Sampling()
    if re.match(r"[A-Za-z][A-Za-z0-9+.-]+:/", str(target)):
        raise MeshError(f"{where}: is an address; copy the file or folder to this machine first")
    if not (is_file(target) or is_folder(target)):
        raise MeshError(f"{where}: there is no such file or folder")
    labels = None
    if target.suffix.lower() in READERS and not target.is_dir():
        labels = labels_in(target, unit=options.stated_unit)
    if labels is None and not target.is_dir():
        check_search_settings(model, sampling)
        settings = reach or ReachSettings(), model, sampling
        reader = partial(_open_mesh, target, settings, options, load, force)
        return _single(target.name, reader, model, sampling)
    others = replace(model, **{name: getattr(GraspModel(), name) for name in OF_MODEL})
    as_read = replace(options, unit=None, max_memory=MeshOptions.max_memory)
    given = {
        "search settings": sampling != Sampling(),
        "a gripper": reach is not None and reach.hand is not None,
        "a load": load is not None,
        "another reading of the mesh": as_read != MeshOptions(),
        "another model of contacts": others != GraspModel(),
    }
    if any(given.values()):
        what = next(name for name, is_given in given.items() if is_given)
        raise SettingError(
            f"{where}: has stored labels, which {what} does not change; view the mesh itself, or "
            "label it again"
        )
    if labels is None:
        return _batch_collection(target, model, unit=options.stated_unit)
    subject = subject_of(labels, target.name)
    return _single(target.name, lambda: subject, *_stored_settings(labels, model))


def _single(
    name: str, reader: Callable[[], Subject], model: GraspModel, sampling: Sampling
) -> Collection:
    return Collection((Item(as_unicode(name), LastOpened().kept(reader)),), model, sampling)


def _stored_settings(labels: SurfaceLabels, model: GraspModel) -> tuple[GraspModel, Sampling]:
    """Settings of labels, with the choices of a model that differ from the defaults.

    The search angle is dropped, so that it does not limit later searches.
    """
    changed = {
        name: getattr(model, name)
        for name in OF_MODEL
        if getattr(model, name) != getattr(GraspModel(), name)
    }
    sampling = replace(labels.sampling or Sampling(), search_angle=None)
    return replace(labels.model, **changed), sampling


def _batch_collection(folder: Path, model: GraspModel, unit: Unit | None) -> Collection:
    """All labelled meshes of a batch, in the order of their names."""
    library = open_library(folder)
    rows = library.rows(["mesh", "outcome", "warnings"])
    labelled = [row for row in rows if row.outcome is Outcome.LABELLED]
    if not labelled:
        raise MeshError(
            f"{printable(str(folder))}: none of its {len(rows)} meshes was labelled; see "
            "report/index.html"
        )
    settings, last = (model, Sampling()), LastOpened()
    readers = [partial(_read_result, library, row.mesh, row.warnings, unit) for row in labelled]
    items = tuple(
        Item(as_unicode(row.mesh), last.kept(reader))
        for row, reader in zip(labelled, readers, strict=True)
    )
    for item in items:
        with suppress(MeshError):  # the error is reported when that mesh is opened
            settings = _stored_settings(item.open().labels, model)
            break
    left_out = len(rows) - len(labelled)
    note = f"{left_out} of {len(rows)} meshes were not labelled; see report/index.html for the "
    return Collection(items, *settings, (f"{note}reasons",) if left_out else ())


def _read_result(library: Library, mesh: str, warnings: str, unit: Unit | None) -> Subject:
    """Read one mesh of a batch. Raises MeshError if its labelled surface is missing or damaged."""
    report_progress(0.0)
    subject = subject_of(library.labels(mesh, unit=unit), mesh)
    notes = (text for text in warnings.split("; ") if text)
    return replace(subject, notes=tuple(dict.fromkeys((*notes, *subject.notes))))


def _open_mesh(
    path: Path, search: Search, options: MeshOptions, load: Load | None, force: bool
) -> Subject:
    reach, model, sampling = search
    task = Labelling.read(path, model, sampling, reach, load, options, force=force)
    report_progress(READ)
    with within(READ, 1.0):
        labels = task.labels()
    return subject_of(labels)


def _label_mesh(mesh: ObjectMesh, model: GraspModel, sampling: Sampling) -> Subject:
    return subject_of(label_surface(mesh, model, sampling=sampling))
