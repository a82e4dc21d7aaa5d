"""Diagnosis of meshes, before and after repair: defects, and whether labels can be trusted."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Literal

import numpy as np

from grasp3d.arrays import Floats, Ints, first_at_position, unit_rows
from grasp3d.mesh.cleaning import holes_of, is_face
from grasp3d.mesh.measures import (
    Triangles,
    center_and_volume,
    edge_counts,
    is_closed,
    part_volumes,
    parts_of,
)
from grasp3d.mesh.normals import CornerNormals, corner_normals
from grasp3d.mesh.object_mesh import ObjectMesh
from grasp3d.mesh.plausible_lengths import length_warnings
from grasp3d.mesh.plausible_units import UnitGuess, guess_unit
from grasp3d.mesh.preparing import MeshSource, prepare
from grasp3d.mesh.repair import RepairStep
from grasp3d.mesh.surface_points import crossing_faces
from grasp3d.settings import GivenModel, GivenSampling, GraspModel, MeshOptions, Sampling
from grasp3d.settings.sampling import Cost, labelling_cost
from grasp3d.settings.units import Unit
from grasp3d.system.context import available_processors

MISSING = 0.05
"""Area fraction of holes above which labels cannot be trusted."""

SELF_INTERSECTING = 0.1
"""Area fraction of self-intersecting faces above which labels cannot be trusted."""

ROUGH = math.radians(3.0)
"""Noise of normals above which a warning is given [rad]: about a quarter of the tilt, alpha / 2,
of the paper's fingertip."""

CREASES = np.radians([(30.0, 1.5), (60.0, 5.0), (180.0, math.inf)])
"""Crease angles to try, each with the largest noise that bends no edge by that much [rad]."""

SCALE = 1.15
"""Ratio of the normals' median error to their median deviation from their neighbours' mean: errors
of neighbours, which share vertices, cancel in part. Measured 1.0 to 1.25 on spheres, cylinders and
tori of even and uneven triangles."""

FLAT = 1e-3
"""Determinant of the second moments of a vertex's neighbours, relative to their mean distance,
below which they are collinear."""


class Trust(StrEnum):
    """Whether labels of a mesh can be trusted."""

    YES = "yes"
    CARE = "with care"
    """Some labels may be wrong; the warnings give the reasons."""
    NO = "no"
    """Many labels may be wrong."""


@dataclass(frozen=True)
class MeshWarning:
    """A defect of a mesh that can make its labels wrong."""

    trust: Trust
    """Whether labels can be trusted despite the defect."""
    message: str
    """The defect and its remedy, in one sentence."""


@dataclass(frozen=True)
class SurfaceMeasures:
    """Counts, area, volume and centre of mass of a surface."""

    vertices: int
    """Vertices that faces use; vertices at equal positions count once."""
    faces: int
    closed: bool
    """Every edge is used equally often in both directions: the faces enclose a volume."""
    boundary_edges: int
    """Edges with one face: the boundaries of holes."""
    crowded_edges: int
    """Edges with more than two faces, where the surface is not a manifold."""
    area: float
    volume: float | None
    """Enclosed volume, negative if the faces are oriented inward; None: the surface is open."""
    center_mass: tuple[float, float, float]
    """Centre of mass at uniform density; of an open surface, the centroid of its area."""


@dataclass(frozen=True)
class MeshDiagnosis:
    """Diagnosis of a mesh; lengths are in metres, or as in the file if its unit is not known."""

    mesh: str
    """Name of the file, the type of another library's object, or 'arrays'."""
    format: str
    """File suffix without its dot, in lower case; else the other library, or 'arrays'."""
    file_bytes: int | None
    """Size of the file; None: the mesh is not from a file."""
    file_unit: Unit | None
    """Unit of the file's coordinates, stated by the file or the user; None: not stated."""
    unit: Literal["m"] | None
    """Unit of the lengths here: metres, or None where that of the file is not known."""
    guess: UnitGuess
    """Unit that the size suggests; never applied."""
    size: float
    """Diameter of the ball around the surface."""
    extents: tuple[float, float, float]
    """Edge lengths of the axis-aligned bounding box."""
    bodies: int
    """Connected parts after repair, without cavities."""
    before: SurfaceMeasures
    """The surface as it was given."""
    after: SurfaceMeasures
    """The surface after repair, before long edges are divided."""
    repairs: tuple[RepairStep, ...]
    crossing_faces: int
    """Faces that certainly intersect others; faces that only touch are not counted."""
    noise: float
    """Median error of contact normals due to the roughness of the surface [rad]."""
    label_vertices: int
    """Number of vertices to label, after long edges are divided."""
    cost: Cost
    """Expected time and memory of labelling."""
    warnings: tuple[MeshWarning, ...]
    """Defects that can make its labels wrong."""

    @property
    def trust(self) -> Trust:
        """Whether its labels can be trusted: the lowest trust of all warnings."""
        return max(
            (warning.trust for warning in self.warnings), key=list(Trust).index, default=Trust.YES
        )


def check_mesh(
    source: MeshSource,
    *,
    model: GivenModel = None,
    sampling: GivenSampling = None,
    options: MeshOptions | None = None,
    force: bool = False,
    **fields: Any,
) -> MeshDiagnosis:
    """Diagnose a mesh before labelling: defects, repairs, and the cost of labelling.

    Args:
        source: A path, or an object as in `load_mesh`. An `ObjectMesh`, which is repaired already,
            is diagnosed as it is.
        model: Model for labelling; used for the cost, and to find lengths in a wrong unit.
        sampling: Settings of the grasp search; used in the same way.
        options: How the mesh is read and prepared; None: the defaults.
        force: Lower the trust to 'with care' only, if a length is implausible for the object.
        fields: Fields of `MeshOptions` that differ from `options`, as in `load_mesh`.

    Returns:
        Measures before and after repair, warnings, whether labels can be trusted, and the time and
        memory that labelling takes.

    Raises:
        MeshError: The mesh cannot be read, for the same reasons as in `load_mesh`.
        SettingError: An option is outside its range.

    Example:
        A box of which one of twelve faces is missing:

        >>> import trimesh
        >>> import grasp3d
        >>> box = trimesh.creation.box([0.1, 0.06, 0.04])
        >>> found = grasp3d.check_mesh((box.vertices, box.faces[1:]), unit="m")
        >>> found.before.closed, found.after.closed, found.trust.value
        (False, False, 'with care')
        >>> print(found.warnings[1].message)
        holes: 1, ...: grasps with contacts there are not found; repair full (--repair full) ...
    """
    own = source.options if isinstance(source, ObjectMesh) else None
    options = MeshOptions.of(options or own, fields)
    model = GraspModel.given("model", model) or GraspModel()
    sampling = Sampling.given("sampling", sampling) or Sampling()
    mesh, repaired, given = prepare(source, options)
    mesh.check_units(model, sampling)
    scale = mesh.file_scale
    surface = Triangles((scale * repaired.vertices - mesh.center) / mesh.size, repaired.faces)
    given_points = (scale * given.vertices - mesh.center) / mesh.size
    joined = first_at_position(given.vertices)  # vertices at equal positions count once
    crossing, bodies, noise = crossing_faces(surface), _count_bodies(surface), normal_noise(surface)
    meant = Trust.CARE if force else Trust.NO
    low, high = (
        getattr(repaired.vertices[repaired.faces], end)(axis=(0, 1)) for end in ("min", "max")
    )
    center = mesh.center_mass / mesh.file_scale
    is_outside = options.center_of_mass is None and not ((low <= center) & (center <= high)).all()
    has_none = repaired.closed and math.isnan(mesh.volume)
    inside = Trust.NO if has_none or is_outside else Trust.CARE
    warnings = (
        *(MeshWarning(inside, message) for message in mesh.report.warnings),
        *_warnings(surface, crossing, bodies, noise),
        *(MeshWarning(meant, message) for message in length_warnings(mesh, model, sampling)),
    )
    extents = np.ptp(repaired.vertices[repaired.faces].reshape(-1, 3), axis=0)
    return MeshDiagnosis(
        mesh=given.name,
        format=given.format,
        file_bytes=given.path.stat().st_size if given.path else None,
        file_unit=mesh.file_unit,
        unit=mesh.unit,
        guess=guess_unit(mesh.options.scale * float(extents.max())),
        size=mesh.size,
        extents=tuple((scale * extents).tolist()),
        bodies=bodies,
        before=_measure(Triangles(given_points, joined[given.faces]), mesh),
        after=_measure(surface, mesh),
        repairs=repaired.steps,
        crossing_faces=len(crossing),
        noise=noise,
        label_vertices=len(mesh.vertices),
        cost=labelling_cost(len(mesh.vertices), model, sampling, threads=available_processors()),
        warnings=warnings,
    )


def _measure(surface: Triangles, mesh: ObjectMesh) -> SurfaceMeasures:
    """Measure a surface in the mesh's normalised frame."""
    proper = Triangles(surface.vertices, surface.faces[is_face(surface.faces)])
    center, volume = center_and_volume(proper)
    boundary, crowded = edge_counts(proper.faces)
    x, y, z = mesh.from_normalized(center).tolist()
    return SurfaceMeasures(
        vertices=len(proper.used),
        faces=len(surface.faces),
        closed=not math.isnan(volume),
        boundary_edges=boundary,
        crowded_edges=crowded,
        area=float(proper.areas.sum()) * mesh.size**2,
        volume=None if math.isnan(volume) else volume * mesh.size**3,
        center_mass=(x, y, z),
    )


def _count_bodies(surface: Triangles) -> int:
    """Number of connected parts, without cavities: parts of a closed surface oriented inward."""
    volumes = part_volumes(surface.vertices, surface.faces, parts_of(surface.faces))
    is_solid = is_closed(surface.faces) and (volumes > 0.0).any()
    return int((volumes >= 0.0).sum()) if is_solid else len(volumes)


def _warnings(
    surface: Triangles, crossing: Ints, bodies: int, noise: float
) -> Iterator[MeshWarning]:
    """Warn about holes, intersecting faces, separate bodies and inaccurate normals."""
    holes, area = holes_of(surface.faces), float(surface.areas.sum())
    if holes:
        rings = [surface.vertices[hole] - surface.vertices[hole].mean(axis=0) for hole in holes]
        fans = (np.cross(ring, np.roll(ring, -1, axis=0)) for ring in rings)
        lids = sum(0.5 * float(np.linalg.norm(fan, axis=1).sum()) for fan in fans)
        missing = lids / (lids + area)
        yield MeshWarning(
            Trust.NO if missing > MISSING else Trust.CARE,
            f"holes: {len(holes)}, {100.0 * missing:.2g} % of the surface: grasps with contacts "
            "there are not found; repair full (--repair full) closes them with a guess",
        )
    if len(crossing):
        fraction = float(surface.areas[crossing].sum()) / area
        yield MeshWarning(
            Trust.NO if fraction > SELF_INTERSECTING else Trust.CARE,
            f"faces that intersect others: {len(crossing):,}, {100.0 * fraction:.2g} % of the "
            "area: contacts there may be inside the object",
        )
    if bodies > 1:
        yield MeshWarning(
            Trust.CARE,
            f"separate bodies: {bodies}, treated as one rigid object: the contacts of a grasp may "
            "be on different bodies; remove those that are not part of the object",
        )
    if noise > ROUGH:
        yield MeshWarning(
            Trust.CARE,
            "the surface is rough: its normals have errors of about "
            f"{math.degrees(noise):.2g} degrees; smooth it, or add twice that to the sensor "
            "resolution (--sensor-resolution)",
        )


def normal_noise(surface: Triangles) -> float:
    """Estimate the error of the vertices' normals due to noise.

    Each normal is compared with the linear extrapolation of its neighbours' normals to its own
    position, which is equal to it on a surface of constant curvature. Creases are left out, unless
    the noise is so strong that it makes creases itself. Errors that are correlated over many faces
    count as shape, and so does noise that a scanner has smoothed away; corners of a coarse mesh of
    a round shape count as noise.

    Args:
        surface: Faces that all have an area.

    Returns:
        Median error over the area [rad], 0 where no normal has neighbours on all sides.
    """
    noise = 0.0
    for crease, largest in CREASES:
        noise = SCALE * _median_deviation(surface, corner_normals(surface, crease))
        if noise <= largest:
            break
    return noise


def _median_deviation(surface: Triangles, normals: CornerNormals) -> float:
    """Median angle between normals and their neighbours' extrapolation, corrected for its error."""
    count, own = len(normals.normals), normals.normals
    ends = normals.corners, np.roll(normals.corners, -1, axis=1)
    pairs = np.concatenate([ends[0] * count + ends[1], ends[1] * count + ends[0]])
    one, two = np.divmod(np.unique(pairs), count)  # each side of a face in both directions
    points = surface.vertices[normals.vertices]
    weights = _weights(points[two] - points[one], own, one)
    expected = np.stack([np.bincount(one, weights * own[two, k], count) for k in range(3)], axis=1)
    spread = np.bincount(one, weights**2, count)
    usable = spread > 0.0
    if not usable.any():
        return 0.0
    sine = np.linalg.norm(np.cross(own, expected), axis=1)
    angles = np.arctan2(sine, (own * expected).sum(axis=1)) / np.sqrt(1.0 + spread)
    areas = np.bincount(normals.corners.ravel(), np.repeat(surface.areas, 3), count)
    weights = (areas / (1.0 + spread))[usable]
    return float(np.quantile(angles[usable], 0.5, weights=weights, method="inverted_cdf"))


def _weights(offsets: Floats, own: Floats, one: Ints) -> Floats:
    """Least-squares weights of neighbours: a mean that is exact for linear functions, shape (m,).

    Args:
        offsets: From the position of a normal to that of its neighbour, for each pair (m, 3).
        own: The normals (C, 3).
        one: Number of the normal in each pair (m,).

    Returns:
        The weights, whose sum is 1 for each normal; 0 where the neighbours are collinear.
    """
    count = len(own)
    squares = np.bincount(one, (offsets**2).sum(axis=1), count)
    reach = np.sqrt(squares / np.bincount(one, minlength=count))
    across = unit_rows(np.cross(own, np.eye(3)[np.abs(own).argmin(axis=1)]))
    axes = np.stack([across, np.cross(own, across)], axis=1)  # (C, 2, 3)
    flat = np.einsum("mak,mk->ma", axes[one], offsets / reach[one, None])
    basis = np.column_stack([np.ones(len(one)), flat])  # (m, 3)
    moments = np.zeros((count, 3, 3))
    np.add.at(moments, one, basis[:, :, None] * basis[:, None])
    spread_out = np.linalg.det(moments) > FLAT
    factors = np.zeros((count, 3))
    factors[spread_out] = np.linalg.inv(moments[spread_out])[:, 0]
    return np.asarray((basis * factors[one]).sum(axis=1))
