"""Load: what each grasp must hold, and with which force."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any, ClassVar, TypeAlias

from grasp3d.errors import SettingError
from grasp3d.quality.task_texts import TaskField, TaskText
from grasp3d.settings.parsing import Settings, settings_of_texts
from grasp3d.settings.units import DENSITIES, FORCES, MASSES, TORQUES, Quantity

if TYPE_CHECKING:
    from grasp3d.quality.tasks import Task


@dataclass(frozen=True)
class Load(Settings):
    """What each grasp must hold, and with which force.

    Quantities are numbers in SI units, or texts with a unit: '500 g', '40N', '7.85 g/cm^3'.

    Attributes:
        mass: Mass of the object [kg], or with a unit: 0.5kg, 500g, 1.1lb. none: from the density;
            without one the forces are for 1 kg.
        density: Density of the object [kg/m^3], or with a unit: 7.85g/cm^3.
        grip_force: Force at hand of each finger, normal to the surface [N], or with a unit: 40N.
            none: the greatest force of the gripper, if any states one.
        torque_limits: Hands with joints: greatest torque of the motor of every joint [N m], or with
            a unit: 0.7Nm. none: those that its description states.
        task: What the grasp must resist: weight; 'weight within 30 of -z' (gravity at most 30
            degrees from an axis, or from three numbers); 'acceleration 5' [m/s^2]; 'wrench
            0,0,-5,0,0,0.1' (force [N], torque about the centre of mass [N m]); a file of wrenches
            (.csv); or several that act together, joined by ' + '.

    Example:
        A part of 500 g, and fingers that press with 40 N:

        >>> import grasp3d
        >>> load = grasp3d.Load(mass="500 g", grip_force="40 N")
        >>> load.mass, load.grip_force, load.task
        (0.5, 40.0, 'weight')
        >>> task = load.task_for(load.mass)
        >>> print(f"{task.support([0, 0, 1, 0, 0, 0]):.3f} N")
        4.903 N
    """

    lone: ClassVar[str] = "mass"

    mass: Quantity[float | None] = Quantity(None, MASSES)
    density: Quantity[float | None] = Quantity(None, DENSITIES)
    grip_force: Quantity[float | None] = Quantity(None, FORCES)
    torque_limits: Quantity[float | None] = Quantity(None, TORQUES)
    task: TaskField = TaskField(TaskText.of("weight"))

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.mass is not None and self.density is not None:
            raise SettingError("mass and density exclude each other; give one of them")

    @property
    def chosen(self) -> "Load | None":
        """The load as the options of the command line choose it; None: all have their defaults."""
        values = {one.name: getattr(self, one.name) for one in fields(self)}
        defaults = {one.name: one.default for one in fields(self)}
        return None if values == defaults else Load(**values)

    def task_for(self, mass: float | None) -> "Task":
        """The task for a mass.

        Args:
            mass: Mass [kg]; None: 1 kg.
        """
        return self.task.task(mass=1.0 if mass is None else mass)


GivenLoad: TypeAlias = Load | Mapping[str, Any] | str | float | None
"""A load as functions take it: also a dict of its fields, or its mass, '0.5kg' or 0.5 [kg]."""


def load_settings(load: Load | None) -> dict[str, str | float | None]:
    """A load as settings of one line each, as `load_from` reads them.

    Args:
        load: The load; None: there is none, and all values are none.

    Example:
        >>> import grasp3d
        >>> from grasp3d.quality.loads import load_from, load_settings
        >>> stored = load_settings(grasp3d.Load(density=7850, grip_force="40N"))
        >>> stored["density"], stored["task"]
        (7850.0, 'weight')
        >>> load_from({name: str(value) for name, value in stored.items()})
        Load(mass=None, density=7850.0, grip_force=40.0, torque_limits=None, ...)
    """
    names = [one.name for one in fields(Load)]
    values = {name: None if load is None else getattr(load, name) for name in names}
    return values | {"task": None if load is None else " ".join(str(load.task).split())}


def load_from(values: Mapping[str, str]) -> Load | None:
    """The load in the settings of a file.

    Args:
        values: As `load_settings` returns them, as texts; others are ignored.

    Returns:
        None: there is none.

    Raises:
        SettingError: It is damaged.
    """
    return None if values.get("task", "None") == "None" else settings_of_texts(Load, values)
