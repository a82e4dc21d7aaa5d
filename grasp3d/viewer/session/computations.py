"""Computations of the viewer: new and wider searches, scans, epsilon, forces, files of labels."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from grasp3d.arrays import chosen_rows, locked
from grasp3d.errors import SettingError
from grasp3d.formats.surfaces.files import writer_for
from grasp3d.hand.scene import Scene
from grasp3d.pictures.colors import ROUNDING
from grasp3d.pictures.subject import NO_LABELS, Subject, subject_of
from grasp3d.settings import GraspModel, Sampling, search_cone
from grasp3d.surface.grasp_table import GraspTable
from grasp3d.surface.labelling import label_surface
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.surface.scanning import scan_surface
from grasp3d.surface.vertex_grasps import Reason
from grasp3d.system.context import report_progress, within
from grasp3d.viewer.session.state import FixedPoints

WIDEST = math.pi / 2.0

COMPUTED = 0.95
"""Fraction of the work of saving after which epsilon and forces are computed."""


def search_grasps(
    subject: Subject, model: GraspModel, sampling: Sampling, *,
    wide: bool = False, scene: Scene | None = None,
) -> Subject:  # fmt: skip
    """Search the best grasps again, for the same gripper and table.

    Args:
        subject: The surface.
        model: Grasp model.
        sampling: Search settings; without a search angle, at least the previous cone is searched.
        wide: Search the widest cone, whatever `sampling` says.
        scene: Another gripper and table; None: the same.
    """
    cone = sampling.search_angle
    if wide:
        cone = WIDEST
    elif cone is None and subject.labels.mode == "label":
        cone = min(max(subject.cone, search_cone(model)), WIDEST)
    labels = label_surface(
        subject.mesh, model, sampling=replace(sampling, search_angle=cone),
        load=subject.labels.load, scene=scene or subject.labels.scene,
    )  # fmt: skip
    return subject_of(labels, subject.name)


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
    narrow = subject.labels
    wide = label_surface(
        narrow.mesh, replace(model, fingers=narrow.model.fingers),
        sampling=replace(sampling, search_angle=WIDEST), load=narrow.load, scene=narrow.scene,
    )  # fmt: skip
    return subject_of(with_known_grasps(wide, narrow), subject.name)


def with_known_grasps(wide: SurfaceLabels, narrow: SurfaceLabels) -> SurfaceLabels:
    """Labels of a wider search, with the grasps of a narrower search within its cone.

    Args:
        wide: Labels of the wider search.
        narrow: Labels of the narrower search on the same mesh.
    """
    beyond = narrow.critical_angle_best > narrow.search.cone + ROUNDING
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


def compute_epsilon(subject: Subject, model: GraspModel) -> Subject:
    """Compute epsilon of every vertex's grasp for another friction and resolution.

    Args:
        subject: The surface.
        model: Grasp model; fingers as the subject has them.
    """
    return replace(subject, epsilons=subject.labels.using(model=model))


def compute_forces(subject: Subject, model: GraspModel) -> Subject:
    """Compute grip force and payload of every vertex's grasp.

    Args:
        subject: A surface with a load.
        model: Grasp model; fingers as the subject has them.
    """
    labels = subject.labels.using(model=model)
    _ = labels.load_result
    return replace(subject, forces=labels)


def check_savable(subject: Subject, model: GraspModel, path: Path) -> None:
    """Check whether the labels of a surface can be written.

    Args:
        subject: The surface.
        model: Friction and resolution.
        path: File to create or replace.

    Raises:
        SettingError: It has no labels, or the search does not cover the model.
        OutputError: No writer has that suffix.
    """
    writer_for(path)
    if subject.poses is not None:
        raise SettingError(NO_LABELS)
    if not subject.covers(model):
        raise SettingError(
            "the grasps for this friction and resolution are not searched yet; save when the "
            "search is finished"
        )


def write_labels(subject: Subject, model: GraspModel, path: Path) -> Subject:
    """Write the labels of a surface.

    Args:
        subject: The surface.
        model: Friction and resolution; fingers as the subject has them.
        path: File to create or replace; its suffix determines the format.

    Returns:
        The subject with everything that was computed for the file.

    Raises:
        GraspError: The file cannot be written; see also `check_savable`.
    """
    check_savable(subject, model, path)
    model = replace(model, fingers=subject.labels.model.fingers)
    relabelled = subject.labels.using(model=model)
    with within(0.0, 0.0):
        relabelled.compute_labels()
    middle = COMPUTED if relabelled.load is None else 0.5 * COMPUTED
    with within(0.0, middle):
        _ = relabelled.epsilon_range
    with within(middle, COMPUTED):
        _ = relabelled.load_result
    with within(COMPUTED, 1.0):
        writer_for(path)(path, relabelled)
    report_progress(1.0)
    forces = None if relabelled.load_result is None else relabelled
    return replace(subject, epsilons=relabelled, forces=forces)
