"""Writing what is shown: labels at the friction and resolution that are chosen."""

import math
from dataclasses import replace
from pathlib import Path

from grasp3d.errors import SettingError
from grasp3d.export import writer_for
from grasp3d.settings import GraspModel, Sampling
from grasp3d.system.progress import Progress, within
from grasp3d.viewer.session.searching import prepared, searched
from grasp3d.viewer.subjects.subject import Epsilons, Subject

FOUND, MEASURED = 0.5, 0.95
"""Shares of the work after which a file's grasps are found, and epsilon is measured."""


def check_savable(subject: Subject, model: GraspModel, path: Path) -> None:
    """Refuse what cannot be written, before any work.

    Args:
        subject: The surface.
        model: Friction and resolution.
        path: File to make or replace.

    Raises:
        SettingError: Its grasps do not answer the model, or are not named.
        OutputError: No writer has that suffix.
    """
    writer_for(path)
    if not subject.covers(model):
        raise SettingError(
            "the grasps that this friction and resolution need are not searched yet; save when "
            "they are"
        )
    if not subject.measurable:
        raise SettingError(
            f"{subject.name}: the file does not name its fixed fingers, so it cannot be written "
            "at other settings; scan the mesh again"
        )


def written(subject: Subject, model: GraspModel, path: Path, progress: Progress) -> Subject:
    """Write the labels of a subject.

    Args:
        subject: The surface; grasps that a file did not name are searched first.
        model: Friction and resolution; fingers as the subject has them.
        path: File to make or replace; its suffix says the format.
        progress: Called with the share of the work done, from 0 to 1.

    Returns:
        The subject with all that had to be computed.

    Raises:
        GraspError: It cannot be written; see `check_savable` as well.
    """
    check_savable(subject, model, path)
    ready = _with_labels(subject, within(progress, 0.0, FOUND))
    assert ready.labels is not None
    relabelled = ready.labels.relabel(
        friction=model.friction, sensor_resolution=model.sensor_resolution
    )
    asked = replace(model, fingers=ready.model.fingers)
    if relabelled.model != asked:
        relabelled = replace(relabelled, model=asked)
    relabelled.enumerate_extremes(within(progress, FOUND, FOUND))
    relabelled.measure(within(progress, FOUND, MEASURED))
    writer_for(path)(path, relabelled)
    progress(1.0)
    found = relabelled.epsilon_range
    return replace(ready, epsilons=Epsilons(found.nominal, found.minimum, asked, found.maximum))


def _with_labels(subject: Subject, progress: Progress) -> Subject:
    """The subject with its mesh and grasps."""
    if subject.labels is not None or subject.partners is not None:
        return prepared(subject, progress)
    sampling = subject.sampling or Sampling()
    sampling = replace(sampling, search_angle=min(subject.cone, math.pi / 2.0))
    return searched(subject, subject.model, sampling, progress)
