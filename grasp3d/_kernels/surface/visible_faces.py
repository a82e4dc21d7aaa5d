"""Pictures of surfaces by a buffer of depths (z-buffer), for workers without OpenGL."""

import math

import numpy as np

from grasp3d._kernels.compiling import kernel, merged

FINE = 2
"""Samples of a pixel in each direction."""

HIDDEN = -1
"""In place of a face where there is none."""

ON_EDGE = -1e-9
"""Least weight of a corner at which a sample belongs to a face, so that no sample falls between
two of them by rounding."""


@merged
def _twice_area(positions, a, b, c):
    """Twice the area of a face in the picture; negative if it is seen from behind."""
    ux, uy = positions[0, b] - positions[0, a], positions[1, b] - positions[1, a]
    vx, vy = positions[0, c] - positions[0, a], positions[1, c] - positions[1, a]
    return ux * vy - uy * vx


@merged
def _weights(positions, a, b, c, factor, x, y):
    """Weights of a face's corners at a point of the picture; `factor` is 1 over twice its area."""
    ax, ay = positions[0, a] - x, positions[1, a] - y
    bx, by = positions[0, b] - x, positions[1, b] - y
    cx, cy = positions[0, c] - x, positions[1, c] - y
    u, v, w = bx * cy - by * cx, cx * ay - cy * ax, ax * by - ay * bx
    return factor * u, factor * v, factor * w


@merged
def _samples_within(low, high, count):
    """First sample of a row or column between two coordinates, and the one after the last."""
    return max(0, math.ceil(FINE * low - 0.5)), min(count, math.floor(FINE * high - 0.5) + 1)


@merged
def _keep_highest(positions, faces, f, both_sides, heights, visible):
    """Enter a face into the samples of which it is the highest so far."""
    a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
    area = _twice_area(positions, a, b, c)
    if area == 0.0 or (area < 0.0 and not both_sides):
        return
    xa, xb, xc = positions[0, a], positions[0, b], positions[0, c]
    ya, yb, yc = positions[1, a], positions[1, b], positions[1, c]
    left, right = _samples_within(min(xa, xb, xc), max(xa, xb, xc), visible.shape[1])
    low, high = _samples_within(min(ya, yb, yc), max(ya, yb, yc), visible.shape[0])
    factor = 1.0 / area
    for row in range(low, high):
        for column in range(left, right):
            x, y = (column + 0.5) / FINE, (row + 0.5) / FINE
            u, v, w = _weights(positions, a, b, c, factor, x, y)
            if min(u, v, w) >= ON_EDGE:
                height = u * positions[2, a] + v * positions[2, b] + w * positions[2, c]
                if height > heights[row, column]:
                    heights[row, column], visible[row, column] = height, f


@merged
def _brightness(lighting, corners, f, u, v, w, ambient):
    """Brightness of a point of a face, both sides of which are lit, from 0 to 1."""
    p, q, r = corners[f, 0], corners[f, 1], corners[f, 2]
    light = u * lighting[p, 0] + v * lighting[q, 0] + w * lighting[r, 0]
    if u * lighting[p, 1] + v * lighting[q, 1] + w * lighting[r, 1] < 0.0:
        light = -light
    return ambient + (1.0 - ambient) * max(light, 0.0)


@kernel("Floats2, FixedInts2, Bytes1, FixedInts2, Floats2, bool, Floats2, float, Floats3")
def draw_surface(positions, faces, codes, corners, lighting, both_sides, palette, ambient, picture):
    """Add the colours of a surface, as seen from above, to a picture.

    Args:
        positions: Of the vertices, in pixels from the lower left corner, and heights (3, V).
        faces: Vertices of each face, counter-clockwise where it faces the viewer (F, 3).
        codes: Number of each vertex's colour (V,); a point has that of the nearest corner.
        corners: Row of `lighting` of each corner of each face (F, 3).
        lighting: Components of outward normals towards the light and the viewer (C, 2).
        both_sides: Whether faces are seen from behind as well.
        palette: The colours, from 0 to 1 (n, 3).
        ambient: Brightness of what turns away from the light.
        picture: Sums of colours and coverage of the pixels, written (H, W, 4); the lowest row
            first.
    """
    rows, columns = FINE * picture.shape[0], FINE * picture.shape[1]
    heights = np.full((rows, columns), -math.inf)
    visible = np.full((rows, columns), HIDDEN, dtype=np.int64)
    for f in range(faces.shape[0]):
        _keep_highest(positions, faces, f, both_sides, heights, visible)
    for row in range(rows):
        for column in range(columns):
            f = visible[row, column]
            if f == HIDDEN:
                continue
            a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
            x, y = (column + 0.5) / FINE, (row + 0.5) / FINE
            factor = 1.0 / _twice_area(positions, a, b, c)
            u, v, w = _weights(positions, a, b, c, factor, x, y)
            code = codes[a if u >= max(v, w) else b if v >= w else c]
            light = _brightness(lighting, corners, f, u, v, w, ambient) / FINE**2
            pixel = picture[row // FINE, column // FINE]
            for k in range(3):
                pixel[k] += light * palette[code, k]
            pixel[3] += 1.0 / FINE**2
