"""The viewed surface, and the best grasp of each of its vertices as far as it is known."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np
import numpy.typing as npt

from grasp3d.arrays import Bytes, Floats, Ints, first_at_position, locked, short_repr
from grasp3d.hand.reach import Reach
from grasp3d.hand.scene import Scene
from grasp3d.loads import Load
from grasp3d.mesh.measures import face_areas, is_closed, surface_extent
from grasp3d.mesh.normals import CornerNormals, corner_normals
from grasp3d.mesh.ray_tracing import FaceRays
from grasp3d.mesh.triangles import Triangles
from grasp3d.settings import AnySampling, GraspModel, MeshOptions, search_cone
from grasp3d.settings.lengths import Unit
from grasp3d.stability.label import Mode
from grasp3d.stability.thresholds import label_angles
from grasp3d.surface.area_statistics import vertex_weights
from grasp3d.surface.contacts import SurfaceContacts
from grasp3d.surface.grasp_table import GraspTable
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.surface.vertex_grasps import Reason
from grasp3d.viewer.subjects.forces import Forces, LoadNumbers
from grasp3d.viewer.subjects.gripper_pose import GripperPose
from grasp3d.viewer.subjects.labelled_file import LabelledFile, read_labelled
from grasp3d.viewer.subjects.located import PAIR, Located, dependence, fits

KEPT = 4
"""Sets of located angles that are kept: those of two panes, before and after a change."""


@dataclass(frozen=True, eq=False)
class Epsilons:
    """Epsilon of every vertex's grasp, for one friction and resolution."""

    nominal: Floats
    """At the perceived normals; nan: no grasp. (V,)"""
    minimum: Floats
    """Smallest over the tilts. (V,)"""
    model: GraspModel
    """Model for which epsilon was computed."""
    maximum: Floats | None = None
    """Largest over the tilts. (V,)"""

    __repr__ = short_repr


@dataclass(frozen=True, eq=False)
class LastContact:
    """The best contact found for the last finger when the others are fixed."""

    points: Floats
    """The contact and the fixed ones, shape (n, 3)."""
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
    grasp: SurfaceContacts | None = None
    """The contacts on the surface, (1, n); None: unknown."""

    __repr__ = short_repr


@dataclass(frozen=True, eq=False)
class Alternatives:
    """Other grasps through one vertex that the gripper reaches, besides the vertex's own."""

    vertex: int
    grasps: GraspTable
    """Best first."""

    __repr__ = short_repr


@dataclass(frozen=True, eq=False)
class Subject:
    """A labelled surface, from labels in memory or from a file.

    Positions are in the mesh's own unit and frame, normals point into the object.
    """

    name: str
    vertices: Floats
    """Shape (V, 3)."""
    faces: Ints
    """Shape (F, 3), counter-clockwise from outside."""
    corner_normals: CornerNormals
    """Normals of the faces at their corners; they differ across creases."""
    normals: Floats
    """Inward unit normal of each vertex, (V, 3)."""
    weights: Floats
    """Area fraction that belongs to each vertex, (V,)."""
    critical_angle: Floats
    """Over the worst normals of the contacts [rad]; inf: no grasp. (V,)"""
    critical_angle_best: Floats
    """Over the best normals [rad]. (V,)"""
    reason: Bytes
    """Codes of `labels.Reason`. (V,)"""
    opening: Floats
    """Largest distance between two contacts; nan: no grasp. (V,)"""
    partners: Floats | None
    """The other contacts, (V, n - 1, 3); None: the file does not contain them."""
    epsilons: Epsilons | None
    """None: not computed yet."""
    model: GraspModel
    """Model of the search."""
    sampling: AnySampling | None
    """Settings of the search; None: a scan."""
    mode: Mode
    cone: float
    """Largest critical friction angle that was searched [rad]."""
    unit: Unit | None
    size: float
    """Diameter of the surface's bounding sphere."""
    closed: bool
    options: MeshOptions
    notes: tuple[str, ...]
    """Warnings that concern the labels, one sentence each."""
    labels: SurfaceLabels | None
    """Labels with the mesh, for new searches; None: from a file whose mesh is not prepared yet."""
    partner_normals: Floats | None = None
    """Inward unit normals at the partners, (V, n - 1, 3)."""
    grip: npt.NDArray[np.int8] | None = None
    """Two fingers: grip codes as in `SurfaceLabels`. (V,)"""
    last_contact: LastContact | None = None
    """With fixed fingers: the best contact found for the last one; None: unknown."""
    scene: Scene | None = None
    """The gripper that must reach each grasp, and the table; None: ideal points."""
    reach: Reach | None = None
    """How it reaches the grasp of each vertex, a row for each; None: no gripper, or the file does
    not contain it."""
    approach_margin: Floats | None = None
    """Half-width of the free approach angles at each vertex [rad]; nan: not reached; None: no
    gripper. (V,)"""
    unreached: Bytes | None = None
    """`Reachability` codes of the grasps, the reason where none is reached, (V,); None: unknown."""
    load: Load | None = None
    """What each grasp must hold; None: no load, or a file whose task cannot be read again."""
    load_numbers: LoadNumbers | None = None
    """Its mass and force at hand; None: no load."""
    forces: Forces | None = None
    """Grip force and payload; None: no load, or not computed yet."""
    alternatives: Alternatives | None = None
    """Other grasps of the vertex that was inspected last; None: not searched."""
    located: Located | None = None
    """Located angles in its file, or that took a computation; None: none."""
    _known: dict[object, Located] = field(init=False, repr=False, default_factory=dict)
    """Located angles that were computed last, by what they depend on."""

    __repr__ = short_repr

    @cached_property
    def rays(self) -> FaceRays:
        """Ray tracer of the faces, for clicks; in the frame of `normalized`."""
        return FaceRays(self.normalized(self.vertices), self.faces)

    @cached_property
    def bounds(self) -> Floats:
        """Lowest and highest corner of the bounding box of the faces, shape (2, 3)."""
        used = self.vertices[np.unique(self.faces)]
        return locked(np.stack([used.min(axis=0), used.max(axis=0)]))

    @cached_property
    def center(self) -> Floats:
        """Centre of the bounding box, shape (3,)."""
        return locked(self.bounds.mean(axis=0))

    def normalized(self, points: Floats) -> Floats:
        """Transform points (..., 3) to a frame in which the surface is centred and of size 1."""
        return (points - self.center) / self.size

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
            return self.critical_angle, self.critical_angle_best
        known, key = self._known, dependence(model)
        if key not in known:
            if len(known) >= KEPT:
                known.pop(next(iter(known)))
            same = self.located is not None and self.located.key == key
            known[key] = self.located if same and self.located else Located.of(self.labels, model)
        return known[key].worst, known[key].best

    def locates(self, model: GraspModel) -> bool:
        """Whether the angles that decide the labels for a model are known, or quickly computed.

        Those of three fingers and more take too long for a move of a slider.
        """
        if model.is_uniform or (self.located is not None and self.located.key == dependence(model)):
            return True
        return self.labels is not None and model.fingers == PAIR and fits(model)

    @property
    def measurable(self) -> bool:
        """Whether the grasps are known or can be searched; false for a file of a scan."""
        return self.labels is not None or self.partners is not None or self.mode == "label"

    def covers(self, model: GraspModel) -> bool:
        """Whether the search went far enough for a model."""
        needed, searched = search_cone(model), search_cone(self.model)
        return needed <= max(self.cone, searched) + 1e-9  # rounding


def subject_of(labels: SurfaceLabels, name: str | None = None) -> Subject:
    """The surface of labels; epsilon only if it was computed already.

    Args:
        labels: The labels.
        name: Name of the object; None: that of its file.
    """
    mesh, reach = labels.mesh, labels.reach
    known, epsilons = labels.computed("epsilon_range"), None
    if known is not None:
        epsilons = Epsilons(known.nominal, known.minimum, labels.model, known.maximum)
    case, held = labels.load_case, labels.computed("holding")
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
        epsilons=epsilons,
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
        scene=labels.scene,
        reach=reach,
        approach_margin=None if reach is None else reach.approach_margin,
        unreached=None if reach is None else reach.state,
        load=labels.load,
        load_numbers=None if case is None else LoadNumbers.of(case),
        forces=None if held is None else Forces.of(held, labels.model),
    )


def read_subject(path: Path, max_memory: float = MeshOptions.max_memory) -> Subject:
    """Read a labelled PLY without searching anything again.

    The file contains neither partners nor openings, and its angles have 32 bits.

    Args:
        path: The file.
        max_memory: Memory limit for reading [GB].

    Raises:
        MeshError: The file is not a labelled PLY, or damaged.
    """
    found = read_labelled(path, max_memory)
    stored, model = found.settings, found.settings.model
    count, closed = len(found.vertices), is_closed(found.faces)
    weights, nominal, minimum, maximum = map(locked, (_weights(found), *found.epsilons))
    other = weights[found.label != label_angles(*found.deciding_angles, model)].sum()
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
        sampling=stored.sampling,
        mode=stored.mode,
        cone=math.pi if stored.mode == "scan" else stored.cone,
        unit=stored.unit,
        size=size,
        closed=closed,
        options=stored.options,
        notes=(*_file_notes(stored.mode, closed=closed), *_method_notes(model, other)),
        labels=None,
        scene=stored.scene,
        approach_margin=locked(found.approach_margin) if stored.scene else None,
        load=stored.load,
        load_numbers=stored.load_numbers,
        forces=None if stored.load_numbers is None else _forces(found),
        located=None if found.located is None else Located(*found.located, dependence(model)),
    )


def _forces(found: LabelledFile) -> Forces:
    grip_force, least, largest, payload = map(locked, found.forces)
    return Forces(grip_force, least, largest, payload, found.settings.model)


def _file_notes(mode: Mode, *, closed: bool) -> Iterator[str]:
    """Notes on what a labelled file does not contain."""
    if not closed:
        yield "the surface is open: inside and outside are taken from the winding of its faces"
    if mode == "scan":
        yield "it is a scan, and the file does not contain the fixed fingers"


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


def _shading(found: LabelledFile) -> CornerNormals:
    """Normals at the corners of the faces; on smooth parts those of the file."""
    computed = corner_normals(
        Triangles(found.vertices, found.faces), found.settings.options.crease_angle
    )
    corners = np.bincount(computed.vertices, minlength=len(found.vertices))[computed.vertices]
    stored = found.normals[computed.vertices]
    smooth = (corners == 1) & (stored != 0.0).any(axis=1)
    normals = np.where(smooth[:, None], stored, computed.normals)
    return CornerNormals(locked(computed.corners), locked(normals), locked(computed.vertices))


def _weights(found: LabelledFile) -> Floats:
    """Area fraction that belongs to each vertex, (V,)."""
    thirds = np.repeat(face_areas(found.vertices, found.faces) / 3.0, 3)
    areas = np.bincount(found.faces.ravel(), thirds, minlength=len(found.vertices))
    return np.asarray(areas / areas.sum(), dtype=np.float64)


def _reasons(found: LabelledFile) -> Bytes:
    """Why vertices have no grasp, as far as a file without reasons shows, (V,)."""
    missing = Reason.SAME_POINT if found.settings.mode == "scan" else Reason.NO_PARTNER
    reasons = np.where(np.isinf(found.critical_angle_best), missing, Reason.FOUND)
    canonical = first_at_position(found.vertices)
    used = np.zeros(len(reasons), dtype=bool)
    used[canonical[found.faces]] = True
    return np.where(used[canonical], reasons, Reason.OFF_SURFACE).astype(np.uint8)
