"""The steps of repair, one method each, their sequence at each level, and what they changed."""

from dataclasses import dataclass

import numpy as np

from grasp3d.arrays import Bools, Floats, Ints, first_at_position, short_repr
from grasp3d.errors import MeshError
from grasp3d.mesh.measures import edges_of, face_areas, has_area, is_closed, parts_of, rounding_of
from grasp3d.mesh.repair.bodies import TOUCH, Bodies, without_inner_walls
from grasp3d.mesh.repair.cleaning import (
    disagreeing,
    first_of_body,
    first_of_linked,
    is_face,
    is_first,
    weld_nearby,
    without_mirrored,
)
from grasp3d.mesh.repair.holes import SMALL, close_holes, holes_of
from grasp3d.mesh.repair.union import unite
from grasp3d.mesh.work_bounds import WorkBoundError
from grasp3d.settings.mesh_options import Repair
from grasp3d.system.counts import counted, noun

MOST_ROUNDING = 1e-6
"""Largest rounding assumed, as a fraction of the size: integers are exact in 32 bits as well."""

SMALL_HOLES = 0.01
"""Small holes are closed if the faces that close them add at most this fraction to the area."""

FLAT = "left out: no area"


@dataclass(frozen=True)
class RepairStep:
    """One kind of change, and how often it was made."""

    name: str
    """Identifier of the change: welded, collapsed, repeated, ..."""
    count: int
    """Number of vertices, faces or bodies that were changed."""
    message: str
    """Description of the change, to be read after the count."""

    def __str__(self) -> str:
        """Count and message in one sentence."""
        return f"{self.count} {self.message}"


@dataclass(frozen=True, eq=False)
class RepairedSurface:
    """A repaired surface over the given vertices."""

    vertices: Floats
    """Positions (V', 3): the given ones, unmoved and in their order, then added ones."""
    faces: Ints
    """Faces (F', 3), counter-clockwise from outside as far as that can be determined."""
    canonical: Ints
    """Canonical vertex of each vertex, shape (V',); faces use canonical vertices only."""
    closed: bool
    """Whether the faces bound a volume: equally many run along every edge in both directions."""
    bodies: int
    """Number of connected components."""
    steps: tuple[RepairStep, ...]
    """What was changed."""
    warnings: tuple[str, ...]
    """What could not be repaired, one sentence each."""

    __repr__ = short_repr


class Work:
    """A surface under repair, in a frame of size about 1 so that volumes stay exact."""

    def __init__(self, vertices: Floats, faces: Ints, where: str, *, apart: bool) -> None:
        self.where, self.vertices = where, vertices
        self.steps: list[RepairStep] = []
        self.warnings: list[str] = []
        self.first_vertex = first_at_position(vertices)
        self.canonical = first_of_body(faces, self.first_vertex) if apart else self.first_vertex
        self.faces = self.canonical[faces]
        joined = int((self.first_vertex != np.arange(len(vertices))).sum())
        self._note("welded", joined, "vertices", "joined to an earlier one at the same position")
        self._keep("collapsed", is_face(self.faces), "left out: two corners at one position")
        corners = vertices[self.faces].reshape(-1, 3)
        self.center = corners.mean(axis=0)
        self.size = float(np.linalg.norm(np.ptp(corners, axis=0)))
        self.points = (vertices - self.center) / self.size
        self.rounding = min(rounding_of(vertices) / self.size, MOST_ROUNDING)
        self._cached_bodies: Bodies | None = None

    def _bodies(self) -> Bodies:
        """Bodies of the current faces."""
        if self._cached_bodies is None or self._cached_bodies.faces is not self.faces:
            touch = max(TOUCH, 2.0 * self.rounding)
            self._cached_bodies = Bodies(self.points, self.faces, touch)
        return self._cached_bodies

    def _note(self, name: str, count: int, things: str, message: str) -> None:
        if count:
            self.steps.append(RepairStep(name, count, f"{noun(count, things)} {message}"))

    def _keep(self, name: str, mask: Bools, message: str) -> None:
        if not mask.any():
            dropped = f"{counted(len(self.faces), 'faces')} {message}"
            raise MeshError(
                f"{self.where}: no face is left ({dropped}); is it the surface of an object?"
            )
        if not mask.all():
            self.faces = self.faces[mask]
            self._note(name, int((~mask).sum()), "faces", message)

    def _merge(self, canonical: Ints) -> None:
        """Replace vertices by canonical ones."""
        if np.array_equal(canonical, np.arange(len(canonical))):
            return
        self.canonical = canonical[self.canonical]
        self.faces = canonical[self.faces]

    def weld(self) -> None:
        """Join the borders of faces that differ by rounding."""
        joined = weld_nearby(self.points, self.faces, self.rounding)
        count = int((joined != np.arange(len(joined))).sum())
        self._merge(joined)
        self._note("joined", count, "vertices", "joined to an earlier one a rounding error away")
        self._keep("sunk", is_face(self.faces), "left out: without area, and joined away")

    def leave_out_repeated(self) -> None:
        """Keep each face once."""
        first = is_first(self.faces)
        once = first.copy()
        once[first] = without_mirrored(self.faces[first])
        self._keep("repeated", once, "left out: came twice")

    def leave_out_needles(self) -> None:
        """Leave out faces without an area if fewer edges are open without them."""
        solid = has_area(self.points, self.faces, self.rounding)
        if solid.any() and not solid.all():
            before, after = (
                np.abs(edges_of(faces).balance).sum() for faces in (self.faces, self.faces[solid])
            )
            if after < before:
                self._keep("flat", solid, FLAT)

    def wind(self) -> None:
        """Make the winding of neighbours consistent."""
        flip, one_sided = disagreeing(self.faces)
        self._flip(flip)
        self._note("rewound", int(flip.sum()), "faces", "turned to agree with neighbours")
        if one_sided:
            self.warnings.append(
                f"a surface with one side only, {counted(one_sided, 'faces')}, has no inside"
            )

    def _flip(self, flip: Bools) -> None:
        if flip.any():
            self.faces = np.where(flip[:, None], self.faces[:, ::-1], self.faces)

    def fill(self, *, only_small: bool) -> None:
        """Close holes: the small ones if that hardly changes the surface, or all."""
        holes = holes_of(self.faces)
        if only_small:  # a lone face is not a hole: the face that closes it would be its reverse
            alone = {tuple(face) for face in np.sort(self.faces, axis=1).tolist()}
            holes = [h for h in holes if len(h) <= SMALL and tuple(np.sort(h)) not in alone]
        if not holes:
            return
        added = np.concatenate(close_holes(self.points, holes))
        area = face_areas(self.points, self.faces).sum()
        fraction = face_areas(self.points, added).sum() / max(area, np.finfo(np.float64).tiny)
        if only_small and fraction > SMALL_HOLES:
            return
        self.faces = np.concatenate([self.faces, added])
        if only_small:
            message = "added to close holes of three or four edges"
            self._note("filled", len(added), "faces", message)
            return
        self._note("closed", len(holes), "holes", f"closed, by {counted(len(added), 'faces')}")
        self.warnings.append(
            f"{counted(len(holes), 'holes')} closed by a guess that adds {fraction:.2%} to the "
            "area: labels there are those of faces that are not in the file"
        )

    def leave_out_copies(self) -> None:
        """Keep each body once."""
        bodies = self._bodies()
        copies = bodies.copies(8.0 * max(self.rounding, np.finfo(np.float64).eps))
        canonical = np.arange(len(self.points))
        for new, old in copies.values():
            canonical[new] = old
        if copies:
            self.faces = self.faces[~np.isin(bodies.body, list(copies))]
        self._merge(canonical)
        self._note("copied", len(copies), "bodies", "left out: came twice")

    def turn_outward(self) -> None:
        """Flip the bodies that are inside out."""
        bodies = self._bodies()
        flip = bodies.inside_out()[bodies.body]
        self._flip(flip)
        self._note("inverted", int(flip.sum()), "faces", "turned: they were inside out")

    def fill_cavities(self) -> None:
        """Leave out the bodies wound inward: no finger reaches a sealed cavity."""
        bodies = self._bodies()
        cavity = ~bodies.open & (bodies.volumes < 0.0)
        if cavity.any():
            self.faces = self.faces[~cavity[bodies.body]]
        self._note("solid", int(cavity.sum()), "sealed cavities", "filled")

    def unite(self) -> None:
        """Unite the bodies that overlap or touch."""
        walls = without_inner_walls(self.points, self.faces, self.rounding)
        self._keep("walls", walls, "left out: back to back inside the object")
        within = self._bodies().doubled()
        united = unite(self._bodies())
        added = united.points[len(self.points) :]
        self.vertices = np.concatenate([self.vertices, added * self.size + self.center])
        new = np.arange(len(self.points), len(united.points))
        self.canonical = united.canonical[np.append(self.canonical, new)]
        self.points, self.faces = united.points, united.faces
        self.rounding = max(self.rounding, united.rounding)
        self._note("united", united.bodies, "bodies", "united: overlapping or touching")
        if united.refused:
            self.warnings.append(
                f"{counted(united.refused, 'bodies')} seem to overlap but could not be united "
                "soundly: the volume may count some regions twice"
            )
        elif within:
            self.warnings.append(
                f"{counted(within, 'bodies')} within others and wound alike: taken as part of "
                "them; cavities must be wound inward"
            )

    def leave_out_flat(self) -> None:
        """Keep the faces that have a normal."""
        self.closed = is_closed(self.faces)
        self._keep("flat", has_area(self.points, self.faces, self.rounding), FLAT)

    def result(self) -> RepairedSurface:
        """Return the repaired surface, the bodies joined again where they touch."""
        added = np.arange(len(self.first_vertex), len(self.vertices))
        canonical = first_of_linked(self.canonical, np.append(self.first_vertex, added))
        return RepairedSurface(
            vertices=self.vertices,
            faces=canonical[self.faces],
            canonical=canonical,
            closed=self.closed,
            bodies=int(parts_of(canonical[self.faces]).max()) + 1,
            steps=tuple(self.steps),
            warnings=tuple(self.warnings),
        )


def repair_surface(vertices: Floats, faces: Ints, level: Repair, where: str) -> RepairedSurface:
    """Repair a surface as far as a level allows.

    Args:
        vertices: Positions (V, 3), finite.
        faces: Vertices of each face (F, 3).
        level: How much may be changed.
        where: Name of the mesh in errors.

    Raises:
        MeshError: No face remains.
        WorkBoundError: A step would take too long.
    """
    work = Work(vertices, faces, where, apart=level != "none")
    if level == "none":
        work.leave_out_flat()
        texts = {str(step) for step in work.steps}
        try:
            safe = repair_surface(vertices, faces, "safe", where)
        except WorkBoundError as error:
            work.warnings = [f"not repaired, as requested; repair 'safe' would be refused: {error}"]
            return work.result()
        work.warnings = [
            f"not repaired, as requested; repair 'safe' would do this: {step}"
            for step in safe.steps
            if str(step) not in texts
        ]
        return work.result()
    work.weld()
    work.leave_out_repeated()
    work.wind()
    work.leave_out_needles()
    work.fill(only_small=True)
    if level == "full":
        work.fill(only_small=False)
    work.leave_out_copies()
    work.turn_outward()
    if level == "full":
        work.fill_cavities()
    work.unite()
    work.leave_out_flat()
    return work.result()
