"""Balls, rods and cones, many in one mesh; and the lines about them."""

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
"""Circles of a ball, its poles left out."""


@dataclass(frozen=True, eq=False)
class Solid:
    """Triangles, counter-clockwise from outside."""

    points: Floats
    """Shape (n, 3)."""
    faces: Ints
    """Shape (m, 3)."""

    def data(self) -> pyvista.PolyData:
        """The same for VTK."""
        made: pyvista.PolyData = pyvista.PolyData.from_regular_faces(
            self.points, self.faces.astype(int)
        )
        return made


def merged(*solids: Solid) -> Solid:
    """Put solids into one."""
    starts = np.cumsum([0, *(len(one.points) for one in solids)])
    faces = [one.faces + start for one, start in zip(solids, starts, strict=False)]
    return Solid(
        np.concatenate([np.empty((0, 3)), *(one.points for one in solids)]),
        np.concatenate([np.empty((0, 3), dtype=int), *faces]),
    )


def balls(centres: Floats, radius: float) -> Solid:
    """A ball about each place, shape (n, 3)."""
    up = np.tile([0.0, 0.0, 1.0], (len(centres), 1))
    return _placed(BALL, centres, up, radius, np.full(len(centres), radius))


def rods(starts: Floats, ends: Floats, radius: float) -> Solid:
    """A round rod from each place to another, both of shape (n, 3), closed at its ends."""
    return _placed(ROD, starts, *_ways(starts, ends, radius))


def tips(apexes: Floats, axes: Floats, angle: float, length: float) -> Solid:
    """The open mantle of a cone at each place, shape (n, 3).

    Args:
        apexes: Where they begin.
        axes: Unit vectors along which they open, shape (n, 3).
        angle: From the axis to the mantle [rad], below a half turn.
        length: Of the mantle's lines.
    """
    heights = np.full(len(apexes), length * math.cos(angle))
    return _placed(MANTLE, apexes, axes, length * math.sin(angle), heights)


def spikes(starts: Floats, ends: Floats, radius: float) -> Solid:
    """A closed cone from a disc about each place to a tip, both of shape (n, 3)."""
    return _placed(SPIKE, starts, *_ways(starts, ends, radius))


def rims(apexes: Floats, axes: Floats, angle: float, length: float) -> Floats:
    """Circles in which the mantles of `tips` end, shape (n, ROUND, 3)."""
    middles = apexes + length * math.cos(angle) * axes
    return _circles(middles, axes, length * math.sin(angle))


def lines(paths: list[Floats]) -> pyvista.PolyData:
    """Draw along paths, each of shape (k, 3)."""
    made = pyvista.PolyData()
    if paths:
        ends = np.cumsum([len(path) for path in paths])
        made.points = np.concatenate(paths)
        made.lines = np.concatenate(
            [
                np.r_[len(path), np.arange(end - len(path), end)]
                for path, end in zip(paths, ends, strict=True)
            ]
        )
    return made


def closed(circles: Floats) -> list[Floats]:
    """Paths all the way round circles (n, k, 3)."""
    return list(np.concatenate([circles, circles[:, :1]], axis=1))


def _ways(starts: Floats, ends: Floats, radius: float) -> tuple[Floats, float, Floats]:
    """Axes, radius and lengths of what leads from places to others."""
    along = ends - starts
    return unit_rows(along), radius, np.linalg.norm(along, axis=1)


def _circles(centres: Floats, axes: Floats, radius: float) -> Floats:
    """Circles about places, shape (n, ROUND, 3), counter-clockwise seen from where axes point."""
    first, second = tangents(axes)
    around = CIRCLE[:, :1] * first[:, None] + CIRCLE[:, 1:] * second[:, None]
    return np.asarray(centres[:, None] + radius * around)


def _placed(shape: Solid, origins: Floats, axes: Floats, radius: float, heights: Floats) -> Solid:
    """Copies of a shape of radius and height 1 about the z-axis, from places (n, 3) along axes."""
    first, second = tangents(axes)
    x, y, z = shape.points.T[..., None]
    flat = radius * (x * first[:, None] + y * second[:, None])
    points = origins[:, None] + flat + z * (heights[:, None] * axes)[:, None]
    starts = len(shape.points) * np.arange(len(origins))[:, None, None]
    return Solid(points.reshape(-1, 3), (starts + shape.faces).reshape(-1, 3))


def _turned(outline: list[tuple[float, float]]) -> Solid:
    """Turn an outline, radius and height of its corners from below, about the z-axis."""
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
    return Solid(np.concatenate(circles), np.concatenate(faces))


_RISES = [math.pi * (ring / (RINGS + 1) - 0.5) for ring in range(1, RINGS + 1)]
_TURNS = np.linspace(0.0, 2.0 * math.pi, ROUND, endpoint=False)
CIRCLE = np.stack([np.cos(_TURNS), np.sin(_TURNS)], axis=1)
BALL = _turned([(0.0, -1.0), *((math.cos(a), math.sin(a)) for a in _RISES), (0.0, 1.0)])
ROD = _turned([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])
MANTLE = _turned([(0.0, 0.0), (1.0, 1.0)])
SPIKE = _turned([(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)])
