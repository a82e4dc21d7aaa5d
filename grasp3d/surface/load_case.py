"""A load on one object: its mass, the task, the force at hand and the fingers' torsion."""

import math
from dataclasses import dataclass

import numpy as np

from grasp3d.arrays import ArrayLike
from grasp3d.contact.contacts import Contacts
from grasp3d.errors import SettingError
from grasp3d.hand.hand import Hand
from grasp3d.hand.scene import Scene
from grasp3d.mesh import ObjectMesh
from grasp3d.mesh.plausible_lengths import length_warnings, object_warnings
from grasp3d.quality.loads import Load
from grasp3d.quality.tasks import Task
from grasp3d.settings import GraspModel
from grasp3d.settings.units import LengthSettings
from grasp3d.system.counts import short_number

DENSITY = "density is in kg/m^3"
"""What needs the unit of a mesh, for the error."""


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
    """What is doubtful about an object and what it is given with, one sentence each.

    Args:
        mesh: The object.
        scene: The gripper; None: none.
        load: Its mass; None: not known.
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
    """A load on one object, as its grasps are evaluated for it.

    Example:
        What a gripper brings: its force, and the torsion radius of its pads, here 2/3 x friction x
        radius of a disc of the pads' area:

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
    """Force at hand of each finger [N]; None: not given."""
    torsion_radius: float
    """Torsion radius of the contacts at nominal friction [m]: that given, or that of the gripper's
    pads; 0: hard fingers."""
    pad_torsion: float | None = None
    """Torsion radius of the gripper's pads per friction, to which it is proportional [m]; None:
    there are no pads, or a torsion radius is given, which is that at any friction."""
    by_motors: bool = False
    """Whether the motors of a hand with joints hold it, and no force of the fingers is at hand."""

    @classmethod
    def of(
        cls, load: Load, mesh: ObjectMesh, model: GraspModel, hand: Hand | None = None
    ) -> "LoadCase":
        """The load on an object.

        Args:
            load: Mass or density, task, and force at hand.
            mesh: The object.
            model: The fingers; without a torsion radius they have that of the gripper's pads.
            hand: Its greatest force is at hand unless the load states another one.

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
        return f"{self.to_hold}, {self.at_hand} at hand" if self.at_hand else self.to_hold

    @property
    def at_hand(self) -> str:
        """The force at hand as text: '20 N'; empty: it is not known."""
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
        """Contacts with another friction, and with the torsion radius that they then have.

        Args:
            contacts: The contacts; their own torsion radii do not matter.
            friction: One value, or shape (..., n); None: theirs.

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
            "force_at_hand": self.available,
            "force_torsion_radius": self.torsion_radius,
        }
