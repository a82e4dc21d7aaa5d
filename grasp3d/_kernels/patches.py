"""The surface around a vertex, out to a distance along it: its area and its area vector."""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from grasp3d._kernels.compiling import merged, scratch_kernel

GAIN = 1e-9
"""Share of the radius by which a distance must fall to count."""

REACHED, WAITING, MARKED = 0, 1, 2
"""What `Front.sizes` counts."""


class Net(NamedTuple):
    """A surface, as distances along it are measured."""

    faces: npt.NDArray[np.int64]
    """Vertices of each face (F, 3)."""
    sides: npt.NDArray[np.float64]
    """Length of the side opposite each corner (F, 3)."""
    cosines: npt.NDArray[np.float64]
    """Of the angle at each corner (F, 3)."""
    sines: npt.NDArray[np.float64]
    """Of these angles (F, 3)."""
    areas: npt.NDArray[np.float64]
    """Areas of the faces (F,)."""
    normals: npt.NDArray[np.float64]
    """Unit normals of the faces (F, 3)."""
    first: npt.NDArray[np.int64]
    """First entry of each vertex in `around` (V + 1,)."""
    around: npt.NDArray[np.int64]
    """Corners 3 f + i that lie at the vertices (3 F,)."""


class Front(NamedTuple):
    """Scratch for one thread; between two patches it is as `make_front` left it."""

    distances: npt.NDArray[np.float64]
    """From the source; inf: not reached (V,)."""
    heap: npt.NDArray[np.int64]
    """Vertices whose faces wait to be looked at, the nearest on top (V,)."""
    rows: npt.NDArray[np.int64]
    """Where each vertex is in the heap; -1: it is not (V,)."""
    reached: npt.NDArray[np.int64]
    """Vertices reached (V,)."""
    marks: npt.NDArray[np.bool_]
    """Tells the faces of the patch (F,)."""
    patch: npt.NDArray[np.int64]
    """These faces (F,)."""
    sizes: npt.NDArray[np.int64]
    """How many vertices are reached, and wait, and how many faces are marked (3,)."""


def make_front(vertices: int, faces: int) -> Front:
    """Allocate scratch for a surface of so many vertices and faces."""
    return Front(
        distances=np.full(vertices, math.inf),
        heap=np.zeros(vertices, dtype=np.int64),
        rows=np.full(vertices, -1, dtype=np.int64),
        reached=np.zeros(vertices, dtype=np.int64),
        marks=np.zeros(faces, dtype=np.bool_),
        patch=np.zeros(faces, dtype=np.int64),
        sizes=np.zeros(3, dtype=np.int64),
    )


@merged
def _lower(vertex, distance, gain, front):
    """Take a shorter way to a vertex, which then waits in the heap."""
    distances, heap, rows, sizes = front.distances, front.heap, front.rows, front.sizes
    if not distance < distances[vertex] - gain:
        return
    if distances[vertex] == math.inf:
        front.reached[sizes[REACHED]] = vertex
        sizes[REACHED] += 1
    distances[vertex] = distance
    row = rows[vertex]
    if row < 0:
        row = sizes[WAITING]
        sizes[WAITING] += 1
    while row > 0:
        above = (row - 1) >> 1
        other = heap[above]
        if distances[other] <= distance:
            break
        heap[row], rows[other] = other, row
        row = above
    heap[row], rows[vertex] = vertex, row


@merged
def _nearest(front):
    """Take the nearest of the waiting vertices from the heap."""
    distances, heap, rows, sizes = front.distances, front.heap, front.rows, front.sizes
    top = heap[0]
    rows[top] = -1
    sizes[WAITING] -= 1
    size = sizes[WAITING]
    if size == 0:
        return top
    last = heap[size]
    distance = distances[last]
    row = 0
    while 2 * row + 1 < size:
        below = 2 * row + 1
        if below + 1 < size and distances[heap[below + 1]] < distances[heap[below]]:
            below += 1
        other = heap[below]
        if distance <= distances[other]:
            break
        heap[row], rows[other] = other, row
        row = below
    heap[row], rows[last] = last, row
    return top


@merged
def _way(a, b, face, i, side, length, net):
    """Distance of a corner of a face, from those of the other two.

    Novotni & Klein 2002: the source is laid into the plane of the face, beyond the side from p to
    q, where it has its distances from both. Straight from there, if the way crosses that side, or
    else along the edge from p.

    Args:
        a: Distance of p.
        b: Distance of q; may be inf.
        face: The face.
        i: Which of its corners p is.
        side: Length from p to q.
        length: Length from p to the third corner.
        net: `Net`.
    """
    if b == math.inf:
        return a + length
    along = 0.5 * (side + (a * a - b * b) / side)
    below = math.sqrt(max(a * a - along * along, 0.0))
    ahead, height = length * net.cosines[face, i], length * net.sines[face, i]
    crossing = along * height + ahead * below
    if 0.0 <= crossing <= side * (below + height):
        return math.sqrt((ahead - along) ** 2 + (below + height) ** 2)
    return a + length


@merged
def _square(a, b, side):
    """Square of the distance of a side from the source, whose distances from its ends are known."""
    foot = 0.5 * (side + (a * a - b * b) / side)
    if 0.0 < foot < side:
        return a * a - foot * foot
    return min(a, b) * min(a, b)


@scratch_kernel
def spread(source, radius, net, front):
    """Measure the distances of vertices from one of them, along the surface.

    Dijkstra's algorithm, with ways across the faces besides those along the edges. A vertex that is
    reached by a shorter way waits again, so that obtuse faces do no harm.

    Args:
        source: The vertex.
        radius: Faces that come nearer are marked, and the distances of all their corners settled.
        net: `Net`.
        front: `Front`; written.
    """
    faces, sides, first, around = net.faces, net.sides, net.first, net.around
    distances, sizes = front.distances, front.sizes
    square, gain, reach = radius * radius, GAIN * radius, radius
    _lower(source, 0.0, gain, front)
    while sizes[WAITING] > 0:
        v = _nearest(front)
        a = distances[v]
        if a > reach:
            break
        for k in range(first[v], first[v + 1]):
            face = around[k] // 3
            i = around[k] - 3 * face
            j, m = (i + 1) % 3, (i + 2) % 3
            p, q = faces[face, j], faces[face, m]
            to_p, to_q, across = sides[face, m], sides[face, j], sides[face, i]
            b, c = distances[p], distances[q]
            _lower(q, _way(a, b, face, i, to_p, to_q, net), gain, front)
            c = distances[q]
            _lower(p, _way(a, c, face, i, to_q, to_p, net), gain, front)
            b = distances[p]
            if not front.marks[face]:
                near = min(_square(a, b, to_p), _square(a, c, to_q), _square(b, c, across))
                if near < square:
                    front.marks[face] = True
                    front.patch[sizes[MARKED]] = face
                    sizes[MARKED] += 1
                    reach = max(reach, b, c)


@merged
def _slice(px, py, qx, qy, square):
    """Signed area of the disc about the origin within the triangle of the origin, p and q."""
    dx, dy = qx - px, qy - py
    length = dx * dx + dy * dy
    half = px * dx + py * dy
    root = half * half - length * (px * px + py * py - square)
    doubled = px * qy - py * qx
    if root > 0.0:
        root = math.sqrt(root)
        enter, leave = max((-half - root) / length, 0.0), min((root - half) / length, 1.0)
        if enter < leave:
            total = doubled * (leave - enter)
            if enter > 0.0:
                x, y = px + enter * dx, py + enter * dy
                total += square * math.atan2(doubled * enter, px * x + py * y)
            if leave < 1.0:
                x, y = px + leave * dx, py + leave * dy
                total += square * math.atan2(doubled * (1.0 - leave), x * qx + y * qy)
            return 0.5 * total
    return 0.5 * square * math.atan2(doubled, px * qx + py * qy)


@merged
def _area_within(a, b, c, face, square, net):
    """Area of the part of a face whose distance is below the radius.

    Between corners at distances a, b and c the square of the distance is interpolated as in the
    plane, where it is the weighted mean of theirs less the products of two weights times the square
    of the side between them. The part is then what a disc has of the triangle.
    """
    area = net.areas[face]
    if max(a, b, c) * max(a, b, c) <= square or area == 0.0:
        return area
    side, left, right = net.sides[face, 2], net.sides[face, 1], net.sides[face, 0]
    ahead = (left * left - right * right + side * side) / (2.0 * side)
    height = 2.0 * area / side
    x = (a * a - b * b + side * side) / (2.0 * side)
    y = (left * left + a * a - c * c - 2.0 * ahead * x) / (2.0 * height)
    disc = square - a * a + x * x + y * y
    if disc <= 0.0:
        return 0.0
    part = (
        _slice(-x, -y, side - x, -y, disc)
        + _slice(side - x, -y, ahead - x, height - y, disc)
        + _slice(ahead - x, height - y, -x, -y, disc)
    )
    return min(max(part, 0.0), area)  # of a needle rounding may leave anything


@scratch_kernel
def patch_vectors(sources, radius, net, front, vectors, areas):
    """Sum the area vectors of the surface around vertices, out to a distance along it.

    Args:
        sources: The vertices (n,).
        radius: The distance.
        net: `Net`.
        front: `Front`, scratch.
        vectors: Written, areas times unit normals, summed (n, 3).
        areas: Written, areas summed (n,).
    """
    faces, sizes, distances = net.faces, front.sizes, front.distances
    for row in range(sources.shape[0]):
        spread(sources[row], radius, net, front)
        x, y, z, total = 0.0, 0.0, 0.0, 0.0
        for k in range(sizes[MARKED]):
            face = front.patch[k]
            a, b, c = (
                distances[faces[face, 0]],
                distances[faces[face, 1]],
                distances[faces[face, 2]],
            )
            area = _area_within(a, b, c, face, radius * radius, net)
            x += area * net.normals[face, 0]
            y += area * net.normals[face, 1]
            z += area * net.normals[face, 2]
            total += area
        vectors[row, 0], vectors[row, 1], vectors[row, 2] = x, y, z
        areas[row] = total
        clear(front)


@scratch_kernel
def clear(front):
    """Forget what was reached, in a time that grows with the patch, not with the mesh."""
    for k in range(front.sizes[REACHED]):
        front.distances[front.reached[k]] = math.inf
    for k in range(front.sizes[WAITING]):
        front.rows[front.heap[k]] = -1
    for k in range(front.sizes[MARKED]):
        front.marks[front.patch[k]] = False
    for k in range(3):
        front.sizes[k] = 0
