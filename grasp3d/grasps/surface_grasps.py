"""Whole grasps on a surface, and how reliable they are."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from grasp3d.arrays import Bytes, Floats, Ints, locked
from grasp3d.mesh import ObjectMesh
from grasp3d.quality.closure import force_closure
from grasp3d.quality.tilting import EpsilonRange
from grasp3d.settings import GraspModel
from grasp3d.stability.label import Label
from grasp3d.stability.thresholds import label_angles, max_resolution
from grasp3d.surface.contacts import SurfaceContacts
from grasp3d.surface.epsilon import pushing_grasps, surface_epsilons
from grasp3d.surface.extreme_normals import hull_labels
from grasp3d.system.progress import Progress


@dataclass(frozen=True, eq=False)
class SurfaceGrasps:
    """Whole grasps on a surface, a row each.

    Every grasp is given, not searched for: an S says that it is surely stable, a U that it is
    surely unstable.
    """

    contacts: SurfaceContacts
    """Where the fingers touch, on the surface."""
    model: GraspModel
    """Friction and touch; `fingers` is the number of contacts."""
    distance: Floats
    """How far each contact was off the surface before it was moved there, shape (b, n)."""
    critical_angle: Floats
    """Critical friction angle over the worst normals of the contacts [rad], shape (b,).

    inf where all contacts are at one place.
    """
    critical_angle_best: Floats
    """The same over the best normals; differs only where a contact is on a crease, shape (b,)."""
    threads: int | None = None
    """Threads for what is computed when it is first asked for; None: one per processor."""

    @property
    def size(self) -> int:
        """Grasps."""
        return self.contacts.size

    @property
    def mesh(self) -> ObjectMesh:
        """The surface."""
        return self.contacts.mesh

    @cached_property
    def label(self) -> Bytes:
        """`Label` codes, shape (b,): 0 U, 1 M, 2 S; `model.method` says how they are made."""
        return _labels(self, None)

    @cached_property
    def max_resolution(self) -> Floats:
        """Coarsest sensor resolution below which the grasp is S [rad], shape (b,); 0: none."""
        return locked(max_resolution(self.critical_angle, self.model))

    @property
    def epsilon(self) -> Floats:
        """Epsilon (Ferrari & Canny 1992), shape (b,).

        At the contacts' nominal normals, which on a crease are the middle of the set; about the
        mesh's centre of mass, torques divided by `mesh.torque_scale`, in the span of the wrenches
        (`rank`). Certified from below, within 1 %. 0 where the grasp is not closed, nan where the
        normals at a contact cancel out.
        """
        return self.epsilon_range.nominal

    @property
    def epsilon_min(self) -> Floats:
        """Smallest epsilon over the tilts within the sensor's resolution, shape (b,).

        `model.tilts` says how it is taken; see `tilting.epsilon_range`.
        """
        return self.epsilon_range.minimum

    @property
    def epsilon_max(self) -> Floats:
        """What epsilon reaches at most over all tilts, shape (b,): a bound.

        With method extremes it is the largest over the combinations of extreme normals, attained.
        """
        return self.epsilon_range.maximum

    @cached_property
    def epsilon_range(self) -> EpsilonRange:
        """`epsilon`, `epsilon_min` and `epsilon_max`."""
        return surface_epsilons(self.contacts, self.model, threads=self.threads)

    @cached_property
    def rank(self) -> Ints:
        """Dimensions of the wrenches, in which epsilon is taken, shape (b,).

        6; 5 for hard fingers on one line, such as any two; 0 where normals cancel out. Epsilons of
        different rank do not compare.
        """
        ranks = np.zeros(self.size, dtype=np.int64)
        pushing = pushing_grasps(self.contacts)
        if len(pushing):
            contacts = self.contacts.take(pushing).contacts(self.model)
            ranks[pushing] = force_closure(contacts, threads=self.threads).rank
        return locked(ranks)

    @cached_property
    def opening(self) -> Floats:
        """Largest distance between any two contacts, shape (b,)."""
        return locked(_gaps(self.contacts).max(axis=1, initial=0.0))

    @cached_property
    def separation(self) -> Floats:
        """Smallest distance between any two contacts, shape (b,)."""
        return locked(_gaps(self.contacts).min(axis=1, initial=math.inf))

    def enumerate_extremes(self, progress: Progress) -> None:
        """Compute the labels of method extremes now; exact ones need no time.

        Args:
            progress: Called with the share of the work done, from 0 to 1.

        Raises:
            SettingError: A grasp has too many combinations of extreme normals.
        """
        if self.model.method == "extremes" and "label" not in vars(self):
            vars(self)["label"] = _labels(self, progress)
            progress(1.0)

    def measure(self, progress: Progress) -> None:
        """Compute `epsilon_range` now.

        Args:
            progress: Called with the share of the work done, from 0 to 1.
        """
        if "epsilon_range" not in vars(self):
            vars(self)["epsilon_range"] = surface_epsilons(
                self.contacts, self.model, threads=self.threads, progress=progress
            )


def _labels(grasps: SurfaceGrasps, progress: Progress | None) -> Bytes:
    """Label codes as the model's method makes them."""
    model = grasps.model
    if model.method != "extremes":
        return locked(label_angles(grasps.critical_angle, grasps.critical_angle_best, model))
    held = np.flatnonzero(np.isfinite(grasps.critical_angle))
    codes = np.full(grasps.size, Label.U, dtype=np.uint8)
    if len(held):
        contacts = grasps.contacts.take(held)
        codes[held] = hull_labels(contacts, model, threads=grasps.threads, progress=progress)
    return locked(codes)


def _gaps(contacts: SurfaceContacts) -> Floats:
    """Distances between the contacts of each grasp, two by two, shape (b, n (n - 1) / 2)."""
    one, two = np.triu_indices(contacts.count, 1)
    return np.asarray(np.linalg.norm(contacts.points[:, one] - contacts.points[:, two], axis=2))
