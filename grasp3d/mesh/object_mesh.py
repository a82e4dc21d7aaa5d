"""ObjectMesh, the surface that contacts lie on, and the report of how it was made."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Literal

import numpy as np

from grasp3d._kernels.hands.touched_surface import TouchedSurface, fill_grid
from grasp3d._kernels.surface.box_tree import RADIUS, THICKNESS, BoxTree, box_tree
from grasp3d._kernels.surface.face_tree import FaceTree, face_tree
from grasp3d._kernels.surface.nearby_normals import FacesAround
from grasp3d._kernels.surface.surface_contacts import EXACT, ContactNormals, Surface
from grasp3d.arrays import Bools, Floats, Ints, locked, short_repr, unit_rows, used_indices
from grasp3d.mesh.measures import Triangles, face_areas, paired_edges
from grasp3d.mesh.normals import CornerNormals, crease_twins, normal_sets
from grasp3d.mesh.plausible_units import unknown_unit
from grasp3d.mesh.repair import RepairStep
from grasp3d.settings import MeshOptions
from grasp3d.settings.units import (
    METRES,
    GivenLength,
    Unit,
    parse_length,
    small_length,
    with_lengths_scaled,
    with_units,
)

if TYPE_CHECKING:
    import pyvista
    import trimesh


STEPS = 48
"""Nodes of the grid of distances along the longest side."""

MARGIN = 0.006
"""How far the grid reaches beyond the surface [m]."""


@dataclass(frozen=True)
class MeshReport:
    """What a mesh file contained and how it was repaired."""

    source: str
    """Name of the file, the type of another library's object ('trimesh.Trimesh'), or 'arrays'."""
    format: str
    """Suffix of the file, name of the other library ('trimesh'), or 'arrays'."""
    unit: Unit | None
    """Unit of the file's coordinates; None if neither the file nor the user states it."""
    bodies: int
    """Connected parts after repair."""
    closed: bool
    """Whether the faces bound a volume: equally many run along every edge in both directions."""
    center_mass_from: str
    """'volume' (uniform density) or, if the mesh encloses none, 'surface'; or 'given'."""
    repairs: tuple[RepairStep, ...]
    """What was changed; one sentence each as text."""
    warnings: tuple[str, ...]
    """What may make the labels wrong, one sentence each."""


@dataclass(frozen=True, eq=False)
class ObjectMesh:
    """An object's surface, with the normals that a contact may have at each surface point.

    Positions are in the file's frame, in metres, or as the file has them where its unit is not
    known; normals point into the object.

    Example:
        >>> import trimesh
        >>> import grasp3d
        >>> box = trimesh.creation.box([4.0, 3.0, 2.0])
        >>> mesh = grasp3d.load_mesh(box, unit="cm", max_edge="9cm")
        >>> mesh.vertices.shape, mesh.faces.shape, round(mesh.volume, 9), mesh.unit
        ((8, 3), (12, 3), 2.4e-05, 'm')
        >>> mesh.file_points[0].tolist(), mesh.file_unit
        ([-2.0, -1.5, -1.0], 'cm')
    """

    vertices: Floats
    """Shape (V, 3): the file's vertices in their own order, then those added by refinement."""
    file_points: Floats
    """The same in the file's own coordinates, shape (V, 3), as in written files."""
    faces: Ints
    """Shape (F, 3), counter-clockwise from outside; they use canonical vertices only."""
    canonical: Ints
    """Canonical vertex of each vertex, the one that faces use at its position, shape (V,)."""
    file_vertices: int
    """Number of vertices in the file; they come first."""
    corner_normals: CornerNormals
    center: Floats
    """Centre of the surface, shape (3,): origin of the normalised frame."""
    size: float
    """Diameter of the ball about `center` around the surface: unit of the normalised frame."""
    center_mass: Floats
    """Centre of mass, at uniform density unless it is given, shape (3,)."""
    volume: float
    """Enclosed volume; nan if the surface is open or encloses none."""
    options: MeshOptions
    """How the mesh was read and prepared."""
    report: MeshReport
    region: Bools | None = None
    """Mask of the vertices in the part of the surface where contacts may be, by the option
    `region`, shape (V,); None: all of it."""

    __repr__ = short_repr

    @property
    def unit(self) -> Literal["m"] | None:
        """Unit of positions and lengths: metres; None: as in the file, whose unit is not known."""
        return None if self.file_unit is None else "m"

    @property
    def file_unit(self) -> Unit | None:
        """Unit of the file's coordinates; None: not known."""
        return self.report.unit

    @property
    def file_scale(self) -> float:
        """Factor from the file's coordinates to those of the mesh."""
        return scale_of(self.file_unit) * self.options.scale

    @property
    def file_size(self) -> float:
        """The object's size in the unit of the file."""
        return self.size / scale_of(self.file_unit)

    @property
    def extent(self) -> float:
        """Largest extent of the surface along an axis."""
        return float(np.ptp(self.vertices[self.faces].reshape(-1, 3), axis=0).max())

    def needs_metres(self, what: str) -> None:
        """Refuse a mesh of unknown unit; `what` says in the error what needs the unit.

        Raises:
            SettingError: The unit is not known; the message names the plausible one.
        """
        if self.unit is None:
            raise unknown_unit(what, self.report.source, self.extent)

    def check_units(self, *settings: object) -> None:
        """Refuse lengths that are stated with a unit for a mesh that has none.

        Args:
            settings: Settings, or tuples of lengths.

        Raises:
            SettingError: There is such a length, as in `needs_metres`.
        """
        for name, length in with_units("", settings):
            self.needs_metres(f"{name or 'a length'} is {length}")

    def length(self, name: str, value: GivenLength) -> float:
        """Convert a length to the unit of this mesh.

        Args:
            name: Name of the setting, for the error.
            value: A number, or a text with a unit.

        Raises:
            SettingError: It is no length, or it has a unit, but that of the mesh is not known.
        """
        length = parse_length(name, value)
        for _ in with_units(name, length):
            self.needs_metres(f"{name} is {value}")
        return float(length)

    def length_text(self, length: float, digits: int = 4) -> str:
        """Format a length of this mesh for people: in millimetres, if its unit is known."""
        return small_length(length, metres=self.unit is not None, digits=digits)

    @cached_property
    def on_surface(self) -> Bools:
        """Mask of the vertices whose position belongs to a face, shape (V,)."""
        mask = np.zeros(len(self.vertices), dtype=bool)
        mask[self.faces] = True
        return locked(mask[self.canonical])

    @cached_property
    def allowed(self) -> Bools:
        """Mask of the vertices on the surface where contacts may be, shape (V,)."""
        return self.on_surface if self.region is None else locked(self.on_surface & self.region)

    @cached_property
    def contact_vertices(self) -> Ints:
        """Canonical vertices on the surface where contacts may be."""
        used = used_indices(self.faces)
        return locked(used[self.allowed[used]])

    @cached_property
    def contact_faces(self) -> Ints:
        """Faces in which contacts may be: all of their corners are allowed."""
        return locked(np.flatnonzero(self.allowed[self.faces].all(axis=1)))

    @cached_property
    def allowed_fraction(self) -> float:
        """Area fraction of the surface where contacts may be."""
        return float(self.vertex_areas.sum()) / self.area

    @cached_property
    def area(self) -> float:
        """Area of the whole surface."""
        return float(face_areas(self.vertices, self.faces).sum())

    @property
    def region_notes(self) -> tuple[str, ...]:
        """A sentence on the part of the surface where contacts may be; empty: all of it."""
        if self.region is None:
            return ()
        share = f"{100.0 * self.allowed_fraction:.3g} %"
        return (f"contacts may be on {share} of the surface only, of which fractions are stated",)

    @cached_property
    def _normal_sets(self) -> tuple[ContactNormals, Floats, Floats]:
        return normal_sets(len(self.vertices), self.corner_normals)

    @property
    def contact_normals(self) -> ContactNormals:
        """All normals that a contact at each vertex may have, as the kernels take them."""
        return self._normal_sets[0]

    @property
    def normal_centres(self) -> Floats:
        """Middle of each set of `contact_normals`, shape (V, 3); 0 where its normals cancel out."""
        return self._normal_sets[1]

    @property
    def normal_radii(self) -> Floats:
        """Largest angle from the middle to a normal of its set [rad], shape (V,); -1: no normal."""
        return self._normal_sets[2]

    @cached_property
    def normals(self) -> Floats:
        """Inward unit normal at each vertex, the middle of its set at creases, shape (V, 3)."""
        return locked(unit_rows(self.normal_centres)[self.canonical])

    @cached_property
    def vertex_areas(self) -> Floats:
        """A third of the area around each vertex, shape (V,).

        Duplicates, and vertices where no contact may be, count as zero.
        """
        third = face_areas(self.vertices, self.faces) / 3.0
        areas = np.zeros(len(self.vertices))
        np.add.at(areas, self.faces, third[:, None])
        return locked(areas * self.allowed)

    @cached_property
    def torque_scale(self) -> float:
        """Largest distance of a surface vertex from the centre of mass (rho)."""
        used = self.vertices[used_indices(self.faces)]
        return float(np.linalg.norm(used - self.center_mass, axis=1).max())

    @cached_property
    def normalized(self) -> Floats:
        """Positions centred and divided by `size`, shape (V, 3)."""
        return locked((self.vertices - self.center) / self.size)

    @cached_property
    def contact_surface(self) -> Surface:
        """The surface in the normalised frame, as the kernels take it."""
        corners, normals = self.corner_normals, self.corner_normals.normals
        twins = crease_twins(self.faces, corners.corners)
        if self.region is not None:
            # Searches take a crease with the face of the lower row: at the border the inner face.
            inside = np.isin(np.arange(len(self.faces)), self.contact_faces)
            pairs, rows = paired_edges(self.faces), twins.reshape(-1, 2)
            one, two = np.concatenate(pairs), np.concatenate(pairs[::-1])
            border = one[inside[one // 3] & ~inside[two // 3] & (rows[one, 0] >= 0)]
            copies = normals[rows[border]].reshape(-1, 3)
            rows[border] = len(normals) + np.arange(len(copies)).reshape(-1, 2)
            normals = locked(np.concatenate([normals, copies]))
        return Surface(
            points=np.ascontiguousarray(self.normalized),
            faces=self.faces,
            corners=corners.corners,
            normals=normals,
            twins=twins,
            turns=EXACT,
        )

    @cached_property
    def boxes(self) -> BoxTree:
        """Tree of the faces in the normalised frame, to find those near a point or a gripper."""
        tree: BoxTree = box_tree(self.normalized, self.faces)
        return tree

    @cached_property
    def faces_around(self) -> FacesAround:
        """The faces around each vertex, as the kernels take them."""
        order = np.argsort(self.faces, axis=None, kind="stable")
        start = np.searchsorted(self.faces.ravel()[order], np.arange(len(self.vertices) + 1))
        return FacesAround(locked(start), locked(order // 3))

    @cached_property
    def face_tree(self) -> FaceTree:
        """Tree of the faces of `contact_surface`, to find those that closing jaws meet."""
        tree: FaceTree = face_tree(self.contact_surface)
        return tree

    @cached_property
    def touched_surface(self) -> TouchedSurface:
        """The surface as the kernels of hands take it; the mesh must be in metres.

        For 20,480 faces it took 0.5 s of CPU time.
        """
        vertices, faces, normals = self.vertices, self.faces, self.corner_normals
        surface, tree = Triangles(vertices, faces), box_tree(vertices, faces)
        outward = np.empty((len(faces), 7, 3))
        outward[:, 0] = -surface.normals
        one, two = surface.pairs
        across = np.full(3 * len(faces), -1, dtype=np.int64)
        across[one], across[two] = two // 3, one // 3
        beyond = np.where(across < 0, np.arange(3 * len(faces)) // 3, across)
        outward[:, 1:4] = (outward[:, :1] + outward[beyond.reshape(-1, 3), 0]).reshape(-1, 3, 3)
        sums = np.zeros((len(vertices), 3))
        np.add.at(sums, faces, surface.angles[:, :, None] * outward[:, :1])
        outward[:, 4:] = unit_rows(sums)[faces]
        place = np.empty(len(faces), dtype=np.int64)
        place[tree.order] = np.arange(len(faces))
        low, high = vertices[surface.used].min(axis=0), vertices[surface.used].max(axis=0)
        origin, extent = low - MARGIN, high - low + 2.0 * MARGIN
        step = float(extent.max()) / (STEPS - 1)
        nodes = np.ceil(extent / step - 1e-9).astype(int) + 1
        boxes = tree.boxes.copy()  # in single precision they must contain those of the tree
        boxes[:, [3, 4, 5, RADIUS, THICKNESS]] += 1e-6 * np.abs(boxes).max()
        touched = TouchedSurface(
            tree=tree,
            boxes=boxes.astype(np.float32),
            closed=self.report.closed,
            corners=np.ascontiguousarray(faces[tree.order]),
            across=np.where(across < 0, -1, place[across]).reshape(-1, 3)[tree.order],
            outward=outward[tree.order].reshape(-1, 21),
            inward=normals.normals[normals.corners[tree.order]].reshape(-1, 9),
            box=np.concatenate([0.5 * (low + high), 0.5 * (high - low)]),
            origin=origin,
            step=step,
            values=np.empty(tuple(nodes), dtype=np.float32),
            slots=np.zeros(tuple(nodes), dtype=np.int32),
        )
        fill_grid(touched)
        return touched

    def scaled(self, factor: float) -> "ObjectMesh":
        """The same object at another size.

        Args:
            factor: Factor of all lengths, above 0.
        """
        # Normals and their sets do not depend on the size.
        return replace(
            self,
            vertices=locked(self.vertices * factor),
            file_points=locked(self.file_points * factor),
            center=locked(self.center * factor),
            size=self.size * factor,
            center_mass=locked(self.center_mass * factor),
            volume=self.volume * factor**3,
        )

    def with_unit(self, unit: Unit) -> "ObjectMesh":
        """The same object in metres, once its unit is known.

        Args:
            unit: Unit of the file's coordinates.
        """
        scale = METRES[unit]
        options = replace(with_lengths_scaled(self.options, scale), unit=unit)
        report = replace(self.report, unit=unit)
        points = self.file_points
        return replace(self.scaled(scale), file_points=points, options=options, report=report)

    def to_trimesh(self) -> "trimesh.Trimesh":
        """Return the prepared surface as a `trimesh.Trimesh`, with outward normals and its unit."""
        import trimesh

        surface = trimesh.Trimesh(
            self.vertices, self.faces, vertex_normals=-self.normals, process=False, validate=False
        )
        if self.unit is not None:
            surface.units = self.unit
        return surface

    def to_polydata(self) -> "pyvista.PolyData":
        """Return the prepared surface as a `pyvista.PolyData`, with outward normals as `normal`."""
        import pyvista

        faces = self.faces.astype(int)
        data: pyvista.PolyData = pyvista.PolyData.from_regular_faces(self.vertices, faces)
        data.point_data["normal"] = -self.normals
        return data

    def from_normalized(self, points: Floats) -> Floats:
        """Transform points (..., 3) of the normalised frame to the mesh's."""
        return points * self.size + self.center


def scale_of(unit: Unit | None) -> float:
    """Factor from coordinates in a unit to metres; 1 if the unit is not known."""
    return 1.0 if unit is None else METRES[unit]
