"""Repair as a whole: which steps are taken, and the record of each."""

from dataclasses import dataclass

import numpy as np

from grasp3d.arrays import Floats, Ints
from grasp3d.errors import MeshError
from grasp3d.mesh.measures import has_area, rounding_of
from grasp3d.mesh.repair.cleaning import CleanFaces, clean_faces
from grasp3d.mesh.repair.orientation import OrientedFaces, orient_faces
from grasp3d.settings import Repair

MOST_ROUNDING = 1e-6
"""Largest rounding believed, as a share of the size: whole numbers fit in 32 bits as well."""


@dataclass(frozen=True)
class RepairStep:
    """One kind of change, and how often it was made."""

    name: str
    """What was done, in one word for programs: welded, collapsed, repeated, ..."""
    count: int
    """Vertices, faces or bodies that were changed."""
    told: str
    """What was done, to be read after the count."""

    def __str__(self) -> str:
        """Say it in one sentence."""
        return f"{self.count} {self.told}"


@dataclass(frozen=True, eq=False)
class RepairedSurface:
    """A surface to put contacts on, over the vertices that were given."""

    vertices: Floats
    """Positions (V', 3): those that were given, unmoved and in their order, then added ones."""
    faces: Ints
    """Faces (F', 3), counter-clockwise from outside as far as that can be told."""
    canonical: Ints
    """For every vertex the one that stands for it, shape (V',); faces use no others."""
    closed: bool
    """Every edge is passed as often one way as the other: the faces bound a volume."""
    bodies: int
    """Connected parts."""
    steps: tuple[RepairStep, ...]
    """What was changed."""
    warnings: tuple[str, ...]
    """What was not, a sentence each."""


def repair_surface(vertices: Floats, faces: Ints, level: Repair, where: str) -> RepairedSurface:
    """Mend a surface as far as a level allows.

    Args:
        vertices: Positions (V, 3), finite.
        faces: Vertices of each face (F, 3).
        level: How much may be changed.
        where: Name of the mesh in errors.

    Raises:
        MeshError: No face is left.
    """
    _ = level
    clean = clean_faces(vertices, faces)
    if len(clean.faces) == 0:
        raise MeshError(f"{where}: all {len(faces)} faces have collapsed to points or lines")
    corners = vertices[clean.faces].reshape(-1, 3)
    center, size = corners.mean(axis=0), float(np.linalg.norm(np.ptp(corners, axis=0)))
    points = (vertices - center) / size
    oriented = orient_faces(points, clean.faces)
    rounding = min(rounding_of(vertices) / size, MOST_ROUNDING)
    solid = has_area(points, oriented.faces, rounding)
    kept = oriented.faces[solid]
    if len(kept) == 0:
        raise MeshError(f"{where}: no face has an area")
    return RepairedSurface(
        vertices=vertices,
        faces=kept,
        canonical=clean.canonical,
        closed=oriented.closed,
        bodies=oriented.bodies,
        steps=_steps(clean, oriented, int((~solid).sum())),
        warnings=_warnings(oriented),
    )


def _steps(clean: CleanFaces, oriented: OrientedFaces, flat: int) -> tuple[RepairStep, ...]:
    joined = int((clean.canonical != np.arange(len(clean.canonical))).sum())
    steps = (
        RepairStep("welded", joined, "vertices joined to an earlier one at the same position"),
        RepairStep("collapsed", clean.collapsed, "faces left out: two corners at one place"),
        RepairStep("repeated", clean.repeated, "faces left out: they came twice"),
        RepairStep("flat", flat, "faces left out: no area"),
        RepairStep("filled", oriented.filled, "faces added to close holes of three or four edges"),
        RepairStep("rewound", oriented.rewound, "faces turned to agree with their neighbours"),
        RepairStep("inverted", oriented.inverted, "faces turned: they were inside out"),
    )
    return tuple(step for step in steps if step.count)


def _warnings(oriented: OrientedFaces) -> tuple[str, ...]:
    if not oriented.doubled:
        return ()
    doubled = (
        f"{oriented.doubled} bodies lie within others and are wound like them: "
        "the volume counts them twice; cavities must be wound inward"
    )
    return (doubled,)
