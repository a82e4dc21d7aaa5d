"""Warnings about defects of a mesh that can make its labels wrong."""

import math
from collections.abc import Iterator

import numpy as np

from grasp3d.diagnosis.mesh_diagnosis import MeshWarning, Trust
from grasp3d.mesh.measures import face_areas, is_closed, part_volumes, parts_of
from grasp3d.mesh.object_mesh import ObjectMesh
from grasp3d.mesh.patches import patch_areas, surface_net
from grasp3d.mesh.repair.holes import close_holes, fan_area, holes_of
from grasp3d.mesh.triangles import Triangles
from grasp3d.mesh.work_bounds import WorkBoundError

MISSING = 0.05
"""Area fraction of holes above which labels cannot be trusted."""

SELF_INTERSECTING = 0.1
"""Area fraction of self-intersecting faces above which labels cannot be trusted."""

ROUGH = math.radians(3.0)
"""Noise of normals above which a warning is given [rad]: about a quarter of the tilt, alpha / 2,
of the paper's fingertip."""

SMOOTH = math.radians(1.0)
"""Noise of normals that a suggested patch radius shall reach [rad]."""

LARGEST_PATCH = 0.1
"""Largest patch radius that is suggested, as a fraction of the object's size."""

FLATNESS = 0.7
"""Least length of a patch's area vector, as a fraction of its area, for a well-defined normal."""

PROBES = 200
"""Number of patches whose flatness is measured."""

STRAY = 0.01
"""Largest area fraction of a part that counts as stray."""

LARGER, FAR_LARGER = 1.5, 3.0
"""Factors by which stray parts enlarge the object: for a warning, and for no trust in labels."""


def interior_warnings(mesh: ObjectMesh) -> Iterator[MeshWarning]:
    """Warn about a surface without an interior."""
    if mesh.report.closed and math.isnan(mesh.volume):
        yield MeshWarning(
            Trust.NO, "the surface has no interior, so that no contact can be pushed against it"
        )


def missing_fraction(surface: Triangles) -> tuple[int, float]:
    """Return the number of holes, and their area fraction of the closed surface."""
    points, holes = surface.vertices, holes_of(surface.faces)
    try:
        closing = close_holes(points, holes)
    except WorkBoundError:
        lids = sum(fan_area(points, hole) for hole in holes)
    else:
        lids = sum(float(face_areas(points, lid).sum()) for lid in closing)
    return len(holes), lids / (lids + float(surface.areas.sum()))


def hole_warnings(count: int, missing: float, *, filled: bool) -> Iterator[MeshWarning]:
    """Warn about holes, left open or filled by repair.

    Args:
        count: Number of holes.
        missing: Their area fraction.
        filled: Whether repair closed them.
    """
    if not count:
        return
    trust = Trust.NO if missing > MISSING else Trust.CARE
    area = f"{100.0 * missing:.2g} % of the surface"
    if filled:
        yield MeshWarning(trust, f"holes: {count}, {area}: closed by repair with a guessed surface")
    elif trust is Trust.NO:
        yield MeshWarning(
            trust,
            f"holes: {count}, {area}: is it a sheet that should have a thickness? Repair full "
            "(--repair full) closes them with a guessed surface",
        )
    else:
        yield MeshWarning(
            trust,
            f"holes: {count}, {area}: grasps with contacts there are not found; repair full "
            "(--repair full) closes them",
        )


def self_intersection_warnings(count: int, fraction: float) -> Iterator[MeshWarning]:
    """Warn about faces that intersect others; `fraction` is their area fraction."""
    if count:
        yield MeshWarning(
            Trust.NO if fraction > SELF_INTERSECTING else Trust.CARE,
            f"faces that intersect others: {count:,}, {100.0 * fraction:.2g} % of the area: "
            "contacts there may be inside the object",
        )


def count_parts(surface: Triangles) -> tuple[int, int]:
    """Return (bodies, cavities); cavities are parts of a closed surface oriented inward."""
    faces = surface.faces
    volumes = part_volumes(surface.vertices, faces, parts_of(faces))
    solid = is_closed(faces) and (volumes > 0.0).any()
    cavities = int((volumes < 0.0).sum()) if solid else 0
    return len(volumes) - cavities, cavities


def body_warnings(bodies: int) -> Iterator[MeshWarning]:
    """Warn about bodies that are not connected."""
    if bodies > 1:
        yield MeshWarning(
            Trust.CARE,
            f"separate bodies: {bodies}, treated as one rigid object: the contacts of a grasp may "
            "be on different bodies",
        )


def stray_warnings(surface: Triangles) -> Iterator[MeshWarning]:
    """Warn about small distant parts, which make the object larger."""
    part, areas = parts_of(surface.faces), surface.areas
    stray = np.bincount(part, areas)[part] <= STRAY * areas.sum()
    if not stray.any() or stray.all():
        return
    whole, rest = (
        float(np.linalg.norm(np.ptp(surface.vertices[chosen].reshape(-1, 3), axis=0)))
        for chosen in (surface.faces, surface.faces[~stray])
    )
    if whole > LARGER * rest:
        percent = 100.0 * areas[stray].sum() / areas.sum()
        yield MeshWarning(
            Trust.NO if whole > FAR_LARGER * rest else Trust.CARE,
            f"stray parts: {len(np.unique(part[stray]))}, {percent:.2g} % of the area: they make "
            f"the object {whole / rest:.3g} times larger; remove them",
        )


def noise_warnings(surface: Triangles, mesh: ObjectMesh, noise: float) -> Iterator[MeshWarning]:
    """Warn about inaccurate normals of a rough surface, and suggest a patch radius."""
    given = mesh.options.patch_radius / mesh.size
    radius = _smoothing_radius(surface, noise)
    if noise <= ROUGH or given >= radius:
        return
    message = (
        f"the surface is rough: its normals have errors of about {math.degrees(noise):.2g} degrees"
    )
    if radius > LARGEST_PATCH or not _has_direction(surface, radius):
        remedy = "smooth or remesh it; it is too rough or too coarse for a patch radius"
    else:
        digits = 1 - math.floor(math.log10(radius * mesh.size))
        rounded = math.ceil(radius * mesh.size * 10.0**digits) / 10.0**digits
        remedy = f"try a patch radius of {rounded:g} (--patch-radius)"
        if given > 0.0:
            remedy += f"; {mesh.options.patch_radius:g} is too small"
    yield MeshWarning(Trust.CARE, f"{message}; {remedy}")


def _smoothing_radius(surface: Triangles, noise: float) -> float:
    """Return the patch radius at which the mean of independent errors is small enough."""
    vertices = (noise / SMOOTH) ** 2
    area = float(surface.areas.sum()) / len(surface.used)
    return math.sqrt(vertices * area / math.pi)


def _has_direction(surface: Triangles, radius: float) -> bool:
    """Return whether patches of a radius are flat enough to have a normal."""
    sources = surface.used[:: max(1, len(surface.used) // PROBES)]
    vectors, areas = patch_areas(surface_net(surface), sources, radius)
    return bool(np.median(np.linalg.norm(vectors, axis=1) / areas) > FLATNESS)
