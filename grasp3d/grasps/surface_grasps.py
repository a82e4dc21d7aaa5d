"""Whole grasps on a surface with labels and epsilon."""

import math
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from grasp3d.arrays import Bytes, Floats, Ints, locked, short_repr
from grasp3d.mesh import ObjectMesh
from grasp3d.quality.closure import force_closure
from grasp3d.quality.tilting import EpsilonRange
from grasp3d.settings import GraspModel
from grasp3d.stability.label import Label
from grasp3d.stability.thresholds import label_angles
from grasp3d.surface.contacts import SurfaceContacts
from grasp3d.surface.deferred import Deferred
from grasp3d.surface.epsilon import grasps_with_normals, surface_epsilons
from grasp3d.surface.extreme_normals import hull_labels
from grasp3d.surface.labelled_grasps import LabelledGrasps
from grasp3d.system.progress import Progress


@dataclass(frozen=True, eq=False)
class SurfaceGrasps(LabelledGrasps):
    """Whole grasps on a surface, one for each row.

    The grasps are given, not searched for: S means surely stable, U surely unstable.
    """

    contacts: SurfaceContacts
    """Contacts on the surface."""
    model: GraspModel
    """Friction and sensor resolution; `fingers` is the number of contacts."""
    distance: Floats
    """Distance of each contact from the surface before it was moved there, shape (b, n)."""
    angles: tuple[Floats, Floats]
    """`critical_angle` and `critical_angle_best`."""
    threads: int | None
    """Threads for what is computed when it is first read; None: one per processor."""
    deferred_label: Deferred[Bytes]
    deferred_epsilon: Deferred[EpsilonRange]

    __repr__ = short_repr

    @property
    def critical_angle(self) -> Floats:
        """Critical friction angle over the worst normals of the contacts [rad], shape (b,).

        inf where all contacts are at one point.
        """
        return self.angles[0]

    @property
    def critical_angle_best(self) -> Floats:
        """The same over the best normals, shape (b,); different only for contacts on creases."""
        return self.angles[1]

    @property
    def size(self) -> int:
        """Number of grasps."""
        return self.contacts.size

    @property
    def mesh(self) -> ObjectMesh:
        """The surface."""
        return self.contacts.mesh

    @cached_property
    def rank(self) -> Ints:
        """Dimension of the span of the wrenches, in which epsilon is computed, shape (b,).

        6; 5 for hard fingers on one line, such as any two; 0 where normals cancel out. Epsilons of
        different rank are not comparable.
        """
        ranks = np.zeros(self.size, dtype=np.int64)
        chosen = grasps_with_normals(self.contacts)
        if len(chosen):
            contacts = self.contacts.take(chosen).contacts(self.model)
            ranks[chosen] = force_closure(contacts, threads=self.threads).rank
        return locked(ranks)

    @cached_property
    def opening(self) -> Floats:
        """Largest distance between any two contacts, shape (b,)."""
        return locked(_distances(self.contacts).max(axis=1, initial=0.0))

    @cached_property
    def separation(self) -> Floats:
        """Smallest distance between any two contacts, shape (b,)."""
        return locked(_distances(self.contacts).min(axis=1, initial=math.inf))


def labelled_grasps(
    contacts: SurfaceContacts,
    model: GraspModel,
    angles: tuple[Floats, Floats],
    *,
    distance: Floats | None = None,
    threads: int | None = None,
) -> SurfaceGrasps:
    """Labels and epsilon of given grasps, computed when they are first read.

    Args:
        contacts: Contacts on the surface.
        model: Friction and sensor resolution.
        angles: Critical friction angles over the worst and the best normals [rad], shape (b,) each.
        distance: Distance of each contact from the surface before it was moved there, shape (b, n);
            None: 0.
        threads: Threads; None: one per processor.
    """
    distances = np.zeros((contacts.size, contacts.count)) if distance is None else distance
    return SurfaceGrasps(
        contacts=contacts,
        model=model,
        distance=locked(distances),
        angles=angles,
        threads=threads,
        deferred_label=Deferred(partial(_labels, contacts, angles, model, threads)),
        deferred_epsilon=Deferred(partial(_epsilons, contacts, model, threads)),
    )


def _labels(
    contacts: SurfaceContacts,
    angles: tuple[Floats, Floats],
    model: GraspModel,
    threads: int | None,
    progress: Progress,
) -> Bytes:
    """Label codes by the model's method, shape (b,)."""
    if model.method == "exact":
        return locked(label_angles(*angles, model))
    chosen = np.flatnonzero(np.isfinite(angles[0]))
    codes = np.full(contacts.size, Label.U, dtype=np.uint8)
    if len(chosen):
        grasps = contacts.take(chosen)
        codes[chosen] = hull_labels(grasps, model, threads=threads, progress=progress)
    return locked(codes)


def _epsilons(
    contacts: SurfaceContacts, model: GraspModel, threads: int | None, progress: Progress
) -> EpsilonRange:
    return surface_epsilons(contacts, model, threads=threads, progress=progress)


def _distances(contacts: SurfaceContacts) -> Floats:
    """Distances of all pairs of contacts of each grasp, shape (b, n (n - 1) / 2)."""
    first, second = np.triu_indices(contacts.count, 1)
    return np.asarray(
        np.linalg.norm(contacts.points[:, first] - contacts.points[:, second], axis=2)
    )
