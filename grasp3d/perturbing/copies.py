"""Noisy copies of a scan: their labels, and what noise does to normals, points and grasps."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from grasp3d._kernels.normal_angles import smallest_angle
from grasp3d.arrays import Bools, Bytes, Floats, Ints, angles_between
from grasp3d.mesh.noise_fields import noise_stream, random_field
from grasp3d.mesh.noisy_copies import MovableSurface
from grasp3d.mesh.object_mesh import ObjectMesh
from grasp3d.mesh.surface_points import SurfacePoints
from grasp3d.stability.label import Label
from grasp3d.surface.contacts import SurfaceContacts, vertex_surface_points
from grasp3d.surface.critical_angles import critical_angles
from grasp3d.surface.labelling import label_surface
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.surface.vertex_grasps import Reason

Singles = npt.NDArray[np.float32]

COPIES = 2
"""Number of the streams of random numbers of copies."""


@dataclass(frozen=True, eq=False)
class CopyResult:
    """What one noisy copy of a surface shows; arrays over the vertices, (V,).

    Numbers have 32 bits, as those of all copies are in memory together.
    """

    label: Bytes
    """Labels of the copy, of the best grasps found there."""
    critical_angle: Singles
    """Their critical friction angles [rad]; inf: no grasp."""
    kept: Bools
    """Whether the surface's own best grasp is S in the copy."""
    stable_area: float
    """Area that is S in the copy, by the areas of the surface itself."""
    right_area: float
    """Area of that part whose grasp is S on the surface itself."""
    turn: Singles
    """Largest angle between the copy's normals and the surface's normal, or set of normals, at the
    vertex [rad]."""
    shift: Singles
    """How far the vertex moved, in the mesh's unit."""
    across: Singles
    """How far the contacts of the surface's own grasp moved across the line between them, as the
    mean of the two: two fingers; for more, how far the vertex moved. nan: no grasp."""


def noisy_copies(
    surface: MovableSurface,
    sigma: float,
    correlation: float,
    seed: int,
    count: int,
    *,
    threads: int | None = None,
) -> Iterator[ObjectMesh]:
    """Make copies of a surface whose vertices are moved along their normals at random.

    Every copy has a random stream of its own, so that copy k is the same for any number of them.

    Args:
        surface: The surface.
        sigma: Standard deviation of the displacements, in the mesh's unit.
        correlation: Correlation length, in the mesh's unit; see `random_field`.
        seed: Seed of all copies.
        count: Number of copies.
        threads: Threads to use; None: one per processor.
    """
    for number in range(count):
        random = noise_stream(seed, COPIES, number)
        field = random_field(surface.points, surface.normals, correlation, random)
        yield surface.moved(sigma * field[:, None] * surface.normals, threads=threads)


def examine_copy(labels: SurfaceLabels, copy: ObjectMesh) -> CopyResult:
    """Label a copy of a surface, and compare it with the surface.

    Args:
        labels: The labels of the surface itself.
        copy: A copy, with the same faces.
    """
    found = label_surface(copy, labels.model, sampling=labels.sampling, threads=labels.threads)
    shift = np.linalg.norm(copy.vertices - labels.mesh.vertices, axis=1)
    across = _shift_across(labels, copy) if labels.model.fingers == 2 else shift
    areas, limit = labels.mesh.vertex_areas, labels.model.effective_friction_angle
    stable = found.label == Label.S
    right = stable & (angles_on(labels.mesh, found) < limit)
    return CopyResult(
        label=found.label,
        critical_angle=found.critical_angle.astype(np.float32),
        kept=angles_on(copy, labels) < limit,
        stable_area=float(areas[stable].sum()),
        right_area=float(areas[right].sum()),
        turn=turned_normals(labels.mesh, copy).astype(np.float32),
        shift=shift.astype(np.float32),
        across=across.astype(np.float32),
    )


def angles_on(mesh: ObjectMesh, labels: SurfaceLabels) -> Floats:
    """Critical friction angles of labelled grasps on another copy of their surface [rad], (V,).

    The contacts are at the same surface points: face and barycentric coordinates.

    Args:
        mesh: A mesh of the same faces.
        labels: Labels with a grasp for each vertex, or none: inf.
    """
    rows = np.flatnonzero(labels.reason == Reason.FOUND)
    angles = np.full(len(labels.reason), math.inf)
    if len(rows):
        contacts = SurfaceContacts(mesh, _surface_points(labels, rows))
        angles[rows], _ = critical_angles(contacts, threads=labels.threads)
    return angles


def turned_normals(mesh: ObjectMesh, copy: ObjectMesh) -> Floats:
    """Largest angle from a surface's normals to those of its copy at each vertex [rad], (V,).

    At creases it is the distance from the set of the surface's normals.
    """
    sets, given = mesh.normal_sets, copy.corner_normals
    vertex, normals = given.vertices, given.normals
    one = sets.counts[vertex] == 1
    angles = np.zeros(len(vertex))
    angles[one] = angles_between(normals[one], sets.normals[sets.start[vertex[one]]])
    for row in np.flatnonzero(~one & (sets.counts[vertex] > 0)):
        at = vertex[row]
        angles[row] = smallest_angle(sets.normals, sets.start[at], sets.counts[at], *normals[row])
    largest = np.zeros(len(mesh.vertices))
    np.maximum.at(largest, vertex, angles)
    return np.asarray(largest[mesh.canonical])


def _shift_across(labels: SurfaceLabels, copy: ObjectMesh) -> Floats:
    """Half the distance by which two contacts moved relative to each other across their line.

    It is the location error whose bound for the turn of the line, asin(2 error / opening), is the
    turn that was seen.
    """
    rows = np.flatnonzero(labels.reason == Reason.FOUND)
    points = _surface_points(labels, rows)
    lines = [np.diff(points.positions(mesh), axis=1)[:, 0] for mesh in (labels.mesh, copy)]
    turn = np.minimum(angles_between(*lines), math.pi / 2.0)
    across = np.full(len(labels.reason), math.nan)
    across[rows] = 0.5 * np.linalg.norm(lines[0], axis=1) * np.sin(turn)
    return across


def _surface_points(labels: SurfaceLabels, rows: Ints | Bools) -> SurfacePoints:
    """All contacts of the grasps of some vertices, (b, n)."""
    own, others = vertex_surface_points(labels.mesh, rows), labels.partner_points
    return SurfacePoints(
        np.concatenate([own.faces[:, None], others.faces[rows, 0]], axis=1),
        np.concatenate([own.weights[:, None], others.weights[rows, 0]], axis=1),
    )
