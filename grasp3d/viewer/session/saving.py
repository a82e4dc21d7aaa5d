"""Writing the labels at the chosen friction and resolution."""

import math
from dataclasses import replace
from pathlib import Path

from grasp3d.errors import SettingError
from grasp3d.export.writers import writer_for
from grasp3d.settings import GraspModel, Sampling
from grasp3d.system.progress import Progress, within
from grasp3d.viewer.session.computations import search_grasps
from grasp3d.viewer.subjects.forces import Forces
from grasp3d.viewer.subjects.subject import Subject

SEARCHED, COMPUTED = 0.5, 0.95
"""Fractions of the work after which the grasps are found, and epsilon and forces are computed."""


def check_savable(subject: Subject, model: GraspModel, path: Path) -> None:
    """Check whether the labels of a surface can be written.

    Args:
        subject: The surface.
        model: Friction and resolution.
        path: File to create or replace.

    Raises:
        SettingError: The search does not cover the model, or the contacts are unknown.
        OutputError: No writer has that suffix.
    """
    writer_for(path)
    if not subject.covers(model):
        raise SettingError(
            "the grasps for this friction and resolution are not searched yet; save when the "
            "search is finished"
        )
    if not subject.measurable:
        raise SettingError(
            f"{subject.name}: the file does not contain its fixed fingers, so it cannot be written "
            "for other settings; scan the mesh again"
        )


def write_labels(subject: Subject, model: GraspModel, path: Path, progress: Progress) -> Subject:
    """Write the labels of a surface.

    Args:
        subject: The surface; grasps that its file does not contain are searched first.
        model: Friction and resolution; fingers as the subject has them.
        path: File to create or replace; its suffix determines the format.
        progress: Called with the finished fraction of the work, from 0 to 1.

    Returns:
        The subject with everything that was computed for the file.

    Raises:
        GraspError: The file cannot be written; see also `check_savable`.
    """
    check_savable(subject, model, path)
    ready = _with_labels(subject, within(progress, 0.0, SEARCHED))
    model = replace(model, fingers=ready.labels.model.fingers)
    relabelled = ready.labels.using(model=model)
    relabelled.compute_labels(within(progress, SEARCHED, SEARCHED))
    middle = COMPUTED if relabelled.load is None else 0.5 * (SEARCHED + COMPUTED)
    relabelled.compute_epsilon(within(progress, SEARCHED, middle))
    relabelled.compute_holding(within(progress, middle, COMPUTED))
    writer_for(path)(path, relabelled)
    progress(1.0)
    holding = relabelled.holding
    return replace(
        ready,
        epsilons=relabelled,
        forces=None if holding is None else Forces.of(holding, model),
    )


def _with_labels(subject: Subject, progress: Progress) -> Subject:
    """The subject with its mesh and grasps."""
    if subject.prepared:
        return subject
    default = Sampling().fitted(subject.labels.model.fingers)
    sampling = subject.labels.sampling or default
    sampling = replace(sampling, search_angle=min(subject.cone, math.pi / 2.0))
    return search_grasps(subject, subject.labels.model, sampling, progress)
