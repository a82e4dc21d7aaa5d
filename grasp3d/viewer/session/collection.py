"""The objects that a viewer can open: a mesh, a labelled file, the results of a batch."""

import re
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import TypeAlias, TypeVar

import numpy as np

from grasp3d.batch.row import Outcome, Row
from grasp3d.batch.store import read_summary
from grasp3d.errors import MeshError, SettingError
from grasp3d.formats.surfaces.files import READERS, labels_in, read_labels
from grasp3d.formats.surfaces.stored import DAMAGE, settings_from
from grasp3d.grasps.evaluated_poses import EvaluatedPoses
from grasp3d.hand.reach_settings import ReachSettings
from grasp3d.hand.scene import Scene, scene_settings
from grasp3d.mesh import ObjectMesh
from grasp3d.mesh.plausible_lengths import refuse_lengths
from grasp3d.mesh.reading.polygon_files import open_ply
from grasp3d.mesh.reading.sources import find_source
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
from grasp3d.system.ply_files import settings_of_header
from grasp3d.viewer.session.computations import scan_of_grasp, search_grasps

READ = 0.2
"""Fraction of the work of opening a mesh after which it is read and prepared."""

SettingsT = TypeVar("SettingsT")
Given: TypeAlias = tuple[GraspModel | None, Sampling | None]
Search: TypeAlias = tuple[ReachSettings, GraspModel, Sampling]
"""Settings of a search."""


@dataclass(frozen=True, eq=False)
class Item:
    """One object of a collection."""

    name: str
    open: Callable[[], Subject]
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
    settings = _chosen(model, sampling)
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
    their stored labels and settings. Settings given here that differ from the defaults override
    the stored settings; if they need other grasps, such as more fingers, these are searched.

    Args:
        target: A mesh, a labelled file, or the folder of a batch's results.
        model: Grasp model; None: as in the file, else the default.
        sampling: Search settings; None: as in the file, else the default.
        options: How a mesh is read; of labelled files only the memory limit is used, and the unit
            if the file states none.
        force: Accept lengths that cannot be meant for an object of this size.
        reach: The gripper that must reach each grasp, and the table; None, or without a gripper: as
            in the file, else none.
        load: What each grasp of a mesh must hold; None: nothing, or as in the file.

    Raises:
        GraspError: The path holds no object to view, or a length has a unit, but that of the
            objects is not known, or not the same; or there is a load for stored labels.
    """
    where, options = printable(str(target)), options or MeshOptions()
    reach = reach or ReachSettings()
    if re.match(r"[A-Za-z][A-Za-z0-9+.-]+:/", str(target)):
        raise MeshError(f"{where}: is an address; copy the file or folder to this machine first")
    if not (is_file(target) or is_folder(target)):
        raise MeshError(f"{where}: there is no such file or folder")
    labels = None
    if target.suffix.lower() in READERS and not target.is_dir():
        labels = labels_in(target, unit=options.unit)
    if load is not None and (target.is_dir() or labels is not None):
        raise SettingError(
            f"{where}: has stored labels, to which a load cannot be given; view the mesh itself, "
            "or label it again with the load"
        )
    if labels is not None and options.region is not None:
        raise SettingError(
            f"{where}: has stored labels, which a region does not change; view the mesh "
            "itself, or label it again with the region"
        )
    if target.is_dir():
        return _batch_collection(target, model, sampling, options, reach, force=force)
    if labels is not None:
        settings = _merged((labels.model, labels.sampling), model, sampling)
        if labels.mode != "scan":
            check_search_settings(*settings)
        subject, given = subject_of(labels, target.name), None if force else (model, sampling)
        opened = partial(_open_stored, lambda: subject, given, (reach, *settings))
        return _single(target.name, opened, *settings)
    settings = _chosen(model, sampling)
    check_search_settings(*settings)
    reader = partial(_open_mesh, target, (reach, *settings), options, load, force)
    return _single(target.name, reader, *settings)


def _single(
    name: str, reader: Callable[[], Subject], model: GraspModel, sampling: Sampling
) -> Collection:
    return Collection((Item(as_unicode(name), LastOpened().kept(reader)),), model, sampling)


def _batch_collection(
    folder: Path,
    model: GraspModel | None,
    sampling: Sampling | None,
    options: MeshOptions,
    reach: ReachSettings,
    *,
    force: bool,
) -> Collection:
    """All labelled meshes of a batch, in the order of their names."""
    rows, left_out = labelled_rows(folder)
    stored = settings_of_results(folder, rows)
    settings = _chosen(model, sampling)
    if stored is not None:
        settings = _merged(stored, model, sampling)
    given = None if force else (model, sampling)
    check_search_settings(*settings)
    last, items = LastOpened(), []
    for row in rows:
        reader = partial(read_result, folder, row, unit=options.unit)
        opened = partial(_open_stored, reader, given, (reach, *settings))
        items.append(Item(as_unicode(row.mesh), last.kept(opened)))
    count = left_out + len(rows)
    note = f"{left_out} of {count} meshes were not labelled; see report/index.html for the reasons"
    return Collection(tuple(items), *settings, (note,) if left_out else ())


def labelled_rows(folder: Path) -> tuple[list[Row], int]:
    """Rows of the meshes that a batch has labelled, and the number of other meshes.

    Args:
        folder: Folder of the results.

    Raises:
        GraspError: It contains no results, they are damaged, or no mesh was labelled.
    """
    rows = read_summary(folder)
    labelled = [row for row in rows if row.outcome is Outcome.LABELLED and row.labels]
    if not labelled:
        raise MeshError(
            f"{printable(str(folder))}: none of its {len(rows)} meshes was labelled; see "
            "report/index.html"
        )
    return labelled, len(rows) - len(labelled)


def settings_of_results(
    folder: Path, rows: Sequence[Row]
) -> tuple[GraspModel, Sampling | None] | None:
    """Settings of the first mesh whose file has them; None: no file can be read."""
    for row in rows:
        with suppress(*DAMAGE):  # the error is reported when that mesh is opened
            header = open_ply(find_source(folder / row.labels)).header
            settings = settings_from(settings_of_header(header))
            return settings.model, settings.sampling
    return None


def read_result(folder: Path, row: Row, *, unit: Unit | None = None) -> Subject:
    """Read one mesh of a batch.

    Args:
        folder: Folder of the results.
        row: Row of the mesh.
        unit: Unit of a file that states none.

    Raises:
        MeshError: Its labelled PLY is missing or damaged.
    """
    labels = read_labels(folder / row.labels, unit=unit)
    subject = subject_of(labels, row.mesh)
    notes = (text for text in row.warnings.split("; ") if text)
    return replace(subject, notes=tuple(dict.fromkeys((*notes, *subject.notes))))


def _open_stored(reader: Callable[[], Subject], given: Given | None, search: Search) -> Subject:
    """Read stored labels; the lengths that the user gave must be such as can be meant for them."""
    report_progress(0.0)
    subject = reader()
    if given is None:
        subject.mesh.check_units(*search)
    else:
        refuse_lengths(subject.mesh, *given)
    return _with_gripper(subject, search)


def _with_gripper(subject: Subject, search: Search) -> Subject:
    """The subject, labelled again if a gripper was chosen that its file was not labelled with.

    Raises:
        SettingError: It is a scan, its unit is unknown, or the gripper cannot make such grasps.
    """
    reach, model, sampling = search
    if reach.hand is None:
        return subject
    if subject.labels.mode == "scan":
        raise SettingError(
            f"{subject.name}: is a scan, whose grasps are given; a gripper cannot be chosen for it"
        )
    stored, scene = subject.labels.scene, Scene.of(reach, subject.mesh)
    assert scene is not None
    if stored is not None and scene_settings(stored) == scene_settings(scene):
        return subject
    searched = search_grasps(subject, model, sampling, scene=scene)
    note = f"grasps were searched again for gripper {scene.hand.name}, unlike in the file"
    return replace(searched, notes=(*subject.notes, note))


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


def _merged(
    stored: tuple[GraspModel, Sampling | None],
    model: GraspModel | None,
    sampling: Sampling | None,
) -> tuple[GraspModel, Sampling]:
    """Stored settings overridden by the given settings.

    The stored search angle is dropped, so that it does not limit later searches.
    """
    own_model, own_sampling = stored
    merged = _overridden(own_model, model)
    if own_sampling is None or merged.fingers != own_model.fingers:
        return merged, sampling or Sampling()
    return merged, _overridden(replace(own_sampling, search_angle=None), sampling)


def _chosen(model: GraspModel | None, sampling: Sampling | None) -> tuple[GraspModel, Sampling]:
    """The given settings, or the defaults."""
    return model or GraspModel(), sampling or Sampling()


def _overridden(stored: SettingsT, options: SettingsT | None) -> SettingsT:
    """Stored settings, replaced where a given value differs from the default."""
    if options is None:
        return stored
    default = type(options)()
    names = [field.name for field in fields(options)]  # type: ignore[arg-type]
    changed = {
        name: getattr(options, name)
        for name in names
        if getattr(options, name) != getattr(default, name)
    }
    return replace(stored, **changed)  # type: ignore[type-var]
