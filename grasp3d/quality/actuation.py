"""Actuation: the torques that the motors and the stops of a hand exert on its joints.

With forces f of the hand on the object, Jacobian J of the contact points and weight g of the links
(as the torques that hold them),

    J^T f + g = B u + E s,    -u+ <= u <= u+,  s >= 0,

where B selects the joints that have a motor, and E those at a stop. Joints that a rigid coupling
moves with another one do not count: J includes their motion, and the structure bears what the motor
does not. The forces for which this has a solution form a convex polyhedron K, which does not depend
on normals.
"""

from dataclasses import dataclass

import numpy as np

from grasp3d.arrays import ArrayLike, Floats, locked, short_repr
from grasp3d.errors import SettingError


@dataclass(frozen=True, eq=False, init=False)
class Actuation:
    """The torques that k motors, at most one for each joint, and stops exert on p joints."""

    columns: Floats
    """Joint torques of unit motors, followed by those of unit stops (B and E), shape (p, q)."""
    limits: Floats
    """Greatest torques of the motors, both ways, above 0; inf: no limit; shape (k,)."""
    names: tuple[str, ...]
    """Names of the motors."""
    links: Floats | None
    """Torques that hold the links per acceleration of gravity [kg m], shape (p, 3); None: their
    weight is neglected."""

    __repr__ = short_repr

    def __init__(
        self,
        limits: ArrayLike,
        *,
        names: tuple[str, ...] | None = None,
        stops: ArrayLike | None = None,
        links: ArrayLike | None = None,
    ) -> None:
        """The actuation of a hand in a posture.

        Args:
            limits: Greatest torque of each joint's motor, both ways [N m], shape (p,); inf: no
                limit, 0: no motor.
            names: Names of the motors. None: their numbers.
            stops: 1 where a joint is at its lower stop, which pushes it up, -1 at its upper one,
                else 0, shape (p,).
            links: Torques that hold the links per acceleration of gravity [kg m], shape (p, 3):
                minus the masses of the links times the Jacobians of their centres.

        Raises:
            SettingError: Shapes do not match, or values are out of range.
        """
        try:
            most = np.asarray(limits, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise SettingError(f"limits of motors must be torques; got {limits!r}") from error
        if most.ndim != 1 or not (most >= 0.0).all():
            raise SettingError(
                f"limits of motors must be one torque for each, at least 0; got {most}"
            )
        joints = len(most)
        ends = np.asarray(np.zeros(joints) if stops is None else stops, dtype=np.float64)
        held = np.asarray(np.zeros((joints, 3)) if links is None else links, dtype=np.float64)
        for name, array, shape in (("stops", ends, (joints,)), ("links", held, (joints, 3))):
            if array.shape != shape or not np.isfinite(array).all():
                raise SettingError(
                    f"{name} of {joints} joints must be finite numbers of shape {shape}; got shape "
                    f"{array.shape}"
                )
        if names and len(names) != len(most):
            raise SettingError(f"{len(most)} motors need as many names; got {len(names)}")
        some, at_stop = np.flatnonzero(most), np.flatnonzero(ends)
        known = names or tuple(f"motor {k}" for k in range(len(most)))
        columns = np.concatenate([np.eye(joints)[:, some], np.diag(np.sign(ends))[:, at_stop]], 1)
        for name, value in (
            ("columns", locked(columns)),
            ("limits", locked(most[some])),
            ("names", tuple(known[k] for k in some)),
            ("links", None if links is None else locked(held)),
        ):
            object.__setattr__(self, name, value)

    @property
    def joints(self) -> int:
        """Number of joints p."""
        return len(self.columns)
