"""The forces that a grasp can apply at the centre of mass without any torque.

They are a slice, in three dimensions, of the grasp wrench space. A task of forces in all directions
at the centre of mass, as weight is, needs only this slice: a polytope in it has few facets where
one in six dimensions has thousands. Its boundary is found along rays, by `resist`, which also
proves that the task needs at least so much.
"""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba.core import types
from numba.extending import overload

from grasp3d._kernels.compiling import part
from grasp3d._kernels.forces.tasks import TaskInSpan, task_reach
from grasp3d._kernels.forces.wrench_resistance import RESISTED, resist
from grasp3d._kernels.hull.support_functions import SIX, WrenchSpace, support
from grasp3d._kernels.surface.vectors import copy6, dot6


class ForceSlice(NamedTuple):
    """The slice of one grasp of rank 6; coordinates are forces."""

    space: WrenchSpace
    task: TaskInSpan
    """The task in the balanced coordinates of the whole space."""
    goals: npt.NDArray[np.float64]
    """The wrenches of unit forces, in those coordinates (3, 6)."""
    size: float
    """Size of the task's forces."""
    rtol: float
    """Largest gap between the bounds of `resist`."""
    vectors: npt.NDArray[np.float64]
    """Scratch of `resist`."""
    best: npt.NDArray[np.float64]
    """Written: the direction, in balanced coordinates, with the smallest support relative to the
    task's reach so far, and that ratio (7,)."""


@part
def _boundary(slice_, u, point):
    """Where the ray along u leaves the slice; see `farthest_point`."""
    goal, best = slice_.vectors[17], slice_.best
    length = math.sqrt((u[0] * u[0] + u[1] * u[1]) + u[2] * u[2])
    for k in range(6):
        goal[k] = (
            u[0] * slice_.goals[0, k] + u[1] * slice_.goals[1, k] + u[2] * slice_.goals[2, k]
        ) / length
        point[k] = 0.0
    vectors = slice_.vectors
    status, lower, upper = resist(slice_.space, SIX, goal, slice_.rtol, vectors, vectors[:0])
    if status != RESISTED:
        return 0.0, -1, 0
    for k in range(3):
        point[k] = u[k] / (length * upper)
    # The direction v that proves the bound along this ray may prove a larger one along another.
    v = slice_.vectors[16]
    support_there = dot6(v, goal) / lower
    ratio = support_there / task_reach(slice_.task, v)
    if ratio < best[6]:
        copy6(v, best)
        best[6] = ratio
    return ratio * length * slice_.size, -1, 0


def farthest_point(space, u, point, force):
    """Farthest wrench of a `WrenchSpace` in a direction, or boundary point of a `ForceSlice`.

    As `support`. The height of a boundary point is that at which the task is proven to need the
    force, not less than the point's own; 0 where no force reaches that way.
    """
    if isinstance(space, ForceSlice):
        return _boundary(space, u, point)
    return support(space, u, point, force)


@overload(farthest_point, inline="always")
def _farthest_point(space, u, point, force):  # noqa: ARG001 - Numba matches the names
    if isinstance(space, types.NamedTuple) and space.instance_class is ForceSlice:

        def implementation(space, u, point, force):  # noqa: ARG001 - as above
            return _boundary(space, u, point)

    else:

        def implementation(space, u, point, force):
            return support(space, u, point, force)

    return implementation
