"""Meshes of spheres, cylinders and cones, and polylines around them."""

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pyvista

from grasp3d.arrays import Floats, Ints, unit_rows
from grasp3d.contact.friction_cones import tangents

ROUND = 40
"""Corners of a circle."""

RINGS = 9
"""Circles of latitude of a sphere, without its poles."""


@dataclass(frozen=True, eq=False)
class TriangleMesh:
    """Triangles, counter-clockwise from outside."""

    points: Floats
    """Shape (n, 3)."""
    faces: Ints
    """Shape (m, 3)."""

    def data(self) -> pyvista.PolyData:
        """The triangles as VTK data."""
        data: pyvista.PolyData = pyvista.PolyData.from_regular_faces(
            self.points, self.faces.astype(int)
        )
        return data


def merged(*solids: TriangleMesh) -> TriangleMesh:
    """Merge several meshes."""
    starts = np.cumsum([0, *(len(one.points) for one in solids)])
    faces = [one.faces + start for one, start in zip(solids, starts, strict=False)]
    return TriangleMesh(
        np.concatenate([np.empty((0, 3)), *(one.points for one in solids)]),
        np.concatenate([np.empty((0, 3), dtype=int), *faces]),
    )


def spheres(centres: Floats, radius: float) -> TriangleMesh:
    """Spheres about points (n, 3)."""
    up = np.tile([0.0, 0.0, 1.0], (len(centres), 1))
    return _copies(SPHERE, centres, up, radius, np.full(len(centres), radius))


def cylinders(starts: Floats, ends: Floats, radius: float) -> TriangleMesh:
    """Closed cylinders between points, both of shape (n, 3)."""
    return _copies(CYLINDER, starts, *_axes(starts, ends, radius))


def cone_surfaces(apexes: Floats, axes: Floats, angle: float, length: float) -> TriangleMesh:
    """Open lateral surfaces of cones.

    Args:
        apexes: Apexes of the cones, shape (n, 3).
        axes: Unit vectors along which they open, shape (n, 3).
        angle: Half-angle [rad], below pi.
        length: Length of the sides.
    """
    heights = np.full(len(apexes), length * math.cos(angle))
    return _copies(CONE_SURFACE, apexes, axes, length * math.sin(angle), heights)


def solid_cones(starts: Floats, ends: Floats, radius: float) -> TriangleMesh:
    """Closed cones with base centres and tips at points, both of shape (n, 3)."""
    return _copies(CONE, starts, *_axes(starts, ends, radius))


def cone_rims(apexes: Floats, axes: Floats, angle: float, length: float) -> Floats:
    """Circles at the open ends of `cone_surfaces`, shape (n, ROUND, 3)."""
    middles = apexes + length * math.cos(angle) * axes
    return _circles(middles, axes, length * math.sin(angle))


def lines(paths: list[Floats]) -> pyvista.PolyData:
    """Polylines along paths of shape (k, 3) each."""
    data = pyvista.PolyData()
    if paths:
        ends = np.cumsum([len(path) for path in paths])
        data.points = np.concatenate(paths)
        data.lines = np.concatenate(
            [
                np.r_[len(path), np.arange(end - len(path), end)]
                for path, end in zip(paths, ends, strict=True)
            ]
        )
    return data


def closed(circles: Floats) -> list[Floats]:
    """Closed paths around circles (n, k, 3)."""
    return list(np.concatenate([circles, circles[:, :1]], axis=1))


def _axes(starts: Floats, ends: Floats, radius: float) -> tuple[Floats, float, Floats]:
    """Axes, radius and heights of solids between points."""
    along = ends - starts
    return unit_rows(along), radius, np.linalg.norm(along, axis=1)


def _circles(centres: Floats, axes: Floats, radius: float) -> Floats:
    """Circles about points, shape (n, ROUND, 3), counter-clockwise about the axes."""
    first, second = tangents(axes)
    around = CIRCLE[:, :1] * first[:, None] + CIRCLE[:, 1:] * second[:, None]
    return np.asarray(centres[:, None] + radius * around)


def _copies(
    shape: TriangleMesh, origins: Floats, axes: Floats, radius: float, heights: Floats
) -> TriangleMesh:
    """Copies of a solid of radius and height 1 about the z-axis, at points (n, 3) along axes."""
    first, second = tangents(axes)
    x, y, z = shape.points.T[..., None]
    flat = radius * (x * first[:, None] + y * second[:, None])
    points = origins[:, None] + flat + z * (heights[:, None] * axes)[:, None]
    starts = len(shape.points) * np.arange(len(origins))[:, None, None]
    return TriangleMesh(points.reshape(-1, 3), (starts + shape.faces).reshape(-1, 3))


def _revolved(outline: list[tuple[float, float]]) -> TriangleMesh:
    """Revolve an outline, radius and height of its corners from below, about the z-axis."""
    circles = [np.c_[radius * CIRCLE, np.full(ROUND, height)] for radius, height in outline]
    here = np.arange(ROUND)
    after = (here + 1) % ROUND
    faces = []
    for row, ((low, _), (high, _)) in enumerate(pairwise(outline)):
        a, b = row * ROUND + here, row * ROUND + after
        if low > 0.0:
            faces.append(np.stack([a, b, b + ROUND], axis=1))
        if high > 0.0:
            faces.append(np.stack([a, b + ROUND, a + ROUND], axis=1))
    return TriangleMesh(np.concatenate(circles), np.concatenate(faces))


_LATITUDES = [math.pi * (ring / (RINGS + 1) - 0.5) for ring in range(1, RINGS + 1)]
_LONGITUDES = np.linspace(0.0, 2.0 * math.pi, ROUND, endpoint=False)
CIRCLE = np.stack([np.cos(_LONGITUDES), np.sin(_LONGITUDES)], axis=1)
SPHERE = _revolved([(0.0, -1.0), *((math.cos(a), math.sin(a)) for a in _LATITUDES), (0.0, 1.0)])
CYLINDER = _revolved([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])
CONE_SURFACE = _revolved([(0.0, 0.0), (1.0, 1.0)])
CONE = _revolved([(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)])
