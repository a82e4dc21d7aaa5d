"""Diagnosis of meshes, before and after repair: defects, and whether labels can be trusted."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any, Literal

import numpy as np

from grasp3d.arrays import first_at_position
from grasp3d.errors import SettingError
from grasp3d.mesh.measures import (
    Triangles,
    edge_counts,
    is_closed,
    part_volumes,
    parts_of,
)
from grasp3d.mesh.mesh_sources import MeshSource
from grasp3d.mesh.noise import normal_noise
from grasp3d.mesh.object_mesh import ObjectMesh
from grasp3d.mesh.plausible_lengths import length_warnings, refuse_lengths
from grasp3d.mesh.plausible_units import UnitGuess, guess_unit, impossible_size
from grasp3d.mesh.preparing import PreparedMesh, prepare, repair_given
from grasp3d.mesh.ray_tracing import crossings
from grasp3d.mesh.repair.cleaning import is_face
from grasp3d.mesh.repair.holes import holes_of
from grasp3d.mesh.repair.solids import Solid
from grasp3d.mesh.repair.work import RepairStep
from grasp3d.settings import (
    AnySampling,
    GivenModel,
    GivenSampling,
    GraspModel,
    MeshOptions,
    Sampling,
    given_sampling,
)
from grasp3d.settings.costs import Cost, labelling_cost
from grasp3d.settings.units import Unit
from grasp3d.system.context import available_processors

MISSING = 0.05
"""Area fraction of holes above which labels cannot be trusted."""

SELF_INTERSECTING = 0.1
"""Area fraction of self-intersecting faces above which labels cannot be trusted."""

ROUGH = math.radians(3.0)
"""Noise of normals above which a warning is given [rad]: about a quarter of the tilt, alpha / 2,
of the paper's fingertip."""

STRAY = 0.01
"""Largest area fraction of a part that counts as stray."""

LARGER, FAR_LARGER = 1.5, 3.0
"""Factors by which stray parts enlarge the object: for a warning, and for no trust in labels."""


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
    cavities: int
    """Closed parts that are oriented inward."""
    before: SurfaceMeasures
    """The surface as it was given."""
    after: SurfaceMeasures
    """The surface after repair, before long edges are divided."""
    repairs: tuple[RepairStep, ...]
    manifold: str
    """Status of the repaired surface in the library Manifold: NoError, NotManifold, ..."""
    crossing_faces: int
    """Faces that certainly intersect others; faces that only touch are not counted."""
    self_intersecting_fraction: float
    """Area fraction of these faces."""
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

    @property
    def center_shift(self) -> float:
        """Distance by which repair moves the centre of mass, as a fraction of the size."""
        moved = zip(self.before.center_mass, self.after.center_mass, strict=True)
        return float(sum((a - b) ** 2 for a, b in moved) ** 0.5 / self.size)


def check_mesh(
    source: MeshSource,
    *,
    model: GivenModel = None,
    sampling: GivenSampling = None,
    options: MeshOptions | None = None,
    **fields: Any,
) -> MeshDiagnosis:
    """Diagnose a mesh before labelling: defects, repairs, and the cost of labelling.

    Args:
        source: A path, or an object as in `load_mesh`. An `ObjectMesh`, which is repaired already,
            is diagnosed as it is.
        model: Model for labelling; used for the cost, and to find lengths in a wrong unit.
        sampling: Settings of the grasp search; used in the same way.
        options: How the mesh is read and prepared; None: the defaults.
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
    settings = MeshOptions.of(options or own, fields)
    model = GraspModel.given("model", model) or GraspModel()
    sampling = given_sampling(model, sampling) or Sampling().fitted(model.fingers)
    return diagnose(source, model, sampling, settings)


def diagnose(
    source: MeshSource,
    model: GraspModel,
    sampling: AnySampling,
    options: MeshOptions,
    *,
    force: bool = False,
) -> MeshDiagnosis:
    """Diagnose a mesh, as `check_mesh` does, with all settings given.

    With `force` lengths that cannot be meant for an object of this size are accepted.
    """
    prepared = prepare(source, options)
    given, repaired, mesh = prepared.given, prepared.repaired, prepared.mesh
    mesh.check_units(model, sampling)
    lengths = model.lengths() | sampling.lengths() | mesh.options.lengths()
    scale = mesh.file_scale
    surface = Triangles((scale * repaired.vertices - mesh.center) / mesh.size, repaired.faces)
    given_points = (scale * given.vertices - mesh.center) / mesh.size
    joined = first_at_position(given.vertices)  # vertices at equal positions count once
    given_surface = Triangles(given_points, joined[given.faces])
    crossing = np.unique(crossings(surface.vertices, surface.faces))
    fraction = float(surface.areas[crossing].sum() / surface.areas.sum())
    noise = normal_noise(surface)
    bodies, cavities = _count_parts(surface)
    impossible = impossible_size(
        mesh.file_size, mesh.file_unit
    )  # then it is not the object that is meant
    warnings = (
        *(
            MeshWarning(Trust.NO if message == impossible else Trust.CARE, message)
            for message in mesh.report.warnings
        ),
        *_hole_warnings(prepared, options),
        *self_intersection_warnings(len(crossing), fraction),
        *_body_warnings(surface, bodies),
        *_noise_warnings(noise),
        *_length_warnings(mesh, lengths, force=force),
    )
    extents = np.ptp(repaired.vertices[repaired.faces].reshape(-1, 3), axis=0)
    return MeshDiagnosis(
        mesh=given.name,
        format=given.format,
        file_bytes=given.path.stat().st_size if given.path else None,
        file_unit=mesh.file_unit,
        unit=mesh.unit,
        guess=guess_unit(float(extents.max())),
        size=mesh.size,
        extents=tuple((scale * extents).tolist()),
        bodies=bodies,
        cavities=cavities,
        before=_measure(given_surface, mesh),
        after=_measure(surface, mesh),
        repairs=repaired.steps,
        manifold=Solid.of(surface.vertices, surface.faces).manifold.status().name,
        crossing_faces=len(crossing),
        self_intersecting_fraction=fraction,
        noise=noise,
        label_vertices=len(mesh.vertices),
        cost=labelling_cost(len(mesh.vertices), model, sampling, threads=available_processors()),
        warnings=warnings,
    )


def _measure(surface: Triangles, mesh: ObjectMesh) -> SurfaceMeasures:
    """Measure a surface in the mesh's normalised frame."""
    count, faces = len(surface.faces), surface.faces[is_face(surface.faces)]
    proper = Triangles(surface.vertices, faces)
    corners, areas = surface.vertices[faces], proper.areas
    closed, volume = is_closed(faces), float(proper.volumes.sum())
    center = (areas[:, None] * corners.mean(axis=1)).sum(axis=0) / areas.sum()
    if closed and volume:
        weighted = proper.volumes[:, None] * corners.sum(axis=1)
        center = weighted.sum(axis=0) / (4.0 * volume)
    boundary, nonmanifold = edge_counts(faces)
    x, y, z = mesh.from_normalized(center).tolist()
    return SurfaceMeasures(
        vertices=len(proper.used),
        faces=count,
        closed=closed,
        boundary_edges=boundary,
        crowded_edges=nonmanifold,
        area=float(areas.sum()) * mesh.size**2,
        volume=volume * mesh.size**3 if closed else None,
        center_mass=(x, y, z),
    )


def _length_warnings(
    mesh: ObjectMesh, lengths: Mapping[str, float | None], *, force: bool
) -> Iterator[MeshWarning]:
    """Warn about lengths that are probably in another unit; some of them cannot be meant."""
    try:
        if not force:
            refuse_lengths(mesh, **lengths)
    except SettingError as error:
        yield MeshWarning(Trust.NO, str(error))
        return
    for message in length_warnings(lengths, mesh):
        yield MeshWarning(Trust.CARE, message)


def _hole_warnings(prepared: PreparedMesh, options: MeshOptions) -> Iterator[MeshWarning]:
    """Warn about a surface without an interior, and about holes, open or closed by repair."""
    repaired, mesh = prepared.repaired, prepared.mesh
    if repaired.closed and math.isnan(mesh.volume):
        yield MeshWarning(
            Trust.NO, "the surface has no interior, so that no contact can be pushed against it"
        )
    filled = any(step.name == "closed" for step in repaired.steps)
    if filled:
        repaired = repair_given(prepared.given, replace(options, repair="safe"))
    count, missing = _missing_fraction(Triangles(repaired.vertices, repaired.faces))
    if not count:
        return
    trust = Trust.NO if missing > MISSING else Trust.CARE
    area = f"{100.0 * missing:.2g} % of the surface"
    if filled:
        remark = "closed by repair with a guessed surface"
    elif trust is Trust.NO:
        remark = (
            "is it a sheet that should have a thickness? Repair full (--repair full) closes them "
            "with a guessed surface"
        )
    else:
        remark = "grasps with contacts there are not found; repair full (--repair full) closes them"
    yield MeshWarning(trust, f"holes: {count}, {area}: {remark}")


def _missing_fraction(surface: Triangles) -> tuple[int, float]:
    """Return the number of holes, and their area fraction of the closed surface."""
    points, holes = surface.vertices, holes_of(surface.faces)
    rings = [points[hole] - points[hole].mean(axis=0) for hole in holes]
    across = (np.cross(ring, np.roll(ring, -1, axis=0)) for ring in rings)  # fans close them
    lids = sum(0.5 * float(np.linalg.norm(each, axis=1).sum()) for each in across)
    return len(holes), lids / (lids + float(surface.areas.sum()))


def self_intersection_warnings(count: int, fraction: float) -> Iterator[MeshWarning]:
    """Warn about faces that intersect others; `fraction` is their area fraction."""
    if count:
        yield MeshWarning(
            Trust.NO if fraction > SELF_INTERSECTING else Trust.CARE,
            f"faces that intersect others: {count:,}, {100.0 * fraction:.2g} % of the area: "
            "contacts there may be inside the object",
        )


def _count_parts(surface: Triangles) -> tuple[int, int]:
    """Return (bodies, cavities); cavities are parts of a closed surface oriented inward."""
    faces = surface.faces
    volumes = part_volumes(surface.vertices, faces, parts_of(faces))
    solid = is_closed(faces) and (volumes > 0.0).any()
    cavities = int((volumes < 0.0).sum()) if solid else 0
    return len(volumes) - cavities, cavities


def _body_warnings(surface: Triangles, bodies: int) -> Iterator[MeshWarning]:
    """Warn about bodies that are not connected, and about small ones that enlarge the object."""
    if bodies > 1:
        yield MeshWarning(
            Trust.CARE,
            f"separate bodies: {bodies}, treated as one rigid object: the contacts of a grasp may "
            "be on different bodies",
        )
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


def _noise_warnings(noise: float) -> Iterator[MeshWarning]:
    """Warn about inaccurate normals of a rough surface."""
    if noise > ROUGH:
        degrees = math.degrees(noise)
        yield MeshWarning(
            Trust.CARE,
            f"the surface is rough: its normals have errors of about {degrees:.2g} degrees; smooth "
            f"it, or add twice that to the sensor resolution (--sensor-resolution)",
        )
