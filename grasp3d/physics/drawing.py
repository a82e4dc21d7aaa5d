"""Grasps drawn from a surface: what a sensor perceives, what is true, and the label between them.

A label is about contacts as they are perceived. The mesh is the truth that is simulated; perceived
normals, points and friction are drawn within the stated uncertainty of it, which is the same as
drawing the truth within the uncertainty of what is perceived.
"""

import math
from dataclasses import dataclass

import numpy as np

from grasp3d.arrays import Bools, Bytes, Floats, Ints, angles_between, short_repr, unit_rows
from grasp3d.contact.contacts import Contacts
from grasp3d.contact.friction_cones import tangents
from grasp3d.errors import GraspError
from grasp3d.mesh import ObjectMesh
from grasp3d.mesh.measures import face_areas
from grasp3d.mesh.surface_points import SurfacePoints, nearest_surface_points
from grasp3d.physics.parts import ConvexParts
from grasp3d.settings import GraspModel, Sampling
from grasp3d.stability.classification import classify
from grasp3d.stability.label import Label
from grasp3d.surface.contacts import SurfaceContacts

POINTS = 4000
"""Surface points of which pairs are drawn."""

PAIRS = 400_000
"""Pairs from which grasps are chosen."""

FACING = math.radians(75.0)
"""Largest angle between the line and a normal: beyond it a tip slides past the surface, which is no
grasp by anyone's measure."""

FIT = 0.05
"""Part of a tip's radius to which it may dip into the surface beside the contact."""

PART_DEPTH = 0.05
"""Part of a tip's radius by which convex parts may be off at a contact."""


@dataclass(frozen=True, eq=False)
class TruePoints:
    """Surface points that a tip reaches; lengths in metres."""

    points: Floats
    """Shape (k, 3)."""
    normals: Floats
    """Inward unit normals, shape (k, 3)."""
    left_out: float
    """Fraction of the surface that is left out since the convex parts differ from it there."""

    __repr__ = short_repr


@dataclass(frozen=True, eq=False)
class DrawnGrasps:
    """Grasps of two fingers; lengths in metres, arrays over the grasps (k, ...)."""

    points: Floats
    """True contact points, shape (k, 2, 3)."""
    normals: Floats
    """True inward normals, shape (k, 2, 3)."""
    friction: Floats
    """True friction of each finger, shape (k, 2)."""
    perceived_points: Floats
    perceived_normals: Floats
    label: Bytes
    """`Label` codes of the perceived contacts, shape (k,)."""
    critical_angle: Floats
    """Critical friction angle of the perceived contacts [rad], shape (k,)."""
    margin: Floats
    """Margin of the label [rad], above 0 for S, shape (k,)."""

    __repr__ = short_repr

    @property
    def count(self) -> int:
        """Number of grasps."""
        return len(self.points)

    def take(self, rows: Ints | Bools) -> "DrawnGrasps":
        """The chosen grasps."""
        return DrawnGrasps(**{name: values[rows] for name, values in vars(self).items()})


def true_points(
    mesh: ObjectMesh,
    parts: ConvexParts,
    tip_radius: float,
    part_angle: float,
    random: np.random.Generator,
) -> TruePoints:
    """Draw surface points, evenly over the area, that a round tip touches in the simulation too.

    Args:
        mesh: The object.
        parts: Its convex parts.
        tip_radius: Radius of the tips [m].
        part_angle: Largest angle between the normals of mesh and parts [rad].
        random: Source of randomness.
    """
    areas = face_areas(mesh.vertices, mesh.faces)
    faces = random.choice(len(areas), POINTS, p=areas / areas.sum())
    weights = random.dirichlet([1.0, 1.0, 1.0], POINTS)
    contacts = SurfaceContacts(mesh, SurfacePoints(faces[:, None], weights[:, None]))
    points, normals = contacts.points[:, 0], contacts.normals[:, 0]
    centres = points - tip_radius * normals
    _, _, distances = nearest_surface_points(mesh, centres)
    fits = (distances >= (1.0 - FIT) * tip_radius) & ~contacts.on_crease[:, 0]
    depth = np.abs(parts.depths(points))
    alike = (depth <= PART_DEPTH * tip_radius) & (
        angles_between(parts.outward(points), -normals) <= part_angle
    )
    usable = fits & alike
    return TruePoints(points[usable], normals[usable], float((fits & ~alike).mean()))


def draw_grasps(
    mesh: ObjectMesh,
    reached: TruePoints,
    model: GraspModel,
    sampling: Sampling,
    count: int,
    random: np.random.Generator,
) -> DrawnGrasps:
    """Draw grasps of two fingers, as many of each label, and of each evenly over the margin.

    Args:
        mesh: The object.
        reached: Where contacts may be.
        model: Friction, and what is uncertain.
        sampling: Its limits of the opening.
        count: Number of grasps, of all labels.
        random: Source of randomness.

    Raises:
        GraspError: No two points face each other within these limits.
    """
    pairs = _facing_pairs(reached, sampling, random)
    if not len(pairs):
        raise GraspError(
            f"{mesh.report.source}: no two points of the surface that tips can touch face each "
            "other within the limits of the opening; give smaller tips (--tip-radius), or a "
            "larger max_opening"
        )
    perceived = _perceived(reached, pairs, model, random)
    numbers = [count // 3 + (number < count % 3) for number in range(3)]
    rows = [
        _evenly(perceived.margin, np.flatnonzero(perceived.label == label), number, random)
        for label, number in zip((Label.S, Label.M, Label.U), numbers, strict=True)
    ]
    return perceived.take(np.concatenate(rows))


def tilt_at_random(normals: Floats, tilt: Floats, random: np.random.Generator) -> Floats:
    """Tilt normals by up to an angle, evenly over the cap of directions.

    Args:
        normals: Unit normals, shape (..., 3).
        tilt: Largest angle [rad], shape (...).
        random: Source of randomness.
    """
    shape = normals.shape[:-1]
    angle = np.arccos(1.0 - random.random(shape) * (1.0 - np.cos(tilt)))
    turn = 2.0 * math.pi * random.random(shape)
    one, two = tangents(normals)
    across = np.cos(turn)[..., None] * one + np.sin(turn)[..., None] * two
    return unit_rows(np.cos(angle)[..., None] * normals + np.sin(angle)[..., None] * across)


def _facing_pairs(reached: TruePoints, sampling: Sampling, random: np.random.Generator) -> Ints:
    """Pairs of points whose surfaces face the line between them from outside, shape (k, 2)."""
    total = len(reached.points)
    if total < 2:
        return np.zeros((0, 2), dtype=np.int64)
    pairs = random.integers(total, size=(PAIRS, 2))
    line = reached.points[pairs[:, 1]] - reached.points[pairs[:, 0]]
    opening = np.linalg.norm(line, axis=1)
    fits = (opening >= max(sampling.min_opening, 1e-9)) & (opening <= sampling.max_opening)
    for finger, sign in ((0, 1.0), (1, -1.0)):
        cosine = sign * (reached.normals[pairs[:, finger]] * line).sum(axis=1)
        fits &= cosine >= math.cos(FACING) * opening
    return np.asarray(pairs[fits])


def _perceived(
    reached: TruePoints, pairs: Ints, model: GraspModel, random: np.random.Generator
) -> DrawnGrasps:
    """What is perceived of true contacts within the uncertainty, and its labels."""
    points, normals = reached.points[pairs], reached.normals[pairs]  # (k, 2, 3)
    low, high = model.friction_interval
    shape = normals.shape[:-1]
    directions = unit_rows(random.standard_normal((*shape, 3)))
    shifts = (model.location_error * np.cbrt(random.random(shape)))[..., None] * directions
    perceived = points + shifts, tilt_at_random(normals, np.full(shape, model.tilt), random)
    classes = classify(
        Contacts(*perceived, 0.5 * (low + high)),
        2.0 * model.tilt,
        friction_interval=(low, high),
        location_error=model.location_error,
    )
    return DrawnGrasps(
        points=points,
        normals=normals,
        friction=low + (high - low) * random.random(shape),
        perceived_points=perceived[0],
        perceived_normals=perceived[1],
        label=classes.label,
        critical_angle=classes.critical_friction_angle,
        margin=classes.margin,
    )


def _evenly(margin: Floats, rows: Ints, count: int, random: np.random.Generator) -> Ints:
    """Choose rows evenly over their margins: one at random in each of so many bins of equal width.

    Bins without any are filled from all others at random.
    """
    if len(rows) <= count:
        return rows
    shuffled = random.permutation(rows)
    low, high = margin[rows].min(), margin[rows].max()
    bins = np.minimum(count * (margin[shuffled] - low) / max(high - low, 1e-12), count - 1)
    _, first = np.unique(bins.astype(np.int64), return_index=True)
    sample = shuffled[first]
    rest = np.setdiff1d(shuffled, sample, assume_unique=True)
    more = random.permutation(rest)[: count - len(sample)]
    return np.sort(np.concatenate([sample, more]))
