"""Contacts of grasps (on a surface, in a file, of closed jaws), their normals and angles.

On a crease or at a corner a contact may have any normal between those of the faces, so a grasp has
two critical friction angles. The one over the worst normals decides S, the one over the best
normals decides U.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from grasp3d._kernels.surface.surface_contacts import (
    HEMISPHERE,
    ContactNormals,
    write_normals_of_all,
)
from grasp3d.arrays import (
    RIGHT_ANGLE,
    ArrayLike,
    Bools,
    Floats,
    Ints,
    locked,
    short_repr,
    unit_rows,
)  # fmt: skip
from grasp3d.contact.contacts import Contacts
from grasp3d.hand.closing import ClosedJaws
from grasp3d.mesh import ObjectMesh
from grasp3d.mesh.surface_points import SurfacePoints
from grasp3d.mesh.turns import normal_turns, turns_beside
from grasp3d.quality.critical_angle import check_tolerance
from grasp3d.settings import GraspModel
from grasp3d.stability.classification import uncertain_angles
from grasp3d.stability.normal_sets import NormalSets, WorstAndBest
from grasp3d.system.context import report_progress

WIDEST = RIGHT_ANGLE - 1e-9
"""Largest tilt that is evaluated [rad]: no force is the same for all normals of half a ball."""

OFF_SURFACE = 1e-3
"""Distance from the surface up to which contacts in a file count as on it, in object sizes."""


@dataclass(frozen=True, eq=False)
class SurfaceContacts:
    """Contacts of grasps at points of a surface, and the sets of normals that each may have.

    Where the surface is smooth a contact has one normal; on creases and at corners it may have any
    of a convex set.
    """

    mesh: ObjectMesh
    surface_points: SurfacePoints
    """Contact points on the faces, shape (b, n)."""

    __repr__ = short_repr

    @property
    def size(self) -> int:
        """Number of grasps."""
        return int(self.surface_points.faces.shape[0])

    @property
    def count(self) -> int:
        """Number of contacts of each grasp."""
        return int(self.surface_points.faces.shape[1])

    @cached_property
    def points(self) -> Floats:
        """Positions in the mesh's frame, shape (b, n, 3)."""
        return locked(self.surface_points.positions(self.mesh))

    @property
    def normals(self) -> Floats:
        """Inward unit normals, the middle of the set on creases, shape (b, n, 3).

        Zero where the normals cancel out.
        """
        return self.sets.middles

    @cached_property
    def on_crease(self) -> Bools:
        """Whether each contact may have more than one normal, shape (b, n)."""
        return locked((self.sets.counts != 1).reshape(self.size, self.count))

    @cached_property
    def with_normals(self) -> Ints:
        """Indices of the grasps where no contact's normals cancel out."""
        return locked(np.flatnonzero((self.normals != 0.0).any(axis=2).all(axis=1)))

    def tilts(self, model: GraspModel) -> ArrayLike:
        """Largest angle between each contact's nominal and possible true normals [rad], (b, n).

        The true normal is within the sensor's resolution of any normal of the set on creases, and
        of any normal nearby with a location error.

        Args:
            model: The resolution and the location error.
        """
        turns = self.turns(model.location_error) if model.location_error > 0.0 else 0.0
        return np.asarray(np.minimum(self.sets.radii + turns + model.tilt, WIDEST))

    def turns(self, location_error: float) -> Floats:
        """How far the surface turns within a location error of each contact [rad], shape (b, n).

        Args:
            location_error: Largest distance between true and perceived contacts [m].
        """
        points, faces = self.points.reshape(-1, 3), self.surface_points.faces.ravel()
        sets = ContactNormals(self.sets.start, self.sets.counts, self.sets.normals)
        turns = normal_turns(self.mesh, points, faces, sets, location_error)
        return turns.reshape(self.size, self.count)

    def contacts(self, model: GraspModel) -> Contacts:
        """The contacts at their `normals`, relative to the mesh's centre of mass.

        Args:
            model: Friction and torsion.

        Raises:
            ContactError: The normals of a contact cancel out.
        """
        points = self.points - self.mesh.center_mass
        return Contacts(points, self.normals, model.nominal_friction, model.torsion_radius)

    def take(self, which: slice | Ints | Bools) -> "SurfaceContacts":
        """The chosen grasps."""
        points = self.surface_points
        return SurfaceContacts(self.mesh, SurfacePoints(points.faces[which], points.weights[which]))

    @cached_property
    def sets(self) -> NormalSets:
        """Inward normals that each contact may have.

        Where a set spans every direction they are the normals of the faces there, unordered.
        """
        return _normal_sets_at(self.mesh, self.surface_points)


@dataclass(frozen=True, eq=False)
class JawContacts(SurfaceContacts):
    """Contacts where jaws have closed on an object: patches of many faces, each with one normal."""

    jaws: ClosedJaws
    """Where the jaws touch, a row for each grasp."""

    __repr__ = short_repr

    @classmethod
    def of(cls, mesh: ObjectMesh, jaws: ClosedJaws) -> "JawContacts":
        """The contacts where jaws close on an object.

        Args:
            mesh: The object.
            jaws: Where the jaws touch.
        """
        shape = jaws.points.shape
        nowhere = SurfacePoints(locked(np.full(shape[:2], -1)), locked(np.zeros(shape)))
        return cls(mesh, nowhere, jaws)

    @property
    def points(self) -> Floats:
        """Positions in the mesh's frame, shape (b, n, 3)."""
        return self.jaws.points

    def turns(self, location_error: float) -> Floats:
        """How far the surface turns about the middles of the patches, which may be off it."""
        points, normals = self.points.reshape(-1, 3), self.normals.reshape(-1, 3)
        turns = turns_beside(self.mesh, points, normals, location_error)
        return turns.reshape(self.size, self.count)

    def take(self, which: slice | Ints | Bools) -> "JawContacts":
        """The chosen grasps."""
        return JawContacts.of(self.mesh, self.jaws.take(which))

    @cached_property
    def sets(self) -> NormalSets:
        """One normal of each contact."""
        normals = self.jaws.normals
        rows = normals.reshape(-1, 3)
        each, none = np.ones(len(rows), dtype=np.int64), np.zeros(normals.shape[:2])
        return NormalSets(np.arange(len(rows) + 1), each, rows, normals, none)


def grasps_at(mesh: ObjectMesh, partner_points: SurfacePoints, vertices: Ints) -> SurfaceContacts:
    """The grasps of chosen vertices as contacts on the surface.

    Args:
        mesh: The surface.
        partner_points: Opposing contacts of every vertex's grasp, shape (V, n - 1).
        vertices: Chosen vertices, shape (b,).

    Returns:
        The grasps (b, n), the contacts at the vertices first.
    """
    own = vertex_surface_points(mesh, vertices)
    faces = np.concatenate([own.faces[:, None], partner_points.faces[vertices]], axis=1)
    weights = np.concatenate([own.weights[:, None], partner_points.weights[vertices]], axis=1)
    return SurfaceContacts(mesh, SurfacePoints(locked(faces), locked(weights)))


def vertex_surface_points(mesh: ObjectMesh, vertices: ArrayLike) -> SurfacePoints:
    """Convert vertices to surface points.

    Args:
        mesh: The surface.
        vertices: Numbers of vertices, any shape.

    Returns:
        Surface points of that shape: a face of each vertex, or of the canonical vertex at its
        position, with weight 1 at that corner; face -1 where the vertex belongs to none.
    """
    face = np.full(len(mesh.vertices), -1, dtype=np.int64)
    corner = np.zeros(len(mesh.vertices), dtype=np.int64)
    face[mesh.faces[::-1]] = np.arange(len(mesh.faces))[::-1, None]  # the first face is kept
    corner[mesh.faces[::-1]] = np.arange(3)
    canonical = mesh.canonical[np.asarray(vertices, dtype=np.int64)]
    return SurfacePoints(face[canonical], np.eye(3)[corner[canonical]])


def _normal_sets_at(mesh: ObjectMesh, surface_points: SurfacePoints) -> NormalSets:
    """Sets of normals at surface points: stored at vertices, computed on faces and edges."""
    # Copies: the kernel would be compiled again for arrays that cannot be written.
    faces = np.array(surface_points.faces).ravel()
    weights = np.array(surface_points.weights).reshape(-1, 3)
    sets = mesh.contact_normals
    counts, vertices = np.empty((2, len(faces)), dtype=np.int64)
    pairs = np.zeros((len(faces), 2, 3))
    write_normals_of_all(faces, weights, mesh.contact_surface, sets, counts, vertices, pairs)
    at_vertex = vertices >= 0
    set_sizes = np.where(sets.counts > 0, sets.counts, np.diff(sets.start))
    rows = np.where(at_vertex, set_sizes[vertices], np.maximum(counts, 1))
    first = np.where(at_vertex, sets.start[vertices], len(sets.normals) + 2 * np.arange(len(faces)))
    start = np.concatenate([[0], np.cumsum(rows)])
    which = np.arange(start[-1]) + np.repeat(first - start[:-1], rows)
    pairs[counts == 0] = unit_rows(pairs[counts == 0])
    normals = np.concatenate([sets.normals, pairs.reshape(-1, 3)])[which]
    middles = pairs[:, 0].copy()
    arcs = np.flatnonzero((counts == 2) & ~at_vertex)
    sums = pairs[arcs].sum(axis=1)
    middles[arcs] = unit_rows(sums)
    middles[at_vertex] = mesh.normals[vertices[at_vertex]]
    spans_all = counts == 0
    spans_all[arcs[np.linalg.norm(sums, axis=1) < 2.0 * HEMISPHERE]] = True
    counts = np.where(spans_all, 0, rows)
    shaped = locked(middles.reshape(*surface_points.faces.shape, 3))
    return NormalSets.about(locked(start), counts, locked(normals), shaped)


SAME_POINT = 1e-12
"""Distance up to which contacts are at the same point, in object sizes."""

CHUNK = 1 << 14
"""Grasps that are evaluated at once."""


def critical_angles(
    contacts: SurfaceContacts, *, location_error: float = 0.0, tolerance: float = 1e-4
) -> WorstAndBest:
    """Critical friction angles of grasps over the worst and over the best normals of the contacts.

    Two contacts have a closed form. For more contacts, none on a crease, both angles are the
    critical friction angle. A contact on a crease may have any normal of the cap about its set, so
    the worst angle is never too small and the best never too large. Where a set spans every
    direction the grasp is neither surely stable nor surely unstable. Contacts that are all at one
    point are no grasp, but may push against each other at an edge: the best is a lower bound.

    Args:
        contacts: Grasps on a surface.
        location_error: Largest distance between true and perceived contact points [m]: lines
            between them turn, and normals as the surface does nearby; see
            `stability.uncertain_angles`.
        tolerance: For three contacts and more, as in `critical_friction_angle` [rad].

    Returns:
        (worst, best) [rad], shape (b,) each. For two contacts up to pi; for more, pi/2 where no
        friction makes the grasp force-closed. The worst is inf where all contacts are at the same
        point.

    Raises:
        SettingError: A tolerance that is not above 0.
    """
    check_tolerance(tolerance)
    bounds = np.full((2, contacts.size), math.inf)
    smooth = ~contacts.on_crease.any(axis=1)
    for alike in (smooth, ~smooth):
        rows = np.flatnonzero(alike)
        for start in range(0, len(rows), CHUNK):
            chunk = rows[start : start + CHUNK]
            bounds[:, chunk] = _angles(contacts.take(chunk), location_error, tolerance)
            report_progress((start + len(chunk)) / contacts.size)
    distances = np.linalg.norm(contacts.points - contacts.points[:, :1], axis=2)
    bounds[0, (distances <= SAME_POINT * contacts.mesh.size).all(axis=1)] = math.inf
    return locked(bounds[0]), locked(bounds[1])


def _angles(contacts: SurfaceContacts, location_error: float, tolerance: float) -> WorstAndBest:
    location = turns = None
    if location_error > 0.0:
        location = np.full(contacts.points.shape[:2], location_error)
        turns = contacts.turns(location_error)
    return uncertain_angles(
        contacts.points, contacts.sets, location=location, turns=turns, tolerance=tolerance
    )
