"""The jaws of a gripper and the faces of a surface between them, in the gripper's frame."""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from grasp3d._kernels.compiling import Floats1, Floats2, Floats3, kernel, merged, part
from grasp3d._kernels.surface.face_tree import GO_ON, NO_NODE, below, faces_of_leaf, walk
from grasp3d._kernels.surface.polygons import CORNERS
from grasp3d._kernels.surface.vectors import copy, copy_rows

ROUNDING = 1e-9
"""Distance, in object sizes, that counts as none: pads that only graze an edge do not touch it."""

EDGE_ON = 1e-9
"""Largest x of a face's unit normal at which it counts as parallel to x and is not touched."""


class Jaw(NamedTuple):
    """Shape of a jaw, in object sizes."""

    planes: Floats2
    """Faces of its inner side, each at x = a + b y + c z; a <= 0 is behind the foremost (m, 3)."""
    edges: Floats3
    """Sides of each face: edges[..., 0] y + edges[..., 1] z <= edges[..., 2] (m, e, 3)."""
    bounds: Floats1
    """Smallest y and z, largest y and z of all these faces (4,)."""
    radius: float
    """Radius of a round tip; 0 for a flat pad."""
    depth: float
    """Distance from the foremost to the rearmost part of the inner side."""
    thickness: float
    """Thickness of the finger behind its inner side; -inf if what lies behind is ignored."""
    compliance: float
    """Depth to which the surface may press into the jaw."""
    footprint: float
    """Depth of the surface opposite the jaw that determines the normal of a free object; 0 to use
    only what is touched."""


class Faces(NamedTuple):
    """Faces that a jaw might touch, in the first rows; see `gather`."""

    numbers: npt.NDArray[np.int64]
    """Index of each face in the mesh (F,)."""
    corners: npt.NDArray[np.float64]
    """Corners in the frame of the gripper (F, 3, 3)."""
    normals: npt.NDArray[np.float64]
    """Outward unit normals in that frame (F, 3)."""
    gathered: npt.NDArray[np.int64]
    """Scratch of `gather` (1,)."""


class Scratch(NamedTuple):
    """Scratch arrays for one jaw."""

    polygon: npt.NDArray[np.float64]
    spare: npt.NDArray[np.float64]
    mean: npt.NDArray[np.float64]
    row: npt.NDArray[np.float64]


@kernel()
def make_faces(size):
    """Allocate arrays for faces."""
    return Faces(
        np.empty(size, np.int64),
        np.empty((size, 3, 3)),
        np.empty((size, 3)),
        np.zeros(1, np.int64),
    )


@kernel()
def make_scratch():
    """Allocate the scratch arrays for one jaw."""
    return Scratch(np.empty((CORNERS, 6)), np.empty((CORNERS, 6)), np.empty(6), np.empty(6))


@kernel()
def without_back(jaw):
    """A copy of a jaw that ignores what lies behind its inner side at the start."""
    return Jaw(
        jaw.planes,
        jaw.edges,
        jaw.bounds,
        jaw.radius,
        jaw.depth,
        -math.inf,
        jaw.compliance,
        jaw.footprint,
    )


@part
def start_before(opening, width, jaw):
    """Start position for jaws, closed to a width, that close again after a small motion.

    What they have already passed is then behind them.
    """
    gap = jaw.radius if jaw.radius > 0.0 else 0.5 * jaw.thickness
    return -min(0.5 * opening, 0.5 * width + gap)


@part
def nearest(corners, side):
    """Smallest x of a triangle; at smaller positions no jaw touches it."""
    return min(side * corners[0, 0], side * corners[1, 0], side * corners[2, 0])


@part
def nearest_to(corners, side, plane):
    """Like `nearest`, for an inclined face of the jaw."""
    low = math.inf
    for c in range(3):
        x = plane[0] + plane[1] * corners[c, 1] + plane[2] * corners[c, 2]
        low = min(low, side * corners[c, 0] - x)
    return low


@part
def edge_and_normal(corners, side):
    """First edge of a triangle, and its unscaled normal."""
    ux, uy = side * (corners[1, 0] - corners[0, 0]), corners[1, 1] - corners[0, 1]
    uz = corners[1, 2] - corners[0, 2]
    vx, vy = side * (corners[2, 0] - corners[0, 0]), corners[2, 1] - corners[0, 1]
    vz = corners[2, 2] - corners[0, 2]
    return ux, uy, uz, uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx


TURNED_AWAY = 0.2
"""Largest x of a face's normal at which it may face a jaw after a small motion."""


ANYWHERE = -math.inf, math.inf, math.inf
"""A span that contains all faces; see `span_of`."""


@merged
def span_of(touches, start, margin, jaw):
    """Find the span of faces that a jaw may touch, or start in, after a small motion of the object.

    Args:
        touches: As in `Settling` (2, 7).
        start: Position from which the jaws close, as in `first_touch`.
        margin: Upper bound of the motion of any point of the faces near the jaws.
        jaw: `Jaw`.

    Returns:
        (behind, ahead of finger 1, ahead of finger 2), as positions along the x of each finger.
    """
    ahead = jaw.depth + margin
    return start - jaw.thickness - margin, touches[0, 5] + ahead, ahead - touches[1, 5]


@part
def gather(surface, tree, pose, jaw, margin, span, nodes, faces):
    """Write the faces within the height and width of the jaws.

    Args:
        surface: `Surface`.
        tree: The surface's `FaceTree`.
        pose: Rotation and translation from the gripper's frame (3, 4).
        jaw: `Jaw`.
        margin: Distance beyond the jaws' bounds within which faces are also written.
        span: As returned by `span_of`; most faces outside are left out.
        nodes: Scratch of `walk`.
        faces: Written.

    Returns:
        Number of faces.
    """
    faces.gathered[0] = 0
    walk(_gather_node, (surface, tree, pose, jaw, margin, span, faces), nodes)
    return faces.gathered[0]


@merged
def _gather_node(node, _position, _stale, state):
    """Visit a node of the tree."""
    surface, tree, pose, jaw, margin, span, faces = state
    if not _near(tree.bounds[node], pose, jaw, margin, span):
        return NO_NODE, NO_NODE, GO_ON
    first, last = faces_of_leaf(node, tree.depth, surface.faces.shape[0])
    count = faces.gathered
    for i in range(first, last):
        count[0] += _write_face(surface, tree.order[i], pose, jaw, margin, count[0], faces)
    later, sooner = below(node, tree.depth)
    return later, sooner, GO_ON


@part
def _near(ball, pose, jaw, margin, span):
    """Whether a ball reaches into the height and width of the jaws, and into their span."""
    x, y, z, reach = 0.0, 0.0, 0.0, ball[3] + margin
    for i in range(3):
        offset = ball[i] - pose[i, 3]
        x += pose[i, 0] * offset
        y += pose[i, 1] * offset
        z += pose[i, 2] * offset
    bounds, radius = jaw.bounds, ball[3] + ROUNDING
    behind = span[0] - radius
    return (
        bounds[0] - reach <= y <= bounds[2] + reach
        and bounds[1] - reach <= z <= bounds[3] + reach
        and (behind < x < span[1] + radius or behind < -x < span[2] + radius)
    )


@part
def _write_face(surface, face, pose, jaw, margin, row, faces):
    """Write a face in the gripper's frame; return whether it is within the jaws' bounds."""
    corners, normal = faces.corners[row], faces.normals[row]
    for i in range(3):
        vertex = surface.faces[face, i]
        x = surface.points[vertex, 0] - pose[0, 3]
        y = surface.points[vertex, 1] - pose[1, 3]
        z = surface.points[vertex, 2] - pose[2, 3]
        for k in range(3):
            corners[i, k] = pose[0, k] * x + pose[1, k] * y + pose[2, k] * z
    if not is_between(corners, jaw, margin):
        return False
    a, b, c = corners[0], corners[1], corners[2]
    normal[0] = (b[1] - a[1]) * (c[2] - a[2]) - (b[2] - a[2]) * (c[1] - a[1])
    normal[1] = (b[2] - a[2]) * (c[0] - a[0]) - (b[0] - a[0]) * (c[2] - a[2])
    normal[2] = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    length = math.sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2)
    for k in range(3):
        normal[k] /= length
    faces.numbers[row] = face
    return True


@part
def is_between(corners, jaw, margin):
    """Whether a triangle comes within a margin of the height and width of the jaws."""
    for k in range(1, 3):
        low = min(corners[0, k], corners[1, k], corners[2, k])
        high = max(corners[0, k], corners[1, k], corners[2, k])
        if low > jaw.bounds[1 + k] + margin or high < jaw.bounds[k - 1] - margin:
            return False
    return True


@part
def move(faces, count, motion, jaw, margin, moved):
    """Move faces with the object, and write those within the height and width of the jaws.

    Args:
        faces: `Faces`.
        count: Number of faces.
        motion: Rotation and translation in the gripper's frame (3, 4).
        jaw: `Jaw`.
        margin: Distance beyond the jaws' bounds within which faces are also written.
        moved: Written, `Faces`.

    Returns:
        Number of faces.
    """
    kept = 0
    for f in range(count):
        corners, normal = moved.corners[kept], moved.normals[kept]
        move_face(faces.corners[f], faces.normals[f], motion, 0, 3, corners, normal)
        if not is_between(corners, jaw, margin):
            continue
        moved.numbers[kept] = faces.numbers[f]
        kept += 1
    return kept


@merged
def move_face(corners, normal, motion, first, last, moved, turned):
    """Write a range of the coordinates of a face's corners and normal after a motion."""
    for k in range(first, last):
        a, b, c, d = motion[k, 0], motion[k, 1], motion[k, 2], motion[k, 3]
        for i in range(3):
            moved[i, k] = d + a * corners[i, 0] + b * corners[i, 1] + c * corners[i, 2]
        turned[k] = a * normal[0] + b * normal[1] + c * normal[2]


@part
def keep_near(faces, count, span, start, margin, jaw):
    """Keep the faces that a jaw may touch, or start in, after a small motion of the object.

    Args:
        faces: `Faces`; those kept are moved to the front.
        count: Number of faces.
        span: As returned by `span_of`.
        start: Position from which the jaws close, as in `first_touch`.
        margin: Upper bound of the motion of any point of the faces near the jaws.
        jaw: `Jaw`.

    Returns:
        Number of faces.
    """
    kept = 0
    for f in range(count):
        corners, wanted = faces.corners[f], False
        low = min(corners[0, 0], corners[1, 0], corners[2, 0])
        high = max(corners[0, 0], corners[1, 0], corners[2, 0])
        for finger in range(2):
            side = 1.0 - 2.0 * finger
            first, last = (low, high) if finger == 0 else (-high, -low)
            if last > span[0] and first < span[1 + finger]:
                ahead = first >= start - jaw.compliance + margin
                # A face ahead is met only by its front, which a turn must not hide.
                wanted |= not ahead or side * faces.normals[f, 0] < TURNED_AWAY
        if not wanted:
            continue
        if kept < f:
            _copy(faces, f, kept)
        kept += 1
    return kept


@part
def _copy(faces, source, target):
    """Copy a face to another row."""
    faces.numbers[target] = faces.numbers[source]
    copy_rows(faces.corners[source], faces.corners[target])
    copy(faces.normals[source], faces.normals[target])


@part
def put_first(faces, count, numbers):
    """Reorder the faces to begin with those with the given numbers.

    The jaws will probably touch next near what they touched last. Trying that first shows that most
    other faces are farther away.

    Args:
        faces: `Faces`.
        count: Number of faces.
        numbers: Indices in the mesh (2,).
    """
    front = 0
    for f in range(count):
        number = faces.numbers[f]
        if front < 2 and (number == numbers[0] or number == numbers[1]):
            swap(faces, f, front)
            front += 1


@part
def swap(faces, i, j):
    """Swap two faces."""
    faces.numbers[i], faces.numbers[j] = faces.numbers[j], faces.numbers[i]
    for k in range(3):
        faces.normals[i, k], faces.normals[j, k] = faces.normals[j, k], faces.normals[i, k]
        for c in range(3):
            a, b = faces.corners[i, c, k], faces.corners[j, c, k]
            faces.corners[i, c, k], faces.corners[j, c, k] = b, a


@part
def starts_inside(faces, count, side, start, jaw):
    """Whether the middle of a jaw is in the object before it moves.

    Args:
        faces: `Faces` that include all on the axis.
        count: Number of faces.
        side: +1 or -1.
        start: Position of the jaw.
        jaw: `Jaw`.
    """
    behind = jaw.radius if jaw.radius > 0.0 else jaw.compliance
    return inside(faces, count, side * (start - behind))


@part
def inside(faces, count, start):
    """Whether the point (start, 0, 0) is in the object.

    Rays along x and against it must both leave the object more often than they enter it. Hence
    nothing is inside an open surface that only one of the rays meets.

    Args:
        faces: `Faces` that include all on the axis.
        count: Number of faces.
        start: Position on the axis.
    """
    return _leaving(faces, count, 1.0, start) > 0 and _leaving(faces, count, -1.0, -start) > 0


@part
def _leaving(faces, count, side, start):
    """Number of times a ray from `start` leaves the object minus the number it enters.

    Each edge counts for only one of its faces, so that a ray through an edge or a vertex crosses
    the surface once.
    """
    total = 0
    for i in range(count):
        corners, meets = faces.corners[i], False
        for c in range(3):
            meets ^= _crosses(corners[c], corners[(c + 1) % 3])
        if not meets:
            continue
        normal, x = faces.normals[i], 0.0
        for k in range(3):
            x += normal[k] * corners[0, k]
        if normal[0] != 0.0 and side * x / normal[0] > start:
            total += 1 if side * normal[0] > 0.0 else -1
    return total


@part
def _crosses(a, b):
    """Whether an edge crosses the half-line y = 0, z > 0, seen along x."""
    if (a[1] > 0.0) == (b[1] > 0.0):
        return False
    if a[1] > 0.0:  # both faces compute with the same order of the edge's ends
        a, b = b, a
    return a[2] - a[1] * (b[2] - a[2]) / (b[1] - a[1]) > 0.0
