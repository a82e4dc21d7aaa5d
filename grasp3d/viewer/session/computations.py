"""Computations of the viewer: new searches, scans, epsilon."""

import math
from dataclasses import replace
from weakref import WeakKeyDictionary

import numpy as np

from grasp3d.errors import MeshError
from grasp3d.hand.scene import Scene
from grasp3d.mesh import ObjectMesh, load_mesh
from grasp3d.mesh.surface_points import SurfacePoints
from grasp3d.settings import AnySampling, GraspModel, search_cone
from grasp3d.surface.labelling import label_surface
from grasp3d.surface.scanning import scan_surface
from grasp3d.system.progress import Progress, within
from grasp3d.viewer.session.explanations import PAIR
from grasp3d.viewer.session.inspection import warm_up
from grasp3d.viewer.session.last_contact import best_last_contact
from grasp3d.viewer.session.painting import labels_at
from grasp3d.viewer.session.state import FixedPoints
from grasp3d.viewer.subjects.forces import Forces
from grasp3d.viewer.subjects.subject import Subject, dependence, located_angles, subject_of

WIDEST = math.pi / 2.0

_meshes: WeakKeyDictionary[Subject, ObjectMesh] = WeakKeyDictionary()
"""Meshes prepared for subjects that were read from files."""

PREPARED, SCANNED = 0.2, 0.8
"""Fractions of the work after which the mesh of a file is prepared, and the vertices scanned."""


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
    given = subject.mesh
    options = replace(given.options, max_edge=math.inf)
    mesh = load_mesh((given.vertices, given.faces), options)
    if len(mesh.vertices) != len(given.vertices):
        options = replace(options, repair="none")
        mesh = load_mesh((given.vertices, given.faces), options)
    if len(mesh.vertices) != len(given.vertices):
        raise MeshError(f"{subject.name}: its mesh cannot be prepared; label the mesh again")
    report = replace(mesh.report, source=subject.name, unit=given.unit)
    return replace(mesh, report=report, options=given.options)


def search_grasps(
    subject: Subject, model: GraspModel, sampling: AnySampling, progress: Progress, *,
    wide: bool = False, scene: Scene | None = None,
) -> Subject:  # fmt: skip
    """Search the best grasps again, for the same gripper and table.

    Args:
        subject: The surface.
        model: Grasp model.
        sampling: Search settings; without a search angle, at least the previous cone is searched.
        progress: Called with the finished fraction of the work, from 0 to 1.
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
    progress(start)
    labels = label_surface(
        mesh, model, sampling=replace(sampling, search_angle=cone),
        load=subject.labels.load, progress=within(progress, start, 1.0),
        scene=scene or subject.labels.scene,
    )  # fmt: skip
    return warm_up(subject_of(labels, subject.name))


def scan_with_fixed(
    subject: Subject, model: GraspModel, fixed: FixedPoints, progress: Progress
) -> Subject:
    """Label every vertex as the contact of one more finger, and search the best contact for it."""
    start = 0.0 if subject.prepared else PREPARED
    mesh = mesh_of(subject)
    progress(start)
    model = replace(model, fingers=len(fixed) + 1)
    labels = scan_surface(
        mesh, model, fixed=np.array(fixed), progress=within(progress, start, SCANNED)
    )
    found = best_last_contact(
        labels, _opposing_contacts(subject, fixed), within(progress, SCANNED, 1.0)
    )
    return warm_up(replace(subject_of(labels, subject.name), last_contact=found))


def _opposing_contacts(subject: Subject, fixed: FixedPoints) -> SurfacePoints:
    """Opposing contacts of one fixed finger's own best grasps, shape (c,); else none."""
    labels, none = subject.labels, SurfacePoints(np.empty(0, dtype=np.int64), np.empty((0, 3)))
    if (
        not subject.prepared
        or labels.mode != "label"
        or labels.model.fingers != PAIR
        or len(fixed) != 1
    ):
        return none
    nearest = int(np.argmin(((subject.mesh.vertices - np.array(fixed[0])) ** 2).sum(axis=1)))
    faces, weights = labels.partner_points.faces[nearest], labels.partner_points.weights[nearest]
    known = faces[:, 0] >= 0
    return SurfacePoints(faces[known, 0], weights[known, 0])


def compute_epsilon(subject: Subject, model: GraspModel, progress: Progress) -> Subject:
    """Compute epsilon of every vertex's grasp for another friction and resolution.

    Args:
        subject: With labels, or from a file with partners.
        model: Grasp model; fingers as the subject has them.
        progress: Called with the finished fraction of the work, from 0 to 1.
    """
    model = replace(model, fingers=subject.labels.model.fingers)
    labels = subject.labels.using(model=model)
    labels.compute_epsilon(progress)
    return replace(subject, epsilons=labels)


def compute_forces(subject: Subject, model: GraspModel, progress: Progress) -> Subject:
    """Compute grip force and payload of every vertex's grasp.

    Args:
        subject: With a load, and labels or partners.
        model: Grasp model; fingers as the subject has them.
        progress: Called with the finished fraction of the work, from 0 to 1.
    """
    model = replace(model, fingers=subject.labels.model.fingers)
    labels = subject.labels.using(model=model)
    labels.compute_holding(progress)
    assert labels.holding is not None
    return replace(subject, forces=Forces.of(labels.holding, model))


def locate_contacts(subject: Subject, model: GraspModel, progress: Progress) -> Subject:
    """Compute the located angles of every vertex's grasp.

    Args:
        subject: With labels.
        model: Grasp model; fingers as the subject has them.
        progress: Called with the finished fraction of the work, from 0 to 1.

    Raises:
        SettingError: The model is for another number of fingers.
    """
    progress(0.0)
    return replace(subject, located={dependence(model): located_angles(subject.labels, model)})


def difference(subject: Subject, other: Subject) -> float:
    """Area fraction whose labels differ between two searches, at the first one's model."""
    first, second = labels_at(subject, subject.labels.model), labels_at(other, subject.labels.model)
    return float(subject.weights[first != second].sum())
