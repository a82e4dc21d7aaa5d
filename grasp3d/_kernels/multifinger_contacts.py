"""Where the fingers of a grasp can stand, and what a grasp must keep to."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from grasp3d._kernels.compiling import inlined, merged
from grasp3d._kernels.normal_sets import Sets
from grasp3d._kernels.surface_contacts import Surface, write_normals

NOWHERE = -1
"""Mark of a finger that has no place."""


class Ground(NamedTuple):
    """Where fingers can stand."""

    surface: Surface
    sets: Sets
    across: npt.NDArray[np.int64]
    """Face beyond the edge opposite each corner (F, 3); -1: none, or several."""
    first: npt.NDArray[np.int64]
    """First row of each vertex in `normals` (V + 1,)."""
    normals: npt.NDArray[np.float64]
    """Inward unit normals that a contact at each vertex is tried with (K, 3)."""
    around: npt.NDArray[np.int64]
    """First neighbour of each vertex in `beside` (V + 1,)."""
    beside: npt.NDArray[np.int64]
    """Vertices around each vertex."""
    on_vertices: bool
    """Fingers stand on vertices only, and a place's number is that of its vertex, not its face."""
    most: int
    """Normals that a vertex may have for a finger to be put there: all combinations are tried."""


class Pool(NamedTuple):
    """Places spread over the surface, any first ones evenly, and places of single vertices."""

    spread: int
    """How many are for all vertices; the others are for one each."""
    points: npt.NDArray[np.float64]
    """Positions (P, 3)."""
    numbers: npt.NDArray[np.int64]
    """Their faces or vertices (P,)."""
    weights: npt.NDArray[np.float64]
    """Barycentric coordinates (P, 3)."""
    normals: npt.NDArray[np.float64]
    """Inward unit normals (P, 3); not used on vertices, which may have several."""


class Rules(NamedTuple):
    """What a grasp must keep to, and how it is searched; lengths in those of `Ground`."""

    low: float
    """Smallest distance between two contacts."""
    high: float
    """Largest distance between two contacts."""
    limit: float
    """Largest critical angle that counts [rad]."""
    tolerance: float
    """Width of the bracket of a critical angle [rad]."""
    margin: float
    """By how much a critical angle must fall to count [rad]."""
    enough: float
    """Critical angle below which a grasp is not improved any more [rad]."""
    candidates: int
    """Places of the pool that a vertex tries."""
    edge: float
    """Mean length of an edge."""
    shortest: float
    """Steps shorter than this end the search."""
    helping: bool
    """Search for the best normals instead of the worst."""


@merged
def put_vertex(i, vertex, ground, trial):
    """Put contact i of a trial on a vertex; returns whether it has a normal."""
    first, points = ground.first[vertex], ground.surface.points
    count = ground.first[vertex + 1] - first
    trial.counts[i] = count
    for c in range(3):
        trial.points[i, c] = points[vertex, c]
        for k in range(count):
            trial.normals[i, k, c] = ground.normals[first + k, c]
    return count > 0


@merged
def put_in_face(i, face, weights, ground, trial, found):
    """Put contact i of a trial in a face; returns whether the surface is smooth there."""
    surface = ground.surface
    b0, b1, b2 = weights[0], weights[1], weights[2]
    count, vertex = write_normals(face, (b0, b1, b2), surface, ground.sets, found)
    v0, v1, v2 = surface.faces[face, 0], surface.faces[face, 1], surface.faces[face, 2]
    trial.counts[i] = 1
    for c in range(3):
        trial.normals[i, 0, c] = found[0, c]
        trial.points[i, c] = (
            b0 * surface.points[v0, c] + b1 * surface.points[v1, c] + b2 * surface.points[v2, c]
        )
    return count == 1 and vertex < 0


@inlined
def put(i, number, weights, ground, bench):
    """Put contact i of a trial on a face or vertex; returns whether a finger may be moved there."""
    if ground.on_vertices:
        fits = put_vertex(i, number, ground, bench.trial)
        return fits and bench.trial.counts[i] <= ground.most
    return put_in_face(i, number, weights, ground, bench.trial, bench.found)


@inlined
def put_site(i, site, ground, pool, trial):
    """Put contact i of a trial on a place of the pool."""
    if ground.on_vertices:
        return put_vertex(i, pool.numbers[site], ground, trial) and trial.counts[i] <= ground.most
    trial.counts[i] = 1
    for c in range(3):
        trial.points[i, c] = pool.points[site, c]
        trial.normals[i, 0, c] = pool.normals[site, c]
    return True


@inlined
def keeps_apart(trial, i, n, rules):
    """Whether contact i keeps its distance from the others of the first n."""
    for j in range(n):
        if j != i:
            x = trial.points[i, 0] - trial.points[j, 0]
            y = trial.points[i, 1] - trial.points[j, 1]
            z = trial.points[i, 2] - trial.points[j, 2]
            square = x * x + y * y + z * z
            if square < rules.low * rules.low or square > rules.high * rules.high:
                return False
    return True
