"""Three hard contacts solved in the plane through them, by no more than NumPy.

About the line through two of the contacts only the third could exert a torque, so forces of three
contacts that balance lie in the plane through them. There each friction cone is a planar one, of
half-angle acos(cos(beta) / cos(elevation)) about the normal's projection, and none at all where the
normal rises over the plane by beta or more. Closure is that the six edges of the planar cones span
all planar wrenches (Nguyen 1988). Nothing here knows of hulls in six dimensions.

Contacts with several normals are met in the worst of them: what holds for every combination of
normals holds for the planar cones that all normals of a contact share. Where a contact's normals
share none, each outermost edge alone must do.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grasp3d import ObjectMesh

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

RIGHT = math.pi / 2.0
STEP = math.radians(2.0)
"""Largest angle between neighbours on the border of a sampled set of normals."""

COLLINEAR = 1e-9
SAME = 1e-12
PAIRS = np.array(list(itertools.combinations(range(6), 2)))
MOST = 4096
"""Grasps looked at together."""


@dataclass(frozen=True, eq=False)
class PlanarGrasps:
    """A batch of three contacts each, in the plane through them."""

    points: Floats
    """About their middle, the farthest at 1, shape (b, 3, 2)."""
    groups: list[tuple[Ints, Floats, Floats]]
    """Contacts with equally many normals: numbers in the batch's 3 b contacts (r,), and azimuth and
    cosine of the elevation of each normal (r, s)."""
    collinear: Bools
    """Grasps in no single plane, shape (b,)."""

    def closes(self, beta: Floats) -> Bools:
        """Whether all combinations of the normals close at friction angles (b,)."""
        left, right, flat = self._cones(beta)
        closed = flat & ~self.collinear
        inverted = left > right
        for ends in itertools.product((False, True), repeat=3):
            # A contact whose cones share nothing: once its one, once its other outermost edge.
            rows = np.flatnonzero(closed & (inverted | ~np.array(ends)).all(axis=1))
            edges = np.stack([left[rows], right[rows]], axis=-1)  # (r, 3, 2)
            alone = np.where(np.array(ends), left[rows], right[rows])
            edges = np.where(inverted[rows, :, None], alone[..., None], edges)
            closed[rows] = _spans(self.points[rows], edges)
        return closed

    def critical_angles(self, high: Floats, tolerance: float) -> Floats:
        """Bracket the angles from which on all combinations close, below `high` (b,).

        Returns:
            Upper ends [rad], shape (b,); inf where none below `high`, nan where collinear.
        """
        found = np.where(self.closes(high), high, math.inf)
        low, upper = np.zeros(len(high)), high.copy()
        while (upper - low).max(initial=0.0) > tolerance:
            middle = 0.5 * (low + upper)
            closed = self.closes(middle)
            low, upper = np.where(closed, low, middle), np.where(closed, middle, upper)
        return np.where(self.collinear, math.nan, np.where(np.isfinite(found), upper, math.inf))

    def _cones(self, beta: Floats) -> tuple[Floats, Floats, Bools]:
        """(left, right) edges of the shared cones (b, 3), and whether the plane meets them (b,)."""
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
    """Whether the wrenches of planar forces along `edges` (b, 3, 2) span all wrenches, (b,).

    They do not if some plane has all of them on one side; it can be turned until two lie in it.
    """
    x, y = np.cos(edges), np.sin(edges)
    torque = points[..., :1] * y - points[..., 1:] * x
    wrenches = np.stack([x, y, torque], axis=-1).reshape(-1, 6, 3)
    planes = np.cross(wrenches[:, PAIRS[:, 0]], wrenches[:, PAIRS[:, 1]])  # (b, 15, 3)
    sides = planes @ wrenches.transpose(0, 2, 1)  # (b, 15, 6)
    parted = (sides.max(axis=2) > SAME) & (sides.min(axis=2) < -SAME)
    return np.asarray((parted | (np.abs(planes).max(axis=2) < SAME)).all(axis=1))


def planar_grasps(points: Floats, normals: Sequence[Floats], which: Ints) -> PlanarGrasps:
    """Lay grasps into their planes.

    Args:
        points: Contacts, shape (b, 3, 3).
        normals: Sets of unit normals, (s, 3) each, of any sizes.
        which: The set of each contact, shape (b, 3).
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
        numbers, place = np.unique(of_contact[rows], return_inverse=True)
        table = np.stack([normals[number] for number in numbers])  # (k, s, 3)
        local = table[place.ravel()] @ frames[rows // 3].transpose(0, 2, 1)  # (r, s, 3)
        azimuth = np.arctan2(local[..., 1], local[..., 0])
        # Sets that leave out the plane's normal span at most half a turn about it.
        away = np.mod(azimuth - azimuth[:, :1] + math.pi, 2.0 * math.pi) - math.pi
        cosine = np.hypot(local[..., 0], local[..., 1])
        groups.append((rows, azimuth[:, :1] + away, np.maximum(cosine, SAME)))
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
    """Normals of a convex set (k, 3) given by its corners in order: the middle, then its border.

    The border is enough to find the worst unless the set holds the normal of the plane through the
    contacts; so that this is seen too, the inside is sampled every 20 degrees or less.
    """
    if len(corners) == 1:
        return corners
    middle = _unit(corners.sum(axis=0))
    sides = [(corners[i], corners[(i + 1) % len(corners)]) for i in range(len(corners))]
    border = np.concatenate([_arc(*side) for side in sides[: 1 if len(corners) == 2 else None]])
    if len(corners) == 2:
        return np.vstack([middle, border])
    inside = [_unit(share * border + (1.0 - share) * middle) for share in (0.4, 0.75)]
    return np.vstack([middle, border, *inside])


def _arc(start: Floats, end: Floats) -> Floats:
    angle = math.atan2(float(np.linalg.norm(np.cross(start, end))), float(start @ end))
    shares = np.linspace(0.0, 1.0, max(1, math.ceil(angle / STEP)) + 1)[:, None] * angle
    return np.asarray((np.sin(angle - shares) * start + np.sin(shares) * end) / math.sin(angle))


def _unit(rows: Floats) -> Floats:
    return np.asarray(rows / np.linalg.norm(rows, axis=-1, keepdims=True))


@dataclass(eq=False)
class Exhaustive:
    """The best of all grasps with three fingers at a mesh's vertices, through each of them."""

    mesh: ObjectMesh
    limit: float
    tolerance: float

    def __post_init__(self) -> None:
        sets = self.mesh.normal_sets
        self.places = np.unique(self.mesh.faces)
        if (sets.counts[self.places] == 0).any():
            raise ValueError("a vertex may have any normal at all: its worst has no angle")
        self.points = self.mesh.vertices[self.places]
        corners = [sets.normals[sets.start[v] : sets.start[v + 1]] for v in self.places]
        self.normals = [sampled_normals(rows) for rows in corners]
        self.middles = [rows[:1] for rows in self.normals]
        self.best = np.full(len(self.places), self.limit)
        self.tested = 0

    def run(self) -> Floats:
        """Critical angles of the worst normals, in the order of `places`; inf above the limit."""
        count = len(self.places)
        rng = np.random.default_rng(0)
        some = np.array([rng.choice(count, 3, replace=False) for _ in range(count)])
        for part in np.array_split(some, -(-len(some) // 64)):
            self.try_all(part)
        for first in range(count - 2):
            one, two = np.triu_indices(count - first - 1, 1)
            one, two = one + first + 1, two + first + 1
            which = np.stack([np.full(len(one), first), one, two], axis=1)
            for start in range(0, len(which), MOST):
                self.try_all(which[start : start + MOST])
        return np.where(self.best < self.limit, self.best, math.inf)

    def try_all(self, which: Ints) -> None:
        """Settle those grasps (b, 3) that may be better than the best of one of their places.

        What rises too far over the plane, then what does not close with the middles of the sets of
        normals, is out.
        """
        which = which[self._low(which)]
        for normals in (self.middles, self.normals):
            grasps = planar_grasps(self.points[which], normals, which)
            which = which[grasps.closes(self._goal(which))]
        self.tested += len(which)
        grasps = planar_grasps(self.points[which], self.normals, which)
        found = grasps.critical_angles(self._goal(which), 0.25 * self.tolerance)
        np.minimum.at(self.best, which, found[:, None])

    def _goal(self, which: Ints) -> Floats:
        """Angle below which a grasp would be news to one of its places (b,)."""
        return np.asarray(self.best[which].max(axis=1) - 0.5 * self.tolerance)

    def _low(self, which: Ints) -> Bools:
        """Whether the middle normals rise over the plane by less than the goal (b,)."""
        points = self.points[which]
        up = np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0])
        middles = np.concatenate(self.middles)[which]
        rise = np.abs((middles @ up[..., None])[..., 0]).max(axis=1)
        return np.asarray(rise < np.sin(self._goal(which)) * np.linalg.norm(up, axis=1))


def exhaustive(
    mesh: ObjectMesh, *, limit: float = math.radians(80.0), tolerance: float = 2e-4
) -> tuple[Ints, Floats]:
    """Best grasp with three fingers on all vertices of a mesh, each in its worst normals.

    Three different vertices on no common line. An angle is exact for smooth places, up to
    `tolerance`; on creases it may be too small by tan(angle) (1 / cos(STEP / 2) - 1).

    Args:
        mesh: The surface, of a few hundred vertices at most.
        limit: Largest angle sought [rad].
        tolerance: By how much the angles may be too large [rad].

    Returns:
        The places (P,) and their critical angles (P,), inf where all exceed the limit.
    """
    search = Exhaustive(mesh, limit, tolerance)
    return search.places, search.run()
