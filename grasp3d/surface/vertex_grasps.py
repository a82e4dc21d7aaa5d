"""Grasps of the vertices of a surface: one contact at the vertex, the others anywhere on it."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property
from typing import Any, ClassVar, Self

import numpy as np
import numpy.typing as npt

from grasp3d._kernels.search import antipodal_candidates
from grasp3d.arrays import ArrayLike, Bools, Bytes, Floats, Ints, locked, short_repr
from grasp3d.hand.reach import Reach
from grasp3d.hand.scene import Scene
from grasp3d.mesh import ObjectMesh
from grasp3d.mesh.surface_points import SurfacePoints
from grasp3d.quality.loads import Load
from grasp3d.quality.measures import ALL
from grasp3d.quality.tilting import EpsilonRange
from grasp3d.settings import GraspModel, Sampling
from grasp3d.stability.label import Label, Mode
from grasp3d.stability.normal_sets import WorstAndBest
from grasp3d.surface.contacts import SurfaceContacts, with_vertices
from grasp3d.surface.grasp_table import COMPUTED, GraspTable
from grasp3d.surface.labelled_grasps import LabelledGrasps
from grasp3d.surface.load_case import LoadCase
from grasp3d.surface.load_result import LoadResult
from grasp3d.surface.rows import NO_ROW, gathered, rows_of


class IndexedGrasps(LabelledGrasps):
    """Places, such as vertices or poses, that have a grasp each, or none.

    The grasps are the rows of a table; arrays have a row for each of the k places.
    """

    grasps: GraspTable
    row: Ints
    no_angle: ClassVar[float] = math.inf
    """Critical angle of places without a grasp."""

    @property
    def mesh(self) -> ObjectMesh:
        """The object."""
        return self.grasps.mesh

    @property
    def model(self) -> GraspModel:
        """Friction and sensor resolution, and the number of fingers."""
        return self.grasps.model

    @property
    def scene(self) -> Scene | None:
        """The gripper of the grasps, and what it must not touch; None: ideal points."""
        return self.grasps.scene

    @property
    def load(self) -> Load | None:
        """What each grasp must hold; None: `load_result` is not computed."""
        return self.grasps.load

    @property
    def load_case(self) -> LoadCase | None:
        """The load on this object, with its mass, task and force at hand; None: no load."""
        return self.grasps.load_case

    @cached_property
    def critical_angle(self) -> Floats:
        """Critical friction angle over the worst normals of the contacts [rad], shape (k,).

        inf at vertices without a grasp, nan at poses whose jaws do not close.
        """
        return self._gathered(self.grasps.critical_angle, self.no_angle)

    @cached_property
    def critical_angle_best(self) -> Floats:
        """The same over the best normals, shape (k,).

        Different at creases only.
        """
        return self._gathered(self.grasps.critical_angle_best, self.no_angle)

    @cached_property
    def critical_angle_bounds(self) -> WorstAndBest:
        """Critical angles (worst, best) with all that is not known about the contacts [rad].

        Shape (k,) each; see `GraspTable.critical_angle_bounds`.
        """
        if self.model.location_error == 0.0:
            return self.critical_angle, self.critical_angle_best
        worst, best = self.grasps.critical_angle_bounds
        return self._gathered(worst, self.no_angle), self._gathered(best, self.no_angle)

    @cached_property
    def label(self) -> Bytes:
        """`Label` codes by `model.method`: 0 U, 1 M, 2 S; shape (k,)."""
        return self._gathered(self.grasps.label, Label.U)

    @cached_property
    def epsilon_range(self) -> EpsilonRange:
        """`epsilon`, `epsilon_min` and `epsilon_max`, shape (k,); computed when first read."""
        epsilon = self.grasps.epsilon_range
        return EpsilonRange(
            self._gathered(epsilon.nominal, math.nan),
            self._gathered(epsilon.minimum, math.nan),
            self._gathered(epsilon.maximum, math.nan),
        )

    @cached_property
    def load_result(self) -> LoadResult | None:
        """Grip force and payload under the load, rows (k,); None: there is no load.

        Computed when first read; see `GraspTable.load_result`.
        """
        load_result = self.grasps.load_result
        return None if load_result is None else load_result.gathered(self.row)

    def metrics(self, names: str | Sequence[str] = ALL) -> dict[str, Floats]:
        """Quality measures of each place's grasp, shape (k,) each; computed when called.

        nan where there is no grasp, and where a measure is undefined; see `GraspTable.metrics`.

        Args:
            names: As in `quality.metrics`: 'all', or names in a list or separated by commas.

        Raises:
            SettingError: An unknown name.
        """
        values = self.grasps.metrics(names)
        return {name: self._gathered(column, math.nan) for name, column in values.items()}

    def computed(self, name: str) -> Any:
        """What has been computed already: `label`, `epsilon_range`, ...; None: it has not been.

        Args:
            name: An attribute that is computed when it is first read.
        """
        is_known = name in vars(self) or self.grasps.computed(name) is not None
        return getattr(self, name) if is_known else None

    def _gathered(self, values: npt.NDArray[Any], missing: float) -> npt.NDArray[Any]:
        """Values of the table's rows at each place, shape (k, ...)."""
        return gathered(values, self.row, missing)


class Reason(IntEnum):
    """Why a vertex has no grasp."""

    FOUND = antipodal_candidates.FOUND
    """It has a grasp."""
    NO_PARTNER = antipodal_candidates.NO_PARTNER
    """No opposing contact was found within the search cone."""
    OPENING = antipodal_candidates.OPENING
    """All opposing contacts were outside the limits of opening or distances."""
    OFF_SURFACE = 3
    """The vertex belongs to no face."""
    SAME_POINT = 4
    """A fixed finger is at the vertex."""
    NOT_REACHED = 5
    """It has grasps, but the gripper reached none of those that were tested."""
    EXCLUDED = 6
    """No contact may be there: it is outside the region."""


@dataclass(frozen=True)
class SearchReport:
    """Extent of the search for grasps."""

    cone: float
    """Largest critical friction angle that was searched for [rad]; for two fingers the half-angle
    of the cones about the inward normals that were searched."""
    rays: int = 0
    """Number of rays traced, for two fingers that expand."""
    evaluated: int = 0
    """Number of candidate grasps evaluated, for three fingers and more; for two fingers that
    squeeze, faces on which the best contact was computed."""


@dataclass(frozen=True, eq=False)
class VertexGrasps(IndexedGrasps):
    """The best grasp found at every vertex of a surface.

    Arrays have one row per vertex of `mesh`; positions are in its unit and frame.
    """

    grasps: GraspTable
    """The best grasps, a row for each position that has one."""
    row: Ints
    """Row of each vertex's grasp in that table, -1: none, shape (V,)."""
    reason: Bytes
    """`Reason` codes, shape (V,)."""
    sampling: Sampling | None
    """How grasps were searched for; None in a scan, where they are given."""
    mode: Mode
    search: SearchReport
    reach: Reach | None = None
    """How the gripper reaches the grasp of each vertex, a row for each; None: no gripper.

    `reach.poses` (V, 4, 4) in the mesh's frame, nan where there is no grasp;
    `reach.approach_margin` (V,) [rad]; and more.
    """

    @classmethod
    def of_vertices(
        cls,
        mesh: ObjectMesh,
        model: GraspModel,
        *,
        angles: WorstAndBest,
        partners: Floats,
        partner_points: SurfacePoints,
        grip: ArrayLike,
        reason: ArrayLike,
        reach: Reach | None = None,
        sampling: Sampling | None,
        mode: Mode,
        search: SearchReport,
        scene: Scene | None = None,
        load: Load | None = None,
    ) -> Self:
        """Labels of the grasps of a surface's vertices, those of one position being the same.

        Args:
            mesh: The surface.
            model: Friction and sensor resolution.
            angles: Critical angles (worst, best) [rad], shape (V,) each.
            partners: As the attribute.
            partner_points: As the attribute.
            grip: As the attribute; one number for all vertices or shape (V,).
            reason: `Reason` codes of the vertices on the surface, shape (V,).
            reach: As the field.
            sampling: As the field.
            mode: As the field.
            search: As the field.
            scene: The gripper that must reach each grasp, and the table; None: ideal points.
            load: What each grasp must hold; None: nothing.
        """
        count = len(mesh.vertices)
        outside = np.where(mesh.on_surface, Reason.EXCLUDED, Reason.OFF_SURFACE)
        reasons = locked(np.where(mesh.allowed, reason, outside), np.uint8)
        vertices = np.unique(mesh.canonical[reasons == Reason.FOUND])
        row = np.full(count, NO_ROW, dtype=np.int64)
        row[vertices] = np.arange(len(vertices))
        table = GraspTable(
            contacts=grasps_at(mesh, partner_points, vertices),
            model=model,
            critical_angle=locked(angles[0][vertices]),
            critical_angle_best=locked(angles[1][vertices]),
            points=locked(
                np.concatenate([mesh.vertices[vertices, None], partners[vertices]], axis=1)
            ),
            grip=locked(np.broadcast_to(grip, count)[vertices], np.int8),
            scene=scene,
            reach=None if reach is None else reach.take(vertices),
            load=load,
        )
        return cls(
            table, locked(row[mesh.canonical]), reasons, sampling=sampling, mode=mode,
            search=search, reach=reach,
        )  # fmt: skip

    __repr__ = short_repr

    @classmethod
    def of_values(
        cls, mesh: ObjectMesh, model: GraspModel, values: Mapping[str, Any], **settings: Any
    ) -> Self:
        """Labels whose values are known, from a file, instead of computed.

        What the file does not contain is computed when it is read.

        Args:
            mesh: The surface.
            model: As in `of_vertices`.
            values: Attributes by name, with a row for each vertex: those of which `of_vertices`
                has arguments, `critical_angle` and `critical_angle_best` [rad], and others such as
                `label`, `critical_angle_bounds`, `epsilon_range` or `load_result`; None: unknown.
            **settings: As in `of_vertices`: sampling, mode, search, scene and load.
        """
        worst, best = values["critical_angle"], values["critical_angle_best"]
        labels = cls.of_vertices(
            mesh, model, angles=(worst, best), partners=values["partners"],
            partner_points=values["partner_points"], grip=values["grip"],
            reason=values["reason"], reach=values.get("reach"), **settings,
        )  # fmt: skip
        fields = {name: one for name, one in values.items() if one is not None}
        vars(labels).update(fields)
        vars(labels.grasps).update(
            {name: rows_of(fields[name], labels.vertices) for name in COMPUTED.intersection(fields)}
        )
        return labels

    @cached_property
    def vertices(self) -> Ints:
        """The first vertex of each position that has a grasp: those of the table's rows."""
        own = self.mesh.canonical == np.arange(len(self.row))
        return locked(np.flatnonzero(own & (self.row != NO_ROW)))

    @cached_property
    def partners(self) -> Floats:
        """Opposing contacts of the vertex's best grasp, shape (V, n - 1, 3); nan: no grasp."""
        return self._gathered(self.grasps.positions[:, 1:], math.nan)

    @cached_property
    def partner_normals(self) -> Floats:
        """Inward unit normals there, the middle of the set on creases, shape (V, n - 1, 3)."""
        return self._gathered(self.grasps.contacts.normals[:, 1:], math.nan)

    @cached_property
    def partner_points(self) -> SurfacePoints:
        """Opposing contacts as surface points, shape (V, n - 1); face -1: no grasp."""
        points = self.grasps.contacts.surface_points
        return SurfacePoints(
            self._gathered(points.faces[:, 1:], -1), self._gathered(points.weights[:, 1:], 0.0)
        )

    @cached_property
    def opening(self) -> Floats:
        """Largest distance between any two contacts, shape (V,); nan: no grasp."""
        return self._gathered(self.grasps.opening, math.nan)

    @cached_property
    def grip(self) -> npt.NDArray[np.int8]:
        """Two fingers: +1 for an external grasp, -1 for an internal one, shape (V,).

        0 where there is no grasp, and for three fingers and more.
        """
        assert self.grasps.grip is not None
        return self._gathered(self.grasps.grip, 0)

    @cached_property
    def reachable(self) -> Bools | None:
        """Whether the gripper reaches the grasp of each vertex, shape (V,); None: no gripper."""
        return None if self.reach is None else locked(self.reach.reached)

    @cached_property
    def approach(self) -> Floats | None:
        """Direction from which the gripper comes, the z axis of its pose, shape (V, 3).

        nan where it reaches no grasp; None: no gripper.
        """
        return None if self.reach is None else locked(self.reach.poses[:, :3, 2])

    @cached_property
    def approach_margin(self) -> Floats | None:
        """Angle by which the approach may turn either way about the closing axis [rad], shape (V,).

        nan where the gripper reaches no grasp; None: no gripper.
        """
        return None if self.reach is None else self.reach.approach_margin


def grasps_at(mesh: ObjectMesh, partner_points: SurfacePoints, vertices: Ints) -> SurfaceContacts:
    """The grasps of chosen vertices as contacts on the surface.

    Args:
        mesh: The surface.
        partner_points: Opposing contacts of every vertex's grasp, shape (V, n - 1).
        vertices: Chosen vertices, shape (b,), which have a grasp.

    Returns:
        The grasps (b, n), the contacts at the vertices first.
    """
    points = SurfacePoints(partner_points.faces[vertices], partner_points.weights[vertices])
    return SurfaceContacts(mesh, with_vertices(mesh, vertices, points))
