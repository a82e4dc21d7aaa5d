"""Repair of a surface: the sequence of its steps at each level, and what they changed."""

from dataclasses import dataclass, field

import numpy as np

from grasp3d.arrays import Bools, Floats, Ints, first_alike, first_at_position, short_repr
from grasp3d.errors import MeshError
from grasp3d.mesh.cleaning import (
    SMALL,
    close_hole,
    clusters,
    disagreeing,
    first_of_body,
    from_least_corner,
    holes_of,
    is_face,
    weld_nearby,
    without_mirrored,
)
from grasp3d.mesh.measures import (
    face_areas,
    first_connected,
    has_area,
    is_closed,
    parts_of,
    rounding_of,
)
from grasp3d.mesh.union import (
    Solid,
    bodies_of,
    count_united,
    orient,
    rows_of,
    surround,
    union_of,
    united,
)
from grasp3d.settings.mesh_options import Repair
from grasp3d.system.names import counted, noun

MOST_ROUNDING = 1e-6
"""Largest rounding assumed, as a fraction of the size: integers are exact in 32 bits as well."""

TOUCH = 1e-10
"""Distance within which bodies touch, as a fraction of the size, unless rounding is larger."""

SMALL_HOLES = 0.01
"""Small holes are closed if the faces that close them add at most this fraction to the area."""


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


@dataclass(eq=False)
class _Work:
    """A surface under repair, in a frame of size about 1 so that volumes stay exact."""

    where: str
    points: Floats
    faces: Ints
    canonical: Ints
    rounding: float
    steps: list[RepairStep] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)

    def note(self, name: str, count: int, things: str, message: str) -> None:
        if count:
            self.steps.append(RepairStep(name, int(count), f"{noun(count, things)} {message}"))

    def keep(self, name: str, mask: Bools, message: str) -> None:
        if not mask.any():
            dropped = f"{counted(len(self.faces), 'faces')} {message}"
            raise MeshError(
                f"{self.where}: no face is left ({dropped}); is it the surface of an object?"
            )
        self.faces = self.faces[mask]
        self.note(name, (~mask).sum(), "faces", message)


def repair_surface(vertices: Floats, faces: Ints, level: Repair, where: str) -> RepairedSurface:
    """Repair a surface as far as a level allows.

    Args:
        vertices: Positions (V, 3), finite.
        faces: Vertices of each face (F, 3).
        level: How much may be changed.
        where: Name of the mesh in errors.

    Raises:
        MeshError: No face remains.
    """
    first = first_at_position(vertices)
    canonical = first if level == "none" else first_of_body(faces, first)
    work = _Work(where, vertices, canonical[faces], canonical, 0.0)
    joined = int((first != np.arange(len(vertices))).sum())
    work.note("welded", joined, "vertices", "joined to an earlier one at the same position")
    work.keep("collapsed", is_face(work.faces), "left out: two corners at one position")
    corners = vertices[work.faces].reshape(-1, 3)
    center, size = corners.mean(axis=0), float(np.linalg.norm(np.ptp(corners, axis=0)))
    work.points = (vertices - center) / size
    work.rounding = min(rounding_of(vertices) / size, MOST_ROUNDING)
    if level != "none":
        _clean(work)
        _close_holes(work, every=False)
        if level == "full":
            _close_holes(work, every=True)
        _unite(work, fill=level == "full")
    solid = has_area(work.points, work.faces, work.rounding)
    closed = is_closed(work.faces) or is_closed(work.faces[solid])
    work.keep("flat", solid, "left out: no area")
    every = np.arange(len(work.points))
    added = work.points[len(first) :] * size + center
    links = np.concatenate([work.canonical, first, every[len(first) :]])  # join touching bodies
    canonical = first_connected(len(every), np.append(every, every), links)
    faces = canonical[work.faces]
    return RepairedSurface(
        vertices=np.concatenate([vertices, added]),
        faces=faces,
        canonical=canonical,
        closed=closed,
        bodies=int(parts_of(faces).max()) + 1,
        steps=tuple(work.steps),
        warnings=tuple(work.warnings),
    )


def _clean(work: _Work) -> None:
    """Weld vertices, leave out needless faces, and make the winding of neighbours consistent."""
    joined = weld_nearby(work.points, work.faces, work.rounding)
    count = int((joined != np.arange(len(joined))).sum())
    work.canonical, work.faces = joined[work.canonical], joined[work.faces]
    work.note("joined", count, "vertices", "joined to an earlier one a rounding error away")
    work.keep("sunk", is_face(work.faces), "left out: without area, and joined away")
    once = np.zeros(len(work.faces), dtype=bool)
    # The same corners in the opposite winding are another face: a sheet may have two sides.
    once[first_alike(from_least_corner(work.faces))[0]] = True
    once[once] = without_mirrored(work.faces[once])
    work.keep("repeated", once, "left out: came twice")
    flip = disagreeing(work.faces)
    work.faces = np.where(flip[:, None], work.faces[:, ::-1], work.faces)
    work.note("rewound", flip.sum(), "faces", "turned to agree with neighbours")


def _close_holes(work: _Work, *, every: bool) -> None:
    """Close the small holes if that hardly changes the surface, or every hole by a guess."""
    holes = holes_of(work.faces)
    if not every:  # a lone face is not a hole: the face that closes it would be its reverse
        alone = {tuple(face) for face in np.sort(work.faces, axis=1).tolist()}
        holes = [h for h in holes if len(h) <= SMALL and tuple(np.sort(h)) not in alone]
    if not holes:
        return
    added = np.concatenate([close_hole(work.points, hole) for hole in holes])
    area = face_areas(work.points, work.faces).sum()
    fraction = face_areas(work.points, added).sum() / max(area, np.finfo(np.float64).tiny)
    if every:
        work.note("closed", len(holes), "holes", f"closed, by {counted(len(added), 'faces')}")
        work.warnings.append(
            f"{counted(len(holes), 'holes')} closed by a guess that adds {fraction:.2%} to the "
            "area: labels there are those of faces that are not in the file"
        )
    elif fraction <= SMALL_HOLES:
        work.note("filled", len(added), "faces", "added to close holes of three or four edges")
    else:
        return
    work.faces = np.concatenate([work.faces, added])


def _unite(work: _Work, *, fill: bool) -> None:
    """Wind the bodies outward, fill cavities, and unite the bodies that overlap or touch."""
    touch = max(TOUCH, 2.0 * work.rounding)
    body, volumes, divided = bodies_of(work.points, work.faces, work.rounding)
    vertex = np.empty(int(divided.max()) + 1, dtype=np.int64)
    vertex[divided] = work.faces
    flip, owner = orient(work.points[vertex], divided, vertex, body, volumes, touch)
    work.note("inverted", flip[body].sum(), "faces", "turned: they were inside out")
    divided = np.where(flip[body][:, None], divided[:, ::-1], divided)
    cavity = (owner >= 0) & (owner != np.arange(len(owner)))
    if fill:
        work.note("solid", cavity.sum(), "sealed cavities", "filled")
        divided, body = divided[~cavity[body]], body[~cavity[body]]
    work.faces = vertex[divided]
    parts = [rows for rows in rows_of(owner[body]) if owner[body[rows[0]]] >= 0]
    flat = [rows for rows in rows_of(body) if volumes[body[rows[0]]] == 0.0]
    kept, areas = np.ones(len(body), dtype=bool), face_areas(work.points, work.faces)
    corners = work.points[work.faces[owner[body] >= 0]]
    for rows in flat if parts else []:
        face = work.faces[rows[np.argmax(areas[rows])]]
        kept[rows] = not surround(corners - work.points[face].mean(axis=0))
    others = work.faces[kept & (owner[body] < 0)]
    work.keep("walls", kept, "left out: back to back inside the object")
    if len(parts) < 2:
        return
    exact = work.points[clusters(work.points, touch)]  # bodies that touch do so exactly
    solids = [Solid.of(exact[vertex], divided[rows], touch) for rows in parts]
    whole = union_of(solids)
    if whole is None:
        work.warnings.append(
            f"{counted(len(solids), 'bodies')} seem to overlap but could not be united "
            "soundly: the volume may count some regions twice"
        )
        return
    joined, within = count_united(whole, solids, touch)
    if not joined:
        return
    count = len(work.points)
    work.points, faces, canonical = united(work.points, vertex, whole, solids, touch)
    work.faces = np.concatenate([others, faces])
    work.canonical = canonical[np.append(work.canonical, np.arange(count, len(work.points)))]
    work.rounding = max(work.rounding, touch)
    work.note("united", joined, "bodies", "united: overlapping or touching")
    if within:
        work.warnings.append(
            f"{counted(within, 'bodies')} within others: taken as part of them; a cavity must be "
            "wound inward, and touch no other surface"
        )
