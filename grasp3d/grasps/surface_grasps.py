"""Whole grasps on a surface with labels and epsilon."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from importlib import import_module
from typing import Any

import numpy as np

from grasp3d.arrays import Bytes, Floats, Ints, locked, short_repr
from grasp3d.grasps.closed_grasps import ClosedGrasps, close_on_grasps
from grasp3d.hand.reach import Reach
from grasp3d.hand.scene import Scene
from grasp3d.loads import Load
from grasp3d.mesh import ObjectMesh
from grasp3d.quality.closure import force_closure
from grasp3d.quality.measures.measuring import MetricValues
from grasp3d.quality.tilting import EpsilonRange
from grasp3d.settings import GraspModel
from grasp3d.stability.label import Label
from grasp3d.stability.sampled_normals import WorstAndBest
from grasp3d.stability.thresholds import label_angles
from grasp3d.surface.contacts import SurfaceContacts
from grasp3d.surface.deferred import Deferred
from grasp3d.surface.epsilon import grasps_with_normals, surface_epsilons
from grasp3d.surface.extreme_normals import hull_labels
from grasp3d.surface.grasp_forces import surface_holding
from grasp3d.surface.grasp_metrics import surface_metrics
from grasp3d.surface.holding import Holding
from grasp3d.surface.labelled_grasps import LabelledGrasps
from grasp3d.surface.load_case import LoadCase
from grasp3d.surface.located_angles import located_angles_of
from grasp3d.system.progress import Progress


@dataclass(frozen=True, eq=False)
class SurfaceGrasps(LabelledGrasps):
    """Whole grasps on a surface, one for each row.

    The grasps are given, not searched for: S means surely stable, U surely unstable.

    Example:
        >>> import trimesh
        >>> import grasp3d
        >>> box = trimesh.creation.box([0.08, 0.05, 0.03])
        >>> labels = grasp3d.label_surface(grasp3d.load_mesh(box, unit="m", max_edge=0.02))
        >>> grasps = grasp3d.best_grasps(labels, 2)
        >>> grasps.to_dataframe()[["grasp", "label", "rank", "opening"]].round(3)
           grasp label  rank  opening
        0      1     S     5     0.08
        1      2     S     5     0.08
    """

    contacts: SurfaceContacts
    """Contacts on the surface."""
    model: GraspModel
    """Friction and sensor resolution; `fingers` is the number of contacts."""
    distance: Floats
    """Distance of each contact from the surface before it was moved there, shape (b, n)."""
    critical_angle: Floats
    """Critical friction angle over the worst normals of the contacts [rad], shape (b,).

    inf where all contacts are at one point.
    """
    critical_angle_best: Floats
    """The same over the best normals, shape (b,); different only for contacts on creases."""
    scene: Scene | None = None
    """The gripper of the grasps, and what it must not touch; None: ideal points."""
    reach: Reach | None = None
    """How the gripper reaches each grasp, with its pose; None: no gripper."""
    load: Load | None = None
    """What each grasp must hold; None: `holding` is not computed."""
    threads: int | None = None
    """Threads for what is computed when it is first read; None: one per processor."""
    deferred_located: Deferred[WorstAndBest] = field(init=False, repr=False)
    """`located_angles`, which take closure tests for three fingers and more."""
    deferred_label: Deferred[Bytes] = field(init=False, repr=False)
    """`label`, which takes an enumeration with method extremes."""
    deferred_epsilon: Deferred[EpsilonRange] = field(init=False, repr=False)
    """`epsilon_range`, which takes a wrench hull and more for each grasp."""
    deferred_holding: Deferred[Holding] | None = field(init=False, repr=False)
    """`holding`, which takes several wrench hulls for each grasp; None: there is no load."""
    deferred_closed: Deferred[ClosedGrasps] | None = field(init=False, repr=False)
    """`closed`, which takes a few ms for each grasp; None: there are no poses."""

    __repr__ = short_repr

    def __post_init__(self) -> None:
        angles = self.critical_angle, self.critical_angle_best
        case, used = self.load_case, (self.contacts, self.model)
        located = Deferred(partial(_located, self.contacts, angles, self.model, self.threads))
        radius = 0.0 if case is None else case.center_radius
        self._defer(
            located,
            partial(_labels, self.contacts, located, self.model, self.threads),
            partial(_epsilons, *used, radius, self.threads),
            None if case is None else partial(_holding, *used, case, self.threads),
        )
        object.__setattr__(self, "deferred_closed", self._deferred_closed())

    def _deferred_closed(self) -> Deferred[ClosedGrasps] | None:
        """`closed`; None: there is no gripper, or there are more than two fingers."""
        if self.reach is None or self.scene is None or self.contacts.count > 2:
            return None
        used = self.mesh, self.reach, self.scene, self.model
        return Deferred(partial(_closed, *used, self.load, self.threads))

    def with_closed(self, closed: ClosedGrasps) -> "SurfaceGrasps":
        """The same grasps, of which it is already known what the closed jaws touch.

        Args:
            closed: What they touch, a row for each grasp.
        """
        same = replace(self)
        object.__setattr__(same, "deferred_closed", Deferred(partial(_known, closed)))
        return same

    @property
    def load_case(self) -> LoadCase | None:
        """The load on this object, with its mass, task and force at hand; None: no load."""
        if self.load is None:
            return None
        hand = None if self.scene is None else self.scene.hand
        return LoadCase.of(self.load, self.mesh, self.model, hand)

    @property
    def size(self) -> int:
        """Number of grasps."""
        return self.contacts.size

    @property
    def mesh(self) -> ObjectMesh:
        """The surface."""
        return self.contacts.mesh

    @property
    def closed(self) -> ClosedGrasps | None:
        """What the jaws touch when they close at the poses, with labels and margins.

        Computed when first read; None: no gripper, or three fingers and more.
        """
        return None if self.deferred_closed is None else self.deferred_closed.value

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

    def metrics(self, names: str | Sequence[str] = "all") -> MetricValues:
        """Quality measures of each grasp, shape (b,) each; computed when called.

        Torques are divided by `mesh.torque_scale`, circular cones replaced by pyramids of 8 edges.

        Args:
            names: As in `quality.metrics`: 'all', or names in a list or separated by commas.

        Raises:
            SettingError: An unknown name.
        """
        return surface_metrics(self.contacts, self.model, names, threads=self.threads)

    def to_table(self) -> Any:
        """Return a `pyarrow.Table` with a row for each grasp: the columns of `write_grasps`."""
        return import_module("grasp3d.grasps.writing").grasps_to_table(self)

    def to_dataframe(self) -> Any:
        """Return `to_table` as a `pandas.DataFrame`.

        Raises:
            OutputError: pandas is not installed; the extra `grasp3d[pandas]` installs it.
        """
        from grasp3d.tables import data_frame

        return data_frame(self.to_table())

    def show(self, **options: Any) -> Any:
        """Show each grasp on the surface: in a notebook below the cell, elsewhere in a window.

        The colours are the labels that the first finger would have elsewhere, with the others as
        they are. The viewer's buttons for the next and the previous object lead to other grasps.

        Args:
            options: As in `grasp3d.viewer.show.show`: settings, height, proxy.

        Raises:
            OutputError: Nothing can be shown in this environment.
        """
        return import_module("grasp3d.viewer.show").show(self, **options)


def _located(
    contacts: SurfaceContacts,
    angles: WorstAndBest,
    model: GraspModel,
    threads: int | None,
    _progress: Progress,
) -> WorstAndBest:
    return located_angles_of(contacts, angles, model, threads=threads)


def _labels(
    contacts: SurfaceContacts,
    located: Deferred[WorstAndBest],
    model: GraspModel,
    threads: int | None,
    progress: Progress,
) -> Bytes:
    """Label codes by the model's method, shape (b,)."""
    if model.method == "exact":
        return locked(label_angles(*located.value, model))
    chosen = np.flatnonzero(np.isfinite(located.value[0]))
    codes = np.full(contacts.size, Label.U, dtype=np.uint8)
    if len(chosen):
        grasps = contacts.take(chosen)
        codes[chosen] = hull_labels(grasps, model, threads=threads, progress=progress)
    return locked(codes)


def _epsilons(
    contacts: SurfaceContacts,
    model: GraspModel,
    center_radius: float,
    threads: int | None,
    progress: Progress,
) -> EpsilonRange:
    return surface_epsilons(
        contacts, model, center_radius=center_radius, threads=threads, progress=progress
    )


def _holding(
    contacts: SurfaceContacts,
    model: GraspModel,
    case: LoadCase,
    threads: int | None,
    progress: Progress,
) -> Holding:
    return surface_holding(contacts, model, case, threads=threads, progress=progress)


def _known(closed: ClosedGrasps, _progress: Progress) -> ClosedGrasps:
    return closed


def _closed(
    mesh: ObjectMesh,
    reach: Reach,
    scene: Scene,
    model: GraspModel,
    load: Load | None,
    threads: int | None,
    _progress: Progress,
) -> ClosedGrasps:
    return close_on_grasps(mesh, reach, scene, model, load=load, threads=threads)


def _distances(contacts: SurfaceContacts) -> Floats:
    """Distances of all pairs of contacts of each grasp, shape (b, n (n - 1) / 2)."""
    first, second = np.triu_indices(contacts.count, 1)
    return np.asarray(
        np.linalg.norm(contacts.points[:, first] - contacts.points[:, second], axis=2)
    )
