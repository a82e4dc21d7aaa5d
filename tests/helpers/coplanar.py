"""Oracle of three hard contacts: force closure in the plane through them, in plain NumPy.

About the line through two of the contacts only the third could exert a torque, so balanced forces
of three contacts lie in the plane through them. There each friction cone is a planar one, of
half-angle acos(cos(beta) / cos(elevation)) about the normal's projection, and empty where the
normal's elevation over the plane is beta or more. The grasp is force-closed if the six edges of the
planar cones positively span all planar wrenches (Nguyen 1988). No hull in six dimensions is needed.

Contacts with several normals are evaluated over the worst of them: a grasp is force-closed with
every combination of normals if it is with the intersection of each contact's planar cones. Where
that is empty, it must be with each of the two outermost edges alone.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grasp3d import ObjectMesh
from grasp3d.arrays import angles_between, unit_rows
from grasp3d.contact.friction_cones import on_arcs

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

RIGHT = math.pi / 2.0
STEP = math.radians(2.0)
"""Largest angle between neighbours on the border of a sampled set of normals."""

COLLINEAR = 1e-9
SAME = 1e-12
PAIRS = np.array(list(itertools.combinations(range(6), 2)))
BATCH = 4096
"""Grasps evaluated together."""


@dataclass(frozen=True, eq=False)
class PlanarGrasps:
    """A batch of grasps of three contacts, projected to the planes through them."""

    points: Floats
    """Contacts about their centroid, the farthest at distance 1, shape (b, 3, 2)."""
    groups: list[tuple[Ints, Floats, Floats]]
    """Contacts with equally many normals: their indices among the 3 b contacts (r,), azimuth
    and the cosine of the elevation of each normal (r, s)."""
    collinear: Bools
    """Grasps with collinear contacts, which determine no plane, shape (b,)."""

    def force_closed(self, beta: Floats) -> Bools:
        """Whether all combinations of the normals are force-closed at friction angles (b,)."""
        left, right, flat = self._cones(beta)
        closed = flat & ~self.collinear
        inverted = left > right
        for ends in itertools.product((False, True), repeat=3):
            # Contacts whose cones have an empty intersection: each outermost edge alone.
            rows = np.flatnonzero(closed & (inverted | ~np.array(ends)).all(axis=1))
            edges = np.stack([left[rows], right[rows]], axis=-1)  # (r, 3, 2)
            alone = np.where(np.array(ends), left[rows], right[rows])
            edges = np.where(inverted[rows, :, None], alone[..., None], edges)
            closed[rows] = _spans(self.points[rows], edges)
        return closed

    def critical_angles(self, high: Floats, tolerance: float) -> Floats:
        """Bracket the angles from which on all combinations are force-closed, below `high` (b,).

        Returns:
            Upper ends [rad], shape (b,); inf where none below `high`, nan where collinear.
        """
        found = np.where(self.force_closed(high), high, math.inf)
        low, upper = np.zeros(len(high)), high.copy()
        while (upper - low).max(initial=0.0) > tolerance:
            middle = 0.5 * (low + upper)
            closed = self.force_closed(middle)
            low, upper = np.where(closed, low, middle), np.where(closed, middle, upper)
        return np.where(self.collinear, math.nan, np.where(np.isfinite(found), upper, math.inf))

    def _cones(self, beta: Floats) -> tuple[Floats, Floats, Bools]:
        """(left, right) edges of the common planar cones (b, 3), whether all exist (b,)."""
        count = len(self.points)
        left, right = np.zeros(3 * count), np.zeros(3 * count)
        flat = np.zeros(3 * count, dtype=bool)
        for rows, azimuth, cosine in self.groups:
            ratio = np.cos(beta)[rows // 3, None] / cosine
            half = np.arccos(np.minimum(ratio, 1.0))
            flat[rows] = (ratio < 1.0).all(axis=1)
            left[rows], right[rows] = (azimuth - half).max(axis=1), (azimuth + half).min(axis=1)
        return left.reshape(-1, 3), right.reshape(-1, 3), flat.reshape(-1, 3).all(axis=1)


def _spans(points: Floats, edges: Floats) -> Bools:
    """Whether planar forces along `edges` (b, 3, 2) positively span all planar wrenches, (b,).

    They do not if all lie on one side of a plane, which can be turned until two lie in it.
    """
    x, y = np.cos(edges), np.sin(edges)
    torque = points[..., :1] * y - points[..., 1:] * x
    wrenches = np.stack([x, y, torque], axis=-1).reshape(-1, 6, 3)
    planes = np.cross(wrenches[:, PAIRS[:, 0]], wrenches[:, PAIRS[:, 1]])  # (b, 15, 3)
    sides = planes @ wrenches.transpose(0, 2, 1)  # (b, 15, 6)
    on_both_sides = (sides.max(axis=2) > SAME) & (sides.min(axis=2) < -SAME)
    return np.asarray((on_both_sides | (np.abs(planes).max(axis=2) < SAME)).all(axis=1))


def planar_grasps(points: Floats, normals: Sequence[Floats], which: Ints) -> PlanarGrasps:
    """Project grasps to their planes.

    Args:
        points: Contacts, shape (b, 3, 3).
        normals: Sets of unit normals, (s, 3) each, of any sizes.
        which: Index of the set of normals of each contact, shape (b, 3).
    """
    middle = points - points.mean(axis=1, keepdims=True)
    middle = middle / np.linalg.norm(middle, axis=2).max(axis=1)[:, None, None]
    first = middle[:, 1] - middle[:, 0]
    up = np.cross(first, middle[:, 2] - middle[:, 0])
    area = np.linalg.norm(up, axis=1)
    collinear = area < COLLINEAR
    up = up / np.where(collinear, 1.0, area)[:, None]
    first = first / np.maximum(np.linalg.norm(first, axis=1, keepdims=True), COLLINEAR)
    frames = np.stack([first, np.cross(up, first), up], axis=1)  # (b, 3, 3)
    sizes = np.array([len(rows) for rows in normals])
    of_contact = which.ravel()
    groups = []
    for size in np.unique(sizes[of_contact]):
        rows = np.flatnonzero(sizes[of_contact] == size)
        numbers, row = np.unique(of_contact[rows], return_inverse=True)
        table = np.stack([normals[number] for number in numbers])  # (k, s, 3)
        local = table[row.ravel()] @ frames[rows // 3].transpose(0, 2, 1)  # (r, s, 3)
        azimuth = np.arctan2(local[..., 1], local[..., 0])
        # Sets without the plane's normal span at most half a turn about it.
        turned = np.mod(azimuth - azimuth[:, :1] + math.pi, 2.0 * math.pi) - math.pi
        cosine = np.hypot(local[..., 0], local[..., 1])
        groups.append((rows, azimuth[:, :1] + turned, np.maximum(cosine, SAME)))
    return PlanarGrasps((middle @ frames.transpose(0, 2, 1))[..., :2], groups, collinear)


def critical_angles(
    points: Floats, normals: Floats, *, tolerance: float = 1e-6, limit: float = RIGHT - 1e-6
) -> Floats:
    """Critical friction angles of three contacts each, points and unit normals (b, 3, 3) [rad].

    Returns:
        Shape (b,), at most `tolerance` too large; inf above the limit, nan for collinear contacts.
    """
    count = len(points)
    sets = normals.reshape(-1, 1, 3)
    grasps = planar_grasps(points, list(sets), np.arange(3 * count).reshape(-1, 3))
    return grasps.critical_angles(np.full(count, limit), tolerance)


def sampled_normals(corners: Floats) -> Floats:
    """Sample a convex set of normals, given by its corners in order (k, 3): centre, then border.

    The worst normal is on the border unless the set contains the normal of the plane through the
    contacts; for that case the interior is sampled every 20 degrees or less.
    """
    if len(corners) == 1:
        return corners
    middle = unit_rows(corners.sum(axis=0))
    border = []
    for i in range(1 if len(corners) == 2 else len(corners)):
        start, end = corners[i], corners[(i + 1) % len(corners)]
        steps = max(1, math.ceil(float(angles_between(start, end)) / STEP))
        border.append(on_arcs(start, end, np.linspace(0.0, 1.0, steps + 1)))
    border = np.concatenate(border)
    if len(corners) == 2:
        return np.vstack([middle, border])
    inside = [unit_rows(part * border + (1.0 - part) * middle) for part in (0.4, 0.75)]
    return np.vstack([middle, border, *inside])


@dataclass(eq=False)
class Exhaustive:
    """The best grasp of three fingers through each vertex, from all triples of vertices.

    The contacts are three different, not collinear vertices. The critical angle over their worst
    normals is exact up to `tolerance` where the surface is smooth; on creases it may be too small
    by tan(angle) (1 / cos(STEP / 2) - 1).
    """

    mesh: ObjectMesh
    """The surface, of a few hundred vertices at most."""
    limit: float
    """Largest critical angle of interest [rad]."""
    tolerance: float
    """Largest amount by which the angles may be too large [rad]."""

    def __post_init__(self) -> None:
        sets = self.mesh.contact_normals
        self.vertices = np.unique(self.mesh.faces)
        if (sets.counts[self.vertices] == 0).any():
            raise ValueError(
                "the normals of a vertex span all directions: its critical angle is undefined"
            )
        self.points = self.mesh.vertices[self.vertices]
        corners = [sets.normals[sets.start[v] : sets.start[v + 1]] for v in self.vertices]
        self.normals = [sampled_normals(rows) for rows in corners]
        self.central_normals = [rows[:1] for rows in self.normals]
        self.best = np.full(len(self.vertices), self.limit)
        self.tested = 0

    def run(self) -> Floats:
        """Critical angles over the worst normals, as `vertices`; inf above the limit."""
        count = len(self.vertices)
        rng = np.random.default_rng(0)
        some = np.array([rng.choice(count, 3, replace=False) for _ in range(count)])
        for part in np.array_split(some, -(-len(some) // 64)):
            self.evaluate(part)
        for first in range(count - 2):
            one, two = np.triu_indices(count - first - 1, 1)
            one, two = one + first + 1, two + first + 1
            which = np.stack([np.full(len(one), first), one, two], axis=1)
            for start in range(0, len(which), BATCH):
                self.evaluate(which[start : start + BATCH])
        return np.where(self.best < self.limit, self.best, math.inf)

    def evaluate(self, which: Ints) -> None:
        """Evaluate those grasps (b, 3) that may be better than the best of one of their vertices.

        Grasps whose central normals have too large elevations, and then those that are not
        force-closed with the central normals, are rejected without their angles.
        """
        which = which[self._below_threshold(which)]
        for normals in (self.central_normals, self.normals):
            grasps = planar_grasps(self.points[which], normals, which)
            which = which[grasps.force_closed(self._thresholds(which))]
        self.tested += len(which)
        grasps = planar_grasps(self.points[which], self.normals, which)
        found = grasps.critical_angles(self._thresholds(which), 0.25 * self.tolerance)
        np.minimum.at(self.best, which, found[:, None])

    def _thresholds(self, which: Ints) -> Floats:
        """Angle below which a grasp improves the best one of some of its vertices (b,)."""
        return np.asarray(self.best[which].max(axis=1) - 0.5 * self.tolerance)

    def _below_threshold(self, which: Ints) -> Bools:
        """Whether the elevations of the central normals are below the thresholds (b,)."""
        points = self.points[which]
        up = np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0])
        middles = np.concatenate(self.central_normals)[which]
        elevation = np.abs((middles @ up[..., None])[..., 0]).max(axis=1)
        return np.asarray(elevation < np.sin(self._thresholds(which)) * np.linalg.norm(up, axis=1))
