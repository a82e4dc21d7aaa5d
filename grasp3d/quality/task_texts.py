"""Tasks as texts and files: 'weight within 30 of -z + acceleration 5', 'pushes.csv'.

Forces are in newtons and torques in newton metres, also in files. Nothing here imports NumPy until
a task is made, so that the command line checks a text quickly.
"""

import csv
import math
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import reduce
from operator import add
from pathlib import Path
from typing import TYPE_CHECKING, Any

from grasp3d.errors import SettingError
from grasp3d.settings.parsing import ParsedField, TextValue
from grasp3d.settings.units import parse_angle
from grasp3d.system.documents import problem_of_file
from grasp3d.system.names import printable

if TYPE_CHECKING:
    from grasp3d.quality.tasks import Task

AXES = {
    sign + axis: tuple(factor if axis == other else 0.0 for other in "xyz")
    for sign, factor in (("", 1.0), ("+", 1.0), ("-", -1.0))
    for axis in "xyz"
}
"""Directions of gravity by name."""

KNOWN = (
    "weight, weight within DEGREES of AXIS, acceleration NUMBER, wrench FX,FY,FZ,TX,TY,TZ, "
    "FILE.csv, and several joined by ' + '"
)

_JOINED = re.compile(r"\s\+\s")
_WITHIN = re.compile(r"within\s+(.+?)\s+of\s+(.+)")
_PER_SECOND_SQUARED = re.compile(r"\s*m/s\^?2$")

Row = tuple[float, ...]

COLUMNS = ("fx", "fy", "fz", "tx", "ty", "tz")
"""Columns of a file of wrenches."""

MAX_WRENCHES = 200
"""Most wrenches of a text or file: the header of a PLY states them."""

LARGEST_FILE = 2**20
"""Bytes of the largest file of wrenches."""


def read_wrenches(path: Path) -> tuple[Row, ...]:
    """Read a file of wrenches.

    Args:
        path: CSV of six columns, between commas, semicolons or tabs: force [N] and torque about the
            centre of mass [N m]; a first line of names is optional, lines that begin with # are
            comments.

    Returns:
        Rows of six finite numbers, shape (k, 6).

    Raises:
        SettingError: It is missing, or no such file.
    """
    name = printable(str(path))
    try:
        if problem := problem_of_file(path):
            raise SettingError(f"{name}: {problem}")
        if path.stat().st_size > LARGEST_FILE:
            raise SettingError(f"{name}: is too large for a file of {MAX_WRENCHES} wrenches")
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except UnicodeDecodeError as error:
        raise SettingError(f"{name}: is not a text file of wrenches") from error
    except OSError as error:
        raise SettingError(f"{name}: cannot be read ({error.strerror})") from error
    rows = tuple(_rows(name, lines))
    if not 1 <= len(rows) <= MAX_WRENCHES:
        raise SettingError(
            f"{name}: must hold from 1 to {MAX_WRENCHES} wrenches, one a line; got {len(rows)}"
        )
    return rows


def _rows(name: str, lines: list[str]) -> Iterator[Row]:
    """Rows of a file; raises SettingError."""
    numbered = [(number, line.strip()) for number, line in enumerate(lines, 1)]
    stated = [(number, line) for number, line in numbered if line and not line.startswith("#")]
    for place, (number, line) in enumerate(stated):
        try:
            delimiter = next((one for one in ";\t" if one in line), ",")
            words = [word.strip() for word in next(csv.reader([line], delimiter=delimiter))]
            if place == 0 and tuple(word.lower() for word in words) == COLUMNS:
                continue
            if delimiter == ";":
                words = [word.replace(",", ".") for word in words]
            row = tuple(map(float, words)) if len(words) == len(COLUMNS) else ()
        except (csv.Error, ValueError) as error:
            raise SettingError(
                f"{name}: line {number} must be six numbers, {', '.join(COLUMNS)}: {error}"
            ) from error
        if not row:
            raise SettingError(
                f"{name}: line {number} has {len(words)} columns; a wrench has six, "
                f"{', '.join(COLUMNS)}: force [N] and torque [N m]"
            )
        if not all(map(math.isfinite, row)):
            raise SettingError(f"{name}: line {number} has a number that is not finite")
        yield row


@dataclass(frozen=True)
class _Part:
    """One part of a task's text."""

    text: str
    kind: str
    """weight, acceleration or wrench."""
    rows: tuple[Row, ...] = ()
    """Weight: the direction of gravity; acceleration: its size; wrench: rows of six numbers."""
    within: float = 0.0
    """Weight: the angle from the direction [rad]."""
    file: str = ""
    """File that holds the rows."""

    @property
    def empty(self) -> bool:
        """Whether it has neither a force nor a torque."""
        known = self.kind != "weight" and not self.file
        return known and not any(map(any, self.rows))


@dataclass(frozen=True, repr=False)
class TaskText(TextValue):
    """The text of a task, checked; its files are opened when they are needed.

    Example:
        >>> from grasp3d.quality.task_texts import TaskText
        >>> TaskText.of(" weight + wrench 0,0,-5,0,0,0 ")
        'weight + wrench 0,0,-5,0,0,0'
        >>> [path.name for path in TaskText.of("weight + pushes.csv").files]
        ['pushes.csv']
        >>> TaskText.of("wrench 0,0,-5")
        Traceback (most recent call last):
            ...
        grasp3d.errors.SettingError: task 'wrench 0,0,-5': give force [N] and torque [N m] as 6 \
finite numbers; got '0,0,-5'
    """

    text: str
    parts: tuple[_Part, ...] = field(compare=False)

    @classmethod
    def of(cls, text: str) -> "TaskText":
        """Parse a text, see `parse_task`.

        Raises:
            SettingError: It is no task.
        """
        parts = tuple(_parse(part.strip()) for part in _JOINED.split(text.strip()))
        return cls(text.strip(), parts).checked()

    def __str__(self) -> str:
        return self.text

    def __repr__(self) -> str:
        """The text that settings take for it."""
        return repr(self.text)

    def checked(self) -> "TaskText":
        """The same; raises SettingError if it is empty, or has too many wrenches."""
        rows = (part.rows for part in self.parts if part.kind == "wrench")
        count = sum(map(len, rows))
        if count > MAX_WRENCHES:
            raise SettingError(f"a task may have at most {MAX_WRENCHES} wrenches; got {count}")
        if all(part.empty for part in self.parts):
            raise _no_task(self.text, "a task needs a force or a torque")
        return self

    @property
    def files(self) -> tuple[Path, ...]:
        """The files that it names; they are not opened."""
        return tuple(Path(part.file) for part in self.parts if part.file)

    def with_files_read(self) -> "TaskText":
        r"""The same task, with the wrenches of its files in the text.

        Raises:
            SettingError: A file is missing or damaged.

        Example:
            >>> from pathlib import Path
            >>> from grasp3d.quality.task_texts import TaskText
            >>> _ = Path("pushes.csv").write_text("fx,fy,fz,tx,ty,tz\n5,0,0,0,0,0\n0,5,0,0,0,0.1\n")
            >>> TaskText.of("weight + pushes.csv").with_files_read()
            'weight + wrench 5,0,0,0,0,0; 0,5,0,0,0,0.1'
        """
        if not self.files:
            return self
        parts = tuple(_with_rows(part) if part.file else part for part in self.parts)
        TaskText(self.text, parts).checked()
        return TaskText(" + ".join(part.text for part in parts), parts)

    @property
    def has_torques(self) -> bool:
        """Whether it states torques, so that the contacts' points must be in metres."""
        return any(any(row[3:]) for part in self.with_files_read().parts for row in part.rows)

    def task(self, *, mass: float = 1.0) -> "Task":
        """The task that it describes; see `parse_task`."""
        from grasp3d.quality.tasks import Acceleration, Weight, Wrenches

        def build(part: _Part) -> "Task":
            if part.kind == "weight":
                axis = part.rows[0] if part.rows else None
                return Weight(mass, axis, part.within)  # type: ignore[arg-type]
            if part.kind == "acceleration":
                return Acceleration(mass, part.rows[0][0])
            return Wrenches(list(part.rows))

        return reduce(add, map(build, self.with_files_read().parts))


class TaskField(ParsedField["TaskText", "str | TaskText"]):
    """A field of settings that holds a task, given as a text; see `parse_task`."""

    def parse(self, _name: str, value: Any) -> "TaskText":
        """See `ParsedField.parse`."""
        if isinstance(value, TaskText):
            return value
        if not isinstance(value, str):
            raise SettingError(f"task must be a text, such as 'weight'; got {value!r}")
        return TaskText.of(value)


def parse_task(text: str, *, mass: float = 1.0) -> "Task":
    """Make the task that a text describes.

    Args:
        text: weight; weight within DEGREES of AXIS; acceleration NUMBER [m/s^2]; wrench
            FX,FY,FZ,TX,TY,TZ [N, N m], several separated by semicolons; a file of wrenches; or
            several joined by ' + '. An axis is x, y, z, -x, -y or -z of the contacts' frame, or
            three numbers with commas.
        mass: Mass of the object [kg].

    Raises:
        SettingError: It is no task, or a file is missing or damaged.

    Example:
        An object of 0.5 kg that is pushed with 5 N:

        >>> from grasp3d.quality.task_texts import parse_task
        >>> task = parse_task("weight + wrench 5,0,0,0,0,0.1", mass=0.5)
        >>> print(f"{task.support([1, 0, 0, 0, 0, 0]):.3f} N")
        9.903 N
    """
    return TaskText.of(text).task(mass=mass)


def _with_rows(part: _Part) -> _Part:
    """A part with the rows of its file, and as text that needs no file."""
    rows = read_wrenches(Path(part.file))
    text = f"wrench {'; '.join(','.join(map(_shortest, row)) for row in rows)}"
    return _Part(text, "wrench", rows)


def _parse(text: str) -> _Part:
    """Parse one part of a text; the rows of a file are read later."""
    word, _, rest = text.partition(" ")
    parser = _PARSERS.get(word)
    if parser is not None:
        return parser(text, rest.strip())
    if text.lower().endswith(".csv"):
        return _Part(text, "wrench", file=text)
    raise SettingError(f"no task is called {printable(text)!r}; known: {KNOWN}")


def _weight(text: str, rest: str) -> _Part:
    if not rest:
        return _Part(text, "weight")
    match = _WITHIN.fullmatch(rest)
    if match is None:
        raise _no_task(text, "write 'weight', or 'weight within DEGREES of AXIS'")
    try:
        within = parse_angle("the angle", match[1])
    except SettingError as error:
        raise _no_task(text, str(error)) from error
    if not 0.0 <= within <= math.pi / 2.0:
        remedy = "'weight' alone acts in any direction"
        raise _no_task(text, f"the angle must be from 0 to 90 degrees; {remedy}")
    axis = AXES.get(match[2]) or _numbers(text, match[2], 3, "the axis x, y, z, -x, -y or -z, or")
    if not any(axis):
        raise _no_task(text, "the axis has no direction")
    return _Part(text, "weight", (axis,), within)


def _acceleration(text: str, rest: str) -> _Part:
    row = _numbers(text, _PER_SECOND_SQUARED.sub("", rest), 1, "the acceleration in m/s^2 as")
    if row[0] < 0.0:
        raise _no_task(text, "the acceleration must be at least 0")
    return _Part(text, "acceleration", (row,))


def _wrench(text: str, rest: str) -> _Part:
    rows = tuple(_numbers(text, row, 6, "force [N] and torque [N m] as") for row in rest.split(";"))
    return _Part(text, "wrench", rows)


_PARSERS: dict[str, Callable[[str, str], _Part]] = {
    "weight": _weight,
    "acceleration": _acceleration,
    "wrench": _wrench,
}


def _numbers(text: str, words: str, count: int, what: str) -> Row:
    """So many finite numbers with commas between them."""
    try:
        numbers = tuple(float(word) for word in words.split(","))
    except ValueError:
        numbers = ()
    if len(numbers) != count or not all(map(math.isfinite, numbers)):
        noun = "number" if count == 1 else "numbers"
        quoted = printable(words.strip())
        raise _no_task(text, f"give {what} {count} finite {noun}; got {quoted!r}")
    return numbers


def _no_task(text: str, reason: str) -> SettingError:
    return SettingError(f"task {printable(text)!r}: {reason}")


def _shortest(number: float) -> str:
    """The shortest text of the same number."""
    return repr(number).removesuffix(".0")
