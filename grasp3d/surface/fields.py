"""Fields: values of each vertex or of each grasp, declared once for all files and tables."""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import KW_ONLY, dataclass
from operator import attrgetter
from typing import Any, Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from grasp3d.stability.label import Label

Array = npt.NDArray[Any]
Arrays = dict[str, Array]
When = Literal["always", "errors", "gripper", "joints", "load"]

RADIANS, LENGTH, AREA, NEWTONS, KILOGRAMS = "rad", "mesh unit", "mesh unit²", "N", "kg"
XYZ = ("x", "y", "z")
LETTERS = tuple(label.name for label in sorted(Label))


class Allowed(NamedTuple):
    """The values that a field may have."""

    low: float = -math.inf
    high: float = math.inf
    """Bounds of the finite values."""
    infinite: float | None = None
    """An infinite value that it may have."""
    unknown: bool = False
    """Whether it may be nan."""


FINITE, KNOWN_OR_NAN = Allowed(), Allowed(unknown=True)
POSITIVE_OR_NAN = Allowed(0.0, unknown=True)
ANGLE, ANGLE_OR_NAN = Allowed(0.0, math.pi), Allowed(0.0, math.pi, unknown=True)
ANGLE_OR_INF = Allowed(0.0, math.pi, math.inf)
NORMAL, NORMAL_OR_NAN = Allowed(-1.0, 1.0), Allowed(-1.0, 1.0, unknown=True)


@dataclass(frozen=True)
class Field:
    """What files and tables hold of each vertex, or of each grasp, under one name."""

    name: str
    """Name of the array, and of the attribute in Python unless `of` is another one."""
    meaning: str
    """In the words of the page on file formats."""
    unit: str = ""
    shape: tuple[int | str, ...] = ()
    """Of the values of one vertex or grasp; 'n': number of fingers, 'n-1': of the other fingers,
    'p': of further joints."""
    allowed: Allowed = FINITE
    _: KW_ONLY
    of: Callable[[Any], Any] | None = None
    """Takes its values from labels or grasps, None where they have none; None: the attribute."""
    kind: str = "f8"
    """NumPy type of the values, as NPZ, VTP and Parquet hold them."""
    when: When = "always"
    """What it takes for the field to be there: nothing; a location error or fingers that differ; a
    gripper; a hand with further joints; a load."""
    columns: tuple[str, ...] = ()
    """Names of its parts where a file or table has numbers alone; empty: with the axes as ends."""
    each: str = ""
    """Name of the values of one finger, with {} for its number; empty: it is not by finger."""
    ply: str = ""
    """Type in a PLY; empty: it has none."""
    array: bool = True
    """Whether NPZ, VTP, `to_trimesh` and `to_polydata` have it."""
    table: bool = True
    """Whether Parquet and `to_table` have it."""
    texts: tuple[str, ...] = ()
    """Texts of the codes 0, 1, ..., which tables have in their place; empty: it has no codes."""
    outward: bool = False
    """Whether these are normals, which point into the object in Python, and outward in files."""

    def values_of(self, holder: object) -> Array | None:
        """The values as files hold them, a row for each vertex or grasp; None: there are none."""
        found = (self.of or attrgetter(self.name))(holder)
        if found is None:
            return None
        values = np.asarray(found)
        return -values if self.outward else values

    def texts_of(self, values: Array) -> Array:
        """Texts in place of codes, if it has any."""
        return np.array(self.texts)[values] if self.texts else values

    def shape_for(self, fingers: int) -> tuple[int, ...]:
        """Shape of the values of one vertex or grasp; -1: any number of joints."""
        sizes = {"n": fingers, "n-1": fingers - 1, "p": -1}
        return tuple(sizes[size] if isinstance(size, str) else size for size in self.shape)

    def column_names(self, fingers: int) -> list[str]:
        """Names of its columns of numbers, those of one finger after those of another."""
        parts = self.columns
        if not parts:
            head = self.each or self.name
            parts = tuple(f"{head}_{axis}" for axis in XYZ) if self.shape[-1:] == (3,) else (head,)
        numbers = range(2, fingers + 1) if self.each else range(1)
        return [part.format(finger) for finger in numbers for part in parts]

    def point_names(self, fingers: int) -> list[str]:
        """Names of its arrays of at most vectors, as VTK has them."""
        each = [self.each.format(finger) for finger in range(2, fingers + 1)]
        return each if self.each else [self.name]

    def as_columns(self, values: Array) -> Arrays:
        """Split values into columns of numbers, by name."""
        flat = values.reshape(len(values), math.prod(values.shape[1:]))
        return dict(zip(self.column_names(self._fingers(values)), flat.T, strict=True))

    def as_points(self, values: Array) -> Arrays:
        """Split values by finger, by name."""
        parts = values.swapaxes(0, 1) if self.each else [values]
        return dict(zip(self.point_names(self._fingers(values)), parts, strict=True))

    def from_columns(self, columns: Mapping[str, Array], fingers: int) -> Array:
        """Put columns of numbers together again; raises KeyError."""
        found = np.stack([columns[name] for name in self.column_names(fingers)], axis=1)
        return found.reshape(len(found), *self.shape_for(fingers))

    def from_points(self, points: Mapping[str, Array], fingers: int) -> Array:
        """Put the arrays of the fingers together again; raises KeyError."""
        parts = [points[name] for name in self.point_names(fingers)]
        if self.each:
            return np.stack(parts, axis=1)
        return parts[0].reshape(len(parts[0]), *self.shape_for(fingers))

    def _fingers(self, values: Array) -> int:
        return values.shape[1] + 1 if self.each else 0


def columns_of(fields: Iterable[Field], holder: object) -> Arrays:
    """Columns of a table, shape (rows,), with texts in place of codes."""
    return {field.name: field.texts_of(values) for field, values in present(fields, holder)}


def present(fields: Iterable[Field], holder: object) -> Iterator[tuple[Field, Array]]:
    """The fields that labels or grasps have, with their values as files hold them."""
    for field in fields:
        values = field.values_of(holder)
        if values is not None:
            yield field, values
