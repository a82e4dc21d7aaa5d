"""A few normals of every vertex, for a search that is settled exactly afterwards."""

import math

import numpy as np

from grasp3d.arrays import Floats, Ints, unit_rows
from grasp3d.mesh import ObjectMesh
from grasp3d.quality.critical_angle import angles_between

STEP = math.radians(15.0)
"""Largest angle between samples along the border of a set of normals."""


def crease_samples(mesh: ObjectMesh) -> tuple[Ints, Floats]:
    """Sample the borders and the middles of the vertices' sets of normals.

    Returns:
        (first, normals): first row of each vertex in `normals` (V + 1,); inward unit normals
        (K, 3), one where the surface is smooth.
    """
    sets = mesh.normal_sets
    several = np.flatnonzero(sets.counts > 1)
    single = np.flatnonzero((sets.counts == 1) | ((sets.counts == 0) & (sets.radii > 0.0)))
    owners, rows = [single], [sets.normals[sets.start[single]]]
    polygons = several[sets.counts[several] > 2]
    owners += [polygons]
    rows += [unit_rows(sets.centres[polygons])]
    for vertices, closed in ((several[sets.counts[several] == 2], False), (polygons, True)):
        own, normals = _borders(mesh, vertices, closed=closed)
        owners += [own]
        rows += [normals]
    owner, normals = np.concatenate(owners), np.concatenate(rows)
    order = np.argsort(owner, kind="stable")
    first = np.searchsorted(owner[order], np.arange(len(mesh.vertices) + 1))
    return first.astype(np.int64), np.ascontiguousarray(normals[order])


def _borders(mesh: ObjectMesh, vertices: Ints, *, closed: bool) -> tuple[Ints, Floats]:
    """(vertex, normal) of samples along arcs, or around polygons, (m,) and (m, 3)."""
    sets = mesh.normal_sets
    counts = sets.counts[vertices]
    sides = counts if closed else np.ones_like(counts)
    owner = np.repeat(vertices, sides)
    number = np.arange(sides.sum()) - np.repeat(np.cumsum(sides) - sides, sides)
    a = sets.normals[sets.start[owner] + number]
    b = sets.normals[sets.start[owner] + (number + 1) % sets.counts[owner]]
    angles = angles_between(a, b)
    steps = np.maximum(1, np.ceil(angles / STEP - 1e-9)).astype(np.int64)
    samples = steps if closed else steps + 1  # an arc has an end of its own
    side = np.repeat(np.arange(len(owner)), samples)
    share = (np.arange(samples.sum()) - np.repeat(np.cumsum(samples) - samples, samples)) / steps[
        side
    ]
    turn = angles[side]
    sine = np.maximum(np.sin(turn), 1e-300)
    left, right = np.sin((1.0 - share) * turn) / sine, np.sin(share * turn) / sine
    return owner[side], unit_rows(left[:, None] * a[side] + right[:, None] * b[side])
