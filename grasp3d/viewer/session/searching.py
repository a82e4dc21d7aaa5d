"""What a viewer has computed while it is open: new searches, scans, epsilon."""

import math
from dataclasses import asdict, replace
from weakref import WeakKeyDictionary

import numpy as np

from grasp3d.arrays import Floats, Ints, locked
from grasp3d.errors import MeshError, SettingError
from grasp3d.mesh import ObjectMesh, mesh_from_arrays
from grasp3d.mesh.surface_points import SurfacePoints, nearest_surface_points
from grasp3d.settings import GraspModel, Sampling, search_cone
from grasp3d.surface.labelling import label_surface
from grasp3d.surface.labels import Reason, SearchReport, SurfaceLabels
from grasp3d.surface.scanning import scan_surface
from grasp3d.system.processors import available_processors
from grasp3d.system.progress import Progress, within
from grasp3d.viewer.session.inspecting import warm_up
from grasp3d.viewer.session.painting import labels_at
from grasp3d.viewer.session.state import Places
from grasp3d.viewer.subjects.subject import Epsilons, Subject, subject_of

WIDEST = math.pi / 2.0

_meshes: WeakKeyDictionary[Subject, ObjectMesh] = WeakKeyDictionary()
"""Meshes of files that were prepared, as long as the files are looked at."""

PREPARED = 0.2
"""Of a search on what a file held, the share of the work after which the mesh is prepared."""


def mesh_of(subject: Subject) -> ObjectMesh:
    """The mesh with all its normals; prepared anew for what a file held.

    Its surface was mended and its edges divided when it was labelled, so nothing of both is done
    again: every vertex keeps its number.

    Raises:
        MeshError: It cannot be prepared.
    """
    if subject.labels is not None:
        return subject.labels.mesh
    if subject not in _meshes:
        _meshes[subject] = _prepared_mesh(subject)
    return _meshes[subject]


def _prepared_mesh(subject: Subject) -> ObjectMesh:
    options = replace(subject.options, max_edge=math.inf)
    mesh = mesh_from_arrays(subject.vertices, subject.faces, **asdict(options))
    if len(mesh.vertices) != len(subject.vertices):
        options = replace(options, repair="none")
        mesh = mesh_from_arrays(subject.vertices, subject.faces, **asdict(options))
    if len(mesh.vertices) != len(subject.vertices):
        raise MeshError(f"{subject.name}: its surface cannot be prepared; label the mesh again")
    report = replace(mesh.report, source=subject.name, unit=subject.unit)
    return replace(mesh, report=report, options=subject.options)


def searched(
    subject: Subject, model: GraspModel, sampling: Sampling, progress: Progress, *,
    wide: bool = False,
) -> Subject:  # fmt: skip
    """Search the best grasps anew.

    Args:
        subject: The surface.
        model: What is asked.
        sampling: How; unless it limits the search angle, as far as was searched before.
        progress: Called with the share of the work done, from 0 to 1.
        wide: In the widest cone, whatever the sampling says.
    """
    cone = sampling.search_angle
    if wide:
        cone = WIDEST
    elif cone is None and subject.mode == "label":
        cone = min(max(subject.cone, search_cone(model, Sampling())), WIDEST)
    begun = 0.0 if subject.labels is not None else PREPARED
    mesh = mesh_of(subject)
    progress(begun)
    labels = label_surface(
        mesh, model, sampling=replace(sampling, search_angle=cone),
        progress=within(progress, begun, 1.0),
    )  # fmt: skip
    return warm_up(subject_of(labels, subject.name))


def scanned(subject: Subject, model: GraspModel, fixed: Places, progress: Progress) -> Subject:
    """Fix fingers, and label every vertex as the place of one more."""
    begun = 0.0 if subject.labels is not None else PREPARED
    mesh = mesh_of(subject)
    progress(begun)
    model = replace(model, fingers=len(fixed) + 1)
    labels = scan_surface(mesh, model, fixed=np.array(fixed), progress=within(progress, begun, 1.0))
    return warm_up(subject_of(labels, subject.name))


def prepared(subject: Subject, progress: Progress) -> Subject:
    """Prepare the mesh of a file that names the partners, and find their surface points.

    Raises:
        SettingError: The file does not name them.
        MeshError: The mesh cannot be prepared, or the partners are not on it.
    """
    if subject.labels is not None:
        return subject
    if subject.partners is None:
        raise SettingError(f"{subject.name}: the file does not name the fingers of its grasps")
    mesh, count = mesh_of(subject), len(subject.vertices)
    progress(0.5)
    found = (subject.reason == Reason.FOUND) & mesh.on_surface
    held = np.flatnonzero(found & np.isfinite(subject.partners).all(axis=(1, 2)))
    points = _partner_points_of(mesh, subject.partners, held, within(progress, 0.5, 1.0))
    labels = SurfaceLabels(
        mesh=mesh,
        model=subject.model,
        sampling=subject.sampling,
        mode=subject.mode,
        critical_angle=subject.critical_angle,
        critical_angle_best=subject.critical_angle_best,
        partners=subject.partners,
        partner_normals=_normals_of(subject),
        partner_points=points,
        opening=subject.opening,
        grip=subject.grip if subject.grip is not None else locked(np.zeros(count), np.int8),
        reason=locked(np.where(mesh.on_surface, subject.reason, Reason.OFF_SURFACE), np.uint8),
        search=SearchReport(cone=subject.cone),
    )
    return warm_up(replace(subject, labels=labels))


def measured(subject: Subject, model: GraspModel, progress: Progress) -> Subject:
    """Measure epsilon of every vertex's grasp for another friction and resolution.

    Args:
        subject: With labels, or of a file that names the partners.
        model: What is asked; fingers as the subject has them.
        progress: Called with the share of the work done, from 0 to 1.
    """
    ready = prepared(subject, within(progress, 0.0, PREPARED))
    assert ready.labels is not None
    asked = replace(model, fingers=ready.model.fingers)
    labels = replace(ready.labels, model=asked)
    labels.measure(within(progress, PREPARED, 1.0))
    found = labels.epsilon_range
    return replace(ready, epsilons=Epsilons(found.nominal, found.minimum, asked, found.maximum))


def difference(subject: Subject, other: Subject) -> float:
    """Share of the area on which two searches of one surface disagree, at the first one's model."""
    one, two = labels_at(subject, subject.model), labels_at(other, subject.model)
    return float(subject.weights[one != two].sum())


def _partner_points_of(
    mesh: ObjectMesh, partners: Floats, held: Ints, progress: Progress
) -> SurfacePoints:
    """Where on the faces partners (V, n - 1, 3) are, twice: the best grasp over either normals."""
    count, others = partners.shape[:2]
    faces = np.full((count, 2, others), -1, dtype=np.int64)
    weights = np.zeros((count, 2, others, 3))
    near, _, off = nearest_surface_points(
        mesh, partners[held].reshape(-1, 3), limit=1e-3 * mesh.size,
        threads=available_processors(), progress=progress,
    )  # fmt: skip
    if np.isinf(off).any():
        raise MeshError("the partners that the file names are not on its surface; label it again")
    faces[held] = near.faces.reshape(-1, 1, others)
    weights[held] = near.weights.reshape(-1, 1, others, 3)
    return SurfacePoints(locked(faces), locked(weights))


def _normals_of(subject: Subject) -> Floats:
    given = subject.partner_normals
    assert subject.partners is not None
    return np.full(subject.partners.shape, math.nan) if given is None else given
