"""Given poses of a hand with the grasps that it makes there: what all hands have.

They are ranked, the one to be taken first at the front, and told apart from those alike.
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
"""Columns of given poses that may be of other settings."""


class EvaluatedPoses(LabelledGrasps):
    """Given poses of a hand, a row for each, with what it holds there."""

    given: GraspPoses
    """The poses as they were given, with their outcomes [m]."""
    load_result = None
    """What the hand holds is in `payload`, of grippers also in `grip_force`."""

    if TYPE_CHECKING:  # fields and attributes of the classes that have this base

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
        """Whether the hand holds the object with two contacts at least, shape (k,)."""
        return np.asarray(self.state == Closing.CLOSED)

    @property
    @abstractmethod
    def fields(self) -> tuple[Field, ...]:
        """What tables and files have of each pose."""

    @property
    @abstractmethod
    def reasons(self) -> Reasons:
        """Why poses are not surely grasps."""

    @abstractmethod
    def contacts_of(self, row: int) -> tuple[Floats, Floats]:
        """Points of a pose's contacts, and inward normals there, shape (n, 3) each; n may be 0."""

    @abstractmethod
    def held_at(self, row: int) -> GripperPose:
        """The hand at a pose, what touches there in the colour of the letter."""

    @abstractmethod
    def compute(self) -> None:
        """Compute now what takes long."""

    @property
    def remarks(self) -> Iterable[str]:
        """What else is to be said of the evaluation, one sentence each without a full stop."""
        return ()

    @abstractmethod
    def using(self, **changed: Any) -> Self:
        """The same poses with another model or load.

        Args:
            changed: `model` or `load`.
        """

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

    def _columns(self) -> Arrays:
        """Results of shape (k,)."""
        return columns_of(self.fields, self)

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
        return audit_poses(self.mesh, self.given, self.hand, table=self.scene.table)

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """What may make the results wrong, one sentence each."""
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
        """The poses with the results as columns, as `write_grasps` writes them.

        Args:
            metrics: Quality measures that become columns, too.
        """
        own = {**self._columns(), **(metrics or {})}
        scores = own.pop(SCORE.name)
        own.pop(OPENING.name, None)
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
        `reachable`, `reason`, `area1`, `area2`, `turn` [rad] and more;
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


DISTINCT = 1.0 / 8.0
"""Distance of corresponding contacts, in object sizes, from which grasps are distinct."""

MOST_DISTINCT = 1000
"""Distinct grasps that are found at most."""

AS_GOOD, STARTS = 0.01, 100
"""Difference of scores up to which grasps are about as good, and so many of them from which the
others are chosen."""

MAX_PERMUTED = 5
"""Most contacts of grasps whose contacts are matched in every order."""


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
    """Distances of grasps from another one: the farthest pair of contacts in the best matching.

    Args:
        points: Contacts, shape (b, n, 3).
        other: Shape (n, 3); more than five contacts are matched in their order.

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
    """Numbers of distinct grasps (b, 2, 3), `count` at most: a best one and many others.

    Where the best ones shut out so many that fewer than `count` are left, those that shut out
    fewest are taken first, beside each of those that are about as good as the best one, and each is
    exchanged that shuts out two others.
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
    """Numbers with those added that are distinct from all, and those exchanged that shut out two.

    The first one stays.

    Args:
        near: Which of n are near each other, shape (n, n).
        chosen: Numbers of those that are chosen.
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
    """Rows of grasps, the one to be taken first at the front; computes scores and epsilon.

    By `score`; where that is the same by margin, by epsilon, and by their order.

    Args:
        grasps: A table of grasps, or poses.

    Returns:
        Shape (b,).
    """
    margin, epsilon = np.nan_to_num(grasps.margin, nan=-np.inf), np.nan_to_num(grasps.epsilon)
    return np.lexsort([-epsilon, -margin, -grasps.score])
