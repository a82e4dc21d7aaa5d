"""Grasps of the vertices of a surface: one contact at the vertex, the others anywhere on it."""

import math
from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property
from typing import Any, Self

import numpy as np

from grasp3d._kernels.search import antipodal_candidates
from grasp3d.arrays import ArrayLike, Bools, Bytes, Floats, Ints, locked
from grasp3d.mesh import ObjectMesh
from grasp3d.mesh.surface_points import SurfacePoints
from grasp3d.settings import GraspModel, Sampling
from grasp3d.stability.label import Mode
from grasp3d.stability.normal_sets import WorstAndBest
from grasp3d.surface.contacts import SurfaceContacts, with_vertices
from grasp3d.surface.grasp_table import GraspRows, GraspTable


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


@dataclass(frozen=True, eq=False, kw_only=True)
class VertexGrasps(GraspRows):
    """The best grasp found at every vertex of a surface, or none.

    Arrays have one row per vertex of `mesh`; positions are in its unit and frame. Vertices at one
    position have the same grasp. `reach.poses` (V, 4, 4) are nan where there is no grasp.
    """

    reason: Bytes
    """`Reason` codes, shape (V,)."""
    sampling: Sampling | None
    """How grasps were searched for; None in a scan, where they are given."""
    mode: Mode
    search: SearchReport

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
        **others: Any,
    ) -> Self:
        """Labels of the grasps of a surface's vertices, those of one position being the same.

        Args:
            mesh: The surface.
            model: Friction and sensor resolution.
            angles: Critical angles (worst, best) [rad], shape (V,) each.
            partners: As the attribute.
            partner_points: As the attribute.
            grip: As the field; one number for all vertices or shape (V,).
            reason: `Reason` codes of the vertices on the surface, shape (V,).
            **others: Other fields by name: sampling, mode, search, scene, reach, load, known.
        """
        outside = np.where(mesh.on_surface, Reason.EXCLUDED, Reason.OFF_SURFACE)
        reasons = locked(np.where(mesh.allowed, reason, outside), np.uint8)
        first, found = mesh.canonical, reasons == Reason.FOUND
        none = ~found[:, None]
        points = SurfacePoints(
            np.where(none, -1, partner_points.faces[first]),
            np.where(none[..., None], 0.0, partner_points.weights[first]),
        )
        others_at = np.where(none[..., None], math.nan, partners[first])
        worst, best = (locked(np.where(found, one[first], math.inf)) for one in angles)
        return cls(
            contacts=SurfaceContacts(mesh, with_vertices(mesh, first, points)),
            model=model,
            critical_angle=worst,
            critical_angle_best=best,
            points=locked(np.concatenate([mesh.vertices[:, None], others_at], axis=1)),
            grip=locked(np.where(found, np.broadcast_to(grip, len(first))[first], 0), np.int8),
            reason=reasons,
            **others,
        )

    @property
    def same(self) -> Ints:
        """The first vertex at the same position, shape (V,)."""
        return self.mesh.canonical

    @property
    def has_grasp(self) -> Bools:
        """Whether each vertex has a grasp, shape (V,)."""
        return np.asarray(self.reason == Reason.FOUND)

    def take(self, rows: Ints) -> GraspTable:
        """The grasps of chosen vertices as a table, with what has been computed of them.

        Args:
            rows: Vertices that have a grasp, shape (c,).
        """
        return GraspTable(model=self.model, scene=self.scene, load=self.load, **self.rows(rows))

    @property
    def partners(self) -> Floats:
        """Opposing contacts of the vertex's best grasp, shape (V, n - 1, 3); nan: no grasp."""
        return self.positions[:, 1:]

    @cached_property
    def partner_normals(self) -> Floats:
        """Inward unit normals there, the middle of the set on creases, shape (V, n - 1, 3)."""
        return self.spread(self.distinct_contacts.normals[:, 1:], math.nan)

    @cached_property
    def partner_points(self) -> SurfacePoints:
        """Opposing contacts as surface points, shape (V, n - 1); face -1: no grasp."""
        points = self.contacts.surface_points
        return SurfacePoints(locked(points.faces[:, 1:]), locked(points.weights[:, 1:]))

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
