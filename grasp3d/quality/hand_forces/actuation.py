"""Actuation: the torques that the actuators, the structure and the stops of a hand exert.

With forces f of the hand on the object, Jacobian J of the contact points and weight g of the links
(as the torques that hold them),

    J^T f + g = B^T u + E s,    -u+ <= u <= u+,  s >= 0,

B the moment arms of the actuators, and E the joints at a stop. Joints that a rigid coupling moves
with another one are no joints of their own: they move with that in J, and structure carries what
its motor does not. All drives are columns with a range: J^T f = M z + c, lower <= z <= upper. The
forces for which that has a solution are a convex polyhedron K, which does not depend on normals.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np

from grasp3d.arrays import ArrayLike, Floats, locked, short_repr
from grasp3d.errors import SettingError

RANK = 1e-10
"""Singular value, relative to the largest, that is 0."""

ROUNDED = 1e-9
"""Pull on a drive, relative to the motion of the joints, that is 0 but for rounding."""


@dataclass(frozen=True, eq=False)
class Actuation:
    """The torques M z + c on p joints that q drives exert within their ranges."""

    columns: Floats
    """Torques of the drives on the joints, M, shape (p, q)."""
    lower: Floats
    """Smallest value of each drive, -inf: none, shape (q,)."""
    upper: Floats
    """Largest value of each drive, inf: none, shape (q,)."""
    offset: Floats
    """Torques c: less those that hold the links [N m], shape (p,)."""
    names: tuple[str, ...]
    """What each drive is, such as 'index_2' or 'index_2 at its stop', (q,)."""
    links: Floats | None = None
    """Torques that hold the links per acceleration of gravity [kg m], shape (p, 3); None: their
    weight is neglected. Payloads of tasks with a mass take them."""

    __repr__ = short_repr

    @classmethod
    def of_hand(
        cls,
        limits: ArrayLike,
        *,
        joints: tuple[str, ...] | int,
        arms: ArrayLike | None = None,
        names: tuple[str, ...] | None = None,
        stops: ArrayLike | None = None,
        links: ArrayLike | None = None,
    ) -> Self:
        """The actuation of a hand in a posture.

        Args:
            limits: Greatest torques of the k actuators, both ways [N m], shape (k,); inf: no limit.
            joints: Names of the p joints, or how many there are.
            arms: Moment arms of the actuators, shape (k, p): (1, 1) for a tendon over two joints,
                which divides its force between them (a differential). None: one motor per joint.
            names: Names of the actuators. None: those of the joints, where each has one.
            stops: 1 where a joint is at its lower stop, which pushes it up, -1 at its upper one,
                else 0, shape (p,).
            links: Torques that hold the links per acceleration of gravity [kg m], shape (p, 3):
                minus the masses of the links times the Jacobians of their centres.

        Raises:
            SettingError: Shapes that do not match, or values out of range.
        """
        labels = joints if isinstance(joints, tuple) else tuple(f"joint {k}" for k in range(joints))
        count = len(labels)
        most = _numbers("limits", limits)
        if most.ndim != 1 or not (most >= 0.0).all():
            raise SettingError(
                f"limits of actuators must be one torque for each, at least 0; got {short(limits)}"
            )
        rows = np.eye(count) if arms is None else _table("arms", arms, count)
        if len(rows) != len(most):
            raise SettingError(f"{len(most)} limits of actuators do not fit {len(rows)} arms")
        if names is None:
            alone = arms is None
            names = labels if alone else tuple(f"actuator {k}" for k in range(len(rows)))
        ends = _vector("stops", stops, count)
        at_stop = np.flatnonzero(ends)
        one_sided = (np.sign(ends)[:, None] * np.eye(count))[at_stop]
        zero = np.zeros(len(at_stop))
        return cls(
            locked(np.concatenate([rows, one_sided]).T),
            locked(np.concatenate([-most, zero])),
            locked(np.concatenate([most, zero + np.inf])),
            locked(np.zeros(count)),
            (*names, *(f"{labels[k]} at its stop" for k in at_stop)),
            None if links is None else locked(_table("links", links, 3)),
        )

    def carrying_links(self, acceleration: Floats) -> "Actuation":
        """The same with what holds the links under one acceleration (3,) [m/s^2]."""
        if self.links is None:
            return self
        return replace(self, offset=locked(self.offset - self.links @ acceleration), links=None)

    @property
    def joints(self) -> int:
        """Number of joints p."""
        return len(self.columns)

    @cached_property
    def inverse(self) -> Floats:
        """Pseudoinverse of the columns, shape (q, p)."""
        return np.asarray(np.linalg.pinv(self.columns, rcond=RANK), dtype=np.float64)

    @cached_property
    def idle(self) -> Floats:
        """Orthonormal columns z that exert no torque, shape (q, k)."""
        return kernel(self.columns)

    @cached_property
    def undriven(self) -> Floats:
        """Orthonormal columns of motions of the joints that no drive acts on, shape (p, r)."""
        return kernel(self.columns.T)

    @cached_property
    def holds_links(self) -> bool:
        """Whether the least values of the drives that hold the links are within their limits."""
        rest = -self.inverse @ self.offset
        left = np.abs(self.undriven.T @ self.offset).max(initial=0.0)
        within = (rest >= self.lower) & (rest <= self.upper)
        return bool(within.all() and left <= ROUNDED * np.abs(self.offset).max(initial=0.0))

    @cached_property
    def _sizes(self) -> Floats:
        return np.asarray(np.linalg.norm(self.columns, axis=0))

    def powers(self, motion: Floats, size: float = 0.0) -> Floats:
        """Largest power of each drive on a motion of the joints (p,); may be inf, (q,).

        Drives without a limit that a motion moves only by rounding have none.

        Args:
            motion: Shape (p,).
            size: Of the motions of which it is part.
        """
        pull = motion @ self.columns
        bound = np.where(pull > 0.0, self.upper, self.lower)
        size = max(size, float(np.linalg.norm(motion)))
        rounded = np.abs(pull) <= ROUNDED * size * self._sizes
        return np.asarray(pull * np.where(rounded & np.isinf(bound) | (pull == 0.0), 0.0, bound))

    def power(self, motion: Floats, size: float = 0.0) -> float:
        """Largest power of all drives and of c on a motion of the joints (p,).

        It is the support function of K: no forces in K do more work on the motion of the contact
        points that the joints' motion causes.
        """
        return float(motion @ self.offset + self.powers(motion, size).sum())


def short(values: object) -> str:
    """Values in few words, for an error."""
    text = " ".join(str(values).split())
    return text if len(text) <= 60 else f"{text[:57]}..."


def kernel(matrix: Floats) -> Floats:
    """Orthonormal basis of the vectors that a matrix takes to 0, as columns."""
    if not matrix.size:
        return np.eye(matrix.shape[1])
    _, sizes, rows = np.linalg.svd(matrix)
    rank = int((sizes > RANK * sizes[0]).sum()) if len(sizes) else 0
    return rows[rank:].T


def _numbers(name: str, values: ArrayLike) -> Floats:
    try:
        array = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise SettingError(f"{name} of a hand must be numbers: {error}") from error
    if np.isnan(array).any():
        raise SettingError(f"{name} of a hand must be numbers; got {short(values)}")
    return array


def _table(name: str, values: ArrayLike, columns: int) -> Floats:
    table = _numbers(name, values)
    if table.ndim != 2 or table.shape[1] != columns or not np.isfinite(table).all():
        raise SettingError(
            f"{name} must be rows of {columns} finite numbers; got shape {table.shape}"
        )
    return table


def _vector(name: str, values: ArrayLike | None, count: int) -> Floats:
    vector = np.zeros(count) if values is None else _numbers(name, values)
    if vector.shape != (count,) or not np.isfinite(vector).all():
        raise SettingError(f"{name} must be {count} finite numbers, one for each joint")
    return vector
