"""Load: what each grasp must hold, and with which force."""

import ast
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from grasp3d.errors import SettingError
from grasp3d.quality.task_texts import TaskField, TaskText
from grasp3d.settings.checks import check_length
from grasp3d.settings.lengths import (
    METRES,
    Length,
    LengthSettings,
    Unit,
    one_line,
    settings_in_unit,
)
from grasp3d.settings.parsing import Main, TextValue, settings_of_texts
from grasp3d.settings.quantities import DENSITIES, FORCES, MASSES, TORQUES, Quantity

if TYPE_CHECKING:
    from grasp3d.quality.tasks import Task

GIVEN_TASK = "given: "
"""Start of a stored task that was made in Python."""


@dataclass(frozen=True)
class Load(LengthSettings):
    """What each grasp must hold, and with which force.

    Quantities are numbers in SI units, or texts with a unit: '500 g', '40N', '7.85 g/cm^3'.

    Attributes:
        mass: Mass of the object [kg], or with a unit: 0.5kg, 500g, 1.1lb. none: from the density;
            without one the forces are for 1 kg.
        density: Density of the object [kg/m^3], or with a unit: 7.85g/cm^3. Several numbers,
            separated by commas: one for each body, in the order of the file; the centre of mass
            follows from them.
        grip_force: Force at hand of each finger, normal to the surface [N], or with a unit: 40N.
            none: the greatest force of the gripper, if any states one.
        torque_limits: Hands with joints: greatest torque of the motor of every joint [N m], or with
            a unit: 0.7Nm. none: those that its description states.
        task: What the grasp must resist: weight; 'weight within 30 of -z' (gravity at most 30
            degrees from an axis, or from three numbers); 'acceleration 5' [m/s^2]; 'wrench
            0,0,-5,0,0,0.1' (force [N], torque about the centre of mass [N m]); a file of wrenches
            (.csv); 'ellipsoid FILE' (rows: semi-axes); or several that act together, joined by
            ' + '.
        center_of_mass_radius: Radius of the ball about the centre of mass in which the true one
            lies, a length.

    Example:
        A part of 500 g, and fingers that press with 40 N:

        >>> import grasp3d
        >>> load = grasp3d.Load(mass="500 g", grip_force="40 N")
        >>> load.mass, load.grip_force, load.task
        (0.5, 40.0, 'weight')
        >>> task = load.task_for(load.mass, "mm")
        >>> print(f"{task.support([0, 0, 1, 0, 0, 0]):.3f} N")
        4.903 N
    """

    mass: Annotated[Quantity[float | None], Main("mass of the object, such as 0.5kg")] = Quantity(
        None, MASSES
    )
    density: Quantity[float | tuple[float, ...] | None] = Quantity(None, DENSITIES, several=True)
    grip_force: Quantity[float | None] = Quantity(None, FORCES)
    torque_limits: Quantity[float | None] = Quantity(None, TORQUES)
    task: TaskField = TaskField(TaskText.of("weight"))
    center_of_mass_radius: Length[float] = Length(0.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.mass is not None and self.density is not None:
            raise SettingError("mass and density exclude each other; give one of them")
        check_length("center_of_mass_radius", self.center_of_mass_radius)
        if self.center_of_mass_radius != 0.0 and not isinstance(self.task, TaskText):
            raise SettingError(
                "center_of_mass_radius is for tasks as text; a Task has a center_radius"
            )

    @property
    def chosen(self) -> "Load | None":
        """The load as the options of the command line choose it; None: all have their defaults.

        The task holds the wrenches of its files, as in `with_files_read`.
        """
        values = {one.name: getattr(self, one.name) for one in fields(self)}
        defaults = {one.name: one.default for one in fields(self)}
        return None if values == defaults else Load(**values).with_files_read()

    @property
    def task_files(self) -> tuple[Path, ...]:
        """Files that the task's text names."""
        return self.task.files if isinstance(self.task, TaskText) else ()

    def with_files_read(self) -> "Load":
        """The same load, with the wrenches of files in the task's text: it needs no files.

        Raises:
            SettingError: A file is missing or damaged.
        """
        if not self.task_files:
            return self
        assert isinstance(self.task, TaskText)
        return replace(self, task=self.task.with_files_read())

    def task_for(
        self, mass: float | None, unit: Unit | None, *, source: str = "the mesh"
    ) -> "Task":
        """The task for a mass, in the unit of a mesh.

        Args:
            mass: Mass [kg]; None: 1 kg, or that of a `Task`.
            unit: Unit of the mesh and of the contacts' points; None: it is not known.
            source: Name of the mesh, for the error.

        Raises:
            SettingError: The unit is not known, but torques or the radius of the centre of mass
                need it; a file is missing or damaged.
        """
        if not isinstance(self.task, TaskText):
            return self.task if mass is None else self.task.scaled_to(mass)
        (converted,) = settings_in_unit(unit, self, source=source)
        return self.task.task(
            mass=1.0 if mass is None else mass,
            center_radius=converted.center_of_mass_radius,
            metres_per_unit=None if unit is None else METRES[unit],
            source=source,
        )


def load_settings(load: Load | None) -> dict[str, str | float | None]:
    """A load as settings of one line each, as `load_from` reads them.

    Args:
        load: With lengths in the mesh's unit; None: there is none, and all values are none.

    Example:
        >>> import grasp3d
        >>> from grasp3d.quality.loads import load_from, load_settings
        >>> stored = load_settings(grasp3d.Load(density=(7850, 700), grip_force="40N"))
        >>> stored["density"], stored["task"]
        ('7850.0,700.0', 'weight')
        >>> load_from({name: str(value) for name, value in stored.items()})
        Load(mass=None, density=(7850.0, 700.0), grip_force=40.0, torque_limits=None, ...)
    """
    names = [one.name for one in fields(Load)]
    return {name: None if load is None else _one_line(getattr(load, name)) for name in names}


def load_from(values: Mapping[str, str]) -> Load | None:
    """The load in the settings of a file.

    Args:
        values: As `load_settings` returns them, as texts; others are ignored.

    Returns:
        None: there is none, or its task was made in Python and cannot be read.

    Raises:
        SettingError: It is damaged.
    """
    task = values.get("task", "None")
    if task == "None":
        return None
    if not task.startswith(GIVEN_TASK):
        return settings_of_texts(Load, values)
    parsed = _given_task(task.removeprefix(GIVEN_TASK))
    others = {name: text for name, text in values.items() if name != "task"}
    return None if parsed is None else replace(settings_of_texts(Load, others), task=parsed)


def _given_task(text: str) -> "Task | None":
    """The task, made in Python, whose `repr` is a text; None: it is none of this package's."""
    from grasp3d.quality import tasks

    kinds = (tasks.Weight, tasks.Acceleration, tasks.Wrenches, tasks.Ellipsoid, tasks.Sum)
    names: dict[str, Any] = {kind.__name__: kind for kind in kinds}

    def value(node: ast.expr) -> Any:
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            return names[node.func.id](**{str(one.arg): value(one.value) for one in node.keywords})
        if isinstance(node, ast.Tuple):
            return tuple(map(value, node.elts))
        return ast.literal_eval(node)

    try:
        task = value(ast.parse(text, mode="eval").body)
    except (
        SyntaxError,
        ValueError,
        TypeError,
        KeyError,
        RecursionError,
        MemoryError,
        SettingError,
    ):
        return None
    return task if isinstance(task, kinds) else None


def _one_line(value: object) -> str | float | None:
    """A value of a load as stored."""
    if isinstance(value, tuple):
        return one_line(value)
    if value is None or isinstance(value, float | int):
        return value
    text = str(value) if isinstance(value, TextValue) else f"{GIVEN_TASK}{value!r}"
    return " ".join(text.split())
