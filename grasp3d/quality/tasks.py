"""Tasks: the wrenches that a grasp must resist.

A task is a convex set of wrenches, given by its support function: how far it reaches in a
direction. A wrench is (force [N], torque about the centre of mass [N m]), as it acts on the object;
where contacts are not in metres, torques are in newtons times their unit. The tasks of a sum act
together: any wrench of the first with any wrench of the second.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, Self

import numpy as np

from grasp3d._kernels.hull import support_functions as kernels
from grasp3d.arrays import ArrayLike, Floats, locked
from grasp3d.errors import SettingError

STANDARD_GRAVITY = 9.80665
"""Acceleration of free fall [m/s^2] (CGPM 1901)."""

LARGEST = 1e12
"""Largest mass, acceleration, length, force or torque."""

MOST_CORNERS = 64
"""Corners of a task up to which the force is computed for each of them."""

Numbers3 = tuple[float, float, float]
Numbers6 = tuple[float, float, float, float, float, float]


class Terms(NamedTuple):
    """A task as the compiled kernels take it; see `grasp3d._kernels.hull.support_functions`."""

    rows: Floats
    """Terms (t, TERM)."""
    points: Floats
    """Wrenches of the terms (p, 6)."""


class Task(ABC):
    """A convex set of wrenches that a grasp must resist: the sum of its terms."""

    @abstractmethod
    def terms(self) -> tuple["Term", ...]:
        """Its terms."""

    def support(self, directions: ArrayLike) -> Floats:
        """How far the task reaches along directions of wrenches.

        Args:
            directions: Shape (..., 6): factors of the force and of the torque.

        Returns:
            The largest product of a wrench of the task with each, shape (...).
        """
        return np.asarray(sum(term.support(directions) for term in self.terms()))[()]

    def farthest(self, directions: ArrayLike) -> Floats:
        """The wrenches of the task that reach farthest along directions, shape (..., 6)."""
        return np.asarray(sum(term.farthest(directions) for term in self.terms()))

    def scaled_to(self, mass: float) -> "Task":
        """The task for another mass [kg]: weights and accelerations change, wrenches do not."""
        return Sum(tuple(term.scaled_to(mass) for term in self.terms()))

    @property
    def mass(self) -> float | None:
        """The largest mass of its terms [kg]; None if none has a mass (given wrenches)."""
        return max((term.mass for term in self.terms() if term.mass is not None), default=None)

    @property
    def in_all_directions(self) -> bool:
        """Whether it has a force in every direction, like weight in any direction."""
        rows = self.arrays().rows
        return bool(((rows[:, 0] == kernels.ANY_DIRECTION) & (rows[:, kernels.SIZE] > 0.0)).any())

    def farthest_for(self, masses: Floats | None, directions: Floats) -> Floats:
        """`farthest` for masses (b,) in place of its own, along directions (b, 6)."""
        if masses is None:
            return self.farthest(directions)
        parts = [
            part.farthest(directions) * (1.0 if part.mass is None else masses[:, None])
            for part in self.scaled_to(1.0).terms()
        ]
        return np.asarray(sum(parts))

    def corners_for(self, masses: Floats | None, size: int) -> Floats | None:
        """The wrenches whose convex hull is the task, for masses (b,), shape (b, k, 6).

        None if it has a curved border, or too many corners.
        """
        task = self if masses is None else self.scaled_to(1.0)
        factors = np.ones(size) if masses is None else masses
        total = np.zeros((size, 1, 6))
        for part in task.terms():
            own = part.corners()
            if own is None or total.shape[1] * len(own) > MOST_CORNERS:
                return None
            scaled = own * (1.0 if part.mass is None else factors[:, None, None])
            count = total.shape[1] * len(own)
            total = total[:, :, None] + scaled.reshape(-1, 1, len(own), 6)
            total = total.reshape(size, count, 6)
        return total

    def __add__(self, other: "Task") -> "Task":
        """Both act together."""
        return Sum((*self.terms(), *other.terms()))

    def arrays(self) -> Terms:
        """The terms as arrays for the compiled kernels."""
        rows, points = [], np.zeros((0, 6))
        for term in self.terms():
            row, own = term.row()
            row[1:3] = len(points), len(points) + len(own)
            rows.append(row)
            points = np.concatenate([points, own])
        return Terms(np.array(rows), np.ascontiguousarray(points))


class Term(Task):
    """A task that is not a sum; without a mass unless a class says otherwise."""

    @abstractmethod
    def farthest(self, directions: ArrayLike) -> Floats:
        """As in `Task`."""

    @abstractmethod
    def row(self) -> tuple[Floats, Floats]:
        """Its numbers (TERM,), and its wrenches (p, 6), for the compiled kernels."""

    def corners(self) -> Floats | None:
        """The wrenches whose convex hull is the task (k, 6); None if its border is curved."""
        return None

    def terms(self) -> tuple["Term", ...]:
        """As in `Task`."""
        return (self,)

    def support(self, directions: ArrayLike) -> Floats:
        """As in `Task`."""
        u = _directions(directions)
        return np.asarray((self.farthest(u) * u).sum(axis=-1))[()]

    def scaled_to(self, mass: float) -> Self:
        """As in `Task`."""
        del mass
        return self

    @property
    def mass(self) -> float | None:
        """As in `Task`."""
        return None


@dataclass(frozen=True)
class ForceAtCenter(Term):
    """A force at the centre of mass that grows with the mass; see `Weight` and `Acceleration`."""

    mass: float = 1.0
    """[kg]."""

    def __post_init__(self) -> None:
        _check("mass", self.mass, "kg", above=True)

    @property
    @abstractmethod
    def force(self) -> float:
        """Size of the force [N]."""

    def scaled_to(self, mass: float) -> Self:
        """As in `Task`."""
        return replace(self, mass=mass)

    def row(self) -> tuple[Floats, Floats]:
        """As in `Term`."""
        row = np.zeros(kernels.TERM)
        row[0], row[3] = kernels.ANY_DIRECTION, self.force
        return row, np.zeros((0, 6))

    def farthest(self, directions: ArrayLike) -> Floats:
        """As in `Task`."""
        force = self.force * _unit(_directions(directions)[..., :3])
        return np.concatenate([force, np.zeros_like(force)], axis=-1)


@dataclass(frozen=True)
class Weight(ForceAtCenter):
    """The weight of a mass: in any direction, or within an angle of a direction.

    Example:
        A part of 0.5 kg, however the hand is turned, and a part that is only ever tipped by 30
        degrees:

        >>> import math
        >>> from grasp3d.quality import Weight
        >>> print(f"{Weight(0.5).support([0, 0, 1, 0, 0, 0]):.3f} N")
        4.903 N
        >>> tipped = Weight(0.5, direction=(0, 0, -1), within=math.radians(30))
        >>> print(f"{tipped.support([0, 0, 1, 0, 0, 0]):.3f} N")
        -4.246 N
    """

    direction: Numbers3 | None = None
    """Direction of gravity in the contacts' frame, of any length; None: any direction."""
    within: float = 0.0
    """Angle from that direction within which gravity may act [rad], at most pi / 2."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.direction is None:
            if self.within:
                raise SettingError("an angle within which gravity acts needs its direction")
            return
        vector = _vector("the direction of gravity", self.direction, 3)
        length = float(np.linalg.norm(vector))
        if not length > 0.0:
            raise SettingError("the direction of gravity has length 0")
        object.__setattr__(self, "direction", tuple((vector / length).tolist()))
        if not 0.0 <= self.within <= math.pi / 2.0:
            raise SettingError(
                "the angle within which gravity acts must lie between 0 and 90 degrees; got "
                f"{math.degrees(self.within):g}; leave the direction out for any direction"
            )

    @property
    def force(self) -> float:
        """Size of the force [N]."""
        return self.mass * STANDARD_GRAVITY

    def corners(self) -> Floats | None:
        """As in `Term`: the weight in one direction is a point."""
        if self.direction is None or self.within:
            return None
        return np.array([[*(self.force * np.array(self.direction)), 0.0, 0.0, 0.0]])

    def row(self) -> tuple[Floats, Floats]:
        """As in `Term`."""
        row, points = super().row()
        if self.direction is not None:
            row[0], row[4:7] = kernels.WITHIN, self.direction
            row[7:9] = math.cos(self.within), math.sin(self.within)
        return row, points

    def farthest(self, directions: ArrayLike) -> Floats:
        """As in `Task`."""
        if self.direction is None:
            return super().farthest(directions)
        u = _directions(directions)
        axis = np.array(self.direction)
        along = u[..., :3] @ axis
        across = u[..., :3] - along[..., None] * axis
        length = np.linalg.norm(across, axis=-1)
        angle = np.minimum(np.arctan2(length, along), self.within)[..., None]
        sideways = np.where(length[..., None] > 0.0, _unit(across), 0.0)
        force = self.force * (np.cos(angle) * axis + np.sin(angle) * sideways)
        return np.concatenate([force, np.zeros_like(force)], axis=-1)


@dataclass(frozen=True)
class Acceleration(ForceAtCenter):
    """The force of inertia of a mass that is accelerated in any direction.

    Example:
        >>> from grasp3d.quality import Acceleration, Weight
        >>> moved = Weight(0.5) + Acceleration(0.5, acceleration=5.0)
        >>> print(f"{moved.support([0, 0, 1, 0, 0, 0]):.3f} N")
        7.403 N
    """

    acceleration: float = 0.0
    """[m/s^2]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        _check("acceleration", self.acceleration, "m/s^2")

    @property
    def force(self) -> float:
        """Size of the force [N]."""
        return self.mass * self.acceleration


@dataclass(frozen=True)
class Wrenches(Term):
    """Given wrenches, and all of their convex hull.

    Example:
        A push of 5 N along x, and a torque of 0.1 about z:

        >>> from grasp3d.quality import Wrenches
        >>> pushes = Wrenches([[5, 0, 0, 0, 0, 0], [0, 0, 0, 0, 0, 0.1]])
        >>> float(pushes.support([1, 0, 0, 0, 0, 0]))
        5.0
    """

    wrenches: tuple[Numbers6, ...]
    """Shape (k, 6): force [N], and torque about the centre of mass [N x unit of the contacts'
    points]."""

    def __init__(self, wrenches: ArrayLike | Sequence[Sequence[float]]) -> None:
        object.__setattr__(self, "wrenches", _table("wrenches", wrenches))

    def row(self) -> tuple[Floats, Floats]:
        """As in `Term`."""
        row = np.zeros(kernels.TERM)
        row[0] = kernels.POINTS
        return row, np.array(self.wrenches)

    def corners(self) -> Floats:
        """As in `Term`."""
        return np.array(self.wrenches)

    def farthest(self, directions: ArrayLike) -> Floats:
        """As in `Task`."""
        rows = np.array(self.wrenches)
        return np.asarray(rows[(_directions(directions) @ rows.T).argmax(axis=-1)])


@dataclass(frozen=True)
class Sum(Task):
    """Tasks that act together, as made by `+`."""

    parts: tuple[Term, ...]

    def terms(self) -> tuple[Term, ...]:
        """As in `Task`."""
        return self.parts


def _directions(directions: ArrayLike) -> Floats:
    u = np.asarray(directions, dtype=np.float64)
    if u.ndim == 0 or u.shape[-1] != 6:
        raise SettingError(f"directions of wrenches must have shape (..., 6); got {u.shape}")
    return u


def _unit(vectors: Floats) -> Floats:
    """Vectors scaled to length 1; an arbitrary one where there is no direction."""
    lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
    first = np.zeros(vectors.shape[-1])
    first[0] = 1.0
    return np.where(lengths > 0.0, vectors / np.where(lengths > 0.0, lengths, 1.0), first)


def _check(name: str, value: float, unit: str, *, above: bool = False) -> None:
    if not (value <= LARGEST and (value > 0.0 or (value == 0.0 and not above))):
        least = "above 0" if above else "at least 0"
        raise SettingError(
            f"{name} must be {least} and at most {LARGEST:g} [{unit}]; got {value:g}"
        )


def _vector(name: str, values: ArrayLike, count: int) -> Floats:
    try:
        vector = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise SettingError(f"{name} must be {count} numbers: {error}") from error
    if vector.shape != (count,) or not np.isfinite(vector).all():
        raise SettingError(f"{name} must be {count} finite numbers; got {values!r}")
    return locked(vector)


def _table(name: str, values: object) -> tuple[Numbers6, ...]:
    try:
        rows = np.atleast_2d(np.asarray(values, dtype=np.float64))
    except (TypeError, ValueError) as error:
        raise SettingError(f"{name} must be rows of six numbers: {error}") from error
    if rows.ndim != 2 or rows.shape[1] != 6 or not len(rows) or not (abs(rows) <= LARGEST).all():
        raise SettingError(
            f"{name} must be rows of six numbers, force and torque, of up to {LARGEST:g}; "
            f"got shape {rows.shape}"
        )
    return tuple(tuple(row) for row in rows.tolist())
