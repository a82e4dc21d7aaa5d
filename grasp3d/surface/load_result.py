"""Grip forces and payloads of grasps under a load."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from grasp3d.arrays import ArrayLike, Bools, Bytes, Floats, Ints, locked, short_repr
from grasp3d.contact.contacts import Contacts
from grasp3d.quality.force_ranges import Certainty, ForceRange, force_range, payload
from grasp3d.quality.grip_forces import Resistance
from grasp3d.quality.tasks import Task
from grasp3d.quality.tilting import FrictionCases, over_friction
from grasp3d.stability.label import Label
from grasp3d.surface.load_case import LoadCase

HARD_FINGERS = (
    "two hard fingers cannot resist a torque about the line through them: give a torsion radius "
    "(--torsion-radius) or a gripper with flat pads, which have one"
)
"""Why most grasps of two hard fingers hold nothing, and what helps."""

FORCE_RTOL = 1e-2
"""Fraction of a grip force that may lie between its bounds; the larger one is given."""

MOST = 0.5
"""Fraction of the grasps from which on they are most."""


@dataclass(frozen=True, eq=False)
class LoadResult:
    """Forces that grasps need under a load, and what they can carry, a row for each grasp.

    Forces are those of each finger along its contact's normal, as data sheets of grippers state
    them; the fingers may press differently for each wrench of the task. Friction cones are
    circular. On creases the true normal may be any within the sensor's resolution of any normal
    there.

    Example:
        A box of 0.5 kg, and soft fingers that press with 40 N:

        >>> import trimesh
        >>> import grasp3d
        >>> box = trimesh.creation.box([0.08, 0.05, 0.03])
        >>> mesh = grasp3d.load_mesh(box, unit="m", max_edge=0.02)
        >>> model = grasp3d.GraspModel(torsion_radius="3mm", sensor_resolution=0.2)
        >>> load = grasp3d.Load(mass=0.5, grip_force=40.0)
        >>> load_result = grasp3d.label_surface(mesh, model, load=load).load_result
        >>> load_result.grip_force.shape, load_result.mass, load_result.available
        ((146,), 0.5, 40.0)
        >>> best = int(load_result.payload.argmax())
        >>> print(f"{load_result.grip_force[best]:.0f} N, {load_result.payload[best]:.1f} kg")
        7 N, 2.7 kg
    """

    case: LoadCase
    """The load on this object."""
    grip_force: Floats
    """Force that each finger needs at the nominal normals [N], shape (b,), for `mass` or, if none
    is given, for 1 kg; inf: no force suffices; nan: no grasp, or normals that cancel out."""
    grip_force_least: Floats
    """The same at the best normals that the sensor cannot distinguish from these, shape (b,)."""
    grip_force_largest: Floats
    """The same at the worst of these normals, shape (b,)."""
    payload: Floats
    """Mass that the force at hand holds at the worst normals [kg], shape (b,); nan: no force at
    hand, no grasp, or a task that does not depend on the mass."""
    resistance: Bytes | None
    """`Resistance` codes at the nominal normals, shape (b,); None: a file does not contain them."""
    how: Certainty
    """How `grip_force_least` and `grip_force_largest` are known; see `quality.force_range`."""

    __repr__ = short_repr

    @property
    def mass(self) -> float | None:
        """Mass of the object [kg]; None: not given, forces are those for 1 kg."""
        return self.case.mass

    @property
    def available(self) -> float | None:
        """Force at hand of each finger [N]; None: not given."""
        return self.case.available

    @property
    def has_payload(self) -> bool:
        """Whether there are payloads: a force is at hand, and the task grows with the mass."""
        return self.available is not None and self.case.by_mass

    @cached_property
    def label(self) -> Bytes | None:
        """`Label` codes with the force at hand, shape (b,); None without a mass or a force.

        S: the load is held at all normals that may be true; U: at none, or there is no grasp; M:
        the sensor cannot decide.
        """
        if self.available is None or not self.case.complete:
            return None
        codes = np.full(len(self.grip_force), Label.M, dtype=np.uint8)
        codes[self.grip_force_largest <= self.available] = Label.S
        missing = np.isnan(self.grip_force_least)
        codes[(self.grip_force_least > self.available) | missing] = Label.U
        return locked(codes)

    @property
    def remedy(self) -> str:
        """What would help where most grasps hold nothing because fingers are hard; else empty."""
        if self.resistance is None:
            return ""
        grasps = ~np.isnan(self.grip_force)
        unresisted = np.isinf(self.grip_force) & (self.resistance == Resistance.NO_SUCH_WRENCH)
        if not self.case.hard or not unresisted.sum() > MOST * grasps.sum():
            return ""
        return HARD_FINGERS

    def each(self, change: Callable[[npt.NDArray[Any]], npt.NDArray[Any]]) -> "LoadResult":
        """The same with every array changed."""
        arrays = {name: getattr(self, name) for name in _ARRAYS}
        changed: dict[str, Any] = {
            name: locked(change(values)) for name, values in arrays.items() if values is not None
        }
        return replace(self, **changed)

    def take(self, rows: slice | Ints) -> "LoadResult":
        """The chosen rows."""
        return self.each(lambda values: values[rows])

    def with_forces(
        self, where: Bools, nominal: float, least: float, largest: float
    ) -> "LoadResult":
        """The same with other forces [N], which hold nothing, at a mask of shape (b,)."""
        values = nominal, least, largest, 0.0 if self.has_payload else math.nan, 0
        changed: dict[str, Any] = {
            name: locked(np.where(where, value, getattr(self, name)))
            for name, value in zip(_ARRAYS, values, strict=True)
        }
        return replace(self, **changed)

    def settings(self) -> dict[str, Any]:
        """Settings in files, with how the least and the largest forces are known."""
        return {**self.case.settings(), "force_bounds": self.how}


_ARRAYS = ("grip_force", "grip_force_least", "grip_force_largest", "payload", "resistance")


def at_rows(values: npt.NDArray[Any], rows: Ints, size: int) -> npt.NDArray[Any]:
    """Values (d, ...) at rows (d,) of an array with `size` rows, whose others are nan, or 0."""
    missing = math.nan if values.dtype.kind == "f" else 0
    every = np.full((size, *values.shape[1:]), missing, dtype=values.dtype)
    every[rows] = values
    return every


def load_result_of(
    contacts: Contacts, tilt: ArrayLike, case: LoadCase, *, friction: tuple[ArrayLike, ArrayLike]
) -> LoadResult:
    """Grip forces and payloads of contacts under a load, at the perceived contact locations.

    Args:
        contacts: A flat batch (b,), relative to the centre of mass, at nominal friction; torsion
            radii are those of the load case.
        tilt: Largest angle between true and given normals [rad], one value or shape (b, n).
        case: The load.
        friction: Smallest and largest coefficient, one for all contacts or shape (n,): the largest
            force and the payload are those of the smallest friction, the least force that of the
            largest, each with the torsion radius of a gripper's pads at that friction.
    """
    is_known = np.array_equal(friction[0], friction[1])
    cases = FrictionCases(
        case.at_friction(contacts), *(case.at_friction(contacts, bound) for bound in friction)
    )
    forces = _forces(cases, tilt, case.task, is_known)
    payloads = np.full(contacts.batch, np.nan)
    force, mass = case.available, case.task.mass
    if force is not None and mass is not None:
        task = case.task.scaled_to(mass)
        if all(term.mass is not None for term in task.terms()) and task == case.task:
            with np.errstate(divide="ignore"):  # no force is needed where nothing accelerates
                payloads = force * mass / forces.largest
        else:
            payloads = payload(cases.weakest, task, force, tilt=tilt, rtol=FORCE_RTOL)
    return LoadResult(
        case=case,
        grip_force=locked(forces.nominal),
        grip_force_least=locked(forces.least),
        grip_force_largest=locked(forces.largest),
        payload=locked(payloads),
        resistance=locked(forces.resistance),
        how=forces.how,
    )


def _forces(cases: FrictionCases, tilt: ArrayLike, task: Task, is_known: bool) -> ForceRange:
    """Forces at the nominal contacts, and the least and the largest over tilts and friction."""

    def forces(contacts: Contacts, tilt: ArrayLike) -> ForceRange:
        return force_range(contacts, task, tilt, rtol=FORCE_RTOL)

    if is_known:
        return forces(cases.nominal, tilt)
    nominal, low, high = over_friction(forces, cases, tilt)
    return replace(nominal, least=high.least, largest=low.largest, how=low.how)
