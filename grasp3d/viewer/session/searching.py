"""What a viewer computes in the background: searches, scans, files of labels."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from grasp3d.arrays import chosen_rows, locked
from grasp3d.errors import SettingError
from grasp3d.formats.surfaces.files import writer_for
from grasp3d.pictures.subject import NO_LABELS, Subject, subject_of
from grasp3d.settings import ANGLE_ROUNDING, GraspModel, Sampling
from grasp3d.surface.grasp_table import GraspTable
from grasp3d.surface.labelling import label_surface
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.surface.scanning import scan_surface
from grasp3d.surface.vertex_grasps import Reason
from grasp3d.system.context import within
from grasp3d.viewer.session.state import FixedPoints

WIDEST = math.pi / 2.0

COMPUTED = 0.95
"""Fraction of the work of saving after which all columns are computed."""


def search_grasps(subject: Subject, model: GraspModel, sampling: Sampling) -> Subject:
    """Search the best grasps of another number of fingers, for the same gripper, table and load.

    More than two fingers squeeze.
    """
    labels, grip = subject.labels, sampling.grip if model.fingers == 2 else "squeeze"
    found = label_surface(
        labels.mesh, model, sampling=replace(sampling, grip=grip), load=labels.load,
        scene=labels.scene,
    )  # fmt: skip
    return _with_notes(subject_of(found, subject.name), subject)


def search_wider(subject: Subject, model: GraspModel, sampling: Sampling) -> Subject:
    """Search the widest cone for the vertices that have no grasp within the searched cone.

    Where a search samples directions or contacts, those in a wider cone are further apart and may
    miss a grasp that the narrower search has found. As those grasps are kept, labels and area
    fractions at the resolutions that were already searched do not change.

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
    """A new result, with the notes on the object that were there before."""
    return replace(found, notes=tuple(dict.fromkeys((*before.notes, *found.notes))))


def with_known_grasps(wide: SurfaceLabels, narrow: SurfaceLabels) -> SurfaceLabels:
    """Labels of a wider search, with the grasps of a narrower search within its cone.

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
    """The surface with all fingers of a grasp fixed but the first."""
    given = grasps.take(np.array([row]))
    labels = scan_surface(grasps.mesh, grasps.model, fixed=given.contacts.points[0, 1:])
    return replace(subject_of(labels.using(scene=grasps.scene)), given=given)


def check_savable(subject: Subject, path: Path) -> None:
    """Check whether the labels of a surface can be written.

    Args:
        subject: The surface.
        path: File to create or replace.

    Raises:
        SettingError: It has no labels, or the search does not cover its friction and resolution.
        OutputError: No writer has that suffix.
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
