"""Oracle for three hard contacts: force closure in the plane through them, in plain NumPy.

Only the third contact could exert a torque about the line through the other two, so balanced forces
of three contacts lie in the plane through them. There each friction cone is a planar one, of
half-angle acos(cos(beta) / cos(elevation)) about the normal's projection; it is empty where the
normal's elevation over the plane is beta or more. The grasp is force-closed if the six edges of the
planar cones positively span all planar wrenches (Nguyen 1988). No hull in six dimensions is needed.

If a contact may have any normal of a cap about its normal, its friction cone is narrower by the
cap's radius: what this cone can do holds for every normal of the cap.
"""

import itertools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grasp3d import ObjectMesh
from grasp3d.arrays import unit_rows

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

RIGHT = math.pi / 2.0
COLLINEAR = 1e-9
SAME = 1e-12
PAIRS = np.array(list(itertools.combinations(range(6), 2)))
BATCH = 4096
"""Number of grasps evaluated together."""


@dataclass(frozen=True, eq=False)
class PlanarGrasps:
    """A batch of grasps of three contacts, projected to the planes through their contacts."""

    points: Floats
    """Contacts relative to their centroid, the farthest at distance 1, shape (b, 3, 2)."""
    azimuth: Floats
    """Azimuth of each normal in its plane [rad], shape (b, 3)."""
    cosine: Floats
    """Cosine of each normal's elevation, shape (b, 3)."""
    radii: Floats
    """Radius of the cap of each normal [rad], shape (b, 3)."""
    collinear: Bools
    """Whether the contacts are collinear and so determine no plane, shape (b,)."""

    def force_closed(self, beta: Floats) -> Bools:
        """Whether grasps are force-closed with all normals, at friction angles (b,)."""
        own = beta[:, None] - self.radii
        ratio = np.cos(own) / self.cosine
        half = np.arccos(np.minimum(ratio, 1.0))
        closed = ((own >= 0.0) & (ratio < 1.0)).all(axis=1) & ~self.collinear
        rows = np.flatnonzero(closed)
        edges = np.stack([self.azimuth - half, self.azimuth + half], axis=-1)  # (b, 3, 2)
        closed[rows] = _spans(self.points[rows], edges[rows])
        return closed

    def critical_angles(self, high: Floats, tolerance: float) -> Floats:
        """Angles (b,) from which on grasps are force-closed, below `high` (b,); inf, nan: none."""
        found = np.where(self.force_closed(high), high, math.inf)
        low, upper = np.zeros(len(high)), high.copy()
        while (upper - low).max(initial=0.0) > tolerance:
            middle = 0.5 * (low + upper)
            closed = self.force_closed(middle)
            low, upper = np.where(closed, low, middle), np.where(closed, middle, upper)
        return np.where(self.collinear, math.nan, np.where(np.isfinite(found), upper, math.inf))


def _spans(points: Floats, edges: Floats) -> Bools:
    """Whether planar forces along `edges` (b, 3, 2) positively span all planar wrenches, (b,).

    They do not if all lie on one side of a plane; such a plane can be turned until two lie in it.
    """
    x, y = np.cos(edges), np.sin(edges)
    torque = points[..., :1] * y - points[..., 1:] * x
    wrenches = np.stack([x, y, torque], axis=-1).reshape(-1, 6, 3)
    planes = np.cross(wrenches[:, PAIRS[:, 0]], wrenches[:, PAIRS[:, 1]])  # (b, 15, 3)
    sides = planes @ wrenches.transpose(0, 2, 1)  # (b, 15, 6)
    on_both_sides = (sides.max(axis=2) > SAME) & (sides.min(axis=2) < -SAME)
    return np.asarray((on_both_sides | (np.abs(planes).max(axis=2) < SAME)).all(axis=1))


def planar_grasps(points: Floats, normals: Floats, radii: Floats) -> PlanarGrasps:
    """Project grasps (b, 3, 3), with radii of caps about the normals (b, 3), to their planes."""
    middle = points - points.mean(axis=1, keepdims=True)
    middle = middle / np.linalg.norm(middle, axis=2).max(axis=1)[:, None, None]
    first = middle[:, 1] - middle[:, 0]
    up = np.cross(first, middle[:, 2] - middle[:, 0])
    area = np.linalg.norm(up, axis=1)
    collinear = area < COLLINEAR
    up = up / np.where(collinear, 1.0, area)[:, None]
    first = first / np.maximum(np.linalg.norm(first, axis=1, keepdims=True), COLLINEAR)
    frames = np.stack([first, np.cross(up, first), up], axis=1)  # (b, 3, 3)
    local = normals @ frames.transpose(0, 2, 1)
    cosine = np.maximum(np.hypot(local[..., 0], local[..., 1]), SAME)
    azimuth = np.arctan2(local[..., 1], local[..., 0])
    flat = (middle @ frames.transpose(0, 2, 1))[..., :2]
    return PlanarGrasps(flat, azimuth, cosine, radii, collinear)


@dataclass(eq=False)
class Exhaustive:
    """The best grasp of three fingers through each vertex, from all triples of vertices.

    The contacts are three different vertices, not collinear, with the caps of their normals.
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
        self.normals = unit_rows(self.mesh.normal_centres[self.vertices])
        self.radii = self.mesh.normal_radii[self.vertices]
        self.best = np.full(len(self.vertices), self.limit)

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
        """Evaluate grasps (b, 3) that may be better than the best one of one of their vertices.

        Grasps whose normals have too large an elevation, and then grasps that are not force-closed,
        are rejected without computing their angles.
        """
        which = which[self._below_threshold(which)]
        which = which[self.grasps(which).force_closed(self._thresholds(which))]
        found = self.grasps(which).critical_angles(self._thresholds(which), 0.25 * self.tolerance)
        np.minimum.at(self.best, which, found[:, None])

    def grasps(self, which: Ints) -> PlanarGrasps:
        """The grasps of triples of vertices (b, 3)."""
        return planar_grasps(self.points[which], self.normals[which], self.radii[which])

    def _thresholds(self, which: Ints) -> Floats:
        """Angle below which a grasp improves the best one at some of its vertices, (b,)."""
        return np.asarray(self.best[which].max(axis=1) - 0.5 * self.tolerance)

    def _below_threshold(self, which: Ints) -> Bools:
        """Whether the elevations of the normals are below the thresholds, (b,)."""
        points = self.points[which]
        up = np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0])
        elevation = np.abs((self.normals[which] @ up[..., None])[..., 0]).max(axis=1)
        return np.asarray(elevation < np.sin(self._thresholds(which)) * np.linalg.norm(up, axis=1))
