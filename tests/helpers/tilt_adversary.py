"""An adversary of the bounds of grip forces over all tilts of the normals.

It looks for normals, within the tilt, at which a grasp of two soft fingers needs as much or as
little force as possible: from many starts it changes the normals of both contacts at random, by
less and less, and keeps what is better for it; for the largest force it then turns all normals,
again and again, to where the grasp is weakest along the direction that proves the force. A force
beyond a bound would be a false S or U. How far the bounds are from the adversary's forces is at
most what they give away.
"""

import numpy as np
from numpy.typing import NDArray

from grasp3d import Contacts
from grasp3d._kernels.hull.grip_force import ForceResults
from grasp3d.contact.contacts import tangents, tilted_normals, turned
from grasp3d.quality.grip_forces import ForceBound, ForceProblem
from tests.helpers.tilts import with_normals

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

RTOL = 1e-4
STEEPEST = 12
"""Steps in which all normals turn so that the grasp is weakest along the direction that proves the
force so far."""


def unit(vectors: Floats) -> Floats:
    """Vectors (..., 3) scaled to length 1."""
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))


def random_pads(count: int, rng: np.random.Generator) -> tuple[Contacts, Floats]:
    """Two pads on opposite faces of parts of 20 to 80 mm, and how far their normals tilt (b, 2)."""
    width = rng.uniform(0.02, 0.08, count)
    points = np.zeros((count, 2, 3))
    points[:, 0, 0], points[:, 1, 0] = -0.5 * width, 0.5 * width
    points += 0.01 * rng.normal(size=(count, 1, 3))
    normals = unit(np.array([[1.0, 0, 0], [-1, 0, 0]]) + 0.05 * rng.normal(size=(count, 2, 3)))
    friction = rng.uniform(0.25, 1.0, count)[:, None]
    radius = rng.uniform(0.004, 0.012, count)[:, None]
    beta = np.arctan(friction)
    share = rng.uniform(0.1, 0.7, (count, 1)) * beta
    tilts = np.where(rng.random((count, 1)) < 0.5, share, np.minimum(0.2, 0.7 * beta))
    # A disc that is evenly pressed resists as much torsion as a radius of two thirds.
    torsion = 2.0 / 3.0 * friction * radius
    return Contacts(points, normals, friction, torsion), np.broadcast_to(tilts, (count, 2))


def tilted(normals: Floats, tilts: Floats, where: Floats) -> Floats:
    """Normals (..., n, 3) turned by a part of the tilts toward points (..., n, 2) of a disc."""
    length = np.linalg.norm(where, axis=-1)
    angle = tilts * np.minimum(length, 1.0)
    across, along = tangents(normals)
    toward = (where[..., :1] * across + where[..., 1:] * along) / np.maximum(length, 1e-300)[
        ..., None
    ]
    return np.asarray(np.cos(angle)[..., None] * normals + np.sin(angle)[..., None] * toward)


class Attack:
    """An adversary of the bounds of contacts (b, n)."""

    def __init__(
        self, contacts: Contacts, tilts: Floats, wrenches: Floats, bound: ForceBound
    ) -> None:
        self.contacts, self.tilts = contacts, tilts
        self.wrenches, self.bound = wrenches, bound

    def forces(self, grasps: Ints, normals: Floats) -> ForceResults:
        """Forces of some grasps (k,) at normals (k, n, 3)."""
        some = with_normals(self.contacts.take(grasps), normals)
        return ForceProblem.bounded(some, self.bound).of_wrenches(self.wrenches[grasps], RTOL)

    def largest(self, starts: int, steps: int, rng: np.random.Generator) -> Floats:
        """The largest force found for each grasp, not more than some normals need, (b,)."""
        grasps, normals = self._search(starts, steps, 1.0, rng)
        results = self.forces(grasps, normals)
        best = results.lower
        for _ in range(STEEPEST):
            results = self.forces(grasps, self._weakest(grasps, results.direction))
            best = np.maximum(best, results.lower)
        return np.asarray(best.reshape(-1, starts).max(axis=1))

    def least(self, starts: int, steps: int, rng: np.random.Generator) -> Floats:
        """The smallest force found for each grasp, not less than some normals need, (b,)."""
        best = self.forces(*self._search(starts, steps, -1.0, rng)).upper
        return np.asarray(best.reshape(-1, starts).min(axis=1))

    def _search(
        self, starts: int, steps: int, sign: float, rng: np.random.Generator
    ) -> tuple[Ints, Floats]:
        """Grasps (b starts,), and normals (..., n, 3) that were changed from random ones."""
        count = len(self.wrenches)
        grasps = np.repeat(np.arange(count), starts)
        given, tilts = self.contacts.normals[grasps], self.tilts[grasps]
        shape = (*given.shape[:2], 2)
        where = unit(rng.normal(size=shape)) * np.sqrt(rng.uniform(0.3, 1.0, (*shape[:2], 1)))

        def force(where: Floats) -> Floats:
            results = self.forces(grasps, tilted(given, tilts, where))
            return sign * np.asarray(results.lower if sign > 0.0 else results.upper)

        best = force(where)
        for step in range(steps):
            radius = 0.6 * (1.0 - step / steps) + 0.02
            tried = where + radius * rng.normal(size=shape)
            tried /= np.maximum(np.linalg.norm(tried, axis=-1, keepdims=True), 1.0)
            found = force(tried)
            better = found > best
            where[better], best[better] = tried[better], found[better]
        return grasps, tilted(given, tilts, where)

    def _weakest(self, grasps: Ints, u: Floats) -> Floats:
        """Normals (k, n, 3) at which contacts resist least along directions of wrenches (k, 6)."""
        some, tilts = self.contacts.take(grasps), self.tilts[grasps]
        g = u[:, None, :3] + np.cross(u[:, None, 3:], some.points)
        rim = np.moveaxis(tilted_normals(some.normals, tilts, count=24), -2, 0)  # (25, k, n, 3)
        both = [turned(some.normals, one, tilts) for one in (g, -g)]
        tried = np.concatenate([rim, both])
        normal = (tried * g).sum(axis=-1)
        across = np.maximum((g * g).sum(axis=-1) - normal**2, 0.0)
        twist = (tried * u[:, None, 3:]).sum(axis=-1) * some.torsion_radius
        support = normal + np.sqrt(some.friction**2 * across + twist**2)
        weakest = support.argmin(axis=0)
        return np.asarray(np.take_along_axis(tried, weakest[None, ..., None], axis=0)[0])
