"""A few normals of every vertex, for the search for multi-finger grasps.

The grasps found are evaluated afterwards with all normals of their contacts.
"""

import math

import numpy as np

from grasp3d.arrays import Floats, Ints, angles_between, unit_rows
from grasp3d.mesh import ObjectMesh

STEP = math.radians(15.0)
"""Largest angle between samples along the border of a set of normals [rad]."""


def crease_samples(mesh: ObjectMesh) -> tuple[Ints, Floats]:
    """Sample the borders and the centres of the vertices' sets of normals.

    Returns:
        (first, normals): first row of each vertex in `normals` (V + 1,); inward unit normals
        (K, 3), one where the surface is smooth.
    """
    sets = mesh.normal_sets
    several = np.flatnonzero(sets.counts > 1)
    single = np.flatnonzero((sets.counts == 1) | ((sets.counts == 0) & (sets.radii > 0.0)))
    vertex_parts, normal_parts = [single], [sets.normals[sets.start[single]]]
    polygons = several[sets.counts[several] > 2]
    vertex_parts += [polygons]
    normal_parts += [unit_rows(sets.centres[polygons])]
    for vertices, closed in ((several[sets.counts[several] == 2], False), (polygons, True)):
        some_vertices, normals = _borders(mesh, vertices, closed=closed)
        vertex_parts += [some_vertices]
        normal_parts += [normals]
    vertex, normals = np.concatenate(vertex_parts), np.concatenate(normal_parts)
    order = np.argsort(vertex, kind="stable")
    first = np.searchsorted(vertex[order], np.arange(len(mesh.vertices) + 1))
    return first.astype(np.int64), np.ascontiguousarray(normals[order])


def _borders(mesh: ObjectMesh, vertices: Ints, *, closed: bool) -> tuple[Ints, Floats]:
    """(vertex, normal) of samples along arcs, or around polygons, (m,) and (m, 3)."""
    sets = mesh.normal_sets
    counts = sets.counts[vertices]
    sides = counts if closed else np.ones_like(counts)
    vertex = np.repeat(vertices, sides)
    number = np.arange(sides.sum()) - np.repeat(np.cumsum(sides) - sides, sides)
    a = sets.normals[sets.start[vertex] + number]
    b = sets.normals[sets.start[vertex] + (number + 1) % sets.counts[vertex]]
    angles = angles_between(a, b)
    steps = np.maximum(1, np.ceil(angles / STEP - 1e-9)).astype(np.int64)
    samples = steps if closed else steps + 1  # an arc has two ends, a polygon none
    side = np.repeat(np.arange(len(vertex)), samples)
    sample = np.arange(samples.sum()) - np.repeat(np.cumsum(samples) - samples, samples)
    fraction = sample / steps[side]
    turn = angles[side]
    sine = np.maximum(np.sin(turn), 1e-300)
    left, right = np.sin((1.0 - fraction) * turn) / sine, np.sin(fraction * turn) / sine
    return vertex[side], unit_rows(left[:, None] * a[side] + right[:, None] * b[side])
