"""Loads: what each grasp must hold, with which force, and tasks as texts and files.

A task is a text such as 'weight within 30 of -z + acceleration 5', or a file, 'pushes.csv'. Forces
are in newtons and torques in newton metres, also in files. NumPy is imported only when a task is
made, so the command line checks a text quickly.
"""

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from functools import reduce
from operator import add
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, TypeAlias

from grasp3d.errors import SettingError
from grasp3d.settings.parsing import ParsedField, Settings, settings_of_texts
from grasp3d.settings.units import DENSITIES, FORCES, MASSES, TORQUES, Quantity, parse_angle
from grasp3d.system.documents import file_bytes
from grasp3d.system.names import printable

if TYPE_CHECKING:
    from grasp3d.quality.tasks import Task


AXES = {
    "x": "1,0,0", "y": "0,1,0", "z": "0,0,1", "-x": "-1,0,0", "-y": "0,-1,0", "-z": "0,0,-1",
}  # fmt: skip
"""Directions of gravity by name."""

Row = tuple[float, ...]

MAX_WRENCHES = 200
"""Most wrenches of a text, as the header of a PLY file contains them."""

COLUMNS = "fx,fy,fz,tx,ty,tz"
"""The optional header line of a file of wrenches."""

LARGEST_FILE = 2**20
"""Largest size of a file of wrenches [bytes]."""


class _Part(NamedTuple):
    """One part of a task's text."""

    text: str
    kind: str
    """weight, acceleration or wrench."""
    rows: tuple[Row, ...] = ()
    """Weight: the direction of gravity; acceleration: its size; wrench: rows of six numbers."""
    within: float = 0.0
    """Weight: the angle from the direction [rad]."""
    file: Path | None = None
    """File that the rows are from."""


def _weight_within(text: str, angle: str, axis: str) -> _Part:
    within = parse_angle("the angle", angle)
    if not 0.0 <= within <= math.pi / 2.0:
        raise SettingError("the angle must be from 0 to 90 degrees; 'weight' acts in any direction")
    direction = _numbers(AXES.get(axis, axis), 3, "the axis x, y, z, -x, -y or -z, or")
    if not any(direction):
        raise SettingError("the axis has no direction")
    return _Part(text, "weight", (direction,), within)


def _acceleration(text: str, size: str) -> _Part:
    row = _numbers(size, 1, "the acceleration in m/s^2 as")
    if row[0] < 0.0:
        raise SettingError("the acceleration must be at least 0")
    return _Part(text, "acceleration", (row,))


def _wrench(text: str, rows: str) -> _Part:
    return _Part(text, "wrench", tuple(map(_numbers, rows.split(";"))))


def _wrench_file(_: str, name: str) -> _Part:
    lines = file_bytes(Path(name), LARGEST_FILE).decode("utf-8-sig").splitlines()
    numbered = [(number, line.strip()) for number, line in enumerate(lines, 1)]
    stated = [(number, line) for number, line in numbered if line and not line.startswith("#")]
    if stated and stated[0][1].replace('"', "").replace(" ", "").lower() == COLUMNS:
        del stated[0]
    rows = []
    for number, line in stated:
        try:
            rows.append(_numbers(line))
        except SettingError as error:
            raise SettingError(f"line {number}: {error}") from error
    if not rows:
        raise SettingError("the file has no wrench")
    words = ([repr(number).removesuffix(".0") for number in row] for row in rows)
    text = f"wrench {'; '.join(map(','.join, words))}"
    return _Part(text, "wrench", tuple(rows), file=Path(name))


_FORMS: tuple[tuple[str, str, Callable[..., _Part]], ...] = (
    ("weight", r"weight", lambda text: _Part(text, "weight")),
    ("weight within DEGREES of AXIS", r"weight\s+within\s+(.+?)\s+of\s+(.+)", _weight_within),
    ("acceleration NUMBER", r"acceleration\s+(.*?)(?:\s*m/s\^?2)?", _acceleration),
    ("wrench FX,FY,FZ,TX,TY,TZ", r"wrench\s+(.+)", _wrench),
    ("FILE.csv", r"(?i:(.+\.csv))", _wrench_file),
)
"""Forms of a part of a text: for messages, as a pattern, and the function that makes the part."""


@dataclass(frozen=True, repr=False)
class TaskText:
    r"""The checked text of a task, with the wrenches of its files.

    Example:
        >>> from pathlib import Path
        >>> from grasp3d.quality.loads import TaskText
        >>> TaskText.of(" weight + wrench 0,0,-5,0,0,0 ")
        'weight + wrench 0,0,-5,0,0,0'
        >>> _ = Path("pushes.csv").write_text("fx,fy,fz,tx,ty,tz\n5,0,0,0,0,0\n0,5,0,0,0,0.1\n")
        >>> TaskText.of("weight + pushes.csv")
        'weight + wrench 5,0,0,0,0,0; 0,5,0,0,0,0.1'
    """

    text: str
    parts: tuple[_Part, ...] = field(compare=False)

    @classmethod
    def of(cls, text: str) -> "TaskText":
        """Parse a text, see `parse_task`, and read its files.

        Raises:
            SettingError: It is not a task, or a file is missing or damaged.
        """
        parts = tuple(_parse(part.strip()) for part in re.split(r"\s\+\s", text.strip()))
        count = sum(len(part.rows) for part in parts if part.kind == "wrench")
        if count > MAX_WRENCHES:
            raise SettingError(f"a task may have at most {MAX_WRENCHES} wrenches; got {count}")
        if not any(part.kind == "weight" or any(map(any, part.rows)) for part in parts):
            raise SettingError(f"task {printable(text)!r}: a task needs a force or a torque")
        return cls(" + ".join(part.text for part in parts), parts)

    def __str__(self) -> str:
        return self.text

    def __repr__(self) -> str:
        """The text form, as in settings."""
        return repr(self.text)

    @property
    def files(self) -> tuple[Path, ...]:
        """The files that were read."""
        return tuple(part.file for part in self.parts if part.file)

    @property
    def has_torques(self) -> bool:
        """Whether it states torques, for which the contact points must be in metres."""
        return any(any(row[3:]) for part in self.parts for row in part.rows)

    def task(self, *, mass: float = 1.0) -> "Task":
        """The task that it describes; see `parse_task`."""
        from grasp3d.quality.tasks import Acceleration, Weight, Wrenches

        def build(part: _Part) -> "Task":
            if part.kind == "weight":
                axis: Any = part.rows[0] if part.rows else None
                return Weight(mass, axis, part.within)
            if part.kind == "acceleration":
                return Acceleration(mass, *part.rows[0])
            return Wrenches(part.rows)

        return reduce(add, map(build, self.parts))


class TaskField(ParsedField["TaskText", "str | TaskText"]):
    """A field of settings that holds a task, given as a text; see `parse_task`."""

    def parse(self, _name: str, value: Any) -> "TaskText":
        """See `ParsedField.parse`."""
        return value if isinstance(value, TaskText) else TaskText.of(str(value))


def parse_task(text: str, *, mass: float = 1.0) -> "Task":
    """Make the task that a text describes.

    Args:
        text: weight; weight within DEGREES of AXIS; acceleration NUMBER [m/s^2]; wrench
            FX,FY,FZ,TX,TY,TZ [N, N m], several separated by semicolons; a file of wrenches; or
            several joined by ' + '. An axis is x, y, z, -x, -y or -z of the contacts' frame, or
            three numbers with commas. A file is a CSV (.csv) of six columns, force and torque; a
            first line of names is optional, lines that begin with # are comments.
        mass: Mass of the object [kg].

    Raises:
        SettingError: It is not a task, or a file is missing or damaged.

    Example:
        An object of 0.5 kg that is pushed with 5 N:

        >>> from grasp3d.quality.loads import parse_task
        >>> task = parse_task("weight + wrench 5,0,0,0,0,0.1", mass=0.5)
        >>> print(f"{task.support([1, 0, 0, 0, 0, 0]):.3f} N")
        9.903 N
    """
    return TaskText.of(text).task(mass=mass)


def _parse(text: str) -> _Part:
    """Parse one part of a text."""
    for _, pattern, make in _FORMS:
        if found := re.fullmatch(pattern, text):
            try:
                return make(text, *found.groups())
            except (SettingError, ValueError, OSError) as error:
                raise SettingError(f"task {printable(text)!r}: {error}") from error
    known = ", ".join(form for form, _, _ in _FORMS)
    raise SettingError(f"no task is called {printable(text)!r}; known: {known}, joined by ' + '")


def _numbers(words: str, count: int = 6, what: str = "force [N] and torque [N m] as") -> Row:
    """Parse `count` finite numbers separated by commas. Raises SettingError."""
    try:
        numbers = tuple(map(float, words.split(",")))
    except ValueError:
        numbers = ()
    if len(numbers) != count or not all(map(math.isfinite, numbers)):
        quoted = printable(words.strip())[:100]
        raise SettingError(f"give {what} {count} finite number{'s' * (count > 1)}; got {quoted!r}")
    return numbers


@dataclass(frozen=True)
class Load(Settings):
    """What each grasp must hold, and with which force.

    Quantities are numbers in SI units, or texts with a unit: '500 g', '40N', '7.85 g/cm^3'.

    Attributes:
        mass: Mass of the object [kg], or with a unit: 0.5kg, 500g, 1.1lb. none: computed from the
            density; without either, forces are for 1 kg.
        density: Density of the object [kg/m^3], or with a unit: 7.85g/cm^3.
        grip_force: Available force of each finger, normal to the surface [N], or with a unit: 40N.
            none: the greatest force of the gripper, if it states one.
        torque_limits: Hands with joints: greatest torque of the motor of every joint [N m], or with
            a unit: 0.7Nm. none: those that the hand's description states.
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
        """The load as the options of the command line state it; None if all have their defaults."""
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
"""A load as functions accept it: a `Load`, its fields as a dict, or its mass, '0.5kg' or 0.5
[kg]."""


def load_settings(load: Load | None) -> dict[str, str | float | None]:
    """A load as settings of one line each, as `load_from` reads them.

    Args:
        load: The load; None: all values are None.

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
        The load; None: the settings contain none.

    Raises:
        SettingError: The settings are damaged.
    """
    return None if values.get("task", "None") == "None" else settings_of_texts(Load, values)
