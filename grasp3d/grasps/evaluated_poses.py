"""Poses of a gripper with the grasps that its jaws make there."""

import math
from abc import abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Self

import numpy as np
import numpy.typing as npt

from grasp3d.arrays import ArrayLike, Bools, Bytes, Floats, Ints, locked, short_repr
from grasp3d.formats.poses import GAP, GraspPoses
from grasp3d.grasps.audit import FEWEST, SUSPECTED, PoseReading, audit_poses
from grasp3d.grasps.gripper_reasons import GripperReasons
from grasp3d.grasps.reasons import Reasons
from grasp3d.grasps.robustness import Robustness, robustness_of
from grasp3d.hand.choices import ObjectMotion
from grasp3d.hand.closed_jaws import ClosedJaws, Closing
from grasp3d.hand.hand import Hand
from grasp3d.hand.object_pose import ObjectPose
from grasp3d.hand.pose_checks import pose_warning
from grasp3d.quality.measures import metric_names
from grasp3d.settings.pose_error import poses_of
from grasp3d.stability.label import Label
from grasp3d.surface.fields import (
    CLOSING_SHARE,
    FORCES,
    HAND_GRASPS,
    SCORE,
    Arrays,
    columns_of,
    given_poses,
)
from grasp3d.surface.grasp_table import GraspRows
from grasp3d.surface.labelled_grasps import LabelledGrasps
from grasp3d.surface.scores import written_scores

STALE = frozenset(
    {*metric_names(), *(field.name for field in (*FORCES, CLOSING_SHARE, *HAND_GRASPS))}
)
"""Columns of given poses that may be of other settings."""


class GivenGrasps(LabelledGrasps):
    """Given poses of a hand, a row for each, with what it holds there."""

    given: GraspPoses

    if TYPE_CHECKING:  # fields and attributes of the classes that have this base

        @property
        def label(self) -> Bytes: ...  # noqa: D102
        @property
        def reachable(self) -> Bools: ...  # noqa: D102

    @property
    @abstractmethod
    def reasons(self) -> Reasons:
        """Why poses are not surely grasps."""

    @property
    def reason(self) -> npt.NDArray[np.str_]:
        """What is wrong with each pose, in one sentence, shape (k,); empty: nothing."""
        return self.reasons.texts

    @abstractmethod
    def take(self, rows: Ints) -> Self:
        """The chosen poses, in that order.

        Args:
            rows: Their indices, shape (c,).
        """

    @abstractmethod
    def _columns(self) -> Arrays:
        """Results of shape (k,)."""

    def _table_columns(self) -> Arrays:
        """What tables have besides, shape (k,)."""
        return {"outcome": self.outcome, "unit": np.full(self.size, "m")}

    @abstractmethod
    def _settings(self) -> dict[str, Any]:
        """Settings of the evaluation but for `SUSPECTED`; angles in radians."""

    @abstractmethod
    def _warnings(self) -> Iterable[str | None]:
        """What else may make the results wrong; None: nothing."""

    def _all_settings(self) -> dict[str, Any]:
        return self._settings() | ({SUSPECTED: str(self.reading)} if self.reading else {})

    @cached_property
    def reading(self) -> PoseReading | None:
        """Another reading of the poses, in which far more fit the object than as stated, if any."""
        table = None if self.scene is None else self.scene.table
        return audit_poses(self.mesh, self.given, self.hand, table=table)

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """What may make the results wrong, one sentence each."""
        mesh, toward, hand = self.mesh, self.given.poses.copy(), self.hand
        toward[:, :3, 2] = toward[:, :3, :3] @ getattr(hand, "approach", (0.0, 0.0, 1.0))
        wrong = str(self.reading) if self.reading else None
        wrong = wrong or pose_warning(toward, mesh, reach=hand.size)
        tilted = None if self.scene is None else self.scene.tilt_warning(self.given.object_pose)
        return (*super().warnings, *filter(None, (wrong, tilted, *self._warnings())))

    @property
    def hand(self) -> Hand:
        """The hand."""
        assert self.scene is not None
        return self.scene.hand

    @property
    def size(self) -> int:
        """Number of poses."""
        return self.given.count

    @property
    def poses(self) -> Floats:
        """The poses as they were given, from the hand's frame to the mesh's, shape (k, 4, 4)."""
        return self.given.poses

    def poses_in(self, object_pose: ObjectPose | str | ArrayLike) -> Floats:
        """The poses in the frame of a robot, shape (k, 4, 4) [m]; see `GraspPoses.poses_in`."""
        return self.given.poses_in(object_pose)

    @property
    def outcome(self) -> Floats:
        """Outcomes of the given poses: 1 held, 0 failed, nan not tried, shape (k,)."""
        return self.given.outcome

    def to_poses(self, metrics: Mapping[str, Floats] | None = None) -> GraspPoses:
        """The poses with the results as columns, as `write_grasps` writes them.

        Args:
            metrics: Quality measures that become columns, too.
        """
        own = {**self._columns(), **(metrics or {})}
        scores = own.pop(SCORE.name)
        # Measures, forces and labels in the given file may be of other settings.
        others = {
            name: column
            for name, column in self.given.columns.items()
            if name not in own and name not in STALE and not name.startswith(GAP)
        }
        settings = {**self.given.settings, **self._all_settings()}
        return replace(
            self.given, hand=self.hand, scores=scores, columns={**others, **own}, settings=settings
        )

    def to_table(self) -> Any:
        """Return a `pyarrow.Table` with a row for each pose; nan leaves the cell empty.

        `grasp` (its number from 1), `name`; of grippers `closing`, `label`, `score`,
        `critical_angle`, `max_resolution`, `margin` [rad], `epsilon`, `epsilon_min`, `epsilon_max`,
        `approach_margin` [rad], with a load `grip_force` [N] and `payload` [kg], `collides`,
        `reachable`, `reason`, `area1`, `area2`, `touch1`, `touch2`, `apart`, `turn` [rad] and more;
        `outcome`, `opening`, contacts `x1` `y1` `z1` ... and outward normals `nx1` `ny1` `nz1` ...

        Of hands with joints `label`, `score`, `critical_angle`, `max_resolution`, `margin` [rad],
        `epsilon`, `rank`, `links`, `gap`, `penetration`, `overlap`,
        `below_table` [m], `reachable`, `reason`, `outcome`, and `gap_LINK` [m] of
        every link that comes near the surface at some pose. With a load also `payload` [kg] and
        more of what the motors hold, and `limit`.
        """
        from grasp3d.system.tables import table_of_columns

        numbers, names = np.arange(1, self.size + 1), np.array(self.given.names)
        columns = {"grasp": numbers, "name": names, **self._columns(), **self._table_columns()}
        return table_of_columns(columns, settings=self._all_settings())


EXECUTABLE = math.radians(5.0)
"""Angle by which the approach of a grasp must be able to turn either way for a robot to execute it
[rad]; a stated error of poses may ask for more."""

TURNS = 4
"""Equal steps in which turned approaches are tested."""

NOWHERE = np.zeros((1, 3))
"""No shift."""


@dataclass(frozen=True, eq=False, kw_only=True)
class EvaluatedPoses(GraspRows, GivenGrasps):
    """Poses of a gripper with the grasps that its jaws make there, a row for each.

    Contacts are where the jaws touch, at the mean normals of the patches. Numbers are nan, and the
    label is U, where the jaws do not close on the object.
    """

    given: GraspPoses
    """The poses as they were given, with their outcomes [m]."""
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

    load_result = None
    """What the patches hold is in `payload` and `grip_force`."""

    __repr__ = short_repr

    @property
    def first(self) -> Ints:
        """The rows themselves, shape (k,); -1: the jaws do not close on the object."""
        return np.where(self.jaws.closed, np.arange(self.size), -1)

    @property
    def state(self) -> Bytes:
        """`Closing` codes, shape (k,)."""
        return self.jaws.state

    @property
    def opening(self) -> Floats:
        """Distance of the pads, or of the nearest points of round tips [m], shape (k,)."""
        return self.jaws.opening

    @cached_property
    def robustness(self) -> Robustness:
        """Scores of the touched patches, and of poses that are a little wrong; rows (k,).

        Computed when first read.
        """
        assert self.scene is not None
        return robustness_of(
            self.mesh, self.poses, self.jaws, self.scene, self.model, self.load_case,
            object_motion=self.object_motion,
        )  # fmt: skip

    @cached_property
    def label(self) -> Bytes:
        """`Label` codes of everything that is stated: `Robustness.label`; shape (k,).

        U where the pose is not `reachable`.
        """
        return locked(np.where(self.reachable, self.robustness.label, np.uint8(Label.U)))

    @property
    def letter(self) -> Bytes:
        """The same as `label`."""
        return self.label

    @cached_property
    def reasons(self) -> GripperReasons:
        """Why poses are not S; computed when first read."""
        return GripperReasons(self)

    @cached_property
    def approach_margin(self) -> Floats:
        """How far the approach may turn about the closing axis, either way, free of collisions.

        Tested in `TURNS` steps up to 5 degrees, or the angle of the pose error if that is larger
        [rad], shape (k,); nan where the pose is not reachable. A gripper that turns may draw back
        by half the height of its pads, which still touch.
        """
        margin = np.where(self.reachable, 0.0, math.nan)
        free = np.flatnonzero(self.reachable)
        for angle in self._most_turn * np.arange(1, TURNS + 1) / TURNS:
            for turn in (angle, -angle):
                turned = self.poses[free] @ poses_of(NOWHERE, np.array([[turn, 0.0, 0.0]]))[1]
                blocked = self._blocked(turned, free)
                back = 0.5 * getattr(self.hand, "pad_height", 0.0)
                turned[:, :3, 3] -= back * turned[:, :3, 2]
                blocked[blocked] = self._blocked(turned[blocked], free[blocked])
                free = free[~blocked]
            margin[free] = angle
        return locked(margin)

    def _blocked(self, poses: Floats, rows: Ints) -> Bools:
        """Whether the open gripper collides at other poses (r, 4, 4) of some rows, shape (r,)."""
        scene, held = self.scene, np.zeros(len(rows), dtype=np.bool_)
        assert scene is not None
        jaws = self.jaws.take(rows)
        return np.array(scene.hand.blocked(self.mesh, poses, jaws, held=held, table=scene.table))

    @property
    def _most_turn(self) -> float:
        assert self.scene is not None
        return max(EXECUTABLE, self.scene.pose_error.angle)

    @property
    def quality(self) -> Floats:
        """How far each grasp is from failing, s: `Robustness.score`; shape (k,)."""
        return self.robustness.score

    @cached_property
    def score(self) -> Floats:
        """The one number of each pose, from 0 to 1: its letter, and within that its quality s.

        1 + s is reduced in proportion where `approach_margin` is smaller than the angle up to which
        it is tested: what has no tolerance cannot be executed. See `written_scores`.
        """
        turn = np.nan_to_num(self.approach_margin) / self._most_turn
        return written_scores(self.letter, (1.0 + self.quality) * turn - 1.0)

    @property
    def grip_force(self) -> Floats:
        """Force that each finger needs at the worst normals [N], shape (k,)."""
        return self.robustness.stated.grip_force

    @property
    def payload(self) -> Floats:
        """What the force at hand holds at the worst normals [kg], shape (k,)."""
        return self.robustness.stated.payload

    def to_poses(self, metrics: Mapping[str, Floats] | None = None) -> GraspPoses:
        """The poses with the results as columns; see `GivenGrasps.to_poses`."""
        poses = super().to_poses(metrics)
        touched = {"contacts": self.jaws.points, "normals": self.jaws.normals}
        # Where the object yields to the pads the first touch may be beyond the stroke.
        opening = np.minimum(self.opening, self.hand.max_opening)
        return replace(poses, opening=opening, columns={**poses.columns, **touched})

    def _warnings(self) -> Iterable[str | None]:
        return [None if self.reading else self._starting_inside()]

    def _starting_inside(self) -> str | None:
        """What suggests that most poses are too deep."""
        inside = int((self.state == Closing.STARTS_INSIDE).sum())
        if self.size < FEWEST or 2 * inside <= self.size:
            return None
        return (
            f"a finger starts in the object in {inside} of {self.size} poses, even wide open: is "
            "the origin of the poses the point between the fingertips, is the unit of mesh and "
            "poses right, and is the object narrower than the stroke there?"
        )

    def _table_columns(self) -> Arrays:
        columns = {"opening": self.opening, **super()._table_columns()}
        outward = 0.0 - self.jaws.normals
        for jaw in range(outward.shape[1]):
            for k, axis in enumerate("xyz"):
                columns[f"{axis}{jaw + 1}"] = self.jaws.points[:, jaw, k]
                columns[f"n{axis}{jaw + 1}"] = outward[:, jaw, k]
        return columns

    def _columns(self) -> Arrays:
        """Results of shape (k,)."""
        return columns_of(given_poses(self.jaws.area.shape[1]), self)

    def _settings(self) -> dict[str, Any]:
        """Settings of the evaluation; angles in radians."""
        own = {"gripper": self.hand.name, "object_motion": self.object_motion}
        return self.settings() | own
