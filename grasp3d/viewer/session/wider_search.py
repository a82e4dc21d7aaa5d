"""A wider search that keeps the grasps found in the narrower cone.

Where a search samples directions or contacts, those in a wider cone are further apart and may miss
a grasp that the narrower search has found. As those grasps are kept, labels and area fractions at
the resolutions that were already searched do not change.
"""

import math
from dataclasses import replace

import numpy as np

from grasp3d.settings import AnySampling, GraspModel
from grasp3d.surface.labelling import label_surface
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.surface.merged_grasps import merged
from grasp3d.surface.vertex_grasps import Reason
from grasp3d.system.progress import Progress, within
from grasp3d.viewer.session.computations import WIDEST, mesh_of
from grasp3d.viewer.session.inspection import warm_up
from grasp3d.viewer.session.painting import ROUNDING
from grasp3d.viewer.subjects.subject import Subject, subject_of

KNOWN = 0.5
"""Fraction of the work after which the known grasps of a file are available."""


def search_wider(
    subject: Subject, model: GraspModel, sampling: AnySampling, progress: Progress
) -> Subject:
    """Search the widest cone for the vertices that have no grasp within the searched cone.

    Args:
        subject: The surface; grasps that its file does not contain are searched first.
        model: Grasp model.
        sampling: Settings of the search, the same as before apart from the cone.
        progress: Called with the finished fraction of the work, from 0 to 1.

    Raises:
        GraspError: The mesh cannot be prepared or searched.
    """
    start = 0.0 if subject.prepared else KNOWN
    known = _known_labels(subject, sampling, within(progress, 0.0, start))
    wide = label_surface(
        known.mesh, replace(model, fingers=known.model.fingers),
        sampling=replace(sampling, search_angle=WIDEST), load=subject.labels.load,
        progress=within(progress, start, 1.0), scene=subject.labels.scene,
    )  # fmt: skip
    return warm_up(subject_of(with_known_grasps(wide, known), subject.name))


def with_known_grasps(wide: SurfaceLabels, known: SurfaceLabels) -> SurfaceLabels:
    """Labels of a wider search, with the grasps that a narrower one found within its cone.

    Args:
        wide: Labels of the wider search.
        known: Labels of the narrower search on the same mesh.
    """
    new, old = wide, known
    beyond = known.search.cone + ROUNDING
    worst = (old.critical_angle > beyond) & (new.critical_angle < old.critical_angle)
    best = (old.critical_angle_best > beyond) | worst
    best &= new.critical_angle_best < old.critical_angle_best
    missing = old.reason != Reason.FOUND
    return merged(
        old, new, worst=worst, best=best, reason=np.where(missing, new.reason, old.reason)
    )


def _known_labels(subject: Subject, sampling: AnySampling, progress: Progress) -> SurfaceLabels:
    """Labels with the grasps that are displayed; those of a file without partners are searched."""
    if subject.prepared:
        return subject.labels
    cone = min(subject.cone, math.pi / 2.0)
    return label_surface(
        mesh_of(subject), subject.labels.model, sampling=replace(sampling, search_angle=cone),
        load=subject.labels.load, progress=progress, scene=subject.labels.scene,
    )  # fmt: skip
