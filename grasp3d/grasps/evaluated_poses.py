"""Given poses of a hand with the grasps made there: what all kinds of hands have in common.

The poses are ranked, best first, and similar ones are told apart.
"""

import itertools
from abc import abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import cached_property, reduce
from typing import TYPE_CHECKING, Any, Self

import numpy as np
import numpy.typing as npt

from grasp3d.arrays import ArrayLike, Bools, Bytes, Floats, Ints
from grasp3d.formats.poses import GAP, GraspPoses
from grasp3d.grasps.audit import SUSPECTED, PoseReading, audit_poses
from grasp3d.grasps.reasons import Reasons
from grasp3d.hand.closing import Closing
from grasp3d.hand.frames import ObjectPose
from grasp3d.hand.gripper_pose import GripperPose
from grasp3d.hand.hand import Hand
from grasp3d.hand.pose_checks import pose_warning
from grasp3d.mesh import ObjectMesh
from grasp3d.quality.measures import metric_names
from grasp3d.surface.fields import (
    CLOSING_SHARE,
    FORCES,
    HAND_GRASPS,
    OPENING,
    SCORE,
    Arrays,
    Field,
    columns_of,
)
from grasp3d.surface.labelled_grasps import LabelledGrasps

if TYPE_CHECKING:
    from grasp3d.hand.scene import Scene
    from grasp3d.surface.load_case import LoadCase


STALE = frozenset(
    {*metric_names(), *(field.name for field in (*FORCES, CLOSING_SHARE, *HAND_GRASPS))}
)
"""Columns of given poses that may come from other settings."""


class EvaluatedPoses(LabelledGrasps):
    """Given poses of a hand, a row for each, with the grasp made there."""

    given: GraspPoses
    """The poses as they were given, with their outcomes [m]."""
    load_result = None
    """What the hand holds is in `payload`, for grippers also in `grip_force`."""

    if TYPE_CHECKING:  # fields and attributes of the subclasses

        @property
        def scene(self) -> Scene: ...  # noqa: D102
        @property
        def load_case(self) -> LoadCase | None: ...  # noqa: D102
        @property
        def reachable(self) -> Bools: ...  # noqa: D102
        @property
        def state(self) -> Bytes: ...  # noqa: D102

    @property
    def letter(self) -> Bytes:
        """The same as `label`."""
        return self.label

    @property
    def closed(self) -> Bools:
        """Whether the hand holds the object with at least two contacts, shape (k,)."""
        return np.asarray(self.state == Closing.CLOSED)

    @property
    @abstractmethod
    def fields(self) -> tuple[Field, ...]:
        """Columns of each pose in tables and files."""

    @property
    @abstractmethod
    def reasons(self) -> Reasons:
        """Why poses are not surely stable grasps."""

    @abstractmethod
    def contacts_of(self, row: int) -> tuple[Floats, Floats]:
        """Points of a pose's contacts and inward normals there, shape (n, 3) each; n may be 0."""

    @abstractmethod
    def held_at(self, row: int) -> GripperPose:
        """The hand at a pose; parts that touch have the colour of the label."""

    @abstractmethod
    def compute(self) -> None:
        """Compute now what takes long, rather than on first use."""

    @property
    def remarks(self) -> Iterable[str]:
        """Further remarks on the evaluation, one sentence each without a full stop."""
        return ()

    @abstractmethod
    def using(self, **changed: Any) -> Self:
        """Return the same poses with another model or load.

        Args:
            changed: `model` or `load`.
        """

    @property
    def reason(self) -> npt.NDArray[np.str_]:
        """Why each pose fails or may fail, in one sentence, shape (k,); empty: it does not."""
        return self.reasons.texts

    @abstractmethod
    def take(self, rows: Ints) -> Self:
        """Return the chosen poses, in that order.

        Args:
            rows: Their indices, shape (c,).
        """

    def _columns(self) -> Arrays:
        """Results of shape (k,)."""
        return columns_of(self.fields, self)

    def _table_columns(self) -> Arrays:
        """Further columns of tables, shape (k,)."""
        return {"outcome": self.outcome, "unit": np.full(self.size, "m")}

    @abstractmethod
    def _settings(self) -> dict[str, Any]:
        """Settings of the evaluation except `SUSPECTED`; angles in radians."""

    @abstractmethod
    def _warnings(self) -> Iterable[str | None]:
        """Further reasons why the results may be wrong; None: no reason."""

    def _all_settings(self) -> dict[str, Any]:
        return self._settings() | ({SUSPECTED: str(self.reading)} if self.reading else {})

    @cached_property
    def reading(self) -> PoseReading | None:
        """Another reading of the poses, in which far more fit the object than as stated, if any."""
        return audit_poses(self.mesh, self.given, self.hand, table=self.scene.table)

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """Reasons why the results may be wrong, one sentence each."""
        wrong = str(self.reading) if self.reading else None
        wrong = wrong or pose_warning(self.poses, self.mesh, reach=self.hand.size)
        tilted = self.scene.tilt_warning(self.given.object_pose)
        return (*super().warnings, *filter(None, (wrong, tilted, *self._warnings())))

    @property
    def hand(self) -> Hand:
        """The hand."""
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
        """Return the poses with the results as columns, as `write_grasps` writes them.

        Args:
            metrics: Quality measures that become columns as well.
        """
        own = {**self._columns(), **(metrics or {})}
        scores = own.pop(SCORE.name)
        own.pop(OPENING.name, None)
        # Measures, forces and labels in the given file may come from other settings.
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

        For grippers the columns are `grasp` (its number from 1), `name`, `closing`, `label`,
        `score`, `critical_angle`, `max_resolution`, `margin` [rad], `epsilon`, `epsilon_min`,
        `epsilon_max`, `approach_margin` [rad], with a load `grip_force` [N] and `payload` [kg],
        `collides`, `reachable`, `reason`, `area1`, `area2`, `turn` [rad] and more; `outcome`,
        `opening`, contacts `x1` `y1` `z1` ... and outward normals `nx1` `ny1` `nz1` ...

        For hands with joints they are `grasp`, `name`, `label`, `score`, `critical_angle`,
        `max_resolution`, `margin` [rad], `epsilon`, `rank`, `links`, `gap`, `penetration`,
        `overlap`, `below_table` [m], `reachable`, `reason`, `outcome`, and `gap_LINK` [m] of every
        link that comes near the surface at some pose. With a load, `payload` [kg], `limit` and
        further results on the motors are added.
        """
        from grasp3d.system.tables import table_of_columns

        numbers, names = np.arange(1, self.size + 1), np.array(self.given.names)
        columns = {"grasp": numbers, "name": names, **self._columns(), **self._table_columns()}
        return table_of_columns(columns, settings=self._all_settings())


DISTINCT = 1.0 / 8.0
"""Distance between corresponding contacts, in object sizes, from which grasps are distinct."""

MOST_DISTINCT = 1000
"""Largest number of distinct grasps that are sought."""

AS_GOOD, STARTS = 0.01, 100
"""Difference of scores up to which grasps are about as good, and number of such grasps from which
the choice of the others starts."""

MAX_PERMUTED = 5
"""Largest number of contacts that are matched in every order."""


def distance_of_distinct(mesh: ObjectMesh) -> float:
    """Default distance from which grasps are distinct [m]."""
    return DISTINCT * mesh.size


def distinct_rows(points: Floats, count: int, limit: float) -> Ints:
    """Indices of grasps (b, n, 3), best first, that are not near a better one."""
    rows: list[int] = []
    remaining = np.arange(len(points))
    while len(remaining) and len(rows) < count:
        rows.append(int(remaining[0]))
        remaining = remaining[1:]
        distance = matched_distance(points[remaining], points[rows[-1]])
        remaining = remaining[(distance >= limit) & (distance > 0.0)]
    return np.array(rows, dtype=np.int64)


def matched_distance(points: Floats, other: Floats) -> Floats:
    """Distances of grasps from another one: that of the farthest contacts in the best matching.

    Args:
        points: Contacts, shape (b, n, 3).
        other: Contacts of the other grasp, shape (n, 3); more than five are matched in their order.

    Returns:
        Shape (b,).
    """
    gaps = points[:, :, None] - other  # (b, n, n, 3)
    gaps *= gaps
    squares = gaps[..., 0] + gaps[..., 1] + gaps[..., 2]  # (b, n, n), faster than `sum`
    indices = tuple(range(len(other)))
    orders = itertools.permutations(indices) if len(other) <= MAX_PERMUTED else [indices]
    farthest = (reduce(np.maximum, (squares[:, i, order[i]] for i in indices)) for order in orders)
    return np.asarray(np.sqrt(reduce(np.minimum, farthest)))


def most_distinct(points: Floats, scores: Floats, limit: float, count: int) -> Ints:
    """Indices of at most `count` distinct grasps (b, 2, 3): a best one and as many others as found.

    Where the best grasps exclude so many others that fewer than `count` are left, the search starts
    anew from each of those about as good as the best one and adds those that exclude the fewest.
    Then each grasp that excludes two distinct others is exchanged for them.
    """
    greedy = distinct_rows(points, count, limit)
    if len(greedy) == min(count, len(points)):
        return greedy
    near = np.stack([matched_distance(points, one) < limit for one in points])
    choices = [_exchanged(near, greedy.tolist())]
    for first in np.flatnonzero(scores >= scores[0] - AS_GOOD)[:STARTS].tolist():
        sparse, left = [first], ~near[first]
        while left.any():
            crowds = np.where(left, (near & left).sum(axis=1), len(points))
            sparse.append(int(crowds.argmin()))
            left &= ~near[sparse[-1]]
        choices.append(_exchanged(near, sparse))
    most = max(choices, key=len)
    return np.array([most[0], *sorted(most[1:])][:count])


def _exchanged(near: Bools, chosen: list[int]) -> list[int]:
    """Add grasps that are distinct from all chosen ones, and exchange one for two where possible.

    The first chosen grasp stays.

    Args:
        near: Which of n grasps are near each other, shape (n, n).
        chosen: Indices of the chosen grasps.
    """
    changed = True
    while changed:
        changed, blocked = False, near[chosen].sum(axis=0)
        if not blocked.all():
            chosen, changed = [*chosen, int(blocked.argmin())], True
            continue
        for one in chosen[1:]:
            alone = np.flatnonzero((blocked == 1) & near[one])
            apart = ~near[np.ix_(alone, alone)]
            first = np.flatnonzero(apart.any(axis=1))
            if len(first):
                pair = alone[[first[0], apart[first[0]].argmax()]]
                chosen = [*(other for other in chosen if other != one), *pair.tolist()]
                changed = True
                break
    return chosen


def ranked_rows(grasps: LabelledGrasps) -> Ints:
    """Rows of grasps, best first; computes scores and epsilon.

    Ordered by `score`, equal scores by margin, then by epsilon, then by their given order.

    Args:
        grasps: A table of grasps, or evaluated poses.

    Returns:
        Shape (b,).
    """
    margin, epsilon = np.nan_to_num(grasps.margin, nan=-np.inf), np.nan_to_num(grasps.epsilon)
    return np.lexsort([-epsilon, -margin, -grasps.score])
