"""Poses of a gripper with the grasps that its jaws make there."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
import numpy.typing as npt

from grasp3d.arrays import Bools, Bytes, Floats, Ints, locked, short_repr
from grasp3d.contact.contacts import Contacts
from grasp3d.grasps.jaw_contacts import jaw_contacts
from grasp3d.grasps.pose_checks import pose_warning
from grasp3d.grasps.pose_readings import FITTING, starting_inside, suspected_reading
from grasp3d.grasps.poses import GraspPoses
from grasp3d.hand.closed_jaws import ClosedJaws, Closing, Touch
from grasp3d.hand.parallel_gripper import ParallelGripper
from grasp3d.hand.reach_settings import ObjectMotion
from grasp3d.loads import Load, load_settings
from grasp3d.mesh import ObjectMesh
from grasp3d.quality.critical_angle import critical_friction_angle
from grasp3d.quality.epsilon_options import EpsilonOptions
from grasp3d.quality.measures.known import METRICS
from grasp3d.quality.measures.measuring import UNDEFINED, MetricValues, metrics
from grasp3d.quality.tilting import EpsilonRange
from grasp3d.quality.uncertain_epsilon import WrenchErrors, uncertain_epsilon_range
from grasp3d.settings import GraspModel
from grasp3d.settings.parsing import plain_values
from grasp3d.stability.classification import classify
from grasp3d.stability.label import Label
from grasp3d.stability.located_angles import ContactLimits, located_contacts
from grasp3d.stability.sampled_normals import WorstAndBest
from grasp3d.stability.thresholds import label_angles
from grasp3d.surface.deferred import Deferred
from grasp3d.surface.epsilon import BOUND_RTOL, EPSILON_RTOL
from grasp3d.surface.grasp_metrics import EDGES, longest_axis
from grasp3d.surface.holding import COLUMNS, Holding, holding_of
from grasp3d.surface.labelled_grasps import LabelledGrasps
from grasp3d.surface.load_case import LoadCase
from grasp3d.system.progress import Progress
from grasp3d.system.versions import package_version

NOT_CLOSED = "the jaws do not close on the object"
"""Why a pose has no quality measures."""

CLOSED_LABEL, CLOSED_MARGIN = "closed_label", "closed_margin"
"""Columns of grasps that were found: the label and the margin that evaluation gives their poses."""

STALE = frozenset({UNDEFINED, CLOSED_LABEL, CLOSED_MARGIN})
"""Columns of given poses, beside measures and forces, that may be of other settings."""


@dataclass(frozen=True, eq=False, kw_only=True)
class EvaluatedPoses(LabelledGrasps):
    """Poses of a gripper with the grasps that its jaws make there, a row for each.

    Numbers are nan, and the label is U, where the jaws do not close on the object.
    """

    mesh: ObjectMesh
    """The object."""
    poses: GraspPoses
    """The poses as they were given, with their outcomes, in the mesh's unit."""
    hand: ParallelGripper
    model: GraspModel
    """Friction and sensor resolution."""
    jaws: ClosedJaws
    """Where the jaws touch, and what happens where they do not."""
    object_motion: ObjectMotion = "fixed"
    """Whether the object gave way to the jaws."""
    collides: Bools
    """Whether the gripper collides with object or table on the way to the pose, shape (k,): with a
    fixed object also when it holds it, or with the clearance before closing; wide open where it
    holds nothing, or the object is free."""
    reachable: Bools
    """Whether the jaws close on the object, within the stroke with its clearance, without
    collision, and from an allowed direction, shape (k,)."""
    load: Load | None = None
    """What each grasp must hold; None: `holding` is not computed."""
    threads: int | None = None
    deferred_located: Deferred[WorstAndBest] = field(init=False, repr=False)
    deferred_label: Deferred[Bytes] = field(init=False, repr=False)
    deferred_epsilon: Deferred[EpsilonRange] = field(init=False, repr=False)
    deferred_holding: Deferred[Holding] | None = field(init=False, repr=False)

    __repr__ = short_repr

    def __post_init__(self) -> None:
        used = self.contacts, self.jaws.closed, self.model, self.threads
        scale, case = self.mesh.torque_scale, self.load_case
        radius = 0.0 if case is None else case.center_radius
        located = Deferred(partial(_located, self.critical_angle, *used))
        self._defer(
            located,
            partial(_labels, located, *used),
            partial(_epsilons, scale, radius, *used),
            None if case is None else partial(_holding, case, *used),
        )

    @property
    def load_case(self) -> LoadCase | None:
        """The load on this object, with its mass, task and force at hand; None: no load."""
        if self.load is None:
            return None
        return LoadCase.of(self.load, self.mesh, self.model, self.hand)

    @property
    def size(self) -> int:
        """Number of poses."""
        return self.poses.count

    @property
    def state(self) -> Bytes:
        """`Closing` codes, shape (k,)."""
        return self.jaws.state

    @property
    def opening(self) -> Floats:
        """Distance of the pads, or of the nearest points of round tips [mesh unit], shape (k,)."""
        return self.jaws.opening

    @cached_property
    def contacts(self) -> Contacts | None:
        """The contacts where the jaws close, relative to the centre of mass; None: nowhere."""
        return jaw_contacts(self.jaws, self.mesh.center_mass, self.model)

    @cached_property
    def critical_angle(self) -> Floats:
        """Critical friction angle at the mean normals of the patches [rad], shape (k,).

        Where contacts have patches (`GraspModel.contact`) it is that of the best line between them.
        """
        angles = np.full(self.size, math.nan)
        if self.contacts is not None:
            angles[self.jaws.closed] = critical_friction_angle(self.contacts)
        return locked(angles)

    @property
    def outcome(self) -> Floats:
        """Outcomes of the given poses: 1 held, 0 failed, nan not tried, shape (k,)."""
        return self.poses.outcome

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """What may make the results wrong, one sentence each."""
        mesh, poses = self.mesh, self.poses.poses
        found = None
        if self.size and (self.jaws.closed & ~self.collides).mean() < FITTING:
            found = suspected_reading(mesh, poses, self.hand, threads=self.threads)
        found = found or pose_warning(poses, mesh.center, mesh.size, mesh.unit)
        inside = starting_inside(self.state)
        return (*mesh.report.warnings, *(line for line in (found, inside) if line))

    def metrics(self, names: str | Sequence[str] = "all") -> MetricValues:
        """Quality measures of the grasp at each pose, shape (k,) each; computed when called.

        Args:
            names: As in `quality.metrics`: 'all', or names in a list or separated by commas.

        Raises:
            SettingError: An unknown name, or contacts with patches.
        """
        if self.contacts is None:
            return MetricValues.undefined(names, self.size, NOT_CLOSED)
        found = metrics(
            self.contacts,
            names,
            torque_scale=self.mesh.torque_scale,
            edges=self.model.edges or EDGES,
            principal_axis=longest_axis(self.mesh),
            threads=self.threads,
        )
        return found.placed(np.flatnonzero(self.jaws.closed), self.size, NOT_CLOSED)

    def to_poses(self, metrics: MetricValues | None = None) -> GraspPoses:
        """The poses with the results as columns, as `write_poses` writes them.

        Args:
            metrics: Quality measures that become columns, too.
        """
        own = {**self._columns(), **({} if metrics is None else metrics.columns())}
        # Measures, forces and labels in the given file may be of other settings.
        others = {
            name: kept
            for name, kept in self.poses.columns.items()
            if name not in own and name not in METRICS and name not in {*STALE, *COLUMNS}
        }
        columns = {**others, **own, "contacts": self.jaws.points, "normals": self.jaws.normals}
        return replace(
            self.poses,
            opening=self.opening,
            hand=self.hand,
            columns=columns,
            settings={**self.poses.settings, **self._settings()},
        )

    def take(self, rows: Ints) -> "EvaluatedPoses":
        """The chosen poses, in that order.

        Args:
            rows: Their indices, shape (c,).
        """
        return replace(
            self,
            poses=self.poses.take(rows),
            jaws=self.jaws.take(rows),
            collides=locked(self.collides[rows]),
            reachable=locked(self.reachable[rows]),
        )

    def to_table(self) -> Any:
        """Return a `pyarrow.Table` with a row for each pose; nan leaves the cell empty.

        `grasp` (its number from 1), `name`, `closing`, `label`, `critical_angle`, `max_resolution`,
        `margin` [rad], `epsilon`, `epsilon_min`, `epsilon_max`, `opening`, `collides`, `reachable`,
        `area1`, `area2`, `touch1`, `touch2`, `apart`, `turn` [rad], with a load also `grip_force`
        and more, see `Holding.columns`; `outcome`, contacts `x1` `y1` `z1` ... and outward normals
        `nx1` `ny1` `nz1` ...
        """
        from grasp3d.tables import table_of_columns

        columns: dict[str, npt.NDArray[Any]] = {
            "grasp": np.arange(1, self.size + 1),
            "name": np.array(self.poses.names),
            **self._columns(),
            "opening": self.opening,
            "outcome": self.outcome,
        }
        outward = 0.0 - self.jaws.normals
        for jaw in range(2):
            for k, axis in enumerate("xyz"):
                columns[f"{axis}{jaw + 1}"] = self.jaws.points[:, jaw, k]
                columns[f"n{axis}{jaw + 1}"] = outward[:, jaw, k]
        return table_of_columns(columns, settings=self._settings())

    def to_dataframe(self) -> Any:
        """Return `to_table` as a `pandas.DataFrame`.

        Raises:
            OutputError: pandas is not installed; the extra `grasp3d[pandas]` installs it.
        """
        from grasp3d.tables import data_frame

        return data_frame(self.to_table())

    def _columns(self) -> dict[str, npt.NDArray[Any]]:
        """Results of shape (k,)."""
        labels = np.array([label.name for label in sorted(Label)])
        states = np.array([state.name.lower() for state in sorted(Closing)])
        touches = np.array([touch.name.lower() for touch in sorted(Touch)])
        epsilon = self.epsilon_range
        return {
            "closing": states[self.state],
            "label": labels[self.label],
            "critical_angle": self.critical_angle,
            "max_resolution": self.max_resolution,
            "margin": self.margin,
            "epsilon": epsilon.nominal,
            "epsilon_min": epsilon.minimum,
            "epsilon_max": epsilon.maximum,
            "collides": self.collides,
            "reachable": self.reachable,
            "area1": self.jaws.area[:, 0],
            "area2": self.jaws.area[:, 1],
            "touch1": touches[self.jaws.touch[:, 0]],
            "touch2": touches[self.jaws.touch[:, 1]],
            "apart": self.jaws.apart,
            "turn": self.jaws.turn,
            **({} if self.holding is None else self.holding.columns(texts=True)),
        }

    def _settings(self) -> dict[str, Any]:
        """Settings of the evaluation; angles in radians."""
        return {
            "version": package_version(),
            "source": self.mesh.report.source,
            **plain_values(self.model),
            "unit": self.mesh.unit,
            "gripper": self.hand.name,
            "object_motion": self.object_motion,
            **{name: value for name, value in self._load().items() if value is not None},
        }

    def _load(self) -> dict[str, Any]:
        if self.holding is None:
            return {}
        return {**load_settings(self.load), **self.holding.settings()}


def _located(
    angles: Floats,
    contacts: Contacts | None,
    closed: Bools,
    model: GraspModel,
    _threads: int | None,
    _progress: Progress,
) -> WorstAndBest:
    """Located angles, shape (k,) each; nan where the jaws do not close on the object."""
    if contacts is None or model.is_uniform:
        return angles, angles
    found = np.full((2, len(closed)), math.nan)
    limits = ContactLimits.of(model.fingertips)
    found[:, closed] = located_contacts(contacts, angles[closed], limits)
    return locked(found[0]), locked(found[1])


def _labels(
    located: Deferred[WorstAndBest],
    contacts: Contacts | None,
    closed: Bools,
    model: GraspModel,
    threads: int | None,
    progress: Progress,
) -> Bytes:
    """Label codes by the model's method, shape (k,)."""
    codes = np.full(len(closed), Label.U, dtype=np.uint8)
    if contacts is None:
        return locked(codes)
    if model.method == "exact":
        worst, best = located.value
        codes[closed] = label_angles(worst[closed], best[closed], model)
    else:
        codes[closed] = classify(
            contacts,
            2.0 * model.tilt,
            method=model.method,
            friction_interval=model.friction_interval if model.friction_error else None,
            extreme_normals=model.extreme_normals,
            options=EpsilonOptions.of_model(
                model, torque_scale=1.0, rtol=EPSILON_RTOL, threads=threads
            ),
        ).label
    progress(1.0)
    return locked(codes)


def _epsilons(
    torque_scale: float,
    center_radius: float,
    contacts: Contacts | None,
    closed: Bools,
    model: GraspModel,
    threads: int | None,
    progress: Progress,
) -> EpsilonRange:
    """Epsilon about the mesh's centre of mass, shape (k,) each."""
    values = np.full((3, len(closed)), math.nan)
    if contacts is not None:
        options = EpsilonOptions.of_model(
            model, torque_scale=torque_scale, rtol=EPSILON_RTOL, threads=threads
        )
        found = uncertain_epsilon_range(
            contacts, model.tilt_of_fingers, WrenchErrors.of_model(model, center_radius), options,
            bound_rtol=BOUND_RTOL, progress=progress,
        )  # fmt: skip
        values[:, closed] = found.nominal, found.minimum, found.maximum
    return EpsilonRange(*map(locked, values))


def _holding(
    case: LoadCase,
    contacts: Contacts | None,
    closed: Bools,
    model: GraspModel,
    threads: int | None,
    progress: Progress,
) -> Holding:
    """Grip forces and payloads, with the torsion radii of the load case, rows (k,)."""
    if contacts is None:
        return Holding.none(case, len(closed))
    found = holding_of(
        contacts, model.tilt_of_fingers, case, friction=model.friction_bounds, threads=threads,
        progress=progress,
    )  # fmt: skip
    return found.placed(np.flatnonzero(closed), len(closed))
