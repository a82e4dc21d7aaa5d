"""Contact normals: interpolated where smooth, one set per side at creases; of a soft fingertip."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from grasp3d._kernels.surface.patches import (
    REACHED,
    GeodesicMesh,
    make_front,
    measure_distances,
    patch_vectors,
    reset_front,
)
from grasp3d._kernels.surface.surface_contacts import ANY_NORMAL, order_normal_sets
from grasp3d.arrays import Bools, Floats, Ints, locked, short_repr, unit_rows
from grasp3d.errors import SettingError
from grasp3d.mesh.measures import Triangles, connected, crowded_edges, paired_edges
from grasp3d.settings import MeshOptions
from grasp3d.system.context import in_threads

HALF = 0.5
"""Length of a mean of unit normals below which it has no meaningful direction."""

SAME_DIGITS = 6
"""Unit normals at one vertex that agree to this many digits count as one."""

LARGEST_PATCH = 0.5
"""Largest radius in object sizes: a wider patch would reach around the object, where the normals
cancel."""

CANCELLED = 0.1
"""Length of a patch's area vector over its area below which it has no meaningful direction."""

MOST_VISITS = 5e9
"""Largest number of vertices of all patches together: about an hour of one processor."""

PROBES = 16
"""Patches from which the work is estimated beforehand."""

MOST_THREADS = 4
"""Most threads: each has scratch arrays as large as the mesh, and batches run many processes."""

CHUNK = 512
"""Patches that a thread sums in one call."""

STRAIGHT = math.radians(0.1)
"""Bend of an edge below which its faces are one facet [rad]."""


@dataclass(frozen=True, eq=False)
class CornerNormals:
    """Inward unit normals at the corners of the faces; corners on one smooth patch share one."""

    corners: Ints
    """Row of `normals` for each corner of each face, shape (F, 3)."""
    normals: Floats
    """Inward unit normals, shape (C, 3)."""
    vertices: Ints
    """Vertex of each normal, shape (C,)."""

    __repr__ = short_repr

    def locked(self) -> "CornerNormals":
        """A copy that cannot be changed."""
        return CornerNormals(*map(locked, (self.corners, self.normals, self.vertices)))


@dataclass(frozen=True, eq=False)
class NormalSets:
    """All normals that a contact at a vertex may have (one where smooth, a polygon at creases)."""

    start: Ints
    """First row of each vertex in `normals`, shape (V + 1,)."""
    counts: Ints
    """Corners of each polygon, shape (V,); 0 with a radius of pi: any direction."""
    normals: Floats
    """Inward unit normals, shape (K, 3)."""
    centres: Floats
    """Middle of each set, shape (V, 3)."""
    radii: Floats
    """Largest angle from the middle to a normal [rad], shape (V,); -1 without any normal."""

    __repr__ = short_repr


def corner_normals(surface: Triangles, crease_angle: float) -> CornerNormals:
    """Average the face normals around each vertex, but never across a crease.

    Faces around a vertex are one patch when they are connected by edges that bend by at most
    `crease_angle`. A patch that as a whole bends more (the tip of a cone) keeps its face normals.
    The average is weighted by the angle at the vertex, which does not depend on the tessellation.

    Args:
        surface: Faces that all have an area.
        crease_angle: Largest bend of a smooth edge [rad].
    """
    faces, flat = surface.faces, surface.normals
    one, two = surface.pairs
    smooth = surface.bends <= crease_angle + 1e-9
    patch = _patches(faces, one[smooth], two[smooth])
    face_of_corner = np.repeat(np.arange(len(faces)), 3)
    weights = surface.angles.ravel()
    sums = [np.bincount(patch, weights * flat[face_of_corner, k]) for k in range(3)]
    mean = unit_rows(np.stack(sums, axis=1).astype(np.float64))
    cosine = np.einsum("ij,ij->i", mean[patch], flat[face_of_corner])
    least = np.full(len(mean), np.inf)
    np.minimum.at(least, patch, cosine)
    bent = (least < np.cos(crease_angle) - 1e-9) | (np.linalg.norm(mean, axis=1) < HALF)
    vertex = np.zeros(len(mean), dtype=np.int64)
    vertex[patch] = faces.ravel()
    own = bent[patch]  # corners that keep their face's normal
    row = np.where(own, len(mean) + np.cumsum(own) - 1, patch)
    normals = np.concatenate([mean, flat[face_of_corner[own]]])
    vertices_of = np.concatenate([vertex, faces.ravel()[own]])
    used, row = np.unique(row, return_inverse=True)
    return CornerNormals(
        corners=row.reshape(-1, 3).astype(np.int64),
        normals=normals[used],
        vertices=vertices_of[used],
    )


def _matched_corners(faces: Ints, one: Ints, two: Ints) -> tuple[Ints, Ints]:
    """Corner numbers (3 f + i) that lie at one vertex across each pair of half-edges."""
    left = np.stack([3 * (one // 3) + (one + k) % 3 for k in (1, 2)])  # next, next but one
    right = np.stack([3 * (two // 3) + (two + k) % 3 for k in (1, 2)])
    flat = faces.ravel()
    swap = flat[left[0]] != flat[right[0]]
    right[:, swap] = right[::-1, swap]
    return left, right


def _patches(faces: Ints, one: Ints, two: Ints) -> Ints:
    """Number the patches of corners that pairs of half-edges connect at vertices, shape (3 F,)."""
    left, right = _matched_corners(faces, one, two)
    return connected(3 * len(faces), left, right)


def crease_twins(faces: Ints, corners: Ints) -> Ints:
    """Rows of the corner normals on the other side of each crease, shape (F, 3, 2).

    Entry [f, i] belongs to the edge opposite corner i of face f, its two columns to the corners
    i + 1 and i + 2; -1 where the edge is smooth or on a border, -2 where more than two faces meet.
    """
    twins = np.full((3 * len(faces), 2), -1, dtype=np.int64)
    twins[crowded_edges(faces)] = ANY_NORMAL
    one, two = paired_edges(faces)
    left, right = _matched_corners(faces, one, two)
    rows = corners.ravel()
    crease = (rows[left] != rows[right]).any(axis=0)
    one, two, left, right = one[crease], two[crease], left[:, crease], right[:, crease]
    twins[one] = rows[right].T
    # Seen from the second face the same two corners come in its own order.
    own = 3 * (two // 3) + (two + 1) % 3
    straight = own == right[0]
    twins[two] = np.where(straight[:, None], rows[left].T, rows[left[::-1]].T)
    return twins.reshape(-1, 3, 2)


def normal_sets(count: int, normals: CornerNormals) -> NormalSets:
    """Collect the distinct corner normals at each vertex into a convex polygon of normals.

    Args:
        count: Number of vertices.
        normals: The corner normals.
    """
    order = np.argsort(normals.vertices, kind="stable")
    vertex, rows = normals.vertices[order], normals.normals[order]
    distinct = _distinct(vertex, rows)
    vertex, rows = vertex[distinct], np.ascontiguousarray(rows[distinct])
    start = np.searchsorted(vertex, np.arange(count + 1)).astype(np.int64)
    counts = np.zeros(count, dtype=np.int64)
    centres = np.zeros((count, 3))
    radii = np.zeros(count)
    order_normal_sets(start, rows, counts, centres, radii)
    return NormalSets(*(locked(array) for array in (start, counts, rows, centres, radii)))


def _distinct(vertex: Ints, rows: Floats) -> Bools:
    """Mark the first of every group of equal normals at one vertex, shape (C,)."""
    mask = np.ones(len(vertex), dtype=bool)
    several = np.flatnonzero(np.bincount(vertex)[vertex] > 1)
    keys = np.column_stack([vertex[several], np.round(rows[several], SAME_DIGITS) + 0.0])
    _, first = np.unique(keys, axis=0, return_index=True)
    mask[several] = False
    mask[several[first]] = True
    return mask


def fingertip_normals(
    base: Triangles, refined: Triangles, normals: CornerNormals, options: MeshOptions, size: float
) -> tuple[CornerNormals, tuple[str, ...]]:
    """Take the contact normals of a fingertip: averaged over its patch, if it has one.

    Args:
        base: The surface before refinement, in the mesh's unit.
        refined: The surface in the normalised frame.
        normals: Its own normals.
        options: With the patch's radius; 0: the surface's own normals.
        size: The object's size in the mesh's unit.

    Returns:
        The normals, and warnings about them, one sentence each.

    Raises:
        SettingError: The patch would reach around the object, or take too long.
    """
    radius = options.patch_radius
    if radius == 0.0:
        return normals, ()
    most = LARGEST_PATCH * size
    if radius > most:
        raise SettingError(
            f"patch_radius is {radius:.4g}, but the object's size is {size:.4g}, and a fingertip's "
            f"patch must not reach around it; give at most {most:.4g}"
        )
    net = surface_net(refined)
    _check_work(net, radius, size)
    averaged = patch_normals(net, normals, radius / size)
    width = facet_width(base, options.crease_angle)
    return averaged, _warnings(radius, width, size * float(net.sides.mean()))


def patch_normals(net: GeodesicMesh, normals: CornerNormals, radius: float) -> CornerNormals:
    """Average the face normals over the patch around each vertex.

    A patch is the surface within a distance of the vertex along it: the far side of a thin plate
    does not belong to it. Faces count by their area within it, so that noise inside the patch
    cancels out, and the result does not depend on the tessellation. All corners at a vertex share
    one normal: an edge of a box is rounded, not a crease. Vertices keep the normals they have where
    the patch's normals cancel out (the rim of a thin plate, the tip of a needle), and where more
    than two faces meet at an edge, as it is undefined which of them a fingertip touches.

    Args:
        net: The surface; see `surface_net`.
        normals: Normals at the corners of its faces.
        radius: Radius of a patch along the surface, in the unit of its vertices, > 0.

    Returns:
        The normals at the same corners.
    """
    sources = np.unique(net.faces)
    vectors, areas = patch_areas(net, sources, radius)
    averaged = np.linalg.norm(vectors, axis=1) > CANCELLED * areas
    averaged &= ~_on_crowded_edges(net)[sources]
    row = np.full(_vertex_count(net), -1, dtype=np.int64)
    row[sources[averaged]] = len(normals.normals) + np.arange(averaged.sum())
    rows = np.where(row[net.faces] >= 0, row[net.faces], normals.corners)
    used, corners = np.unique(rows, return_inverse=True)
    return CornerNormals(
        corners=corners.reshape(-1, 3).astype(np.int64),
        normals=np.concatenate([normals.normals, unit_rows(vectors[averaged])])[used],
        vertices=np.concatenate([normals.vertices, sources[averaged]])[used],
    )


def patch_areas(net: GeodesicMesh, sources: Ints, radius: float) -> tuple[Floats, Floats]:
    """Sum the areas within a distance of vertices, measured along the surface.

    Args:
        net: The surface.
        sources: The vertices (n,).
        radius: The distance.

    Returns:
        Inward area vectors (n, 3) and areas (n,).
    """
    vectors, areas = np.zeros((len(sources), 3)), np.zeros(len(sources))

    def work(part: slice, front: Any) -> None:
        patch_vectors(sources[part], radius, net, front, vectors[part], areas[part])

    sizes = _vertex_count(net), len(net.faces)
    in_threads(work, len(sources), CHUNK, lambda: make_front(*sizes), most=MOST_THREADS)
    return vectors, areas


def surface_net(surface: Triangles) -> GeodesicMesh:
    """Compute what distances along a surface are measured with."""
    faces = surface.faces
    order = np.argsort(faces.ravel(), kind="stable")
    counts = np.bincount(faces.ravel(), minlength=len(surface.vertices))
    return GeodesicMesh(
        faces=np.array(faces),  # a copy: for read-only arrays kernels would be compiled once more
        sides=surface.sides,
        cosines=np.cos(surface.angles),
        sines=np.sin(surface.angles),
        areas=surface.areas,
        normals=surface.normals,
        first=np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
        around=order.astype(np.int64),
    )


def facet_width(surface: Triangles, crease_angle: float) -> float:
    """Mean width of the facets that a round surface consists of, across their bent edges.

    The height of a face over each of its edges that bend without being creases, weighted by the
    edge's length. 0 if there is none: the surface is flat between creases.

    Args:
        surface: The surface before refinement.
        crease_angle: Largest bend of a smooth edge [rad].
    """
    round_ = (surface.bends > STRAIGHT) & (surface.bends <= crease_angle)
    one, two = (half[round_] for half in surface.pairs)
    lengths = surface.sides.ravel()[one].sum()
    doubled = surface.areas[one // 3].sum() + surface.areas[two // 3].sum()  # mean of both sides
    return float(doubled / lengths) if lengths > 0.0 else 0.0


def _check_work(net: GeodesicMesh, radius: float, size: float) -> None:
    """Refuse patches that together have too many vertices, estimated from a few of them."""
    sources = np.unique(net.faces)
    probes = sources[np.linspace(0, len(sources) - 1, PROBES).astype(np.int64)]
    front = make_front(_vertex_count(net), len(net.faces))
    reached = 0
    for probe in probes:
        measure_distances(probe, radius / size, net, front)
        reached += front.sizes[REACHED]
        reset_front(front)
    each = reached / PROBES
    if each * len(sources) > MOST_VISITS:
        raise SettingError(
            f"a patch_radius of {radius:.4g} means patches of about {each:.0f} vertices around "
            f"each of {len(sources)}, which would take hours; give a smaller one, or a coarser mesh"
        )


def _warnings(radius: float, width: float, edge: float) -> tuple[str, ...]:
    """Warnings about a patch that is too small to average over several faces, one sentence each."""
    warnings = []
    if radius < width:
        warnings.append(
            f"the patch radius, {radius:.3g}, is less than the mean width of the mesh's facets, "
            f"{width:.3g}: it averages over few of them, and round parts show their facets"
        )
    if radius < edge:
        warnings.append(
            f"the patch radius, {radius:.3g}, is less than the mean edge of the refined mesh, "
            f"{edge:.3g}, along which normals are interpolated; give a max_edge of at most the "
            "radius"
        )
    return tuple(warnings)


def _vertex_count(net: GeodesicMesh) -> int:
    """Number of vertices, including those without a face."""
    return len(net.first) - 1


def _on_crowded_edges(net: GeodesicMesh) -> Bools:
    """Mask of the vertices of edges with more than two faces, shape (V,)."""
    half = crowded_edges(net.faces)
    marked = np.zeros(_vertex_count(net), dtype=bool)
    for k in (1, 2):
        marked[net.faces[half // 3, (half + k) % 3]] = True
    return marked
