"""Preparation of an ObjectMesh from any source: read, check, repair, refine.

Sources are files, arrays, and objects of other libraries. These libraries are not imported: their
objects are recognised by the names of their classes.
"""

import math
import os
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from grasp3d.arrays import Floats, Ints, first_at_position, locked, unit_rows
from grasp3d.errors import MeshError, SettingError
from grasp3d.mesh.cleaning import clusters
from grasp3d.mesh.measures import Triangles, center_and_volume, rounding_of, surface_extent
from grasp3d.mesh.mesh_files import read_mesh
from grasp3d.mesh.normals import CornerNormals, corner_normals
from grasp3d.mesh.object_mesh import MeshReport, ObjectMesh, scale_of
from grasp3d.mesh.plausible_units import guessed_unit, unit_warning, unknown_unit
from grasp3d.mesh.region import restricted
from grasp3d.mesh.repair import MOST_ROUNDING, RepairedSurface, repair_surface
from grasp3d.mesh.sources import RawMesh, flattened, unit_called
from grasp3d.settings import MeshOptions
from grasp3d.settings.sampling import check_cost
from grasp3d.settings.units import Unit, with_units
from grasp3d.system.limited_reading import Limits, in_limits
from grasp3d.system.names import reason_of

if TYPE_CHECKING:
    MeshSource: TypeAlias = object
else:

    class MeshSource:
        """What is accepted wherever a mesh is expected.

        - a path of a file in a supported format (STL, OBJ, PLY, OFF, GLB, glTF, 3MF, ...);
        - an `ObjectMesh`;
        - a `trimesh.Trimesh` or `trimesh.Scene`, with the transforms of its parts applied and its
          `units`;
        - a PyVista `PolyData`; faces with more than three corners are divided into triangles;
        - an Open3D `TriangleMesh` of `open3d.geometry`, which `to_legacy()` makes of tensors;
        - a pair `(vertices, faces)` of arrays: positions (V, 3), and for every triangle the
          numbers of its corners (F, 3), counter-clockwise seen from outside.

        All of them go through the same checks and repair; their vertices keep their order.
        """


OUTSIDE = 1e-6
"""Distance from the bounding box, as a fraction of the size, above which a point is outside it."""

FAR = 100.0
"""Largest plausible distance of a centre of mass from the object, in its sizes."""

SECONDS = 120.0
"""Time limit for repairing a mesh, and for dividing its edges, if reading is limited [s]; 300,000
faces usually take 4 s."""

MEMORY = 4e9
"""Memory limit for the same [bytes]."""

FLAT_VOLUME = 1e-9
"""Volume, as a fraction of the size cubed, below which a closed surface encloses none."""

MAX_ROUNDS = 40

DEFAULT_EDGE = 1.0 / 32.0
"""Longest edge as a fraction of the object's size."""

MANY = 1e15
"""Upper bound of estimated face counts, so that they fit an integer."""


def load_mesh(source: MeshSource, options: MeshOptions | None = None, **fields: Any) -> ObjectMesh:
    """Read a mesh, and prepare its surface for contacts.

    The source's own vertices keep their order and come first. Nothing is moved; where the unit is
    known, positions are in metres.

    Args:
        source: A path (STL, OBJ, PLY, OFF, GLB, glTF, 3MF, ...), a trimesh `Trimesh` or `Scene`, a
            PyVista `PolyData`, an Open3D `TriangleMesh`, a pair (vertices, faces) of arrays of
            shapes (V, 3) and (F, 3), or an `ObjectMesh`; see `MeshSource`. An `ObjectMesh` is
            returned as it is if its options do not change. If only the region changes, it keeps its
            vertices. Otherwise its surface is prepared again, with the vertices that were added to
            divide edges.
        options: How the mesh is read and prepared; None: the defaults.
        fields: Fields of `MeshOptions` that differ from `options`: unit, max_edge, crease_angle,
            repair, center_of_mass, region, max_memory.

    Returns:
        The mesh; its `report` states what was read and repaired, and warnings. Positions are in the
        source's frame, in metres if its unit is known, and normals point into the object.

    Raises:
        MeshError: The file is missing, damaged, too large, of an unknown format, or contains no
            surface; or the object is no mesh.
        SettingError: An option is outside its range; or a length has a unit, but that of the mesh
            is not known.

    Example:
        A cube of 40 mm as arrays, and as an object of trimesh:

        >>> import numpy as np
        >>> import trimesh
        >>> import grasp3d
        >>> cube = trimesh.creation.box([40.0, 40.0, 40.0])
        >>> mesh = grasp3d.load_mesh((cube.vertices, cube.faces), unit="mm")
        >>> mesh.report.source, mesh.file_unit, mesh.report.closed
        ('arrays', 'mm', True)
        >>> print(f"{mesh.volume:.2g}, {mesh.file_vertices} of {len(mesh.vertices):,} vertices")
        6.4e-05, 8 of 6,146 vertices
        >>> coarse = grasp3d.load_mesh(cube, max_edge=20.0)
        >>> coarse.report.source, coarse.unit, len(coarse.vertices)
        ('trimesh.Trimesh', None, 50)

        Contacts on one end alone:

        >>> end = grasp3d.load_mesh(coarse, region="box:15,-20,-20,20,20,20")
        >>> len(end.contact_faces), round(end.allowed_fraction, 3)
        (16, 0.278)
    """
    if isinstance(source, ObjectMesh) and source.unit is None:
        unit = MeshOptions.of(options, fields).stated_unit
        source = source if unit is None else source.with_unit(unit)
    own = source.options if isinstance(source, ObjectMesh) else None
    settings = MeshOptions.of(options or own, fields)
    if isinstance(source, ObjectMesh):
        if settings == own:
            return source
        if replace(settings, region=source.options.region) == own:
            return restricted(source, settings)
    return prepare(source, settings)[0]


def prepare(
    source: MeshSource, options: MeshOptions, *settings: object, in_metres: str = ""
) -> tuple[ObjectMesh, RepairedSurface, RawMesh]:
    """Prepare a mesh, as `load_mesh` does, and return also the surfaces that it was made from.

    Args:
        source: As in `load_mesh`; an `ObjectMesh` is prepared again.
        options: How the mesh is read and prepared.
        settings: Further settings, whose lengths may need the unit of the mesh.
        in_metres: What else needs the unit, as the start of a sentence; empty: nothing. A missing
            unit is an error before any work.

    Returns:
        The mesh; its repaired surface, before long edges were divided; and its surface as read.
        Both surfaces are in the file's coordinates.

    Raises:
        MeshError: For the same reasons as in `load_mesh`.
        SettingError: The unit of the mesh is needed, but not known; or the centre of mass is far
            away.
    """
    given, guess = read_source(source), ""
    extent = options.scale * given.extent
    if options.unit == "guess":
        unit = given.unit
        if unit is None:
            unit, guess = guessed_unit(given.where, extent)
        options = replace(options, unit=unit)
    if (options.unit or given.unit) is None:
        lengths = (f"{name} is {length}" for name, length in with_units("", (options, *settings)))
        if what := in_metres or next(lengths, ""):
            raise unknown_unit(what, given.name, extent)
    check_cost(len(given.faces) // 2, options.max_memory, given.where, "simplify the mesh")
    remedy = "mend it in a CAD program, or give --repair none"
    limits = Limits(SECONDS, MEMORY, f"{given.where}: repairing it", remedy)
    arguments = given.vertices, given.faces, options.repair, given.where
    repaired = in_limits(limits, repair_surface, *arguments)
    return _refined(given, repaired, options, guess), repaired, given


def _refined(
    source: RawMesh, repaired: RepairedSurface, options: MeshOptions, guess: str
) -> ObjectMesh:
    """Make the mesh of a repaired surface: normals, refinement, mass properties; see `prepare`."""
    unit, where = options.stated_unit or source.unit, source.where
    metres, error = scale_of(unit) * options.scale, rounding_of(source.vertices)
    center, size = surface_extent(repaired.vertices, repaired.faces)
    surface = Triangles((repaired.vertices - center) / size, repaired.faces)
    normals = corner_normals(surface, options.crease_angle)
    edge = DEFAULT_EDGE if options.max_edge is None else options.max_edge / (metres * size)
    check_refinement(surface, edge, options.max_memory, where)
    rounding = min(error / size, MOST_ROUNDING)
    remedy = "give a longer max_edge (--max-edge)"
    limits = Limits(SECONDS, MEMORY, f"{where}: dividing its long edges", remedy)
    refined, normals = in_limits(limits, refine, surface, normals, edge, rounding)
    center_mass, volume = center_and_volume(surface)
    center_from = "volume"
    if not volume > FLAT_VOLUME:
        center_mass, volume, center_from = np.zeros(3), math.nan, "surface"
    if options.center_of_mass is not None:
        center_mass = (np.array(options.center_of_mass) / metres - center) / size
        center_from = "given"
    warnings = [
        *_warnings(source, repaired, unit, volume, center_from),
        *filter(
            None,
            [
                guess,
                unit_warning(options.scale * size, unit),
                _center_warning(surface, center_mass, options),
            ],
        ),
    ]
    added = np.arange(len(repaired.vertices), len(refined.vertices))
    points = np.concatenate([repaired.vertices, refined.vertices[added] * size + center])
    mesh = ObjectMesh(
        vertices=locked(points * metres),
        file_points=locked(points),
        faces=locked(refined.faces),
        canonical=locked(np.concatenate([repaired.canonical, added])),
        file_vertices=len(source.vertices),
        corner_normals=normals.locked(),
        center=locked(center * metres),
        size=size * metres,
        center_mass=locked((center_mass * size + center) * metres),
        volume=volume * (size * metres) ** 3,
        options=options,
        report=MeshReport(
            source=source.name,
            format=source.format,
            unit=unit,
            bodies=repaired.bodies,
            closed=repaired.closed,
            center_mass_from=center_from,
            repairs=repaired.steps,
            warnings=tuple(warnings),
        ),
    )
    return restricted(mesh, options)


def _warnings(
    source: RawMesh, repaired: RepairedSurface, unit: Unit | None, volume: float, center_from: str
) -> Iterator[str]:
    """Warn about a surface without an inside, about its unit, and about its repair.

    Args:
        source: The surface as it was read.
        repaired: The repaired surface.
        unit: Its unit; None: not known.
        volume: Its volume; nan: it has none.
        center_from: What the centre of mass follows from.
    """
    if math.isnan(volume):
        what = "encloses no volume, though it is closed"
        if not repaired.closed:
            what = "is open: inside and outside are taken from the winding of its faces"
        center = "; the centre of mass is the surface's" if center_from == "surface" else ""
        yield f"the surface {what}{center}"
    if source.unit not in {None, unit}:
        yield f"the mesh states the unit {source.unit}, but {unit} was requested"
    yield from repaired.warnings


def _center_warning(surface: Triangles, center_mass: Floats, options: MeshOptions) -> str:
    """Warning of a centre of mass outside the surface's bounding box; empty: it is inside.

    Raises:
        SettingError: It is given, and too far away to be meant.
    """
    points, is_given = surface.vertices[surface.used], options.center_of_mass is not None
    beyond = np.maximum(points.min(axis=0) - center_mass, center_mass - points.max(axis=0)).max()
    text = f"the centre of mass is outside the object's bounding box by {beyond:.3g} of its size: "
    text += (
        "is it in the mesh's frame, with its unit (10mm,0,-2mm)?"
        if is_given
        else "the surface crosses itself; mend it, or give the centre (--center-of-mass)"
    )
    if is_given and not beyond <= FAR:
        raise SettingError(text)
    return text if beyond > OUTSIDE else ""


def refine(
    surface: Triangles, normals: CornerNormals, max_edge: float, rounding: float
) -> tuple[Triangles, CornerNormals]:
    """Bisect every edge longer than `max_edge`, until none is left.

    Args:
        surface: The surface.
        normals: Normals at the corners of its faces.
        max_edge: Longest edge allowed, in the unit of the vertices.
        rounding: Largest error of a coordinate, in the same unit.

    Returns:
        The same surface, with the given vertices first and unchanged; normals at the corners of its
        faces, interpolated like the positions, so that a coarse round surface stays round.
    """
    from trimesh.remesh import subdivide_to_size

    vertices, (one, _) = surface.vertices, surface.pairs
    # Positions and normals are columns of one array, one row per patch at a vertex: the columns
    # after the first three are interpolated but do not count for an edge's length.
    rows = np.hstack([vertices[normals.vertices], normals.normals])
    rows, corners = subdivide_to_size(
        rows, normals.corners, max_edge * (1.0 + 1e-9), max_iter=MAX_ROUNDS
    )
    count = len(normals.vertices)
    first = first_at_position(rows[:, :3])  # the two sides of a crease make the same midpoints
    if len(one) * 2 < surface.faces.size:
        tolerance = 8.0 * max(rounding, np.finfo(np.float64).eps)
        first = _first_nearby(rows[:, :3], first, count, tolerance)
    own = (first == np.arange(len(rows))) & (np.arange(len(rows)) >= count)
    number = np.concatenate([normals.vertices, len(vertices) + np.cumsum(own)[count:] - 1])
    vertex_of_row = number[first]
    return (
        Triangles(np.concatenate([vertices, rows[own, :3]]), vertex_of_row[corners]),
        CornerNormals(corners, unit_rows(rows[:, 3:]), vertex_of_row),
    )


def _first_nearby(points: Floats, same: Ints, count: int, tolerance: float) -> Ints:
    """First point within a tolerance of each added point, shape (n,).

    `same` is the first point at each point's position. At a T-junction one face has a vertex in the
    middle of another's edge, and the midpoints of the two faces there agree only up to rounding.
    """
    distinct, row = np.unique(same, return_inverse=True)  # many points may be at one position
    first = distinct[clusters(points[distinct], tolerance)][row]
    first[:count] = np.arange(count)  # given vertices stay distinct
    return first


def check_refinement(surface: Triangles, max_edge: float, max_memory: float, where: str) -> None:
    """Refuse a surface whose refinement would make too large a mesh.

    Args:
        surface: The surface.
        max_edge: Longest edge allowed, in the unit of the vertices.
        max_memory: Largest memory for labelling [GB].
        where: Name of the mesh in errors.

    Raises:
        MeshError: The mesh would be too large.
    """
    count, corners = len(surface.faces), surface.vertices[surface.faces]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    faces = 2.0 * surface.areas.sum() / max_edge**2 + (2.0 * longest / max_edge).sum() + count
    added = int(min(faces, MANY)) - count
    expected = max(len(surface.used), count // 2) + added // 2
    check_cost(expected, max_memory, where, "give a longer max_edge (--max-edge)")


def read_source(source: MeshSource) -> RawMesh:
    """Read a mesh from any source.

    Args:
        source: A path, or an object as in `MeshSource`.

    Raises:
        MeshError: A file cannot be read, or an object is no mesh.
    """
    if isinstance(source, str | os.PathLike):
        return read_mesh(Path(os.fsdecode(source)))
    if isinstance(source, ObjectMesh):
        report, stated = source.report, source.file_unit
        return RawMesh(source.file_points, source.faces, report.format, stated, report.source)
    kinds = type(source).__mro__
    names = [f"{kind.__module__.partition('.')[0]}.{kind.__name__}" for kind in kinds]
    name = next((one for one in names if one in _LIBRARIES), names[0])
    reader = _LIBRARIES.get(name)
    if reader is None:
        raise MeshError(
            f"an object of type {name.removeprefix('builtins.')} is not a mesh; give a path, an "
            "ObjectMesh, a trimesh Trimesh or Scene, a PyVista PolyData, an Open3D TriangleMesh, "
            "or a pair (vertices, faces)"
        )
    try:
        vertices, faces, unit = reader(source)
        arrays = np.array(vertices, np.float64), np.array(faces, np.int64)
    except (MeshError, MemoryError):
        raise
    except Exception as error:  # each library raises its own classes of errors
        raise MeshError(f"{name}: its surface cannot be read ({reason_of(error)})") from error
    library = name.partition(".")[0]
    if library == "builtins":
        name = library = "arrays"
    return RawMesh(*arrays, library, unit_called(unit, name), name)


Surface: TypeAlias = tuple[Any, Any, str | None]
"""Vertices, faces and unit of an object, as its library has them."""


def _of_arrays(pair: Any) -> Surface:
    vertices, faces = (np.asarray(one) for one in pair)
    for array, kinds, what in (
        (vertices, "fiu", "vertices must be real numbers of shape (V, 3)"),
        (faces, "iu", "faces must be whole numbers of shape (F, 3), the corners of triangles"),
    ):
        if array.ndim != 2 or array.shape[1] != 3 or array.dtype.kind not in kinds:
            raise MeshError(f"{what}; got {array.dtype} {array.shape}")
    return vertices, faces, None


def _of_scene(source: Any) -> Surface:
    units = sorted({str(part.units or "none") for part in source.geometry.values()})
    stated = None if units == ["none"] else " and ".join(units)
    return *flattened(source, "trimesh.Scene"), stated


def _of_polydata(source: Any) -> Surface:
    surface = source.triangulate()
    return surface.points, np.asarray(surface.faces).reshape(-1, 4)[:, 1:], None


_LIBRARIES: dict[str, Callable[[Any], Surface]] = {
    "builtins.tuple": _of_arrays,
    "builtins.list": _of_arrays,
    "trimesh.Trimesh": lambda one: (one.vertices, one.faces, one.units),
    "trimesh.Scene": _of_scene,
    "pyvista.PolyData": _of_polydata,
    "open3d.TriangleMesh": lambda one: (one.vertices, one.triangles, None),
}
"""Readers of other libraries' objects, by library and class."""
