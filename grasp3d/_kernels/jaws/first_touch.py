"""Where a pad or round tip that moves along x touches a surface first.

Everything is in the frame of the gripper, with x multiplied by the side of the jaw (+1 finger 1,
-1 finger 2), so that both jaws move toward larger x. A *position* of a jaw is the x of its pad's
plane, or of the foremost point of its ball. Faces touch it whose outward normal has a negative x.
"""

import math

from grasp3d._kernels.compiling.decorators import kernel
from grasp3d._kernels.jaws.jaws import EDGE_ON, ROUNDING, nearest, nearest_to
from grasp3d._kernels.jaws.round_tips import ball_position
from grasp3d._kernels.surface.clipping import clip_to_polygon

ON_SIDE = 1e-9
"""Barycentric coordinate, or sine of an angle, below which features are not distinguished."""

TIED = 1e-10
"""Difference of positions, in object sizes, that rounding makes: it must not choose what is touched
of a face that lies flat on a pad."""


@kernel
def first_touch(faces, count, side, jaw, start, scratch):
    """Smallest position at which a jaw touches a face.

    Args:
        faces: The `Faces`.
        count: Number of them.
        side: +1 or -1.
        jaw: Shape of the jaw.
        start: Position from which it moves, to its mirror image.
        scratch: Memory; `row` is written: the point touched first, as a row of a polygon.

    Returns:
        (face, position): index among the faces, -1 none, -2: the jaw meets the surface at its start
        already.
    """
    found, first = -1, math.inf
    for i in range(count):
        corners, normal = faces.corners[i], faces.normals[i]
        low, facing = nearest(corners, side), side * normal[0] < -EDGE_ON
        if low >= first or (low >= start and not facing):
            continue
        meets, position, _ = touch_face(
            corners, normal, side, jaw, start, first, scratch, scratch.row
        )
        if meets:
            return -2, first
        if position < first:
            found, first = i, position
    return found, first


@kernel
def touch_face(corners, normal, side, jaw, start, first, scratch, row):
    """Position at which a jaw touches one face.

    Args:
        corners: Its corners (3, 3).
        normal: Its outward unit normal.
        side: +1 or -1.
        jaw: Shape of the jaw.
        start: Position from which it moves, to its mirror image.
        first: Position at which it touches another face. Of faces that it touches together, up to
            rounding, it is the first that counts.
        scratch: Memory.
        row: Written if it touches this face before: the point touched, as a row of a polygon.

    Returns:
        (whether the jaw meets the face at its start, position, inf: not before the other; index
        among the jaw's own faces).
    """
    found, part, facing = math.inf, 0, side * normal[0] < -EDGE_ON
    for j in range(jaw.planes.shape[0]):
        if nearest_to(corners, side, jaw.planes[j]) >= first - TIED:
            continue
        if jaw.radius > 0.0:
            meets, position = ball_position(corners, normal, side, jaw, start, scratch)
        else:
            meets, position = _pad_position(corners, side, jaw, j, start, scratch)
        if meets:
            return True, math.inf, j
        if facing and position < first - TIED and position <= ROUNDING - start:
            found, first, part = position, position, j
            row[:] = scratch.mean
    return False, found, part


@kernel
def slopes(corners, normal, part, side, jaw, position, row):
    """How the position of a jaw changes as the object that it touches moves along y and z.

    Vertices of the object slide on a face of the jaw, corners of the jaw on a face of the object,
    and edges on sides; round tips roll on what they touch.

    Args:
        corners: Corners of the face touched (3, 3).
        normal: Its outward unit normal.
        part: Face of the jaw that touches it.
        side: +1 or -1.
        jaw: Shape of the jaw.
        position: Its position.
        row: The point touched, as a row of a polygon.

    Returns:
        (d position / dy, d position / dz); along x it is `side`.
    """
    if jaw.radius > 0.0:
        x = position - jaw.radius - row[0]
        return -row[1] / x, -row[2] / x
    near, plane, edges = 0, jaw.planes[part], jaw.edges[part]
    for k in range(3):
        if row[3 + k] > 1.0 - ON_SIDE:
            return -plane[1], -plane[2]
        if row[3 + k] < row[3 + near]:
            near = k
    if row[3 + near] > ON_SIDE:  # within the object's face: a corner of the jaw
        return side * normal[1] / normal[0], side * normal[2] / normal[0]
    crossed, gap = 0, math.inf
    for e in range(edges.shape[0]):
        distance = edges[e, 2] - edges[e, 0] * row[1] - edges[e, 1] * row[2]
        if distance < gap:
            crossed, gap = e, distance
    ty, tz = -edges[crossed, 1], edges[crossed, 0]
    tx = plane[1] * ty + plane[2] * tz
    a, b = corners[(near + 1) % 3], corners[(near + 2) % 3]
    ux, uy, uz = side * (b[0] - a[0]), b[1] - a[1], b[2] - a[2]
    x = uy * tz - uz * ty
    if abs(x) <= ON_SIDE * (abs(uy) + abs(uz)):  # parallel: the edge slides on the jaw's face
        return -plane[1], -plane[2]
    return (uz * tx - ux * tz) / x, (ux * ty - uy * tx) / x


@kernel
def _pad_position(corners, side, jaw, part, start, scratch):
    """(whether the pad overlaps a face at its start, position at which it touches it, inf: never).

    The point touched is written to `scratch.mean`.
    """
    polygon, plane, edges = scratch.polygon, jaw.planes[part], jaw.edges[part]
    count = clip_to_polygon(corners, side, plane, edges, polygon, scratch.spare)
    if count < 3:
        return False, math.inf
    lowest, high = 0, -math.inf
    for i in range(count):
        high = max(high, polygon[i, 0])
        if polygon[i, 0] < polygon[lowest, 0] - TIED:
            lowest = i
    low, mean = polygon[lowest, 0], scratch.mean
    for k in range(6):
        mean[k] = polygon[lowest, k]
    mean[0] += plane[0] + plane[1] * mean[1] + plane[2] * mean[2]
    if low < start - jaw.compliance - ROUNDING:
        return high > start - jaw.thickness + ROUNDING, math.inf
    return False, low
