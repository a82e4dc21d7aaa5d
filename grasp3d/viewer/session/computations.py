"""Computations of the viewer: new and wider searches, epsilon, forces, and files of labels."""

import math
from dataclasses import replace
from pathlib import Path
from weakref import WeakKeyDictionary

import numpy as np

from grasp3d.errors import MeshError, SettingError
from grasp3d.export.writers import writer_for
from grasp3d.hand.scene import Scene
from grasp3d.mesh import ObjectMesh, load_mesh
from grasp3d.settings import AnySampling, GraspModel, Sampling, search_cone
from grasp3d.surface.labelling import label_surface
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.surface.merged_grasps import merged
from grasp3d.surface.vertex_grasps import Reason
from grasp3d.system.context import report_progress, within
from grasp3d.viewer.session.inspection import warm_up
from grasp3d.viewer.session.painting import ROUNDING, labels_at
from grasp3d.viewer.subjects.forces import Forces
from grasp3d.viewer.subjects.subject import Subject, dependence, located_angles, subject_of

WIDEST = math.pi / 2.0

_meshes: WeakKeyDictionary[Subject, ObjectMesh] = WeakKeyDictionary()
"""Meshes prepared for subjects that were read from files."""

PREPARED = 0.2
"""Fraction of the work after which the mesh of a file is prepared."""
KNOWN = 0.5
"""Fraction of the work after which the known grasps of a file are available."""
COMPUTED = 0.95
"""Fraction of the work of saving after which epsilon and forces are computed."""


def mesh_of(subject: Subject) -> ObjectMesh:
    """The object mesh of a subject; prepared first if the subject was read from a file.

    The surface was already repaired and refined when it was labelled, so neither is repeated and
    the vertices keep their numbers.

    Raises:
        MeshError: The mesh cannot be prepared.
    """
    if subject.prepared:
        return subject.mesh
    if subject not in _meshes:
        _meshes[subject] = _prepared_mesh(subject)
    return _meshes[subject]


def _prepared_mesh(subject: Subject) -> ObjectMesh:
    source = subject.mesh
    options = replace(source.options, max_edge=math.inf)
    mesh = load_mesh((source.vertices, source.faces), options)
    if len(mesh.vertices) != len(source.vertices):
        options = replace(options, repair="none")
        mesh = load_mesh((source.vertices, source.faces), options)
    if len(mesh.vertices) != len(source.vertices):
        raise MeshError(f"{subject.name}: its mesh cannot be prepared; label the mesh again")
    report = replace(mesh.report, source=subject.name, unit=source.unit)
    return replace(mesh, report=report, options=source.options)


def search_grasps(
    subject: Subject, model: GraspModel, sampling: AnySampling, *,
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
    start = 0.0 if subject.prepared else PREPARED
    mesh = mesh_of(subject)
    report_progress(start)
    with within(start, 1.0):
        labels = label_surface(
            mesh, model, sampling=replace(sampling, search_angle=cone),
            load=subject.labels.load, scene=scene or subject.labels.scene,
        )  # fmt: skip
    return warm_up(subject_of(labels, subject.name))


def with_grasps(subject: Subject, *, sampling: AnySampling | None = None) -> Subject:
    """The subject with its mesh and grasps; those that its file does not contain are searched.

    Args:
        subject: The surface.
        sampling: Search settings, apart from the cone; None: those of the file, or the default.
    """
    if subject.prepared:
        return subject
    model = subject.labels.model
    sampling = sampling or subject.labels.sampling or Sampling().fitted(model.fingers)
    sampling = replace(sampling, search_angle=min(subject.cone, WIDEST))
    return search_grasps(subject, model, sampling)


def search_wider(subject: Subject, model: GraspModel, sampling: AnySampling) -> Subject:
    """Search the widest cone for the vertices that have no grasp within the searched cone.

    Where a search samples directions or contacts, those in a wider cone are further apart and may
    miss a grasp that the narrower search has found. As those grasps are kept, labels and area
    fractions at the resolutions that were already searched do not change.

    Args:
        subject: The surface; grasps that its file does not contain are searched first.
        model: Grasp model.
        sampling: Settings of the search, equal to those of the labels apart from the cone.

    Raises:
        GraspError: The mesh cannot be prepared or searched.
    """
    start = 0.0 if subject.prepared else KNOWN
    with within(0.0, KNOWN):
        narrow = with_grasps(subject, sampling=sampling).labels
    with within(start, 1.0):
        wide = label_surface(
            narrow.mesh, replace(model, fingers=narrow.model.fingers),
            sampling=replace(sampling, search_angle=WIDEST), load=subject.labels.load,
            scene=subject.labels.scene,
        )  # fmt: skip
    return warm_up(subject_of(with_known_grasps(wide, narrow), subject.name))


def with_known_grasps(wide: SurfaceLabels, narrow: SurfaceLabels) -> SurfaceLabels:
    """Labels of a wider search, with the grasps of a narrower search within its cone.

    Args:
        wide: Labels of the wider search.
        narrow: Labels of the narrower search on the same mesh.
    """
    new, old = wide, narrow
    beyond = narrow.search.cone + ROUNDING
    worst = (old.critical_angle > beyond) & (new.critical_angle < old.critical_angle)
    best = (old.critical_angle_best > beyond) | worst
    best &= new.critical_angle_best < old.critical_angle_best
    missing = old.reason != Reason.FOUND
    return merged(
        old, new, worst=worst, best=best, reason=np.where(missing, new.reason, old.reason)
    )


def compute_epsilon(subject: Subject, model: GraspModel) -> Subject:
    """Compute epsilon of every vertex's grasp for another friction and resolution.

    Args:
        subject: With labels, or from a file with partners.
        model: Grasp model; fingers as the subject has them.
    """
    return replace(subject, epsilons=subject.labels.using(model=model))


def compute_forces(subject: Subject, model: GraspModel) -> Subject:
    """Compute grip force and payload of every vertex's grasp.

    Args:
        subject: With a load, and labels or partners.
        model: Grasp model; fingers as the subject has them.
    """
    labels = subject.labels.using(model=model)
    assert labels.holding is not None
    return replace(subject, forces=Forces.of(labels.holding, model))


def locate_contacts(subject: Subject, model: GraspModel) -> Subject:
    """Compute the located angles of every vertex's grasp.

    Args:
        subject: With labels.
        model: Grasp model; fingers as the subject has them.

    Raises:
        SettingError: The model is for another number of fingers.
    """
    report_progress(0.0)
    return replace(subject, located={dependence(model): located_angles(subject.labels, model)})


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


def write_labels(subject: Subject, model: GraspModel, path: Path) -> Subject:
    """Write the labels of a surface.

    Args:
        subject: The surface; grasps that its file does not contain are searched first.
        model: Friction and resolution; fingers as the subject has them.
        path: File to create or replace; its suffix determines the format.

    Returns:
        The subject with everything that was computed for the file.

    Raises:
        GraspError: The file cannot be written; see also `check_savable`.
    """
    check_savable(subject, model, path)
    with within(0.0, KNOWN):
        ready = with_grasps(subject)
    model = replace(model, fingers=ready.labels.model.fingers)
    relabelled = ready.labels.using(model=model)
    with within(KNOWN, KNOWN):
        relabelled.compute_labels()
    middle = COMPUTED if relabelled.load is None else 0.5 * (KNOWN + COMPUTED)
    with within(KNOWN, middle):
        relabelled.compute("epsilon_range")
    with within(middle, COMPUTED):
        relabelled.compute("holding")
    with within(COMPUTED, 1.0):
        writer_for(path)(path, relabelled)
    report_progress(1.0)
    holding = relabelled.holding
    return replace(
        ready,
        epsilons=relabelled,
        forces=None if holding is None else Forces.of(holding, model),
    )


def difference(subject: Subject, other: Subject) -> float:
    """Area fraction whose labels differ between two searches, at the first one's model."""
    first, second = labels_at(subject, subject.labels.model), labels_at(other, subject.labels.model)
    return float(subject.weights[first != second].sum())
