"""Small labelled surfaces, and sessions that have finished their jobs."""

import time
from copy import copy
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp3d import (
    GraspModel,
    Label,
    Sampling,
    SurfaceLabels,
    label_surface,
    load_mesh,
    scan_surface,
)
from grasp3d.formats.surface_files import read_labels
from grasp3d.mesh.object_mesh import MeshReport
from grasp3d.pictures.subject import Subject, subject_of
from grasp3d.quality.force_ranges import EpsilonRange
from grasp3d.stability.label import COLORS
from grasp3d.viewer.collection import Collection, collection_of
from grasp3d.viewer.inspection import Inspection
from grasp3d.viewer.panel_text import panel_text
from grasp3d.viewer.session import Session
from tests.helpers import shapes
from tests.helpers.vertex_labels import with_arrays

TIMEOUT = 120.0


@cache
def labels() -> SurfaceLabels:
    """A cone with all labels, sharp edges, a tip, and vertices without a grasp."""
    mesh = load_mesh(shapes.cone(0.35, sections=24), unit="cm", max_edge="0.2cm")
    found = label_surface(mesh, GraspModel(friction=0.75), sampling=Sampling(max_opening="3mm"))
    assert set(found.label) == {0, 1, 2}
    assert np.isinf(found.critical_angle).any()
    return found


@cache
def located(location_error: float) -> SurfaceLabels:
    """The same surface with a location error."""
    exact = labels()
    model = replace(exact.model, location_error=location_error)
    return label_surface(exact.mesh, model, sampling=exact.sampling)


@cache
def box() -> SurfaceLabels:
    return label_surface(load_mesh(shapes.box(), max_edge=0.5))


@cache
def three_fingers() -> SurfaceLabels:
    """Labels of a sphere for three fingers."""
    mesh = load_mesh(shapes.sphere(1), max_edge=9.0)
    return label_surface(mesh, GraspModel(fingers=3), sampling=Sampling(candidates=8))


@cache
def scan(fingers: int = 2) -> SurfaceLabels:
    """A scan of the cone, with fingers fixed at its side."""
    mesh = labels().mesh
    return scan_surface(mesh, fixed=mesh.vertices[[30, 60, 90][: fingers - 1]])


def with_values(subject: Subject, **values: Any) -> Subject:
    """Return the subject with other values of its labels, by name, such as those of a file."""
    labels = copy(subject.labels)
    vars(labels).update(values)
    return replace(subject, labels=labels)


def with_epsilon(subject: Subject, value: float, model: GraspModel) -> Subject:
    """Return the subject with one epsilon everywhere, for a model; the largest one is unknown."""
    known = copy(subject.at(model).labels)
    epsilon = np.full(known.size, value)
    vars(known)["epsilon_range"] = EpsilonRange(epsilon, epsilon, np.full_like(epsilon, np.nan))
    return replace(subject, labels=known)


def uncomputed(session: Session) -> Subject:
    """The displayed subject before the worker has computed any of its columns."""
    subject = shown(session)
    return replace(subject, labels=subject.labels.using(model=session.model))


def read_subject(path: Path) -> Subject:
    """The subject of a labelled file."""
    return subject_of(read_labels(path), path.name)


def with_report(labels: SurfaceLabels, report: MeshReport) -> SurfaceLabels:
    """Return the same labels with another report of their mesh."""
    return with_arrays(labels, mesh=replace(labels.mesh, report=report))


def ready_session(collection: Collection | SurfaceLabels) -> Session:
    """A session that has finished all jobs."""
    session = Session(
        collection if isinstance(collection, Collection) else collection_of(collection)
    )
    wait_until_idle(session)
    return session


def shown(session: Session) -> Subject:
    """The displayed subject."""
    assert session.subject is not None
    return session.subject


def inspected(session: Session) -> Inspection:
    """The inspected vertex or grasp."""
    assert session.inspection is not None
    return session.inspection


def fractions(session: Session) -> dict[str, float]:
    """Area fractions in the panel, by letter."""
    return {one.letter: one.fraction for one in panel_text(session).fractions}


def has_begun(session: Session, text: str) -> bool:
    """Whether a job runs, or waits to be polled; it may already be done in another thread."""
    working = session.working
    return working is not None and working[0] == text and 0.0 <= working[1] <= 1.0


def wait_until_idle(session: Session) -> None:
    end = time.monotonic() + TIMEOUT
    while session.working is not None:
        session.poll()
        assert time.monotonic() < end, session.working
        time.sleep(0.002)


def nearest_label(pixels: NDArray[Any]) -> NDArray[np.int64]:
    """Label with the hue that is nearest to the hue of each shaded pixel."""
    colors = np.array([COLORS[label] for label in sorted(Label)], dtype=float)
    hues = colors / np.linalg.norm(colors, axis=1, keepdims=True)
    return np.asarray((pixels.astype(float) @ hues.T).argmax(axis=-1))


def label_parts(picture: NDArray[Any]) -> dict[str, float]:
    """Fraction of the coloured pixels for each label."""
    nearest = nearest_label(picture[np.ptp(picture.astype(int), axis=-1) > 60])
    return {label.name: float((nearest == label).mean()) for label in Label}
