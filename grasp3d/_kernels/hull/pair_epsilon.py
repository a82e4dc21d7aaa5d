"""Epsilon of two hard fingers with circular cones, by branch and bound over one angle.

The families of directions of `pair_sides` have three parameters; for a given angle psi the other
two have a maximum with proof (`cap_maximum`). So intervals of psi are divided until none can hold a
direction that matters: a bound of an interval exceeds its value by the square of its width.
"""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from grasp3d._kernels.compiling.decorators import merged, part, scratch_kernel
from grasp3d._kernels.hull.cap_maximum import largest_on_cap, value_at
from grasp3d._kernels.hull.growing_hull import CONVERGED
from grasp3d._kernels.hull.pair_sides import (
    aligned_side,
    combined,
    is_long,
    line_frame,
    point_of,
    ray_at,
    side_of,
    square_of_direction,
    triple,
    write_direction,
)
from grasp3d._kernels.hull.support_functions import PER_FINGER
from grasp3d._kernels.surface.vectors import cross, dot

FIRST_INTERVALS = 6
"""Intervals of psi at the start."""

MOST_PARTS = 8
"""Most parts in which an interval is divided at once."""

MAX_INTERVALS = 30_000
"""Intervals after which a pair is left to the growing hull."""

CLEAR_ANGLE = 1e-6
"""Angle between the line of the contacts and the rim of a friction cone [rad] from which force
closure is sure in spite of rounding."""

ROUNDING = 1e-14
"""Relative error of the bounds by rounding."""

RANK = 5
"""Dimension of the wrenches of two hard fingers: none is a torque about their line."""

SMALLEST_FRICTION = 1e-6
"""Least tangential component of a force on the rim of a cone; below, the rank may be less."""


class PairScratch(NamedTuple):
    """Scratch of one thread."""

    intervals: npt.NDArray[np.float64]
    """Stack of intervals: middle, half width, bound and value (k, 4)."""
    best: npt.NDArray[np.float64]
    """The best direction: value, front, g (3), v (2), e (2); and the multiplier
    of `largest_on_cap` last found; (10,)."""
    starts: npt.NDArray[np.int64]
    """Where the intervals of each side start in the stack (2,)."""


def make_pair_scratch() -> PairScratch:
    """Allocate scratch for any number of pairs."""
    return PairScratch(np.zeros((512, 4)), np.zeros(10), np.zeros(2, dtype=np.int64))


@merged
def _keep(best, value, front, g, v1, v2, e1, e2):
    """Remember a direction that is better than all before."""
    if value > best[0]:
        best[0], best[1] = value, front
        best[2], best[3], best[4] = g
        best[5], best[6], best[7], best[8] = v1, v2, e1, e2


@part
def _examined(side, front, per_finger, cosine, sine, reduction, factor, best):
    """(bound, value) of |u|^2 for an interval of psi, and in its middle.

    inf as bound where rays of the outer cone never arrive. The value is 0 where it is not needed,
    since the bound decides the interval; otherwise `best` is updated.
    """
    bound, g = 0.0, side.normal
    for outer in (True, False):
        arrives, v1, v2, a1, a2 = ray_at(side, cosine, sine, reduction if outer else 1.0)
        if not arrives:
            bound = math.inf
            continue
        e1, e2 = (0.0, 0.0) if per_finger else (a1, a2)
        matrix, q, rest = square_of_direction(side, v1, v2, e1, e2)
        most, enough = -math.inf, factor * best[0] - rest
        if side.cosine < 1.0 and (outer or bound == math.inf):
            most, m, g = largest_on_cap(matrix, q, side.normal, side.cosine, best[9], enough)
            best[9] = m
        here = rest + value_at(matrix, q, g)
        alone = 0.0
        if per_finger:  # the front may see 0
            _, _, alone = square_of_direction(side, v1, v2, a1, a2)
        if outer:
            bound = max(most + rest, here, alone)
            if bound <= factor * best[0]:
                break
        else:
            _keep(best, here, front, g, v1, v2, e1, e2)
            _keep(best, alone, front, (0.0, 0.0, 0.0), v1, v2, a1, a2)
            return bound, max(here, alone)
    return bound, 0.0


@merged
def _divided(side, front, per_finger, middle, half, parts, factor, scratch, size, largest):
    """Examine the parts of an interval, and stack those that are not decided.

    Returns:
        (size of the stack, largest bound of decided intervals).
    """
    intervals, best = scratch.intervals, scratch.best
    narrow = half / parts
    reduction, turn_cosine, turn_sine = (
        math.cos(narrow),
        math.cos(2.0 * narrow),
        math.sin(2.0 * narrow),
    )
    psi = middle - half + narrow
    cosine, sine = math.cos(psi), math.sin(psi)
    for _ in range(parts):
        bound, value = _examined(side, front, per_finger, cosine, sine, reduction, factor, best)
        if bound <= factor * best[0]:
            largest = max(largest, bound)
        else:
            row = intervals[size]
            row[0], row[1], row[2], row[3] = psi, narrow, bound, value
            size += 1
        psi += 2.0 * narrow
        cosine, sine = (
            cosine * turn_cosine - sine * turn_sine,
            sine * turn_cosine + cosine * turn_sine,
        )
    return size, largest


@merged
def _parts(bound, value, goal):
    """In how many parts an interval is divided, as bounds approach values by the square."""
    if bound == math.inf or value >= goal:
        return np.int64(2)
    parts = math.ceil(math.sqrt((bound - value) / (goal - value)))
    return np.int64(min(max(parts, 2), MOST_PARTS))


@part
def _searched(side, front, per_finger, factor, first, size, largest, scratch):
    """Divide the stacked intervals of a side; (whether all are decided, largest bound)."""
    intervals, best = scratch.intervals, scratch.best
    count = 0
    while size > first:
        size -= 1
        middle, half, bound, value = intervals[size]
        goal = factor * best[0]
        if bound <= goal:
            largest = max(largest, bound)
            continue
        parts = _parts(bound, value, goal)
        count += parts
        if count > MAX_INTERVALS or size + parts > intervals.shape[0]:
            return False, largest
        size, largest = _divided(
            side, front, per_finger, middle, half, parts, factor, scratch, size, largest
        )
    return True, largest


@part
def _nearly_symmetric(sides, angles, spherical, per_finger, factor, scratch):
    """(largest bound of |u|^2, whether that is near enough) where a pair is nearly symmetric.

    A cone holds that about the line whose half-angle is less by the normal's angle to it, and a
    centre of mass a from the line changes epsilon by at most the factor (a + sqrt(a^2 + 4)) / 2
    (see `quality.uncertain_epsilon`). About the line all psi are alike.
    """
    best, largest = scratch.best, 0.0
    for f in range(2):
        front, back = angles[f], angles[1 - f]
        aligned = aligned_side(sides[f], front[1] - front[0], back[1] - back[0], spherical)
        best[0] = 0.0  # only the bound is of use
        bound, _ = _examined(aligned, 0.0, per_finger, 1.0, 0.0, 1.0, 1.0, best)
        largest = max(largest, bound)
    best[0] = 0.0
    for f in range(2):
        _examined(sides[f], 1.0 * f, per_finger, 1.0, 0.0, 1.0, 1.0, best)
    stretch = 0.5 * (sides[0].arm + math.sqrt(sides[0].arm * sides[0].arm + 4.0))
    largest *= stretch * stretch
    return largest, largest <= factor * best[0]


@merged
def _angle_between(a, b):
    x = cross(a, b)
    return math.atan2(math.sqrt(dot(x, x)), dot(a, b))


@merged
def _placed(d, normal, cone):
    """(angle from d to a normal, half-angle of the cone about it) [rad]."""
    return _angle_between(normal, d), math.atan2(cone[1], cone[0])


@merged
def _is_regular(form, angles):
    """Whether the families of directions in `pair_sides` are all there are."""
    kind, spherical, _, _ = form
    one, two = angles[0][0] + angles[0][1], angles[1][0] + angles[1][1]
    if kind == PER_FINGER:
        return max(one, two) < 0.5 * math.pi - CLEAR_ANGLE
    return not spherical or one + two < math.pi - CLEAR_ANGLE


@part
def _separated(frames, points, normals, cones, spherical, direction):
    """Write a direction (6,) in which no wrench has a positive component; whether there is one.

    Where neither sense of the line lies in one of the cones, what that contact sees may be across
    the line, on the side away from its normal, and the other sees nothing. Where the cones of both
    hold the same sense, each sees its reversed normal.
    """
    zero = (0.0, 0.0)
    for f in range(2):
        frame = frames[f]
        side = side_of(frame, points, normals, cones, spherical, f)
        n, b = side.normal, side.back
        across = math.sqrt(n[1] * n[1] + n[2] * n[2])
        rim = math.atan2(cones[f, 1], cones[f, 0])
        if math.atan2(across, n[0]) - rim > CLEAR_ANGLE:
            g = (0.0, -n[1] / across, -n[2] / across)
            write_direction(side, frame, g, zero, zero, direction)
            return True
        if f == 0:
            angle = math.atan2(math.sqrt(b[1] * b[1] + b[2] * b[2]), b[0])
            if math.atan2(cones[1, 1], cones[1, 0]) - angle > CLEAR_ANGLE:
                g = (-1.0, -n[1] / n[0], -n[2] / n[0])
                write_direction(side, frame, g, zero, (-b[1] / b[0], -b[2] / b[0]), direction)
                return True
    return False


@merged
def _largest_square(sides, angles, spherical, per_finger, factor, scratch):
    """(whether it was found, bound of the largest |u|^2); `scratch.best` holds the best u."""
    asymmetry = sides[0].arm + max(
        angles[0][0] / math.tan(angles[0][1]), angles[1][0] / math.tan(angles[1][1])
    )
    if asymmetry < 0.5 * (factor - 1.0):
        largest, near = _nearly_symmetric(sides, angles, spherical, per_finger, factor, scratch)
        if near:
            return True, largest
    scratch.best[0], size, largest, done = 0.0, np.int64(0), 0.0, True
    parts = np.int64(FIRST_INTERVALS)
    for f in range(2):
        scratch.starts[f] = size
        size, largest = _divided(
            sides[f], 1.0 * f, per_finger, 0.0, math.pi, parts, factor, scratch, size, largest
        )
    for f in range(1, -1, -1):
        first = scratch.starts[f]
        if done:
            done, largest = _searched(
                sides[f], 1.0 * f, per_finger, factor, first, size, largest, scratch
            )
            size = first
    return done, largest


@part
def _epsilon(form, frames, points, normals, cones, angles, rtol, scratch, direction):
    """(whether it was found, lower, upper) of one force-closed pair; writes its direction (6,)."""
    kind, spherical, _, _ = form
    per_finger, best = kind == PER_FINGER, scratch.best
    best[9] = 0.0
    sides = (
        side_of(frames[0], points, normals, cones, spherical, np.int64(0)),
        side_of(frames[1], points, normals, cones, spherical, np.int64(1)),
    )
    factor = 1.0 / ((1.0 - rtol) * (1.0 - rtol))
    done, largest = _largest_square(sides, angles, spherical, per_finger, factor, scratch)
    if not done:
        return False, 0.0, 0.0
    f = int(best[1])
    write_direction(
        sides[f], frames[f], triple(best[2:5]), (best[5], best[6]), (best[7], best[8]), direction
    )
    largest = max(best[0], largest)
    return True, (1.0 - ROUNDING) / math.sqrt(largest), (1.0 + ROUNDING) / math.sqrt(best[0])


@merged
def _write_equilibrium(spherical, axes, d, forces):
    """Write the components along the contacts' axes of opposite forces along the line.

    Their bounded sizes, lengths or normal components, add up to 1 as on the hull of the wrenches.
    """
    total = 2.0
    if not spherical:
        total = dot(triple(axes[0, 0]), d) - dot(triple(axes[1, 0]), d)
    for i in range(2):
        size = (1.0 if i == 0 else -1.0) / total
        for k in range(3):
            forces[i, k] = size * dot(triple(axes[i, k]), d)
        forces[i, 3] = 0.0


@scratch_kernel
def pair_epsilons(form, wrenches, tangential, cones, rtol, scratch, results, left):
    """Epsilon of pairs of hard fingers with circular cones, where it is clear whether they close.

    Args:
        form: As in `wrench_problem.epsilons`.
        wrenches: Axes of the contacts (b, 2, 4, 6).
        tangential: As in `wrench_problem.epsilons` (b, 2).
        cones: As in `WrenchSpace` (b, 2, 2).
        rtol: Largest gap between the bounds, relative to the upper one.
        scratch: `PairScratch`.
        results: `Results`.
        left: Written, whether a pair is left to the growing hull (b,).
    """
    for g in range(wrenches.shape[0]):
        left[g] = True
        axes = wrenches[g]
        points = (point_of(axes[0]), point_of(axes[1]))
        normals = (triple(axes[0, 0]), triple(axes[1, 0]))
        frames = (
            line_frame(points[0], points[1], normals[0]),
            line_frame(points[1], points[0], normals[1]),
        )
        if not (
            is_long(points, frames[0][4])
            and min(tangential[g, 0], tangential[g, 1]) > SMALLEST_FRICTION
            and min(cones[g, 0, 0], cones[g, 1, 0]) > 0.0
        ):
            continue
        d = frames[0][0]
        back = combined(-1.0, d, 0.0, d)
        angles = (_placed(d, normals[0], cones[g, 0]), _placed(back, normals[1], cones[g, 1]))
        inside = min(angles[0][1] - angles[0][0], angles[1][1] - angles[1][0])
        closed, lower, upper = inside > CLEAR_ANGLE, 0.0, 0.0
        if closed and _is_regular(form, angles):
            found, lower, upper = _epsilon(
                form, frames, points, normals, cones[g], angles, rtol, scratch,
                results.direction[g],
            )  # fmt: skip
        else:
            found = inside < -CLEAR_ANGLE and _separated(
                frames, points, normals, cones[g], form[1], results.direction[g]
            )
        if not found:
            continue
        left[g] = False
        results.lower[g], results.upper[g] = min(lower, upper), upper
        results.rank[g], results.status[g], results.closed[g] = RANK, CONVERGED, closed
        if closed:
            results.slack[g] = 0.0
            _write_equilibrium(form[1], axes, d, results.forces[g])
