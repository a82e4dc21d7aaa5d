"""Poses of a gripper on an object, with the openings, scores and outcomes that belong to them."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from grasp3d.arrays import ArrayLike, Floats, locked, short_repr
from grasp3d.errors import ContactError
from grasp3d.formats.checks import outcomes_of
from grasp3d.hand.articulated_hand import ArticulatedHand
from grasp3d.hand.frames import FRAMES, GripperFrame, ObjectPose
from grasp3d.hand.hand import Hand
from grasp3d.hand.pose_checks import checked_poses
from grasp3d.mesh import ObjectMesh
from grasp3d.settings.units import METRES, Unit
from grasp3d.surface.fields import AREA, HAND_GRASPS, LENGTH, given_poses
from grasp3d.system.documents import described

_POWERS = {LENGTH: 1, AREA: 2}
POWERS = {field.name: _POWERS.get(field.unit, 0) for field in (*given_poses(), *HAND_GRASPS)}
"""Power of the length unit of each column, by name, for conversion between units."""

GAP = "gap_"
"""Prefix of columns with the distance of one link of a hand from the surface."""

OWN_NAMES = frozenset({
    "name", "pose", "opening", "pregrasp_opening", "posture", "score", "outcome", "success",
    "pregrasp_posture", "squeeze_posture", "pregrasp_pose", "squeeze_pose", "joint_names", "unit",
    "object_pose", "frame", "gripper_frame", "grasp", "px", "py", "pz", "qx", "qy", "qz", "qw",
})  # fmt: skip
"""Names that files use for the fields themselves; no further column may have one of them."""

NUMBERS = ("opening", "pregrasp_opening", "scores", "outcome")
"""Fields of one number for each pose."""

STAGES = ("", "pregrasp_", "squeeze_")
"""Prefixes of poses and postures: at the grasp, before it, and where the hand would be if the
object gave way."""

VECTOR_COLUMNS = ("contacts", "normals")
"""Columns of shape (k, n, 3), for n contacts."""


def _power(column: str) -> int:
    return POWERS.get(column, int(column.startswith(GAP) or column == "contacts"))


@dataclass(frozen=True, eq=False, kw_only=True)
class GraspPoses:
    """Poses of a gripper in the frame of an object.

    A pose is the 4x4 matrix that takes coordinates of the gripper's frame to the object's frame.
    The gripper's frame has its origin at the tool centre point (TCP), z is the approach direction
    and x the closing axis, from finger 1 to finger 2; see `Hand`.

    Example:
        >>> import numpy as np
        >>> from grasp3d.formats.poses import GraspPoses
        >>> from_above = np.diag([1.0, -1.0, -1.0, 1.0])
        >>> poses = GraspPoses(poses=from_above, opening=0.05, unit="m")
        >>> poses.count, poses.names, poses.in_unit("mm").opening.tolist()
        (1, ('grasp_1',), [50.0])
    """

    poses: Floats
    """TCP frame to the object's frame, translations in `unit`, shape (k, 4, 4); (4, 4) for one."""
    opening: Floats = field(default_factory=lambda: np.array(np.nan))
    """Distance between the contacts at the grasp [unit], shape (k,); nan: not known."""
    pregrasp_opening: Floats = field(default_factory=lambda: np.array(np.nan))
    """Opening with which the gripper approaches [unit], shape (k,); nan: not known."""
    posture: Floats = field(default_factory=lambda: np.zeros((0, 0)))
    """Values of the hand's joints [rad or m], shape (k, p); p is 0 for a parallel gripper."""
    joint_names: tuple[str, ...] = ()
    """Names of these joints; empty: not stated, in the order of the hand."""
    pregrasp_posture: Floats = field(default_factory=lambda: np.zeros((0, 0)))
    """Posture with which the hand approaches, shape (k, p), nan: not known; p is 0: for no pose."""
    squeeze_posture: Floats = field(default_factory=lambda: np.zeros((0, 0)))
    """Posture that is commanded to press, of the same shape."""
    pregrasp_poses: Floats | None = None
    """Poses with which the hand approaches, shape as `poses`; None: `poses`."""
    squeeze_poses: Floats | None = None
    """Poses that are commanded to press; None: `poses`."""
    scores: Floats = field(default_factory=lambda: np.array(np.nan))
    """Confidence or another quality, larger is better, shape (k,); nan: not known."""
    outcome: Floats = field(default_factory=lambda: np.array(np.nan))
    """1: the grasp held, 0: it failed, nan: not tried, shape (k,)."""
    names: tuple[str, ...] = ()
    """A name of each grasp; empty: grasp_1, grasp_2 and so on."""
    unit: Unit | None = None
    """Unit of all lengths; None: not known."""
    hand: Hand | str | None = None
    """The gripper, or its name; None: not known."""
    columns: Mapping[str, npt.NDArray[Any]] = field(default_factory=dict)
    """What else is known about each grasp, shape (k, ...): `label` (text), `critical_angle`,
    `max_resolution`, `approach_margin` [rad], `epsilon`, `contacts` [unit] and `normals`, into the
    object, shape (k, n, 3) each, and others of shape (k,)."""
    settings: Mapping[str, Any] = field(default_factory=dict)
    """What a file states, or is to state, about all its grasps."""
    object_file: str | None = None
    """Name of the object's mesh file; None: not stated."""
    object_scale: float | None = None
    """Factor from the numbers of that file to metres; None: not stated."""
    object_pose: ObjectPose | None = None
    """Pose of the object in the robot's frame, in which files state the poses; None: they state
    them in the object's frame. `poses` and `columns` are always in the object's frame."""
    gripper_frame: GripperFrame = FRAMES["tcp"]
    """Frame of the gripper whose poses the file states; `poses` are always those of the TCP."""
    assumes_frame: bool = False
    """Whether that frame is the default of the file's format, as the file does not state it."""

    def __post_init__(self) -> None:
        poses = checked_poses(self.poses)
        count, scale = len(poses), self.object_scale
        if self.unit not in (None, *METRES):
            units = ", ".join(METRES)
            raise ContactError(f"the unit of poses must be one of {units}; got {self.unit!r}")
        if scale is not None and not (np.isfinite(scale) and scale > 0.0):
            raise ContactError(f"the object's scale must be a finite number above 0; got {scale:g}")
        values: dict[str, Any] = {
            "poses": locked(poses),
            "names": _names(self.names, count),
            **self._checked_joints(count),
            **{name: _numbers(name, getattr(self, name), count) for name in NUMBERS},
            "columns": {name: _column(name, one, count) for name, one in self.columns.items()},
            "settings": dict(self.settings),
        }
        for name in ("opening", "pregrasp_opening"):
            one = values[name]
            what, unit = f"{name} must be a length of at least 0", f" {self.unit or ''}".rstrip()
            _refuse((one < 0.0) | np.isinf(one), one, what, unit)
        outcome = values["outcome"]
        bad = ~(np.isnan(outcome) | (outcome == 0.0) | (outcome == 1.0))
        _refuse(bad, outcome, "outcome must be 1 (held), 0 (failed) or nan (not tried)")
        for name, value in values.items():
            object.__setattr__(self, name, value)

    def __repr__(self) -> str:
        return short_repr(self)

    def __len__(self) -> int:
        return self.count

    @property
    def count(self) -> int:
        """Number of poses."""
        return len(self.poses)

    @property
    def frame_words(self) -> str:
        """The frame in which the poses were read, in words, and whether the file states it."""
        why = ", as the file states none" if self.assumes_frame else ""
        frame, words = self.gripper_frame, f"the gripper's frame '{self.gripper_frame}'"
        if isinstance(self.hand, ArticulatedHand):
            is_base = np.array_equal(frame.to_tcp(self.hand), np.eye(4))
            words = "the frame of the hand's base" if is_base else f"the frame '{frame}'"
        return f"{words}{why} (--frame)"

    def in_unit(self, unit: Unit) -> Self:
        """The same poses with all lengths in another unit.

        Raises:
            ContactError: The unit of these poses is not known.
        """
        metres = self._metres_per_unit()
        return self if unit == self.unit else self.scaled(metres / METRES[unit], unit)

    def on(self, mesh: ObjectMesh) -> Self:
        """The same poses in the unit of a mesh; if they have none, that of its file is assumed."""
        stated = self if self.unit else replace(self, unit=mesh.file_unit)
        return stated.in_unit("m") if mesh.unit else stated

    def _metres_per_unit(self) -> float:
        if self.unit is None:
            where = "--unit, in Python unit=..., in a table of poses a column unit"
            raise ContactError(f"the unit of the poses is not known: give it ({where})")
        return METRES[self.unit]

    def scaled(self, factor: float, unit: Unit | None) -> Self:
        """The same poses with all lengths multiplied by a factor.

        Args:
            factor: For example 1 / `object_scale`, from metres to the numbers of the mesh file.
            unit: Unit of the result; None: not known.
        """
        lengths = np.ones((4, 4))
        lengths[:3, 3] = factor
        return replace(
            self.changed(lambda poses: poses * lengths),
            opening=self.opening * factor,
            pregrasp_opening=self.pregrasp_opening * factor,
            columns={name: one * factor ** _power(name) if _power(name) else one
                     for name, one in self.columns.items()},
            unit=unit,
        )  # fmt: skip

    def changed(self, change: Callable[[Floats], Floats]) -> Self:
        """The same with a function applied to the poses of all stages.

        Args:
            change: Maps poses to poses, shape (k, 4, 4) each.
        """
        changed: Any = {name: change(one) for name, one in self.of_stages("poses").items()}
        return replace(self, **changed)

    def of_stages(self, name: str) -> dict[str, Any]:
        """The known fields of 'poses' or 'posture' at all stages, by name of the field."""
        fields = (f"{stage}{name}" for stage in STAGES)
        values = {field: getattr(self, field) for field in fields}
        return {field: one for field, one in values.items() if one is not None and one.size}

    def moved(self, transform: Floats) -> Self:
        """The same poses and contacts in another frame.

        Args:
            transform: From coordinates of this frame to those of the other one, translation in
                metres, shape (4, 4).

        Raises:
            ContactError: The unit of these poses is not known.
        """
        transform = transform.copy()
        transform[:3, 3] /= self._metres_per_unit()
        columns = dict(self.columns)
        for name in filter(columns.__contains__, VECTOR_COLUMNS):
            columns[name] = columns[name] @ transform[:3, :3].T
            if name == "contacts":
                columns[name] += transform[:3, 3]
        return replace(self.changed(lambda poses: transform @ poses), columns=columns)

    def poses_in(self, object_pose: ObjectPose | str | ArrayLike) -> Floats:
        """The poses in the frame of a robot, shape (k, 4, 4), translations in metres.

        Args:
            object_pose: Pose of the object in that frame: a 4x4 matrix, translation in metres, or a
                text; see `ObjectPose`.

        Raises:
            ContactError: It is no valid pose, or the unit of the poses is not known.
        """
        return ObjectPose.of(object_pose).matrix @ self.in_unit("m").poses

    def take(self, indices: ArrayLike) -> Self:
        """The poses with the given indices, or those where a mask is true, in that order."""
        index = np.asarray(indices)
        # An empty list has no type of its own.
        rows = np.arange(self.count)[index if index.size else index.astype(np.int64)]
        staged = {**self.of_stages("poses"), **self.of_stages("posture")}
        return replace(
            self,
            **{name: one[rows] for name, one in staged.items()},
            **{name: getattr(self, name)[rows] for name in NUMBERS},
            names=tuple(self.names[k] for k in rows),
            columns={name: values[rows] for name, values in self.columns.items()},
        )

    def with_outcomes(self, outcome: str | None) -> Self:
        """The same with outcomes from the scores or a further column; None: unchanged."""
        if outcome is None:
            return self
        values = {"score": self.scores, **self.columns}
        found = outcomes_of(outcome, self.count, values, values.__getitem__)
        return replace(self, outcome=found)

    def _checked_joints(self, count: int) -> dict[str, Any]:
        """Check the postures, the names of their joints, and the poses of the other stages."""
        values: dict[str, Any] = {"joint_names": tuple(self.joint_names)}
        for stage in STAGES:
            name = f"{stage}posture"
            posture = np.asarray(getattr(self, name), dtype=np.float64)
            if not posture.size and posture.shape[:1] != (count,):
                posture = np.zeros((count, 0))
            if posture.ndim != 2 or len(posture) != count:
                shape = f"({count}, joints); got {posture.shape}"
                raise ContactError(f"the {name} must be numbers of shape {shape}")
            _refuse(np.isinf(posture) if stage else ~np.isfinite(posture), posture,
                    f"its {name} must be finite [rad or m]")  # fmt: skip
            values[name] = locked(posture)
            joints = values["posture"].shape[1]
            if posture.shape[1] not in {0, joints}:
                raise ContactError(f"the {name} must have {joints} joints, as the posture")
            if stage and (poses := getattr(self, f"{stage}poses")) is not None:
                values[f"{stage}poses"] = moved = locked(checked_poses(poses))
                if len(moved) != count:
                    raise ContactError(f"{count} poses need as many {stage}poses")
        names = values["joint_names"]
        if len(names) not in {0, joints} or len(set(names)) < len(names) or _unprintable(names):
            raise ContactError(f"{joints} joints need as many names that differ; got {names!a:.80}")
        return values


def _refuse(bad: npt.NDArray[np.bool_], values: Floats, what: str, unit: str = "") -> None:
    """Raise a ContactError that names the first grasp with a bad value, if there is one."""
    for row, *joint in np.argwhere(bad)[:1]:
        where = f"value {joint[0] + 1} of " if joint else ""
        raise ContactError(f"grasp {row + 1}: {where}{what}; got {values[row, *joint]:g}{unit}")


def _unprintable(texts: Iterable[object]) -> list[int]:
    """Numbers, from 1, of the items that are no printable texts."""
    return [k for k, t in enumerate(texts, 1) if not isinstance(t, str) or not t.isprintable()]


def _names(names: Iterable[str], count: int) -> tuple[str, ...]:
    """Check the names of grasps; if there are none, make them from numbers."""
    names = tuple(names) or tuple(f"grasp_{k + 1}" for k in range(count))
    if len(names) != count:
        raise ContactError(f"{count} poses need {count} names; got {len(names)}")
    if wrong := _unprintable(names):
        name = f"{names[wrong[0] - 1]!a:.40}"
        raise ContactError(f"grasp {wrong[0]}: a name must be text that can be printed; got {name}")
    return names


def _numbers(name: str, values: ArrayLike, count: int) -> Floats:
    """Check one number for each pose, or one for all, and return shape (k,); nan is allowed."""
    try:
        return locked(np.broadcast_to(np.asarray(values, dtype=np.float64), (count,)))
    except (TypeError, ValueError, OverflowError) as error:
        shape = f"({count},); got shape {np.shape(values)}"
        raise ContactError(f"{name} must be numbers of shape {shape}") from error


def _column(name: str, values: ArrayLike, count: int) -> npt.NDArray[Any]:
    """Check a further column of numbers or text, shape (k, ...)."""
    if name in OWN_NAMES:
        raise ContactError(f"no column of poses can be called {name!r}: files use this name")
    try:
        array = np.asarray(values)
    except ValueError as error:
        raise ContactError(f"{name} must have as many values in all grasps") from error
    if array.dtype.kind == "O":
        items = array.ravel().tolist()
        if wrong := [one for one in items if isinstance(one, list | dict)]:
            raise ContactError(f"{name} must be numbers or text; got {described(wrong[0])}")
        if all(isinstance(one, int | float | None) for one in items):
            array = np.array(items, dtype=np.float64)
        else:
            array = np.array(["" if one is None else str(one) for one in items])
    vectors = name in VECTOR_COLUMNS
    shape = (count, *array.shape[1:2], 3) if vectors else (count,)
    kind, size = ("numbers", ", contacts, 3") if vectors else ("numbers or text", ",")
    if array.shape != shape or array.dtype.kind not in ("fiub" if vectors else "fiubU"):
        found = f"({count}{size}); got {array.dtype} of {array.shape}"
        raise ContactError(f"column {name!r} of poses must be {kind} of shape {found}")
    if array.dtype.kind == "U" and _unprintable(array):
        raise ContactError(f"column {name!r} of poses has text that cannot be printed")
    return locked(array)
