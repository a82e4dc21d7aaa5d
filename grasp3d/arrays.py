"""Array types, read-only copies, and vector functions."""

import math
import textwrap
import zipfile
import zlib
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import fields, is_dataclass, replace
from functools import cached_property
from tokenize import TokenError
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from numpy.typing import ArrayLike as ArrayLike  # noqa: PLC0414, exported
else:

    class ArrayLike:
        """What NumPy turns into an array: numbers, their lists, arrays (`numpy.typing.ArrayLike`).

        The alias itself would fill the signatures that `help` and the documentation show.
        """


Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Bools = npt.NDArray[np.bool_]
Bytes = npt.NDArray[np.uint8]

ValueT = TypeVar("ValueT")

RIGHT_ANGLE = math.pi / 2.0

HEADER_ERRORS = (
    ValueError, TypeError, OverflowError, EOFError, SyntaxError, MemoryError, RecursionError,
    TokenError,
)  # fmt: skip
"""Exceptions that NumPy raises for headers of its files, which are texts of Python dictionaries."""

ARCHIVE_ERRORS = (
    *HEADER_ERRORS, zipfile.BadZipFile, zlib.error, OSError, RuntimeError, LookupError,
)  # fmt: skip
"""Exceptions that NumPy raises for damaged archives of arrays."""


def text_of(array: npt.NDArray[Any]) -> str:
    """Return the text that an array holds; NumPy's own conversion may end with a SystemError.

    Raises:
        ValueError: The array holds no text.
    """
    if not isinstance(array, np.ndarray) or array.dtype.kind != "U":
        raise ValueError("it is not text")
    ordered = array.astype(array.dtype.newbyteorder("<"))
    return ordered.tobytes().decode("utf-32-le").rstrip("\0")


def locked(array: ArrayLike, dtype: npt.DTypeLike | None = None) -> npt.NDArray[Any]:
    """Return a read-only C-contiguous copy, or the array itself if it already is one."""
    if (
        type(array) is np.ndarray and array.base is None and array.flags.c_contiguous
        and not array.flags.writeable and dtype in (None, array.dtype)
    ):  # fmt: skip
        return array
    copy = np.array(array, dtype=dtype, order="C", copy=True)
    copy.flags.writeable = False
    return copy


def shaped(values: npt.NDArray[Any], batch: tuple[int, ...]) -> npt.NDArray[Any]:
    """Reshape results of a flat batch (b, ...) to the batch's shape, read-only; a scalar for ()."""
    reshaped = values.reshape((*batch, *values.shape[1:]))[()]
    return locked(reshaped) if reshaped.ndim else reshaped


def unit_rows(vectors: Floats) -> Floats:
    """Scale the rows (..., 3) to length 1; rows of length 0 stay 0."""
    lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
    scaled: Floats = np.divide(vectors, lengths, out=np.zeros_like(vectors), where=lengths > 0.0)
    return scaled


def angles_between(a: Floats, b: Floats) -> Floats:
    """Angles between vectors (..., 3) [rad], accurate near 0 and pi."""
    angles: Floats = np.arctan2(np.linalg.norm(np.cross(a, b), axis=-1), (a * b).sum(axis=-1))
    return angles


def used_indices(indices: Ints) -> Ints:
    """Distinct indices, 0 or more, in ascending order; takes time linear in the largest index."""
    used = np.zeros(int(indices.max(initial=-1)) + 1, dtype=np.bool_)
    used[indices.ravel()] = True
    return np.flatnonzero(used)


def first_at_position(vertices: Floats) -> Ints:
    """Index of the first vertex with exactly the same position, for each vertex, shape (V,)."""
    first, same = first_alike(vertices)
    return first[same]


def first_alike(rows: Floats | Ints) -> tuple[Ints, Ints]:
    """Find the first of each set of equal rows (b, k), and for each row the number of its set.

    Sets are sorted by their values. `numpy.unique`, which compares rows as records, takes several
    times as long.
    """
    order = np.lexsort(rows.T[::-1])
    ordered, begins = rows[order], np.ones(len(rows), dtype=np.bool_)
    begins[1:] = (ordered[1:] != ordered[:-1]).any(axis=1)
    same = np.empty(len(rows), dtype=np.int64)
    same[order] = np.cumsum(begins) - 1
    return order[begins], same


def chosen_rows(which: Bools, one: Any, other: Any) -> Any:
    """Take rows of one value where `which` is true, and of another of the same type elsewhere.

    Args:
        which: Rows to take from `one`, shape (b,).
        one: An array (b, ...), or a dataclass of such values, whose other fields the result keeps.
        other: The same, for the other rows.
    """
    if one is other:
        return one
    if isinstance(one, np.ndarray):
        return locked(np.where(which.reshape(-1, *[1] * (one.ndim - 1)), one, other))
    if not (hasattr(one, "__dataclass_fields__") and isinstance(other, type(one))):
        return one
    names = [field.name for field in fields(one) if field.init]
    pairs = {name: (getattr(one, name), getattr(other, name)) for name in names}
    return replace(one, **{name: chosen_rows(which, *both) for name, both in pairs.items()})


def short_repr(instance: Any) -> str:
    """Represent a dataclass of arrays as text of at most three lines.

    Arrays are shown by type and shape, other dataclasses by their name.
    """
    values = (
        f"{field.name}={_short(getattr(instance, field.name))}"
        for field in fields(instance)
        if field.repr and not field.name.startswith("_")
    )
    text = f"{type(instance).__name__}({', '.join(values)})"
    lines = textwrap.wrap(text, 100, subsequent_indent="    ", max_lines=3, placeholder=" ...)")
    return "\n".join(lines)


def _short(value: object) -> str:
    if isinstance(value, np.ndarray):
        return f"{value.dtype}[{', '.join(map(str, value.shape))}]"
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float):
        return f"{value:.6g}"
    return type(value).__name__ if is_dataclass(value) else textwrap.shorten(repr(value), 60)


class computed(cached_property[ValueT]):  # noqa: N801, a decorator
    """A property that takes long to compute and is computed once, possibly by another thread.

    Before Python 3.12 a `cached_property` has one lock for all instances, so reading it on one
    instance would wait for its computation on another.
    """

    def __init__(self, function: Callable[[Any], ValueT]) -> None:
        super().__init__(function)
        self.lock = nullcontext()
