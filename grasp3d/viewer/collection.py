"""Objects that a viewer can open (a mesh, a labelled file, results of a batch), and their data.

Searches, scans and file access run in the background. The user's choices are an immutable value.
"""

import math
import re
import threading
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np

from grasp3d.arrays import Floats, chosen_rows, locked
from grasp3d.batch.chunks import Library, open_library
from grasp3d.batch.row import Outcome
from grasp3d.errors import MeshError, SettingError
from grasp3d.formats.surface_files import READERS, labels_in, writer_for
from grasp3d.grasps.evaluated_poses import EvaluatedPoses
from grasp3d.hand.reach_settings import ReachSettings
from grasp3d.mesh import ObjectMesh
from grasp3d.pictures.subject import NO_LABELS, Subject, subject_of, subject_of_poses
from grasp3d.pictures.view_settings import Paint
from grasp3d.quality.loads import Load
from grasp3d.settings import (
    ANGLE_ROUNDING,
    GraspModel,
    MeshOptions,
    Sampling,
    check_choice,
    check_search_settings,
)
from grasp3d.settings.units import Unit
from grasp3d.surface.grasp_table import GraspTable
from grasp3d.surface.labelling import Labelling, label_surface, scan_surface
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.surface.vertex_fields import Reason
from grasp3d.system.context import report_progress, within
from grasp3d.system.documents import is_file, is_folder
from grasp3d.system.names import as_unicode, printable

Axis = Literal["x", "y", "z"]
Click = Literal["inspect", "fix"]
OF_MODEL: dict[str, type] = {"friction": float, "sensor_resolution": float, "fingers": int}
"""Fields of the model that a user can change one by one, and their types."""
FixedPoints = tuple[tuple[float, float, float], ...]
"""Contact points of fixed fingers, in the mesh's frame."""


@dataclass(frozen=True)
class Section:
    """A plane that cuts the object open; the part in front of it is hidden."""

    axis: Axis = "x"
    """Axis of the mesh's frame that is normal to the plane."""
    position: float = 0.5
    """Position along the object, from 0 to 1."""
    flipped: bool = False
    """Show the upper part. By default the lower part is shown, as the initial camera is on the side
    of positive x, y and z and looks into the cut."""

    def __post_init__(self) -> None:
        check_choice("axis of a section", self.axis, Axis)
        if not 0.0 <= self.position <= 1.0:
            raise SettingError(f"section position must be from 0 to 1; got {self.position}")

    def plane(self, bounds: Floats) -> tuple[Floats, Floats]:
        """Return a point of the plane, and its normal toward the visible part, shape (3,) each.

        Args:
            bounds: Lowest and highest corner of the object, shape (2, 3).
        """
        low, high = bounds
        normal = np.zeros(3)
        normal["xyz".index(self.axis)] = 1.0 if self.flipped else -1.0
        return low + self.position * (high - low), normal


@dataclass(frozen=True)
class ViewState:
    """All choices of the user for the current object."""

    model: GraspModel
    """Chosen friction, resolution and number of fingers."""
    paint: Paint = "label"
    section: Section | None = None
    click: Click = "inspect"
    """Action of a click on the surface: inspect a vertex, or fix a finger there."""
    vertex: int | None = None
    """The vertex that is inspected."""
    grasp: int | None = None
    """Number of the best grasp that is shown, from 0."""
    show_gripper: bool = True
    """Whether the gripper is drawn at the inspected grasp, if there is one."""
    show_table: bool = True
    """Whether the table is drawn, if there is one."""
    fixed: FixedPoints = ()
    """Contact points of the fixed fingers; none: every vertex has its best grasp."""

    def __post_init__(self) -> None:
        check_choice("paint", self.paint, Paint)
        check_choice("click action", self.click, Click)
        points = np.asarray(self.fixed or np.zeros((1, 3)), dtype=np.float64)
        if points.ndim != 2 or points.shape[1] != 3 or not np.isfinite(points).all():
            raise SettingError("fixed fingers must be points of three finite coordinates each")


def changed_state(state: ViewState, changes: Mapping[str, Any]) -> ViewState:
    """Return a state with some choices changed.

    Args:
        state: The state before.
        changes: Fields of `ViewState`, and those of its model in `OF_MODEL`. If the number of
            fingers falls, the last fixed fingers are released.

    Raises:
        SettingError: A value is outside its range, or there is no such field.
    """
    unknown = set(changes) - set(OF_MODEL) - {field.name for field in fields(ViewState)}
    if unknown:
        raise SettingError(f"the viewer has no setting {min(unknown)!r}")
    try:
        of_model = {name: kind(changes[name]) for name, kind in OF_MODEL.items() if name in changes}
        others = {name: value for name, value in changes.items() if name not in OF_MODEL}
        changed = replace(state, **others)
    except (TypeError, ValueError) as error:
        raise SettingError(f"a value has the wrong type: {error}") from error
    model = replace(changed.model, **of_model)
    most = max(0, model.fingers - 1)
    if "fixed" in changes and len(changed.fixed) > most:
        raise SettingError(
            f"of {model.fingers} fingers at most {most} can be fixed; got {len(changed.fixed)}"
        )
    return replace(changed, model=model, fixed=changed.fixed[:most])


WIDEST = math.pi / 2.0

COMPUTED = 0.95
"""Fraction of the work of saving after which all columns are known."""


def search_grasps(subject: Subject, model: GraspModel, sampling: Sampling) -> Subject:
    """Search the best grasps for another number of fingers, with the same hand, table and load.

    More than two fingers always squeeze.
    """
    labels, grip = subject.labels, sampling.grip if model.fingers == 2 else "squeeze"
    found = label_surface(
        labels.mesh, model, sampling=replace(sampling, grip=grip), load=labels.load,
        scene=labels.scene,
    )  # fmt: skip
    return _with_notes(subject_of(found, subject.name), subject)


def search_wider(subject: Subject, model: GraspModel, sampling: Sampling) -> Subject:
    """Search the widest cone for the vertices that have no grasp within the searched cone.

    If a search samples directions or contacts, the samples in a wider cone are further apart and
    may miss a grasp that the narrower search found. As such grasps are kept, labels and area
    fractions at the resolutions searched before do not change.

    Args:
        subject: The surface.
        model: Grasp model.
        sampling: Settings of the search, equal to those of the labels apart from the cone.

    Raises:
        GraspError: The mesh cannot be searched.
    """
    known = subject.labels
    model = replace(model, fingers=known.model.fingers)
    wide = search_grasps(subject, model, replace(sampling, search_angle=WIDEST)).labels
    return _with_notes(subject_of(with_known_grasps(wide, known), subject.name), subject)


def _with_notes(found: Subject, before: Subject) -> Subject:
    """Return a new result with the earlier notes on the object."""
    return replace(found, notes=tuple(dict.fromkeys((*before.notes, *found.notes))))


def with_known_grasps(wide: SurfaceLabels, narrow: SurfaceLabels) -> SurfaceLabels:
    """Return the labels of a wider search, with a narrower search's grasps within its cone.

    Args:
        wide: Labels of the wider search.
        narrow: Labels of the narrower search on the same mesh.
    """
    beyond = narrow.critical_angle_best > narrow.search.cone + ANGLE_ROUNDING
    better = beyond & (wide.critical_angle < narrow.critical_angle)
    reason = np.where(narrow.reason == Reason.FOUND, narrow.reason, wide.reason)
    labels: SurfaceLabels = replace(chosen_rows(better, wide, narrow), reason=locked(reason))
    return labels


def scan_with_fixed(subject: Subject, model: GraspModel, fixed: FixedPoints) -> Subject:
    """Label every vertex as the contact of one more finger.

    Args:
        subject: The surface.
        model: Friction and resolution.
        fixed: Contact points of the fixed fingers.
    """
    model = replace(model, fingers=len(fixed) + 1)
    labels = scan_surface(subject.mesh, model, fixed=np.array(fixed))
    return subject_of(labels, subject.name)


def scan_of_grasp(grasps: GraspTable, row: int) -> Subject:
    """Label the surface with all fingers of a grasp but the first fixed."""
    given = grasps.take(np.array([row]))
    labels = scan_surface(grasps.mesh, grasps.model, fixed=given.contacts.points[0, 1:])
    return replace(subject_of(labels.using(scene=grasps.scene)), given=given)


def check_savable(subject: Subject, path: Path) -> None:
    """Check whether the labels of a surface can be written.

    Args:
        subject: The surface.
        path: File to create or replace.

    Raises:
        SettingError: There are no labels, or the search does not cover friction and resolution.
        OutputError: No writer has this suffix.
    """
    writer_for(path)
    if subject.poses is not None:
        raise SettingError(NO_LABELS)
    if not subject.covers(subject.model):
        raise SettingError(
            "the grasps for this friction and resolution are not searched yet; save when the "
            "search is finished"
        )


def write_labels(subject: Subject, path: Path) -> None:
    """Write the labels of a surface, which `check_savable` accepts; all columns are computed.

    Args:
        subject: The surface.
        path: File to create or replace; its suffix determines the format.

    Raises:
        GraspError: The file cannot be written.
    """
    labels = subject.labels
    middle = COMPUTED if labels.load is None else 0.5 * COMPUTED
    with within(0.0, middle):
        _ = labels.label, labels.epsilon_range
    with within(middle, COMPUTED):
        _ = labels.load_result
    with within(COMPUTED, 1.0):
        writer_for(path)(path, labels)


READ = 0.2
"""Fraction of the work of opening a mesh after which it has been read and prepared."""

Search: TypeAlias = tuple[ReachSettings, GraspModel, Sampling]
"""Settings of a search."""


@dataclass(frozen=True, eq=False)
class Item:
    """One object of a collection."""

    name: str
    open: Callable[[], Subject]
    """Function that reads the object."""


@dataclass(frozen=True, eq=False)
class Collection:
    """At least one object to view, with the initial model and search settings."""

    items: tuple[Item, ...]
    model: GraspModel
    sampling: Sampling
    notes: tuple[str, ...] = ()
    """Sentences for the user, for example on meshes that were left out."""

    def __post_init__(self) -> None:
        if not self.items:
            raise SettingError("there is no object to view")


class LastOpened:
    """Cache of the object that was opened last; only one thread at a time opens an object."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._kept: tuple[Callable[[], Subject], Subject] | None = None

    def kept(self, reader: Callable[[], Subject]) -> Callable[[], Subject]:
        """Return a function that opens an object, unless it is the cached one.

        Args:
            reader: Function that opens the object.
        """

        def read() -> Subject:
            with self._lock:
                if self._kept is None or self._kept[0] is not reader:
                    self._kept = reader, reader()
                return self._kept[1]

        return read


def collection_of(labels: SurfaceLabels) -> Collection:
    """Return a collection of one surface that is already labelled."""
    subject = subject_of(labels)
    sampling = labels.sampling or Sampling()
    return _single(subject.name, lambda: subject, labels.model, sampling)


def collection_of_mesh(
    mesh: ObjectMesh, model: GraspModel | None = None, sampling: Sampling | None = None
) -> Collection:
    """Return a collection of one mesh, which is labelled when it is opened.

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
    """Return a collection of grasps on one surface, an item for each.

    The labels of the surface are those of the first finger at every vertex, with the other fingers
    fixed. The grasp itself is shown until a vertex is inspected. For poses of a hand the surface
    has no labels, and the hand is coloured instead.

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
    """Return a collection of the objects at a path.

    A mesh is labelled when it is opened. A labelled file and the results of a batch are shown with
    their stored labels and settings. Friction, resolution and fingers of `model` that differ from
    the defaults are the initial choices instead.

    Args:
        target: A mesh, a labelled file, or the folder of a batch's results.
        model: Grasp model; None: as in the file, else the default.
        sampling: Search settings of a mesh; None: the default.
        options: How a mesh is read. For labelled files only the memory limit is used, and the unit
            if the file states none.
        force: Accept lengths that are implausible for an object of this size.
        reach: For a mesh: the gripper that must reach each grasp, and the table; None: none.
        load: For a mesh: what each grasp must hold; None: nothing.

    Raises:
        GraspError: The path holds no object to view; a length has a unit, but the object's unit is
            not known; or there are settings that do not affect stored labels.
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
            f"{where}: has stored labels, which {what} cannot change; view the mesh itself, or "
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
    """Return the settings of labels, with a model's choices that differ from the defaults.

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
    """Return all labelled meshes of a batch, in the order of their names."""
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
