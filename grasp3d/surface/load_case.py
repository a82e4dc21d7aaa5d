"""A load on one object (mass, task, available force, torsion), and its results for grasps.

The results are grip forces and payloads.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from grasp3d.arrays import ArrayLike, Bools, Bytes, Floats, Ints, locked, short_repr
from grasp3d.contact.contacts import Contacts
from grasp3d.errors import SettingError
from grasp3d.hand.hand import Hand
from grasp3d.hand.scene import Scene
from grasp3d.mesh import ObjectMesh
from grasp3d.mesh.plausible_lengths import length_warnings, object_warnings
from grasp3d.quality.force_ranges import (
    Certainty,
    ForceRange,
    FrictionCases,
    force_range,
    over_friction,
    payload,
)
from grasp3d.quality.grip_forces import Resistance
from grasp3d.quality.loads import Load
from grasp3d.quality.tasks import Task
from grasp3d.settings import GraspModel
from grasp3d.settings.units import LengthSettings
from grasp3d.stability.label import Label
from grasp3d.system.names import short_number

DENSITY = "density is in kg/m^3"
"""Why the unit of a mesh is needed, for the error."""


def mass_of(mesh: ObjectMesh, load: Load) -> float | None:
    """Mass of an object [kg]: as given, or from the density; None: neither is given.

    Args:
        mesh: The object.
        load: The load.

    Raises:
        SettingError: A density needs the mesh's unit, or a volume.
    """
    if load.density is None:
        return load.mass
    source = mesh.report.source
    if math.isnan(mesh.volume):
        raise SettingError(
            f"{source}: {_without_volume(mesh)}, so a density gives no mass: give the mass "
            "(--mass) and the centre of mass (--center-of-mass) instead, or close the mesh "
            "(--repair full)"
        )
    mesh.needs_metres(DENSITY)
    return load.density * mesh.volume


def _without_volume(mesh: ObjectMesh) -> str:
    return "encloses no volume" if mesh.report.closed else "is open"


def input_warnings(
    mesh: ObjectMesh, scene: Scene | None, load: Load | None, *settings: LengthSettings | None
) -> tuple[str, ...]:
    """Warnings about an object and the settings given with it, one sentence each.

    Args:
        mesh: The object.
        scene: The gripper; None: none.
        load: The load with the object's mass; None: not known.
        settings: Settings with lengths, besides those of the mesh.
    """
    hand, mass = (
        None if scene is None else scene.hand,
        None if load is None else mass_of(mesh, load),
    )
    sizes = (0.0, math.inf)
    if hand is not None:
        sizes = math.sqrt(hand.touch_area), hand.max_opening or math.inf  # 0: it has no opening
    doubts = (*object_warnings(mesh, mass, *sizes), *length_warnings(mesh, *settings))
    return (*mesh.report.warnings, *doubts)


@dataclass(frozen=True)
class LoadCase:
    """A load on one object, for which grasps are evaluated.

    Example:
        A gripper brings its force and the torsion radius of its pads, here 2/3 x friction x radius
        of a disc of the pads' area:

        >>> import trimesh
        >>> import grasp3d
        >>> from grasp3d.surface.load_case import LoadCase
        >>> mesh = grasp3d.load_mesh(trimesh.creation.box([80, 50, 30]), unit="mm")
        >>> hand = grasp3d.ParallelGripper.preset("franka")
        >>> case = LoadCase.of(grasp3d.Load(density=1000.0), mesh, grasp3d.GraspModel(), hand)
        >>> print(f"{case.mass:.3f} kg, {case.available:g} N, {case.torsion_radius:.5f} m")
        0.120 kg, 70 N, 0.00329 m
    """

    load: Load
    """The load as it was given."""
    mass: float | None
    """Mass of the object [kg]; None: not given, the task is for 1 kg."""
    task: Task
    """The wrenches that must be resisted."""
    available: float | None
    """Available force of each finger [N]; None: not given."""
    torsion_radius: float
    """Torsion radius of the contacts at nominal friction [m]: the given one, or that of the
    gripper's pads; 0: hard fingers."""
    pad_torsion: float | None = None
    """Torsion radius of the gripper's pads per unit of friction [m]; None: there are no pads, or a
    torsion radius is given, which holds at any friction."""
    by_motors: bool = False
    """Whether the motors of a hand with joints hold it, instead of an available force."""

    @classmethod
    def of(
        cls, load: Load, mesh: ObjectMesh, model: GraspModel, hand: Hand | None = None
    ) -> "LoadCase":
        """Apply a load to an object.

        Args:
            load: Mass or density, task, and available force.
            mesh: The object.
            model: The fingers; without a torsion radius they have that of the gripper's pads.
            hand: The hand; its greatest force is available unless the load states another one.

        Raises:
            SettingError: The centre of mass is not known, or the mass or the unit of the mesh is
                needed but not known.
        """
        by_motors = hand is not None and not hand.fingers
        if load.torque_limits is not None and not by_motors:
            raise SettingError("torque_limits are those of the motors of a hand with joints")
        source = mesh.report.source
        mass = mass_of(mesh, load)
        if math.isnan(mesh.volume) and mesh.report.center_mass_from == "surface":
            raise SettingError(
                f"{source}: {_without_volume(mesh)}, so its centre of mass is not known, which a "
                "load needs: give it (--center-of-mass, in Python center_of_mass=...), or close "
                "the mesh (--repair full)"
            )
        if load.task.has_torques:
            mesh.needs_metres("torques of the task are in N m")
        task = load.task_for(mass)
        force = load.grip_force
        if force is None and hand is not None:
            force = hand.max_force
        torsion, pads = model.torsion_radius, None
        if torsion == 0.0 and hand is not None:
            pads = hand.torsion_radius(1.0)
            torsion = pads * model.nominal_friction
        return cls(load, mass, task, force, torsion, pads, by_motors)

    def __str__(self) -> str:
        return f"{self.to_hold}, {self.force_text} available" if self.force_text else self.to_hold

    @property
    def force_text(self) -> str:
        """The available force as text: '20 N'; empty: it is not known."""
        return "" if self.available is None else f"{short_number(self.available)} N"

    @property
    def by_mass(self) -> bool:
        """Whether the task depends on the mass; given wrenches alone do not."""
        return self.task.mass is not None

    @property
    def to_hold(self) -> str:
        """What must be held, in a few words."""
        if not self.by_mass:
            return "given wrenches"
        return "1 kg (no mass is given)" if self.mass is None else f"{short_number(self.mass)} kg"

    @property
    def complete(self) -> bool:
        """Whether it is known what must be held, and with which force."""
        return self.decided and self.available is not None

    @property
    def decided(self) -> bool:
        """Whether the task is that of the object: its mass is known, or does not matter."""
        return self.mass is not None or not self.by_mass

    def at_friction(self, contacts: Contacts, friction: ArrayLike | None = None) -> Contacts:
        """Return contacts with another friction, and with the torsion radius that follows from it.

        Args:
            contacts: The contacts; their own torsion radii do not matter.
            friction: One value, or shape (..., n); None: that of the contacts.

        Example:
            Pads that rub less also resist less torque about their normal:

            >>> import trimesh
            >>> import grasp3d
            >>> box = trimesh.creation.box([80, 50, 30])
            >>> mesh = grasp3d.load_mesh(box, unit="mm", max_edge="20mm")
            >>> franka, model = grasp3d.ParallelGripper.preset("franka"), grasp3d.GraspModel()
            >>> case = grasp3d.surface.LoadCase.of(grasp3d.Load(), mesh, model, franka)
            >>> sides = grasp3d.Contacts([[0, -0.025, 0], [0, 0.025, 0]], [[0, 1, 0], [0, -1, 0]])
            >>> case.at_friction(sides, (0.25, 0.5)).torsion_radius.round(5).tolist()
            [0.00165, 0.00329]
        """
        own = contacts.friction if friction is None else np.asarray(friction, dtype=float)
        if self.pad_torsion is None:
            torsion = np.asarray(self.torsion_radius)
        else:
            torsion = self.pad_torsion * own
        return Contacts(contacts.points, contacts.normals, own, torsion)

    @property
    def hard(self) -> bool:
        """Whether the fingers resist no torsion."""
        return self.torsion_radius == 0.0

    def settings(self) -> dict[str, float | None]:
        """What follows from the load and the object, as settings of files."""
        return {
            "object_mass": self.mass,
            "available_force": self.available,
            "force_torsion_radius": self.torsion_radius,
        }


HARD_FINGERS = (
    "two hard fingers cannot resist a torque about the line through them: give a torsion radius "
    "(--torsion-radius) or a gripper with flat pads, which have one"
)
"""Why most grasps of two hard fingers hold nothing, and what helps."""

FORCE_RTOL = 1e-2
"""Fraction of a grip force that may lie between its bounds; the larger one is given."""

MOST = 0.5
"""Fraction of the grasps that must be exceeded for 'most grasps'."""


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
    """The same at the worst such normals, shape (b,)."""
    payload: Floats
    """Mass that the available force holds at the worst normals [kg], shape (b,); nan: no force at
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
        """Available force of each finger [N]; None: not given."""
        return self.case.available

    @property
    def has_payload(self) -> bool:
        """Whether there are payloads: a force is available, and the task grows with the mass."""
        return self.available is not None and self.case.by_mass

    @cached_property
    def label(self) -> Bytes | None:
        """`Label` codes with the available force, shape (b,); None without a mass or a force.

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
        """Remedy if most grasps hold nothing because fingers are hard; else empty."""
        if self.resistance is None:
            return ""
        grasps = ~np.isnan(self.grip_force)
        unresisted = np.isinf(self.grip_force) & (self.resistance == Resistance.NO_SUCH_WRENCH)
        if not self.case.hard or not unresisted.sum() > MOST * grasps.sum():
            return ""
        return HARD_FINGERS

    def each(self, change: Callable[[npt.NDArray[Any]], npt.NDArray[Any]]) -> "LoadResult":
        """The same with a function applied to every array."""
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
        """The same with other forces [N], and no payload, where a mask (b,) is true."""
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
    """Put values (d, ...) at rows (d,) of an array with `size` rows; other rows are nan, or 0."""
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
