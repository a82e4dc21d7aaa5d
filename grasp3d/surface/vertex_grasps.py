"""The best grasp of every vertex: one contact at the vertex, the others anywhere on the surface."""

import math
from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property

import numpy as np
import numpy.typing as npt

from grasp3d._kernels import antipodal_candidates
from grasp3d.arrays import ArrayLike, Bools, Bytes, Floats, Ints, locked, short_repr
from grasp3d.hand.reach import Reach
from grasp3d.mesh import ObjectMesh
from grasp3d.mesh.surface_points import SurfacePoints
from grasp3d.settings import GraspModel
from grasp3d.stability.located_angles import ContactLimits, PairLines, located_pairs
from grasp3d.stability.sampled_normals import WorstAndBest
from grasp3d.surface.contacts import SurfaceContacts, vertex_surface_points
from grasp3d.surface.located_angles import lines_of_pairs, located_angles_of


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


@dataclass(frozen=True, eq=False)
class VertexGrasps:
    """The best grasp of every vertex of a surface, as plain arrays; see `SurfaceLabels`."""

    mesh: ObjectMesh
    critical_angle: Floats
    """Critical friction angle over the worst normals of the contacts [rad]; inf: no grasp. (V,)"""
    critical_angle_best: Floats
    """The same over the best normals. (V,)

    Different at creases, and where locations are uncertain: there it is that of the best aligned
    grasp, which may have less margin than that of `critical_angle`."""
    partners: Floats
    """Opposing contacts of the vertex's best grasp; nan where there is none. (V, n - 1, 3)"""
    partner_normals: Floats
    """Inward unit normals there, the middle of the set on creases. (V, n - 1, 3)"""
    partner_points: SurfacePoints
    """Opposing contacts as surface points, shape (V, 2, n - 1): of the best grasp over the worst
    normals, which are `partners`, and of the best grasp over the best normals."""
    opening: Floats
    """Largest distance between any two contacts. (V,)"""
    grip: npt.NDArray[np.int8]
    """Two fingers: +1 for an external grasp, -1 for an internal one. 0: no grasp, and grasps of
    three fingers and more. (V,)"""
    reason: Bytes
    """`Reason` codes. (V,)"""
    reach: Reach | None = None
    """How the gripper reaches the grasp of each vertex, a row for each; None: no gripper."""

    __repr__ = short_repr

    @classmethod
    def of(
        cls,
        mesh: ObjectMesh,
        *,
        angles: tuple[Floats, Floats],
        partners: Floats,
        partner_normals: Floats,
        partner_points: SurfacePoints,
        grip: ArrayLike,
        reason: ArrayLike,
        opening: Floats | None = None,
        reach: Reach | None = None,
    ) -> "VertexGrasps":
        """Copy the arrays; vertices off the surface get `Reason.OFF_SURFACE`.

        Args:
            mesh: The surface.
            angles: `critical_angle` and `critical_angle_best`.
            partners: As the field.
            partner_normals: As the field.
            partner_points: As the field.
            grip: As the field; one number for all vertices or shape (V,).
            reason: `Reason` codes of the vertices on the surface, shape (V,).
            opening: As the field; None: computed from the partners.
            reach: As the field.
        """
        count = len(mesh.vertices)
        if opening is None:
            opening = largest_distance(mesh.vertices, partners)
        return cls(
            mesh=mesh,
            critical_angle=locked(angles[0]),
            critical_angle_best=locked(angles[1]),
            partners=locked(partners),
            partner_normals=locked(partner_normals),
            partner_points=SurfacePoints(
                locked(partner_points.faces), locked(partner_points.weights)
            ),
            opening=locked(opening),
            grip=locked(np.broadcast_to(grip, count), np.int8),
            reason=locked(np.where(mesh.on_surface, reason, Reason.OFF_SURFACE), np.uint8),
            reach=reach,
        )

    def located_angles(self, model: GraspModel, *, threads: int | None = None) -> WorstAndBest:
        """Critical angles with all that a model does not know about the contacts, shape (V,) each.

        See `stability.located_angles`; `critical_angle` and `critical_angle_best` where contact
        locations are known and fingers are alike. Two contacts take a closed form.

        Args:
            model: The model, with lengths in the mesh's unit.
            threads: Threads; None: one per processor.
        """
        if model.is_uniform:
            return self.critical_angle, self.critical_angle_best
        angles, limits = (
            (self.critical_angle, self.critical_angle_best),
            ContactLimits.of(model.fingertips),
        )
        if model.fingers == 2:
            worst, best = located_pairs(*angles, self._pair_lines, limits)
            return locked(worst), locked(best)
        # Other frictions and resolutions have the same angles, which take many closure tests.
        if limits.key not in self._located:
            self._located.clear()
            self._located[limits.key] = self._of_many(model, threads)
        return self._located[limits.key]

    @cached_property
    def _located(self) -> dict[bytes, WorstAndBest]:
        """The last located angles of three contacts and more, by what is known about contacts."""
        return {}

    def _of_many(self, model: GraspModel, threads: int | None) -> WorstAndBest:
        """Located angles of three contacts and more, shape (V,) each."""
        angles, vertices = (self.critical_angle, self.critical_angle_best), self.vertices
        found = np.full((2, len(self.critical_angle)), math.inf)
        contacts = grasps_at(self.mesh, self.partner_points, vertices, 0)
        chosen = angles[0][vertices], angles[1][vertices]
        found[:, vertices] = located_angles_of(contacts, chosen, model, threads=threads)
        worst, best = found[:, self.mesh.canonical]
        return locked(worst), locked(best)

    @cached_property
    def _pair_lines(self) -> PairLines:
        """Lines of the grasps of two contacts, a row for each vertex (V,)."""
        vertices, canonical = self.vertices, self.mesh.canonical
        rows = np.full(len(canonical), 0)
        rows[vertices] = np.arange(len(vertices))
        if not len(vertices):
            return PairLines.none(len(canonical))
        worst, best = (
            lines_of_pairs(grasps_at(self.mesh, self.partner_points, vertices, number))
            for number in range(2)
        )
        return worst.with_best(best).at(rows[canonical])

    @property
    def vertices(self) -> Ints:
        """Canonical vertices, one for each position, that have a grasp."""
        return np.unique(self.mesh.canonical[self.reason == Reason.FOUND])


def grasps_at(
    mesh: ObjectMesh, partner_points: SurfacePoints, vertices: Ints, number: int
) -> SurfaceContacts:
    """The grasps of chosen vertices as contacts on the surface.

    Args:
        mesh: The surface.
        partner_points: Opposing contacts of every vertex's two grasps, shape (V, 2, n - 1).
        vertices: Chosen vertices, shape (b,), which have both grasps.
        number: 0: the best grasp over the worst normals; 1: over the best normals.

    Returns:
        The grasps (b, n), the contacts at the vertices first.
    """
    first = vertex_surface_points(mesh, vertices)
    faces, weights = (
        partner_points.faces[vertices, number],
        partner_points.weights[vertices, number],
    )
    return SurfaceContacts(
        mesh,
        SurfacePoints(
            np.concatenate([first.faces[:, None], faces], axis=1),
            np.concatenate([first.weights[:, None], weights], axis=1),
        ),
    )


def grasps_differ(partner_points: SurfacePoints, vertices: Ints) -> Bools:
    """Whether the best grasps over the best and over the worst normals differ, shape (b,)."""
    faces, weights = partner_points.faces[vertices], partner_points.weights[vertices]
    same = (faces[:, 0] == faces[:, 1]) & (weights[:, 0] == weights[:, 1]).all(axis=-1)
    return np.asarray(~same.all(axis=-1))


def largest_distance(vertices: Floats, partners: Floats) -> Floats:
    """Largest distance between any two contacts of vertices' grasps.

    Args:
        vertices: The first contacts, shape (V, 3).
        partners: The others, shape (V, n - 1, 3); nan where there is no grasp.

    Returns:
        Shape (V,), in the unit of the positions.
    """
    points = np.concatenate([vertices[:, None], partners], axis=1)
    first, second = np.triu_indices(points.shape[1], 1)
    return np.asarray(np.linalg.norm(points[:, second] - points[:, first], axis=2).max(axis=1))
