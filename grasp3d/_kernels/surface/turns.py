"""What a location error does to the contacts of a grasp, as a search takes it.

The line between two contacts turns, and so do their normals: see `nearby_normals`, whose exact
values are known at the points of a lattice on each face.
"""

import math
from typing import NamedTuple

import numpy as np

from grasp3d._kernels.array_types import FixedFloats1, FixedInts1
from grasp3d._kernels.compiling import merged
from grasp3d.arrays import locked


class Turns(NamedTuple):
    """Turns of the contacts of a surface as a search takes them: known at points of a lattice."""

    error: float
    """Location errors of two contacts together, as lengths of the surface; 0: places are exact."""
    vertices: FixedFloats1
    """Turn at each vertex [rad] (V,)."""
    levels: FixedInts1
    """Parts of the edges of each face (F,)."""
    start: FixedInts1
    """First value of each face (F,)."""
    values: FixedFloats1
    """Turns on faces [rad] (K,); on a face of n parts, for j = 0 to n and i = 0 to n - j, at the
    place with i / n and j / n as its second and third barycentric coordinate."""
    least: FixedFloats1
    """Least turn on each face [rad] (F,)."""


NONE, NOWHERE = locked(np.zeros(0)), locked(np.zeros(0, dtype=np.int64))
EXACT = Turns(0.0, NONE, NOWHERE, NOWHERE, NONE, NONE)
"""Places are exact."""


@merged
def lattice_row(i, j, parts):
    """Row of a point of a lattice among those of its face; see `Turns`."""
    return j * (parts + 1) - j * (j - 1) // 2 + i


@merged
def turn_at_vertex(v, turns):
    """Turn of a contact at a vertex [rad]."""
    return turns.vertices[v] if turns.error > 0.0 else 0.0


@merged
def turn_on_face(face, weights, turns):
    """Turn of a contact on a face [rad]: the largest of the three nearest ones that are known."""
    if not turns.error > 0.0:
        return 0.0
    parts, first = turns.levels[face], turns.start[face]
    x, y = parts * weights[1], parts * weights[2]
    i = min(max(int(x), 0), parts - 1)
    j = min(max(int(y), 0), parts - 1 - i)
    values = turns.values
    one = values[first + lattice_row(i + 1, j, parts)]
    two = values[first + lattice_row(i, j + 1, parts)]
    if x - i + y - j <= 1.0 or i + j + 2 > parts:
        return max(one, two, values[first + lattice_row(i, j, parts)])
    return max(one, two, values[first + lattice_row(i + 1, j + 1, parts)])


@merged
def least_turn(faces, turns):
    """Least turn of contacts on some faces [rad]."""
    if not turns.error > 0.0:
        return 0.0
    least = math.pi
    for i in range(faces.shape[0]):
        least = min(least, turns.least[faces[i]])
    return least


@merged
def line_turn(opening, turns):
    """Angle by which the line between two contacts may turn [rad]: its ends are not exact."""
    return math.asin(min(turns.error / opening, 1.0)) if turns.error > 0.0 else 0.0
