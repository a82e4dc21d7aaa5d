"""The viewed surface, and the best grasp of each of its vertices as far as it is known."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from grasp3d.arrays import Floats, locked, short_repr
from grasp3d.export.read_labels import labels_of, read_stored
from grasp3d.export.read_settings import FileSettings
from grasp3d.export.stored import Stored
from grasp3d.mesh import ObjectMesh
from grasp3d.mesh.ray_tracing import FaceRays
from grasp3d.settings import GraspModel, MeshOptions, search_cone
from grasp3d.settings.lengths import Unit
from grasp3d.stability.located_angles import ContactLimits
from grasp3d.stability.normal_sets import WorstAndBest
from grasp3d.stability.thresholds import label_angles
from grasp3d.surface.area_statistics import vertex_weights
from grasp3d.surface.contacts import GraspContacts
from grasp3d.surface.grasp_numbers import located_angles_of
from grasp3d.surface.grasp_table import GraspTable
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.viewer.subjects.forces import Forces, LoadNumbers
from grasp3d.viewer.subjects.gripper_pose import GripperPose

PAIR = 2

KEPT = 4
"""Sets of located angles that are kept: those of two panes, before and after a change."""


@dataclass(frozen=True, eq=False)
class LastContact:
    """The best contact found for the last finger when the others are fixed."""

    points: Floats
    """The contact and the fixed contacts, shape (n, 3)."""
    normals: Floats
    """Inward unit normals there, (n, 3)."""
    worst: float
    """Smallest critical friction angle over the worst normals of the contacts [rad]; inf: none."""
    best: float
    """The same over the best normals, possibly of another contact."""
    between: bool
    """Whether the contact is between vertices, which are the only points with a colour."""
    creases: tuple[int, ...] = ()
    """Indices of the fingers that are on sharp edges (creases), from 0."""
    held: GripperPose | None = None
    """Pose of a gripper, if it reaches the grasp."""
    grasp: GraspContacts | None = None
    """The contacts on the surface, (1, n); None: unknown."""

    __repr__ = short_repr

    def angles(self, model: GraspModel) -> tuple[float, float]:
        """Angles that decide its label for a model, over the worst and the best normals [rad]."""
        if self.grasp is None:
            return self.worst, self.best
        return located_grasp(self.grasp, self.worst, self.best, model)


@dataclass(frozen=True, eq=False)
class Alternatives:
    """Other grasps through one vertex that the gripper reaches, besides the vertex's own."""

    vertex: int
    grasps: GraspTable
    """Best first."""

    __repr__ = short_repr


@dataclass(frozen=True, eq=False)
class Subject:
    """Labels that are viewed, computed or from a file, with what was computed of them since."""

    labels: SurfaceLabels
    name: str
    notes: tuple[str, ...] = ()
    """Warnings that concern the labels, one sentence each."""
    epsilons: SurfaceLabels | None = None
    """The same grasps at the model for which epsilon was computed; None: not computed yet."""
    load_numbers: LoadNumbers | None = None
    """Mass and force at hand of the load; None: no load."""
    forces: Forces | None = None
    """Grip force and payload; None: no load, or not computed yet."""
    last_contact: LastContact | None = None
    """With fixed fingers: the best contact found for the last one; None: unknown."""
    alternatives: Alternatives | None = None
    """Other grasps of the vertex that was inspected last; None: not searched."""
    located: Mapping[object, WorstAndBest] = field(default_factory=dict)
    """Located angles that took a computation, by what they depend on; see `dependence`."""
    _recent: dict[object, WorstAndBest] = field(init=False, repr=False, default_factory=dict)
    """Located angles that were needed last, likewise."""

    __repr__ = short_repr

    @property
    def mesh(self) -> ObjectMesh:
        """The surface of the labels."""
        return self.labels.mesh

    @property
    def prepared(self) -> bool:
        """Whether the mesh and the contacts are known, for new searches: a PLY has not enough."""
        return self.labels.grasps.known_contacts is not None

    @property
    def cone(self) -> float:
        """Largest critical friction angle that was searched [rad]."""
        return math.pi if self.labels.mode == "scan" else self.labels.search.cone

    @cached_property
    def weights(self) -> Floats:
        """Area fraction that belongs to each vertex, (V,)."""
        return locked(vertex_weights(self.mesh, "area"))

    @cached_property
    def rays(self) -> FaceRays:
        """Ray tracer of the faces, for clicks; in the frame of `normalized`."""
        return FaceRays(self.normalized(self.mesh.vertices), self.mesh.faces)

    @cached_property
    def bounds(self) -> Floats:
        """Lowest and highest corner of the bounding box of the faces, shape (2, 3)."""
        points = self.mesh.vertices[np.unique(self.mesh.faces)]
        return locked(np.stack([points.min(axis=0), points.max(axis=0)]))

    @cached_property
    def center(self) -> Floats:
        """Centre of the bounding box, shape (3,)."""
        return locked(self.bounds.mean(axis=0))

    def normalized(self, points: Floats) -> Floats:
        """Transform points (..., 3) to a frame in which the surface is centred and of size 1."""
        return (points - self.center) / self.mesh.size

    def angles(self, model: GraspModel) -> tuple[Floats, Floats]:
        """Critical angles that decide the labels for a model, over the worst and best normals.

        Located angles where contact locations are uncertain or fingers differ, else
        `critical_angle` and `critical_angle_best`; these also where the former are not known.

        Args:
            model: Friction and errors; fingers as the subject has them.

        Returns:
            Shape (V,) each [rad].
        """
        if model.is_uniform or not self.locates(model):
            return self.labels.critical_angle, self.labels.critical_angle_best
        key = dependence(model)
        if key in self.located:
            return self.located[key]
        if key not in self._recent:
            if len(self._recent) >= KEPT:
                self._recent.pop(next(iter(self._recent)))
            of_labels = key == dependence(self.labels.model)
            self._recent[key] = (
                self.labels.located_angles if of_labels else located_angles(self.labels, model)
            )
        return self._recent[key]

    def locates(self, model: GraspModel) -> bool:
        """Whether the angles that decide the labels for a model are known, or quickly computed.

        Those of the labels' own model are, as the labels follow from them. Those of three fingers
        and more for another one take too long for a move of a slider.
        """
        key = dependence(model)
        if model.is_uniform or key == dependence(self.labels.model) or key in self.located:
            return True
        return self.prepared and model.fingers == PAIR and fits(model)

    @property
    def measurable(self) -> bool:
        """Whether the grasps are known or can be searched; false for a file of a scan."""
        return self.prepared or self.labels.mode == "label"

    def covers(self, model: GraspModel) -> bool:
        """Whether the search went far enough for a model."""
        needed, searched = search_cone(model), search_cone(self.labels.model)
        return needed <= max(self.cone, searched) + 1e-9  # rounding


def subject_of(labels: SurfaceLabels, name: str | None = None) -> Subject:
    """The subject of labels; epsilon and forces only if they were computed already.

    Args:
        labels: The labels.
        name: Name of the object; None: that of its file.
    """
    report = labels.mesh.report
    case, holding = labels.load_case, labels.computed("holding")
    return Subject(
        labels,
        report.source if name is None else name,
        notes=(*labels.warnings, *_method_notes(labels.model, math.nan)),
        epsilons=None if labels.computed("epsilon_range") is None else labels,
        load_numbers=None if case is None else LoadNumbers.of(case),
        forces=None if holding is None else Forces.of(holding, labels.model),
    )


def read_subject(
    path: Path,
    max_memory: float = MeshOptions.max_memory,
    *,
    unit: Unit | None = None,
    name: str | None = None,
) -> Subject:
    """Read a labelled file without searching anything again.

    Args:
        path: The file.
        max_memory: Memory limit for reading [GB].
        unit: Unit of a file that states none.
        name: Name of the object; None: that of the file.

    Raises:
        MeshError: The file is not labelled, or damaged.
    """
    stored, settings = read_stored(path, max_memory)
    labels = labels_of(stored, settings, unit)
    subject, model = subject_of(labels, name or path.name), labels.model
    notes = [*labels.warnings]
    if not subject.prepared and labels.mode == "scan":
        notes.append("it is a scan, and the file does not contain the fixed fingers")
    differing = labels.label != label_angles(*labels.located_angles, model)
    notes += _method_notes(model, subject.weights[differing].sum())
    subject = replace(subject, notes=tuple(notes))
    if labels.load is not None or subject.prepared or "object_mass" not in stored.settings:
        return subject
    return _with_forces(subject, stored, settings)


def _with_forces(subject: Subject, stored: Stored, settings: FileSettings) -> Subject:
    """The subject with the forces of a PLY whose task cannot be read again."""
    mass, force = settings.object_mass, settings.force_at_hand
    payload = stored.values.get("payload")
    payloads = np.full(len(subject.weights), math.nan) if payload is None else payload
    return replace(
        subject,
        load_numbers=LoadNumbers(mass, force, by_mass=force is None or payload is not None),
        forces=Forces(
            locked(stored.field("grip_force"), np.float64),
            locked(stored.field("grip_force_least"), np.float64),
            locked(stored.field("grip_force_largest"), np.float64),
            locked(payloads, np.float64),
            subject.labels.model,
        ),
    )


def _method_notes(model: GraspModel, other: float) -> tuple[str, ...]:
    """Note on labels that are not thresholds, with the area fraction that differs if known."""
    if model.method == "exact":
        return ()
    note = (
        "its labels were computed from wrench hulls at extreme normals; the displayed ones are "
        "thresholds on the critical friction angle, which hold for every normal"
    )
    if math.isfinite(other):
        note += f", and differ on {other:.1%} of the area"
    return (note,)


def located_angles(labels: SurfaceLabels, model: GraspModel) -> WorstAndBest:
    """Located angles of labels for another model, see `stability.located_angles`, (V,) each [rad].

    Raises:
        SettingError: The model is for another number of fingers.
    """
    worst, best = labels.using(model=model).located_angles
    # A file has no second grasp, of the best normals at a crease, whose line could be turned:
    # what the worst finger adds to its angle is a bound.
    bound = labels.critical_angle_best + ContactLimits.of(model.fingertips).outer.max()
    return worst, locked(np.minimum(best, bound))


def dependence(model: GraspModel) -> object:
    """What located angles depend on: of equal fingers the location error alone.

    The thresholds that they are compared with have all that the fingers have in common.
    """
    return model if model.per_finger else model.location_error


def fits(model: GraspModel) -> bool:
    """Whether the values of single fingers are for the model's number of fingers."""
    return not model.per_finger or len(model.per_finger) == model.fingers


def located_grasp(
    grasp: GraspContacts, worst: float, best: float, model: GraspModel
) -> tuple[float, float]:
    """Angles that decide the label of one grasp, over the worst and the best normals [rad].

    Args:
        grasp: The grasp, shape (1, n).
        worst: Its critical angle over the worst normals [rad].
        best: The same over the best normals.
        model: Grasp model, with lengths in the mesh's unit.
    """
    model = replace(model, fingers=grasp.count)
    if model.is_uniform or not fits(model):
        return float(worst), float(best)
    angles = np.array([worst]), np.array([best])
    angles = located_angles_of(grasp, angles, model)
    return float(angles[0][0]), float(angles[1][0])
