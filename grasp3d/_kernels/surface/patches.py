"""Patches of a surface: the area and the area vector within a geodesic distance of a vertex.

Distances are propagated from the vertex in the order of Dijkstra's algorithm, with the update of
fast marching across each face (Novotni & Klein 2002).
"""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from grasp3d._kernels.compiling.decorators import merged, scratch_kernel

MIN_GAIN = 1e-9
"""Smallest improvement of a distance that counts, relative to the radius."""

REACHED, WAITING, MARKED = 0, 1, 2
"""Entries of `Front.sizes`."""


class GeodesicMesh(NamedTuple):
    """A surface with the lengths and angles that geodesic distances need."""

    faces: npt.NDArray[np.int64]
    """Vertices of each face (F, 3)."""
    sides: npt.NDArray[np.float64]
    """Length of the side opposite each corner (F, 3)."""
    cosines: npt.NDArray[np.float64]
    """Cosine of the angle at each corner (F, 3)."""
    sines: npt.NDArray[np.float64]
    """Sine of the angle at each corner (F, 3)."""
    areas: npt.NDArray[np.float64]
    """Areas of the faces (F,)."""
    normals: npt.NDArray[np.float64]
    """Unit normals of the faces (F, 3)."""
    first: npt.NDArray[np.int64]
    """First entry of each vertex in `around` (V + 1,)."""
    around: npt.NDArray[np.int64]
    """Corners 3 f + i at each vertex, grouped by vertex (3 F,)."""


class Front(NamedTuple):
    """The propagating front: scratch arrays for one thread, reset after each patch."""

    distances: npt.NDArray[np.float64]
    """Distance of each vertex from the source; inf: not reached (V,)."""
    heap: npt.NDArray[np.int64]
    """Binary heap of vertices whose faces must be updated, the nearest on top (V,)."""
    rows: npt.NDArray[np.int64]
    """Position of each vertex in the heap; -1: not in it (V,)."""
    reached: npt.NDArray[np.int64]
    """Vertices reached (V,)."""
    marks: npt.NDArray[np.bool_]
    """Whether each face belongs to the patch (F,)."""
    patch: npt.NDArray[np.int64]
    """Faces of the patch (F,)."""
    sizes: npt.NDArray[np.int64]
    """Number of vertices reached, of vertices in the heap, and of faces of the patch (3,)."""


def make_front(vertices: int, faces: int) -> Front:
    """Allocate the scratch arrays for a surface of so many vertices and faces."""
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
def _lower_distance(vertex, distance, gain, front):
    """Lower a vertex's distance and put it into the heap, or move it up there."""
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
    # Sift up: parents that are farther move down.
    while row > 0:
        above = (row - 1) >> 1
        other = heap[above]
        if distances[other] <= distance:
            break
        heap[row], rows[other] = other, row
        row = above
    heap[row], rows[vertex] = vertex, row


@merged
def _pop_nearest(front):
    """Remove the nearest vertex from the heap."""
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
    # Sift down the last entry from the top: nearer children move up.
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
def _distance_across_face(a, b, face, i, side, length, mesh):
    """Distance of the third corner of a face from the source, from those of corners p and q.

    Novotni & Klein 2002: a virtual source in the plane of the face, beyond the side from p to q,
    has the known distances from both. The distance is measured straight from it where that line
    crosses the side, otherwise along the edge from p.

    Args:
        a: Distance of p.
        b: Distance of q; may be inf.
        face: The face.
        i: Index of p among its corners.
        side: Length from p to q.
        length: Length from p to the third corner.
        mesh: `GeodesicMesh`.
    """
    if b == math.inf:
        return a + length
    # The virtual source lies `along` from p on the side and `below` it.
    along = 0.5 * (side + (a * a - b * b) / side)
    below = math.sqrt(max(a * a - along * along, 0.0))
    ahead, height = length * mesh.cosines[face, i], length * mesh.sines[face, i]
    crossing = along * height + ahead * below
    if 0.0 <= crossing <= side * (below + height):
        return math.sqrt((ahead - along) ** 2 + (below + height) ** 2)
    return a + length


@merged
def _squared_distance_to_side(a, b, side):
    """Squared distance of a side from the source, from the distances a and b of its ends."""
    foot = 0.5 * (side + (a * a - b * b) / side)
    if 0.0 < foot < side:
        return a * a - foot * foot
    return min(a, b) * min(a, b)


@scratch_kernel
def measure_distances(source, radius, mesh, front):
    """Measure geodesic distances of vertices from one of them.

    Dijkstra's algorithm with updates across the faces besides those along the edges. A vertex whose
    distance decreases enters the heap again, because with obtuse faces vertices are not always
    reached in the order of their final distances.

    Args:
        source: The vertex.
        radius: Faces that come nearer are added to the patch, with final distances of all corners.
        mesh: `GeodesicMesh`.
        front: `Front`; written.
    """
    faces, sides, first, around = mesh.faces, mesh.sides, mesh.first, mesh.around
    distances, sizes = front.distances, front.sizes
    square, gain, reach = radius * radius, MIN_GAIN * radius, radius
    _lower_distance(source, 0.0, gain, front)
    while sizes[WAITING] > 0:
        v = _pop_nearest(front)
        a = distances[v]
        # No waiting vertex is nearer than `a`.
        if a > reach:
            break
        for k in range(first[v], first[v + 1]):
            face = around[k] // 3
            i = around[k] - 3 * face
            j, m = (i + 1) % 3, (i + 2) % 3
            p, q = faces[face, j], faces[face, m]
            to_p, to_q, across = sides[face, m], sides[face, j], sides[face, i]
            b, c = distances[p], distances[q]
            # Both other corners, each from v and the newest distance of the other.
            _lower_distance(q, _distance_across_face(a, b, face, i, to_p, to_q, mesh), gain, front)
            c = distances[q]
            _lower_distance(p, _distance_across_face(a, c, face, i, to_q, to_p, mesh), gain, front)
            b = distances[p]
            if not front.marks[face]:
                near = min(
                    _squared_distance_to_side(a, b, to_p),
                    _squared_distance_to_side(a, c, to_q),
                    _squared_distance_to_side(b, c, across),
                )
                # `reach` grows so that the distances at all corners of the patch become final.
                if near < square:
                    front.marks[face] = True
                    front.patch[sizes[MARKED]] = face
                    sizes[MARKED] += 1
                    reach = max(reach, b, c)


@merged
def _disc_area(px, py, qx, qy, square):
    """Signed area of the disc about the origin within the triangle of the origin, p and q."""
    dx, dy = qx - px, qy - py
    length = dx * dx + dy * dy
    half = px * dx + py * dy
    root = half * half - length * (px * px + py * py - square)
    doubled = px * qy - py * qx
    # Where the side crosses the circle, sectors outside of it replace parts of the triangle.
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
def _area_within(a, b, c, face, square, mesh):
    """Area of the part of a face whose distance is below the radius.

    Between corners at distances a, b and c the square of the distance is interpolated as in the
    plane, where it is the weighted mean of theirs less the products of two weights times the square
    of the side between them. The part is then what a disc has of the triangle.
    """
    area = mesh.areas[face]
    if max(a, b, c) * max(a, b, c) <= square or area == 0.0:
        return area
    # The third corner is at (ahead, height) from the first, the (virtual) source at (x, y), in the
    # plane of the face; `disc` is the squared radius of the disc about it.
    side, left, right = mesh.sides[face, 2], mesh.sides[face, 1], mesh.sides[face, 0]
    ahead = (left * left - right * right + side * side) / (2.0 * side)
    height = 2.0 * area / side
    x = (a * a - b * b + side * side) / (2.0 * side)
    y = (left * left + a * a - c * c - 2.0 * ahead * x) / (2.0 * height)
    disc = square - a * a + x * x + y * y
    if disc <= 0.0:
        return 0.0
    part = (
        _disc_area(-x, -y, side - x, -y, disc)
        + _disc_area(side - x, -y, ahead - x, height - y, disc)
        + _disc_area(ahead - x, height - y, -x, -y, disc)
    )
    return min(max(part, 0.0), area)  # for needle-shaped faces rounding errors may exceed the area


@scratch_kernel
def patch_vectors(sources, radius, mesh, front, vectors, areas):
    """Sum the areas and the area vectors of the surface within a geodesic distance of vertices.

    Args:
        sources: The vertices (n,).
        radius: The geodesic distance.
        mesh: `GeodesicMesh`.
        front: `Front`; scratch arrays.
        vectors: Written, sum of area times unit normal (n, 3).
        areas: Written, sum of the areas (n,).
    """
    faces, sizes, distances = mesh.faces, front.sizes, front.distances
    for row in range(sources.shape[0]):
        measure_distances(sources[row], radius, mesh, front)
        x, y, z, total = 0.0, 0.0, 0.0, 0.0
        for k in range(sizes[MARKED]):
            face = front.patch[k]
            a, b, c = (
                distances[faces[face, 0]],
                distances[faces[face, 1]],
                distances[faces[face, 2]],
            )
            area = _area_within(a, b, c, face, radius * radius, mesh)
            x += area * mesh.normals[face, 0]
            y += area * mesh.normals[face, 1]
            z += area * mesh.normals[face, 2]
            total += area
        vectors[row, 0], vectors[row, 1], vectors[row, 2] = x, y, z
        areas[row] = total
        reset_front(front)


@scratch_kernel
def reset_front(front):
    """Reset the scratch arrays, in a time proportional to the patch, not to the mesh."""
    for k in range(front.sizes[REACHED]):
        front.distances[front.reached[k]] = math.inf
    for k in range(front.sizes[WAITING]):
        front.rows[front.heap[k]] = -1
    for k in range(front.sizes[MARKED]):
        front.marks[front.patch[k]] = False
    for k in range(3):
        front.sizes[k] = 0
