"""What speaks against the labels of a mesh, besides lengths in a wrong unit."""

import math
from collections.abc import Iterator

import numpy as np

from grasp3d.arrays import Floats, Ints
from grasp3d.diagnosis.mesh_diagnosis import MeshWarning, Trust
from grasp3d.mesh.measures import face_areas, is_closed, part_volumes, parts_of
from grasp3d.mesh.object_mesh import ObjectMesh
from grasp3d.mesh.patches import patch_areas, surface_net
from grasp3d.mesh.repair.holes import close_hole, holes_of

MISSING = 0.05
"""Share of the area that holes may take before labels say little about the object."""

CROSSED = 0.1
"""Share of the area that may cross itself before labels say little about the object."""

ROUGH = math.radians(3.0)
"""Noise of normals that is worth a warning [rad]: about a quarter of the resolution of
the paper's fingertip."""

CALM = math.radians(1.0)
"""Noise of normals that a patch is suggested for."""

LARGEST_PATCH = 0.1
"""Share of the object's size that a fingertip's patch may have to be suggested."""

BENT = 0.7
"""Length of a patch's area vector, as a share of its area, from which on it has one direction."""

PROBES = 200
"""Patches by which it is judged whether they have."""

STRAY = 0.01
"""Share of the area of parts that are strays if they make the object much larger."""

LARGER, FAR_LARGER = 1.5, 3.0
"""How much larger they make it, to be worth a warning, and to leave labels of little use."""


def inside_out_warnings(mesh: ObjectMesh) -> Iterator[MeshWarning]:
    """Tell of a surface without an inside."""
    if mesh.report.closed and math.isnan(mesh.volume):
        yield MeshWarning(
            Trust.NO, "nothing is inside the surface: no finger could press against it"
        )


def missing_fraction(points: Floats, faces: Ints) -> tuple[int, float]:
    """How many holes there are, and their share of the whole surface."""
    holes = holes_of(faces)
    lids = sum(float(face_areas(points, close_hole(points, hole)).sum()) for hole in holes)
    return len(holes), lids / (lids + float(face_areas(points, faces).sum()))


def hole_warnings(count: int, missing: float, *, closed: bool) -> Iterator[MeshWarning]:
    """Tell of holes, left open or closed by a guess."""
    if not count:
        return
    trust = Trust.NO if missing > MISSING else Trust.CARE
    share = f"{100.0 * missing:.2g} % of the surface"
    if closed:
        yield MeshWarning(trust, f"holes: {count}, closed by a guess, which is {share}")
    elif trust is Trust.NO:
        yield MeshWarning(
            trust,
            f"holes: {count}, {share}: is it a sheet that should have a thickness? Repair full "
            "(--repair full) would close them by a guess",
        )
    else:
        yield MeshWarning(
            trust,
            f"holes: {count}, {share}: grasps that would end in them are not found; repair full "
            "(--repair full) closes them",
        )


def self_intersection_warnings(count: int, share: float) -> Iterator[MeshWarning]:
    """Tell of faces that cross others."""
    if count:
        yield MeshWarning(
            Trust.NO if share > CROSSED else Trust.CARE,
            f"faces that cross others: {count:,}, {100.0 * share:.2g} % of the area: contacts "
            "there may lie inside the object",
        )


def count_parts(points: Floats, faces: Ints) -> tuple[int, int]:
    """(bodies, cavities): connected parts, and parts of a closed surface that are wound inward."""
    volumes = part_volumes(points, faces, parts_of(faces))
    solid = is_closed(faces) and (volumes > 0.0).any()
    cavities = int((volumes < 0.0).sum()) if solid else 0
    return len(volumes) - cavities, cavities


def body_warnings(bodies: int) -> Iterator[MeshWarning]:
    """Tell of bodies that do not hang together."""
    if bodies > 1:
        yield MeshWarning(
            Trust.CARE,
            f"separate bodies, {bodies}, are taken for one rigid object: a grasp may hold two of "
            "them",
        )


def stray_warnings(points: Floats, faces: Ints) -> Iterator[MeshWarning]:
    """Tell of small pieces far off, which make the object seem larger."""
    part, areas = parts_of(faces), face_areas(points, faces)
    stray = np.bincount(part, areas)[part] <= STRAY * areas.sum()
    if not stray.any() or stray.all():
        return
    whole, rest = (
        float(np.linalg.norm(np.ptp(points[chosen].reshape(-1, 3), axis=0)))
        for chosen in (faces, faces[~stray])
    )
    if whole > LARGER * rest:
        share = 100.0 * areas[stray].sum() / areas.sum()
        yield MeshWarning(
            Trust.NO if whole > FAR_LARGER * rest else Trust.CARE,
            f"stray pieces, {len(np.unique(part[stray]))}, with {share:.2g} % of the area make "
            f"the object {whole / rest:.3g} times larger: leave them out",
        )


def noise_warnings(
    points: Floats, faces: Ints, mesh: ObjectMesh, noise: float
) -> Iterator[MeshWarning]:
    """Tell that the surface is too rough for its normals, and what patch may calm them."""
    given = mesh.options.patch_radius / mesh.size
    radius = _calming_radius(points, faces, noise)
    if noise <= ROUGH or given >= radius:
        return
    message = f"normals are off by about {math.degrees(noise):.2g} degrees"
    if radius > LARGEST_PATCH or not _has_direction(points, faces, radius):
        cure = "the mesh is too rough or too coarse for a fingertip's patch: smooth or remesh it"
    else:
        digits = 1 - math.floor(math.log10(radius * mesh.size))
        rounded = math.ceil(radius * mesh.size * 10.0**digits) / 10.0**digits
        cure = f"a fingertip's patch of {rounded:g} may calm them (--patch-radius)"
        if given > 0.0:
            cure = f"the patch of {mesh.options.patch_radius:g} is small for it, {rounded:g} may do"
    yield MeshWarning(Trust.CARE, f"{message}; {cure}")


def _calming_radius(points: Floats, faces: Ints, noise: float) -> float:
    """Radius of a patch with so many vertices that independent errors average to little."""
    places = (noise / CALM) ** 2
    area = float(face_areas(points, faces).sum()) / len(np.unique(faces))
    return math.sqrt(places * area / math.pi)


def _has_direction(points: Floats, faces: Ints, radius: float) -> bool:
    """Tell whether patches of this radius are flat enough to have a normal."""
    used = np.unique(faces)
    sources = used[:: max(1, len(used) // PROBES)]
    vectors, areas = patch_areas(surface_net(points, faces), sources, radius)
    return bool(np.median(np.linalg.norm(vectors, axis=1) / areas) > BENT)
