"""How safe, and how cautious, the bounds of grip forces over all tilts of the normals are.

An adversary looks for normals, within the tilt, at which a grasp needs as much or as little force
as possible: from many starts it changes the normals of all contacts at random, by less and less,
and keeps what is better for it; for the largest force it then turns all normals, again and again,
to where the grasp is weakest along the direction that proves the force. A force beyond a bound
would be a false S or U. How far the bounds are from the adversary's forces is at most what they
give away. Contacts are two soft fingers, or two patches that are pressed at points of them, whose
normals the adversary turns each by itself.

    python scripts/validate_forces.py [--grasps 1000] [--starts 50] [--steps 30] [--seed 0]
"""

import argparse
import time
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from grasp3d import Contacts
from grasp3d._kernels.forces.grip_force import ForceResults
from grasp3d.contact import disc
from grasp3d.contact.friction_cones import tangents, tilted_normals, turned
from grasp3d.quality.force_problem import PATCH_POINTS, ForceBound, ForceProblem, pressed_at_points
from grasp3d.quality.force_ranges import force_range

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

RTOL = 1e-4
STEEPEST = 12
"""Steps in which all normals turn so that the grasp is weakest along the direction that proves the
force so far."""

QUANTILES = (0.0, 0.1, 0.25, 0.5, 0.75, 0.9, 1.0)


def unit(vectors: Floats) -> Floats:
    """Vectors (..., 3) scaled to length 1."""
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))


def random_pads(count: int, rng: np.random.Generator, *, patches: bool) -> tuple[Contacts, Floats]:
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
    torsion = 0.0 if patches else 2.0 / 3.0 * friction * radius
    patch = disc(normals, radius) if patches else None
    return Contacts(points, normals, friction, torsion, patch), np.broadcast_to(tilts, (count, 2))


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
    """An adversary of the bounds of contacts (b, n), some of which share a jaw and its bound."""

    def __init__(
        self, contacts: Contacts, tilts: Floats, wrenches: Floats, bound: ForceBound, jaw: int
    ) -> None:
        self.contacts, self.tilts, self.wrenches = contacts, tilts, wrenches
        self.bound, self.jaw = bound, jaw

    def forces(self, grasps: Ints, normals: Floats) -> ForceResults:
        """Forces of some grasps (k,) at normals (k, n, 3)."""
        some = self.contacts.take(grasps).with_normals(normals)
        if self.jaw == 1:
            problem = ForceProblem.of_contacts(some, bound=self.bound)
        else:
            problem = ForceProblem.over_tilts(some, 0.0, "sure", bound=self.bound)
            problem = replace(problem, group=self.jaw)
        return problem.of_wrenches(self.wrenches[grasps], RTOL, certified=False)

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
        jaws = (len(grasps), given.shape[1] // self.jaw, 2)
        # The contacts of a jaw start together.
        where = unit(rng.normal(size=jaws)) * np.sqrt(rng.uniform(0.3, 1.0, (*jaws[:2], 1)))
        where = np.repeat(where, self.jaw, axis=1)

        def force(where: Floats) -> Floats:
            results = self.forces(grasps, tilted(given, tilts, where))
            return sign * np.asarray(results.lower if sign > 0.0 else results.upper)

        best = force(where)
        for step in range(steps):
            radius = 0.6 * (1.0 - step / steps) + 0.02
            turn = radius * rng.normal(size=jaws).repeat(self.jaw, axis=1)
            if step % 2:
                turn = radius * rng.normal(size=where.shape)
            tried = where + turn
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


def main() -> None:
    """Print the quantiles of bounds relative to forces of the adversary."""
    parser = argparse.ArgumentParser(description=__doc__)
    for name, value in (("grasps", 1000), ("starts", 50), ("steps", 30), ("seed", 0)):
        parser.add_argument(f"--{name}", type=int, default=value)
    settings = parser.parse_args()
    table = Table(title=f"{settings.grasps} grasps of each kind, {settings.starts} starts")
    for column in ("contacts", "bound", "side", "beyond", *(f"{q:.0%}" for q in QUANTILES), "ms"):
        table.add_column(column, justify="right")
    for patches in (False, True):
        bounds: tuple[ForceBound, ...] = ("normal", "norm")
        for bound in bounds:
            rng = np.random.default_rng(settings.seed)
            contacts, tilts = random_pads(settings.grasps, rng, patches=patches)
            weights = np.zeros((settings.grasps, 6))
            weights[:, :3] = 4.9 * unit(rng.normal(size=(settings.grasps, 3)))
            force_range(contacts, weights, tilts, bound=bound)  # compiles
            start = time.perf_counter()
            found = force_range(contacts, weights, tilts, bound=bound, rtol=RTOL)
            each = 1e3 * (time.perf_counter() - start) / settings.grasps
            points = pressed_at_points(contacts, "sure") if patches else contacts
            jaw = PATCH_POINTS if patches else 1
            limits = np.repeat(tilts, jaw, axis=1)
            adversary = Attack(points, limits, weights, bound, jaw)
            for side in ("largest", "least"):
                extreme = getattr(adversary, side)(settings.starts, settings.steps, rng)
                if side == "largest":
                    beyond = extreme > found.largest
                    with np.errstate(invalid="ignore"):  # both may be infinite
                        ratio = found.largest / extreme
                else:
                    beyond = extreme < found.least
                    ratio = extreme / found.least
                ratio = ratio[np.isfinite(ratio)]
                quantiles = (f"{one:.3f}" for one in np.quantile(ratio, QUANTILES))
                kind = "patches" if patches else "soft"
                row = (kind, bound, side, str(beyond.sum()), *quantiles, f"{each:.2f}")
                table.add_row(*row)
    Console(width=140).print(table)


if __name__ == "__main__":
    main()
