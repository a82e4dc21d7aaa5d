"""The critical friction angle of two patches, in which the pressure may be centred anywhere."""

import math
from dataclasses import dataclass

import numpy as np

from grasp3d.arrays import RIGHT_ANGLE, Bools, Floats, Ints, angles_between

CHUNK = 4096
"""Grasps in memory at once."""

SHARPEST = 1e12
"""Last weight of tau against the barriers: tau is then within 1e-11 of the largest."""

SHARPER = 50.0
"""Factor between two weights."""

STEPS = 30
"""Most steps for one weight."""

CENTRED = 1e-3
"""Newton decrement, squared, at which the next weight follows."""

RIDGE = 1e-13
"""Part of the diagonal that keeps Newton's equations solvable in spite of rounding."""

BARRIERS = 9.0
"""Sum of the barriers' parameters: tau is at most this over the weight below the largest."""

NEAREST = 1e-4
"""Shortest line that counts, relative to the contacts' distance and their patches."""

DISCS = np.stack([np.diag([-1.0, -1, 0, 0, 1, 0]), np.diag([0, 0, -1.0, -1, 1, 0])])
"""Matrices of the constraints that keep the centres of pressure in the patches, (2, 6, 6)."""

NOT_BELOW = 1e-5
"""Angle below 90 degrees within which no friction angle is found [rad]."""


def best_line_angles(points: Floats, normals: Floats, patch: Floats, known: Floats) -> Floats:
    """Critical friction angles of two elliptic patches: those of the best line between them.

    Args:
        points: Middles of the patches, shape (b, 2, 3).
        normals: Inward unit normals, shape (b, 2, 3).
        patch: Semi-axes, shape (b, 2, 2, 3).
        known: The angles of point contacts [rad], which these do not exceed, shape (b,).

    Returns:
        Angles [rad], shape (b,), at most 1e-5 too large; at most pi/2 but of points.
    """
    line = points[:, 1] - points[:, 0]
    first, second = normals[:, 0], -normals[:, 1]
    middle = 0.5 * angles_between(first, second)
    arms = np.linalg.norm(patch, ord=2, axis=(-2, -1)).sum(axis=-1)  # of both patches
    length = np.linalg.norm(line, axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        turn = np.where(length > arms, np.arcsin(np.minimum(arms / length, 1.0)), math.pi)
    smallest = np.minimum(known, RIGHT_ANGLE)
    for sign in (1.0, -1.0):
        a, b = sign * first, sign * second
        nominal = np.maximum(angles_between(a, line), angles_between(b, line))
        # No line is nearer to both normals than their middle, nor turned by more than the patches.
        least = np.maximum(middle, nominal - turn)
        for rows in _chunks((least < smallest - NOT_BELOW) & (arms > 0.0)):
            angles = _Lines.of(line[rows], patch[rows], a[rows], b[rows]).least()
            smallest[rows] = np.minimum(smallest[rows], angles)
    smallest = np.where(smallest < RIGHT_ANGLE - NOT_BELOW, smallest, RIGHT_ANGLE)
    return np.where(arms > 0.0, np.minimum(smallest, known), known)


def _chunks(mask: Bools) -> list[Ints]:
    rows = np.flatnonzero(mask)
    return [rows[i : i + CHUNK] for i in range(0, len(rows), CHUNK)]


@dataclass(frozen=True, eq=False)
class _Lines:
    """The convex problem of each grasp of two contacts with patches.

    They balance each other by opposite forces along one line, through a centre of pressure in each
    patch. The least friction angle is the least over the lines d between the patches of the larger
    angle between d and a = n_1, or -n_2 = b; for fingers that push apart of -a and -b. Below 90
    degrees its cosine is the largest tau of a convex problem, with scaled lines u = s d + S y,

        a . u >= tau,  b . u >= tau,  |u| <= 1,  |(y_1, y_2)| <= s,  |(y_3, y_4)| <= s,

    d the line between the contacts and S the semi-axes of the patches. It is solved for many grasps
    at once by Newton's method with logarithmic barriers (Boyd & Vandenberghe, Convex Optimization,
    2004, ch. 11). The unknowns are x = (y_1 ... y_4, s, tau), shape (b, 6).
    """

    matrix: Floats
    """From x to u, shape (b, 3, 6)."""
    linear: Floats
    """Rows l of the constraints l . x + constant > 0, shape (b, 3, 6)."""
    a: Floats
    b: Floats

    @classmethod
    def of(cls, line: Floats, patch: Floats, a: Floats, b: Floats) -> "_Lines":
        """The problem in lengths relative to the line and the patches."""
        axes = patch * np.array([-1.0, 1.0])[:, None, None]
        vectors = np.concatenate([axes.reshape(-1, 4, 3), line[:, None]], axis=1)  # (b, 5, 3)
        size = np.linalg.norm(vectors, axis=-1).sum(axis=-1)
        matrix = np.zeros((len(line), 3, 6))
        matrix[..., :5] = np.swapaxes(vectors / size[:, None, None], 1, 2)
        linear = np.zeros((len(line), 3, 6))
        for row, normal in enumerate((a, b)):
            linear[:, row] = (normal[:, None] @ matrix)[:, 0]
            linear[:, row, 5] = -1.0
        linear[:, 2, 4] = -1.0
        return cls(matrix, linear, a, b)

    def least(self) -> Floats:
        """The larger angle of the best line with the normals [rad], shape (b,)."""
        x = np.zeros((len(self.matrix), 6))
        x[:, 4] = 0.5
        x[:, 5] = (self.linear[:, :2] @ x[..., None])[..., 0].min(axis=-1) - 1.0
        weight = 1.0
        while weight < SHARPEST:
            # Where tau cannot rise above 0 the lines shrink to nothing: these are left.
            rows = np.flatnonzero(x[:, 5] + BARRIERS / weight > NOT_BELOW)
            weight *= SHARPER
            x[rows] = self.take(rows).centred(x[rows], weight)
        lines = (self.matrix @ x[..., None])[..., 0]
        return np.maximum(angles_between(self.a, lines), angles_between(self.b, lines))

    def take(self, rows: Ints) -> "_Lines":
        """The problems of chosen grasps."""
        return _Lines(self.matrix[rows], self.linear[rows], self.a[rows], self.b[rows])

    def centred(self, x: Floats, weight: float) -> Floats:
        """The minimum of -weight tau and the barriers, from x inside them."""
        active = np.arange(len(x))
        for _ in range(STEPS):
            part = self.take(active)
            step, decrement = part.newton_step(x[active], weight)
            moving = np.isfinite(step).all(axis=-1) & (decrement > CENTRED)
            active, step = active[moving], step[moving]
            if not len(active):
                break
            part = self.take(active)
            # Half of the way to the nearest barrier at most; damped steps then converge.
            length = 1.0 / (1.0 + np.sqrt(decrement[moving]))
            length = np.where(decrement[moving] < 0.25, 1.0, length)
            for _ in range(STEPS):
                outside = ~part.inside(x[active] + length[:, None] * step)
                if not outside.any():
                    break
                length = np.where(outside, 0.5 * length, length)
            else:
                length = np.where(outside, 0.0, length)
            x[active] += length[:, None] * step
        return x

    def _constraints(self, x: Floats) -> tuple[Floats, Floats, Floats]:
        """Values (b, 6), gradients (b, 6, 6) and matrices (b, 3, 6, 6) of the quadratic ones."""
        squares = np.empty((len(x), 3, 6, 6))
        squares[:, 0] = -np.swapaxes(self.matrix, 1, 2) @ self.matrix
        squares[:, 1:] = DISCS
        products = (squares @ x[:, None, :, None])[..., 0]  # (b, 3, 6)
        linear = (self.linear @ x[..., None])[..., 0] + np.array([0.0, 0.0, 1.0 / NEAREST])
        quadratic = (products * x[:, None]).sum(axis=-1) + np.array([1.0, 0.0, 0.0])
        values = np.concatenate([linear, quadratic], axis=-1)
        return values, np.concatenate([self.linear, 2.0 * products], axis=1), squares

    def inside(self, x: Floats) -> Bools:
        """Whether x is inside all barriers, shape (b,)."""
        values, _, _ = self._constraints(x)
        return np.asarray((values > 0.0).all(axis=-1) & (x[:, 4] > 0.0))

    def newton_step(self, x: Floats, weight: float) -> tuple[Floats, Floats]:
        """Newton step (b, 6) and squared decrement (b,)."""
        values, gradients, squares = self._constraints(x)
        scaled = gradients / values[..., None]
        gradient = -scaled.sum(axis=1)
        gradient[:, 5] -= weight
        hessian = np.swapaxes(scaled, 1, 2) @ scaled
        hessian -= 2.0 * (squares / values[:, 3:, None, None]).sum(axis=1)
        # Scaled to a unit diagonal: the barriers differ by many orders of magnitude.
        scale = 1.0 / np.sqrt(np.einsum("bii->bi", hessian))
        unit = hessian * scale[:, :, None] * scale[:, None]
        unit += RIDGE * np.eye(6)
        step = -scale * np.linalg.solve(unit, (scale * gradient)[..., None])[..., 0]
        return step, -(gradient * step).sum(axis=-1)
