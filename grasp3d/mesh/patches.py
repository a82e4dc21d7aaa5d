"""Contact normals of a soft fingertip: face normals averaged over its contact patch."""

import math
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from grasp3d._kernels.surface.patches import (
    REACHED,
    GeodesicMesh,
    make_front,
    measure_distances,
    patch_vectors,
    reset_front,
)
from grasp3d.arrays import Bools, Floats, Ints, unit_rows
from grasp3d.errors import SettingError
from grasp3d.mesh.measures import Triangles, crowded_edges
from grasp3d.mesh.normals import CornerNormals
from grasp3d.settings import MeshOptions
from grasp3d.system.processors import available_processors

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


def fingertip_normals(
    given: Triangles,
    refined: Triangles,
    normals: CornerNormals,
    options: MeshOptions,
    size: float,
    *,
    threads: int | None = None,
) -> tuple[CornerNormals, tuple[str, ...]]:
    """Take the contact normals of a fingertip: averaged over its patch, if it has one.

    Args:
        given: The surface before refinement, in the mesh's unit.
        refined: The surface in the normalised frame.
        normals: Its own normals.
        options: With the patch's radius; 0: the surface's own normals.
        size: The object's size in the mesh's unit.
        threads: As in `patch_normals`.

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
    averaged = patch_normals(net, normals, radius / size, threads=threads)
    width = facet_width(given, options.crease_angle)
    return averaged, _warnings(radius, width, size * float(net.sides.mean()))


def patch_normals(
    net: GeodesicMesh, normals: CornerNormals, radius: float, *, threads: int | None = None
) -> CornerNormals:
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
        threads: Threads to use; None: one per processor, up to a few. The result does not depend
            on it.

    Returns:
        The normals at the same corners.
    """
    sources = np.unique(net.faces)
    vectors, areas = patch_areas(net, sources, radius, threads=threads)
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


def patch_areas(
    net: GeodesicMesh, sources: Ints, radius: float, *, threads: int | None = None
) -> tuple[Floats, Floats]:
    """Sum the areas within a distance of vertices, measured along the surface.

    Args:
        net: The surface.
        sources: The vertices (n,).
        radius: The distance.
        threads: Threads to use; None: one per processor, up to a few.

    Returns:
        Inward area vectors (n, 3) and areas (n,).
    """
    threads = min(available_processors(), MOST_THREADS) if threads is None else threads
    vectors, areas = np.zeros((len(sources), 3)), np.zeros(len(sources))
    starts = range(0, len(sources), CHUNK)

    def work(number: int) -> None:
        front = make_front(_vertex_count(net), len(net.faces))
        for start in starts[number::threads]:
            part = slice(start, start + CHUNK)
            patch_vectors(sources[part], radius, net, front, vectors[part], areas[part])

    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(work, range(threads)))
    return vectors, areas


def surface_net(surface: Triangles) -> GeodesicMesh:
    """Compute what distances along a surface are measured with."""
    faces = surface.faces
    order = np.argsort(faces.ravel(), kind="stable")
    counts = np.bincount(faces.ravel(), minlength=len(surface.vertices))
    return GeodesicMesh(
        faces=faces,
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
