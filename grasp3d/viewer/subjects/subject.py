"""What is looked at: a surface, and what is known of the best grasp of each of its vertices."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import numpy.typing as npt

from grasp3d.arrays import Bytes, Floats, Ints, first_at_position, locked
from grasp3d.mesh.measures import face_areas, is_closed
from grasp3d.mesh.normals import CornerNormals, corner_normals
from grasp3d.mesh.preparing import surface_extent
from grasp3d.mesh.ray_tracing import FaceRays
from grasp3d.settings import GraspModel, MeshOptions, Sampling, Unit, search_cone
from grasp3d.stability.label import Mode
from grasp3d.stability.thresholds import label_angles
from grasp3d.surface.area_statistics import vertex_weights
from grasp3d.surface.labels import Reason, SurfaceLabels
from grasp3d.viewer.subjects.labelled_file import LabelledFile, read_labelled


@dataclass(frozen=True, eq=False)
class Epsilons:
    """Epsilon of every vertex's grasp, which belongs to one friction and resolution."""

    nominal: Floats
    """nan where there is no grasp. (V,)"""
    minimum: Floats
    """The smallest over the tilts. (V,)"""
    model: GraspModel
    """Of which they are."""
    maximum: Floats | None = None
    """What they reach at most over the tilts. (V,)"""


@dataclass(frozen=True, eq=False)
class Subject:
    """A surface with one row per vertex; from labels, or as a file holds them.

    Positions are in the mesh's own unit and frame, normals point into the object.
    """

    name: str
    vertices: Floats
    """Shape (V, 3)."""
    faces: Ints
    """Shape (F, 3), counter-clockwise from outside."""
    corner_normals: CornerNormals
    """Normals that faces have at their corners, apart at creases."""
    normals: Floats
    """Inward unit normal of each vertex, (V, 3)."""
    weights: Floats
    """Share of the surface that each vertex stands for, (V,)."""
    critical_angle: Floats
    """Over the worst normals of the contacts [rad]; inf: no grasp. (V,)"""
    critical_angle_best: Floats
    """Over the best. (V,)"""
    reason: Bytes
    """Codes of `labels.Reason`. (V,)"""
    opening: Floats
    """Largest distance between two contacts; nan: no grasp. (V,)"""
    partners: Floats | None
    """The other contacts, (V, n - 1, 3); None: a file that does not name them."""
    epsilons: Epsilons | None
    """None: not measured yet."""
    model: GraspModel
    """What the grasps were searched for."""
    sampling: Sampling | None
    """How; None in a scan."""
    mode: Mode
    cone: float
    """Largest critical friction angle that counted [rad]."""
    unit: Unit | None
    size: float
    """Diameter of the ball about the surface."""
    closed: bool
    options: MeshOptions
    notes: tuple[str, ...]
    """What a user should know before trusting the labels, a sentence each."""
    labels: SurfaceLabels | None
    """With the mesh, for new searches; None: a file, whose mesh was not prepared yet."""
    partner_normals: Floats | None = None
    """Inward unit normals at the partners, (V, n - 1, 3)."""
    grip: npt.NDArray[np.int8] | None = None
    """Two fingers: as in `SurfaceLabels`. (V,)"""

    @cached_property
    def rays(self) -> FaceRays:
        """Finds what a click meets; in the frame of `normalized`."""
        return FaceRays(self.normalized(self.vertices), self.faces)

    @cached_property
    def bounds(self) -> Floats:
        """Lowest and highest corner of the box about the faces, shape (2, 3)."""
        used = self.vertices[np.unique(self.faces)]
        return locked(np.stack([used.min(axis=0), used.max(axis=0)]))

    @cached_property
    def center(self) -> Floats:
        """Middle of that box, shape (3,)."""
        return locked(self.bounds.mean(axis=0))

    def normalized(self, points: Floats) -> Floats:
        """Take points (..., 3) to a frame in which the surface is centred and of size 1."""
        return (points - self.center) / self.size

    @property
    def measurable(self) -> bool:
        """Whether the grasps are known, or can be searched; not in a file of a scan."""
        return self.labels is not None or self.partners is not None or self.mode == "label"

    def covers(self, model: GraspModel) -> bool:
        """Tell whether the search went as far as a model asks."""
        needed = search_cone(model, Sampling())
        return needed <= max(self.cone, search_cone(self.model, Sampling())) + 1e-9  # rounding


def subject_of(labels: SurfaceLabels, name: str | None = None) -> Subject:
    """Take a labelled surface, epsilon only where it is known already.

    Args:
        labels: The labels.
        name: How the object is called; None: as its file.
    """
    mesh = labels.mesh
    known = vars(labels).get("epsilon_range")
    return Subject(
        name=mesh.report.source if name is None else name,
        vertices=mesh.vertices,
        faces=mesh.faces,
        corner_normals=mesh.corner_normals,
        normals=mesh.normals,
        weights=locked(vertex_weights(mesh, "area")),
        critical_angle=labels.critical_angle,
        critical_angle_best=labels.critical_angle_best,
        reason=labels.reason,
        opening=labels.opening,
        partners=labels.partners,
        epsilons=known and Epsilons(known.nominal, known.minimum, labels.model, known.maximum),
        model=labels.model,
        sampling=labels.sampling,
        mode=labels.mode,
        cone=math.pi if labels.mode == "scan" else labels.search.cone,
        unit=mesh.unit,
        size=mesh.size,
        closed=mesh.report.closed,
        options=mesh.options,
        notes=(*mesh.report.warnings, *_method_notes(labels.model, math.nan)),
        labels=labels,
        partner_normals=labels.partner_normals,
        grip=labels.grip,
    )


def read_subject(path: Path, max_memory: float = MeshOptions.max_memory) -> Subject:
    """Take a PLY that grasp3d has labelled, as it is: nothing is searched anew.

    The file names neither partners nor openings, and its angles have 32 bits.

    Args:
        path: The file.
        max_memory: What reading it may take [GB].

    Raises:
        MeshError: It is no such file, or damaged.
    """
    found = read_labelled(path, max_memory)
    told, model = found.settings, found.settings.model
    count, closed = len(found.vertices), is_closed(found.faces)
    weights, nominal, minimum, maximum = map(locked, (_weights(found), *found.epsilons))
    other = weights[
        found.label != label_angles(found.critical_angle, found.critical_angle_best, model)
    ].sum()
    _, size = surface_extent(found.vertices, found.faces)
    return Subject(
        name=path.name,
        vertices=locked(found.vertices),
        faces=locked(found.faces),
        corner_normals=_shading(found),
        normals=locked(found.normals),
        weights=weights,
        critical_angle=locked(found.critical_angle),
        critical_angle_best=locked(found.critical_angle_best),
        reason=locked(_reasons(found)),
        opening=locked(np.full(count, math.nan)),
        partners=None,
        epsilons=Epsilons(nominal, minimum, model, maximum),
        model=model,
        sampling=told.sampling,
        mode=told.mode,
        cone=math.pi if told.mode == "scan" else told.cone,
        unit=told.unit,
        size=size,
        closed=closed,
        options=told.options,
        notes=(*_file_notes(told.mode, closed=closed), *_method_notes(model, other)),
        labels=None,
    )


def _file_notes(mode: Mode, *, closed: bool) -> Iterator[str]:
    """What a labelled file does not hold."""
    if not closed:
        yield "the surface is open: inside and outside are taken from the winding of its faces"
    if mode == "scan":
        yield "it is a scan, and the file does not name the fixed fingers"


def _method_notes(model: GraspModel, other: float) -> tuple[str, ...]:
    """What else the labels may be than thresholds, and on what share of the area, where known."""
    if model.method == "exact":
        return ()
    note = (
        "its labels were made from the wrench hulls at extreme normals; those shown here are "
        "thresholds on the critical friction angle, which settle every normal"
    )
    if math.isfinite(other):
        note += f", and are others on {other:.1%} of the area"
    return (note,)


def _shading(found: LabelledFile) -> CornerNormals:
    """Normals at the corners of the faces; where the surface is smooth, those of the file."""
    made = corner_normals(found.vertices, found.faces, found.settings.options.crease_angle)
    alone = np.bincount(made.vertices, minlength=len(found.vertices))[made.vertices] == 1
    given = found.normals[made.vertices]
    taken = alone & (given != 0.0).any(axis=1)
    normals = np.where(taken[:, None], given, made.normals)
    return CornerNormals(locked(made.corners), locked(normals), locked(made.vertices))


def _weights(found: LabelledFile) -> Floats:
    """Share of the area that each vertex stands for, (V,)."""
    thirds = np.repeat(face_areas(found.vertices, found.faces) / 3.0, 3)
    areas = np.bincount(found.faces.ravel(), thirds, minlength=len(found.vertices))
    return np.asarray(areas / areas.sum(), dtype=np.float64)


def _reasons(found: LabelledFile) -> Bytes:
    """Why vertices have no grasp, as far as a file without reasons tells, (V,)."""
    missing = Reason.SAME_PLACE if found.settings.mode == "scan" else Reason.NO_PARTNER
    reasons = np.where(np.isinf(found.critical_angle_best), missing, Reason.FOUND)
    places = first_at_position(found.vertices)
    used = np.zeros(len(reasons), dtype=bool)
    used[places[found.faces]] = True
    return np.where(used[places], reasons, Reason.OFF_SURFACE).astype(np.uint8)
