"""Checks of values in JSON, YAML and NumPy files, among them outcomes of grasps.

Nothing here walks a document deeper than the expected shape, because YAML may refer to one list
many times.
"""

import json
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib import import_module
from importlib.util import find_spec
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from grasp3d.arrays import HEADER_ERRORS, Floats
from grasp3d.errors import ContactError, OutputError, SettingError
from grasp3d.system.documents import (
    described,
    file_bytes,
    is_folder,
    number_of,
    package_version,
    problem_of_file,
)
from grasp3d.system.files import atomic_write
from grasp3d.system.names import printable, reason_of

Entries = Sequence[Mapping[str, Any]]

Values = npt.NDArray[Any] | Sequence[Any]
"""One value for each grasp."""


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """Add the name of a file or folder to errors in its content, and write each in one line.

    Raises:
        ContactError: There is no such file, or its content is wrong.
    """
    if (problem := problem_of_file(path)) and not (is_folder(path) and not path.suffix):
        raise ContactError(printable(f"{path}: {problem}"))
    try:
        yield
    except (ContactError, SettingError, ValueError, OSError) as error:
        kind = type(error) if isinstance(error, ContactError) else ContactError
        reason = getattr(error, "strerror", None) or " ".join(str(error).split())
        reason = f"cannot be read ({reason})" if isinstance(error, OSError) else reason
        raise kind(printable(f"{path}: {reason}")) from error


def library(module: str, package: str) -> Any:
    """Import a library of the extra `datasets`. Raises OutputError if it is not installed."""
    if find_spec(module) is None:
        raise OutputError(f"this format needs {package}: pip install 'grasp3d[datasets]'")
    return import_module(module)


def load_yaml(path: Path) -> Any:
    """Content of a YAML file of plain values. Raises ContactError, ValueError, OSError."""
    yaml = library("yaml", "PyYAML")
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    text = file_bytes(path)
    try:
        return yaml.load(text, loader)
    except (yaml.YAMLError, *HEADER_ERRORS, AttributeError) as error:
        # Dates such as 2026-13-45, numbers of thousands of digits and list keys raise them too.
        raise ContactError(f"is not valid YAML: {reason_of(error)}") from error


MOST_NUMBERS = 200_000_000
"""Largest number of values of an array that is read."""


def load_array(path: Path) -> npt.NDArray[Any]:
    """Map the numbers of an .npy file, without reading them. Raises ContactError, OSError."""
    try:
        array: npt.NDArray[Any] = np.lib.format.open_memmap(path, mode="r")
    except HEADER_ERRORS as error:
        raise ContactError(f"is not a .npy file of numbers ({reason_of(error)})") from error
    if array.size > MOST_NUMBERS:
        raise ContactError(f"has more than {MOST_NUMBERS:,} numbers")
    return array


def has(*paths: str) -> Any:
    """Return a test whether content has keys, nested ones as a.b; 0 is the first item of a list."""
    return lambda content: all(_holds(content, *path.split(".")) for path in paths)


def _holds(content: Any, key: str, *further: str) -> bool:
    if key == "0":
        return _holds(content[0] if isinstance(content, list) and content else content, *further)
    found = isinstance(content, dict) and key in content
    return found and (not further or _holds(content[key], *further))


def mapping(value: object, what: str) -> dict[str, Any]:
    """Return a value that is an object of keys and values. Raises ContactError for others."""
    if not isinstance(value, dict):
        raise ContactError(f"{what} must be an object of keys and values; got {described(value)}")
    return value


def grasp_list(value: object, what: str) -> list[Any]:
    """Return a value that is a list of at least one grasp. Raises ContactError for others."""
    if not isinstance(value, list):
        raise ContactError(f"{what} must be a list; got {described(value)}")
    if not value:
        raise ContactError("there are no grasps in it")
    return value


def entries_of(value: object, what: str) -> list[dict[str, Any]]:
    """Return the grasps of a list, each an object of keys and values. Raises ContactError."""
    listed = enumerate(grasp_list(value, what), 1)
    return [mapping(entry, f"grasp {number}") for number, entry in listed]


def required(document: Mapping[str, Any], key: str, where: str = "") -> Any:
    """The value of a key. Raises ContactError if it is missing."""
    if key not in document:
        raise ContactError(f"{where}the key {key} is missing")
    return document[key]


def each(entries: Entries, *keys: str) -> list[Any]:
    """The value of nested keys in every entry. Raises ContactError if one is missing."""
    values: list[Any] = list(entries)
    for depth, key in enumerate(keys):
        what = ".".join(keys[:depth]) or "it"
        named = ((f"grasp {number}: ", one) for number, one in enumerate(values, 1))
        values = [required(mapping(one, where + what), key, where) for where, one in named]
    return values


def numbers(values: Values, shape: tuple[int, ...], what: str) -> Floats:
    """Numbers of each grasp, shape (k, *shape); null becomes nan.

    Numbers as text are accepted, because YAML reads 1e-05 as text.

    Raises:
        ContactError: Values are no numbers, or lists have other lengths.
    """
    if isinstance(values, np.ndarray) and values.dtype.kind in "fiub":
        return values.astype(np.float64)
    if (found := _numbers(values, shape)) is not None:
        return found
    row = next(k for k, value in enumerate(values) if _numbers([value], shape) is None)
    words = "a number" if not shape else " x ".join(map(str, shape)) + " numbers, in lists"
    words = f"a list of {shape[0]} numbers" if len(shape) == 1 else words
    raise ContactError(f"grasp {row + 1}: {what} must be {words}; got {described(values[row])}")


def _numbers(values: Values, shape: tuple[int, ...]) -> Floats | None:
    """As `numbers`, but None if the values are no such numbers."""
    flat = list(values)
    for size in shape:
        if not all(isinstance(one, list) and len(one) == size for one in flat):
            return None
        flat = list(chain.from_iterable(flat))
    try:
        if all(isinstance(one, int | float | str | None) for one in flat):
            return np.array(flat, dtype=np.float64).reshape(len(values), *shape)
    except (TypeError, ValueError, OverflowError):
        pass
    return None


def optional_numbers(entries: Entries, key: str) -> Floats:
    """Numbers of a key that entries need not have, shape (k,); nan where it is missing."""
    return numbers([entry.get(key) for entry in entries], (), key)


def joints_of(
    values: Sequence[Any], what: str, names: tuple[str, ...] = ()
) -> tuple[tuple[str, ...], Floats]:
    """Names of the joints, and their values in each grasp, shape (k, p).

    Args:
        values: For each grasp, an object of names and numbers.
        what: Name of the values in messages.
        names: Names that there must be, in this order; empty: those of the first grasp.

    Raises:
        ContactError: The joints of two grasps differ, or values are no numbers.
    """
    rows = [mapping(one, f"grasp {number}: {what}") for number, one in enumerate(values, 1)]
    names = names or tuple(map(str, rows[0]))
    for number, row in enumerate(rows, 1):
        if other := sorted(map(str, row.keys() ^ {*names})):
            where = f"grasp {number}: {what} must have the same joints in all"
            raise ContactError(f"{where}, {' '.join(names[:30])}; {other[0]!r} differs")
    columns = [numbers([row[name] for row in rows], (), f"{what} {name}") for name in names]
    return names, np.reshape(columns, (len(names), len(rows))).T.copy()


def number_or_none(value: object, what: str) -> float | None:
    """Check that a value is a finite number or None. Raises ContactError."""
    if value is not None and not math.isfinite(number_of(value)):
        raise ContactError(f"{what} must be a finite number; got {described(value)}")
    return None if value is None else number_of(value)


def text_or_none(value: object, what: str) -> str | None:
    """Check that a value is a text or None. Raises ContactError."""
    if value is not None and not isinstance(value, str):
        raise ContactError(f"{what} must be text; got {described(value)}")
    return value


OUTCOMES = ("outcome", "success")
"""Names of outcomes in grasp3d's own formats; the first one is written."""

WORDS = {"1": 1.0, "1.0": 1.0, "true": 1.0, "0": 0.0, "0.0": 0.0, "false": 0.0}
"""Outcomes by their text in lower case; an empty text means not known."""


def outcomes_of(
    outcome: str | None,
    count: int,
    names: Iterable[str],
    read: Callable[[str], Values],
    *,
    default: Sequence[str] = OUTCOMES,
) -> Floats:
    """Outcomes of grasps: 1 held, 0 failed, nan not tried, shape (count,).

    Args:
        outcome: Name of the values; None: those of the format.
        count: Number of grasps.
        names: Names of the values that the file has for each grasp; for a path with /, `outcome`
            may be its last parts alone.
        read: Returns the values of a name, one for each grasp.
        default: Names that the format uses, of which a file has one.

    Raises:
        ContactError: The file has no such values, one of them is no outcome, or it has values
            of two names.
    """
    names = list(names)
    found = [name for name in default if name in names]
    if outcome is not None:
        found = [one for one in names if one == outcome or one.endswith(f"/{outcome}")]
        found = [outcome] if outcome in names else found
        if not found:
            listed = ", ".join(names[:30]) + ", ..." * (len(names) > 30) or "nothing"
            raise ContactError(f"no outcome is called {outcome!r}: its grasps have {listed}")
    if len(found) > 1:
        raise ContactError(f"it has both {' and '.join(found)}: give one of them (--outcome)")
    if not found:
        return np.full(count, math.nan)
    outcomes = []
    for number, value in enumerate(np.asarray(read(found[0]), dtype=object).tolist(), 1):
        text = "" if value is None else str(value).strip().lower()
        if text not in {"", "nan"} and text not in WORDS:
            raise ContactError(
                f"grasp {number}: {found[0]} must be 1 or true (it held), 0 or false (it failed), "
                f"or empty (not tried); got {described(value)}"
            )
        outcomes.append(WORDS.get(text, math.nan))
    return np.array(outcomes, dtype=np.float64)


def outcomes_of_entries(outcome: str | None, entries: Entries) -> Floats:
    """Outcomes of grasps from their keys, for formats without outcomes. See `outcomes_of`."""
    keys = dict.fromkeys(key for entry in entries for key in entry) if outcome else ()
    return outcomes_of(outcome, len(entries), keys, lambda key: [one.get(key) for one in entries])


def json_values(values: npt.NDArray[Any]) -> Any:
    """Convert to lists for JSON; nan and infinite numbers, which JSON lacks, become null."""
    if values.dtype.kind != "f":
        return values.tolist()
    numbers_or_none = values.astype(object)
    numbers_or_none[~np.isfinite(values)] = None
    return numbers_or_none.tolist()


def nested(values: Mapping[str, npt.NDArray[Any]]) -> list[list[dict[str, Any]]]:
    """Convert values (k, n, ...) by name to an object for each contact of each grasp, for JSON."""
    grasps = zip(*map(json_values, values.values()), strict=True)
    contacts = (zip(*one, strict=True) for one in grasps)
    return [[dict(zip(values, one, strict=True)) for one in of_grasp] for of_grasp in contacts]


def write_text(path: Path, parts: Iterable[str]) -> None:
    """Make or replace a file. Raises OutputError."""
    with atomic_write(path) as part, part.open("w", encoding="utf-8") as stream:
        stream.writelines(parts)


def write_array(path: Path, values: npt.NDArray[Any]) -> None:
    """Make or replace an .npy file. Raises OutputError."""
    with atomic_write(path) as part, part.open("wb") as stream:
        np.save(stream, values)


def write_yaml(path: Path, document: Mapping[str, Any]) -> None:
    """Write a YAML file that says which program wrote it."""
    yaml = library("yaml", "PyYAML")
    dumper = getattr(yaml, "CSafeDumper", yaml.SafeDumper)
    style: Any = {"sort_keys": False, "default_flow_style": None, "allow_unicode": True}
    text = yaml.dump(document, Dumper=dumper, **style)
    write_text(path, [f"# written by grasp3d {package_version()}\n", text])


def write_rows(path: Path, header: Mapping[str, Any], columns: Mapping[str, Any]) -> None:
    """Write JSON: what applies to all grasps, then one line for each grasp.

    Args:
        path: File to make or replace.
        header: What applies to all grasps.
        columns: By name, the values of all grasps, as JSON has them.

    Raises:
        OutputError: The file cannot be written, or JSON cannot represent a value.
    """
    rows = (dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True))
    try:
        lines = ",\n".join(json.dumps(row, allow_nan=False) for row in rows)
        start = f'{{"grasp3d": {json.dumps(header, allow_nan=False)},\n"grasps": [\n'
    except (TypeError, ValueError) as error:
        raise OutputError(f"{path}: its settings are not JSON: {error}") from error
    write_text(path, [start, lines, "\n]}\n"])
