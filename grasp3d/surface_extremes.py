"""The paper's enumeration of extreme normals for the grasps on a surface."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from grasp3d._kernels.faces import normals_at
from grasp3d._kernels.normal_sets import Sets
from grasp3d.arrays import Bytes, Floats, Ints, unit_rows
from grasp3d.contacts import Contacts
from grasp3d.enumeration import extremes, see
from grasp3d.extremes import Tested, check_combinations, extreme_normals, rings_needed
from grasp3d.mesh import ObjectMesh
from grasp3d.mesh.places import SurfacePlaces
from grasp3d.progress import Progress
from grasp3d.sampling.antipodal import contact_normals, contact_surface
from grasp3d.settings import GraspModel
from grasp3d.stability import Label

PART = 4096
"""Grasps enumerated at once."""

MOST_FACES = 12
"""Faces at one place whose normals are tried; of more, so many spread evenly around it."""


class SurfaceGrasps(NamedTuple):
    """Two-finger grasps on a surface."""

    mesh: ObjectMesh
    vertices: Ints
    """First contacts, shape (b,)."""
    seconds: SurfacePlaces
    """Second contacts, shape (b,)."""


def check_combinations_of(model: GraspModel) -> None:
    """Refuse before the work what no smooth grasp could be labelled with.

    Raises:
        SettingError: A grasp of two smooth contacts has too many combinations.
    """
    rings = rings_needed(model.tilt, model.friction_angle)
    check_combinations([1 + rings * model.extreme_normals] * 2)


def hull_labels(
    grasps: SurfaceGrasps,
    model: GraspModel,
    *,
    threads: int | None = 1,
    progress: Progress | None = None,
) -> Bytes:
    """Label grasps by their wrench hulls alone (Wan & Howe 2018, Sec. III).

    Args:
        grasps: The grasps.
        model: Friction, resolution, edges and the number of extreme normals.
        threads: Threads; None: one per processor.
        progress: Called with the share of the work done, from 0 to 1.

    Returns:
        Label codes, shape (b,).

    Raises:
        SettingError: A grasp has too many combinations.
    """
    labels = np.full(len(grasps.vertices), Label.M, dtype=np.uint8)
    done = 0
    for rows, contacts, tested in _groups(grasps, model):
        seen = see(contacts, tested, edges=model.edges, threads=threads)
        labels[rows[~seen.closing]] = Label.U
        labels[rows[~seen.failing]] = Label.S
        done += len(rows)
        if progress is not None:
            progress(done / len(labels))
    return labels


def hull_epsilons(
    grasps: SurfaceGrasps,
    model: GraspModel,
    *,
    rtol: float,
    threads: int | None = 1,
    progress: Progress | None = None,
) -> tuple[Floats, Floats]:
    """Smallest and largest epsilon over the combinations of extreme normals, shape (b,) each.

    Args:
        grasps: The grasps.
        model: As for `hull_labels`, and actuation and torsion.
        rtol: As in `quality.epsilon`.
        threads: Threads; None: one per processor.
        progress: Called with the share of the work done, from 0 to 1.

    Raises:
        SettingError: A grasp has too many combinations.
    """
    found, done = np.zeros((2, len(grasps.vertices))), 0
    for rows, contacts, tested in _groups(grasps, model):
        range_ = extremes(
            contacts, tested, edges=model.edges, actuation=model.actuation,
            torque_scale=grasps.mesh.torque_scale, rtol=rtol, threads=threads,
        )  # fmt: skip
        found[:, rows] = range_.minimum, range_.maximum
        done += len(rows)
        if progress is not None:
            progress(done / len(grasps.vertices))
    return found[0], found[1]


def _groups(grasps: SurfaceGrasps, model: GraspModel) -> Iterator[tuple[Ints, Contacts, Tested]]:
    """Grasps with as many normals at either contact, some at a time: (rows, contacts, tested)."""
    first, second = _vertex_normals(grasps), _place_normals(grasps)
    points = np.stack(
        [grasps.mesh.vertices[grasps.vertices], grasps.seconds.positions(grasps.mesh)], axis=1
    )
    points -= grasps.mesh.center_mass
    sizes = np.array([[len(one), len(two)] for one, two in zip(first, second, strict=True)])
    kinds, kind = np.unique(sizes.reshape(-1, 2), axis=0, return_inverse=True)
    for number in range(len(kinds)):
        members = np.flatnonzero(kind == number)
        for start in range(0, len(members), PART):
            rows = members[start : start + PART]
            sets = [np.stack([normals[row] for row in rows]) for normals in (first, second)]
            nominal = np.stack([some[:, 0] for some in sets], axis=1)
            contacts = Contacts(points[rows], nominal, model.friction, model.torsion_radius)
            creases = {i: some for i, some in enumerate(sets) if some.shape[1] > 1}
            tilt = np.full((len(rows), 2), model.tilt)
            count = model.extreme_normals
            yield rows, contacts, extreme_normals(contacts, tilt, count=count, creases=creases)


def _vertex_normals(grasps: SurfaceGrasps) -> list[Floats]:
    """Normals of the faces at the first contacts, (k, 3) each."""
    sets = contact_normals(grasps.mesh)
    return [_few(_normals_of(sets, vertex)) for vertex in grasps.vertices]


def _place_normals(grasps: SurfaceGrasps) -> list[Floats]:
    """Normals of the faces at the second contacts, (k, 3) each."""
    surface, sets = contact_surface(grasps.mesh), contact_normals(grasps.mesh)
    found, room = [], np.empty((2, 3))
    for face, weights in zip(grasps.seconds.faces, grasps.seconds.weights, strict=True):
        count, vertex = normals_at(face, tuple(weights), surface, sets, room)
        known = _normals_of(sets, vertex) if vertex >= 0 else unit_rows(room[: max(count, 1)])
        found.append(_few(known))
    return found


def _normals_of(sets: Sets, vertex: int) -> Floats:
    """Corners of a vertex's set; all its normals where they span every direction."""
    first, count = sets.start[vertex], sets.counts[vertex]
    return sets.normals[first : first + count if count else sets.start[vertex + 1]]


def _few(normals: Floats) -> Floats:
    count = min(len(normals), MOST_FACES)
    return normals[np.linspace(0, len(normals), count, endpoint=False).astype(np.int64)]
