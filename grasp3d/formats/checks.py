"""Values of JSON, YAML and NumPy files, checked.

Nothing here walks a document deeper than the shape that is expected: YAML may refer to one list
many times.
"""

import json
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from importlib import import_module
from importlib.util import find_spec
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from grasp3d.arrays import HEADER_ERRORS, Floats
from grasp3d.errors import ContactError, OutputError
from grasp3d.system.documents import (
    described,
    file_bytes,
    is_folder,
    number_of,
    problem_of_file,
)
from grasp3d.system.files import atomic_write
from grasp3d.system.names import printable, reason_of
from grasp3d.system.versions import package_version

Entries = Sequence[Mapping[str, Any]]


def check_file(path: Path) -> None:
    """Raise ContactError unless there is such a file, or a folder of files."""
    if (problem := problem_of_file(path)) and not (is_folder(path) and not path.suffix):
        raise ContactError(printable(f"{path}: {problem}"))


def one_line(path: Path, problem: str) -> ContactError:
    """The error of a file; the messages of libraries can have several lines."""
    return ContactError(printable(f"{path}: {' '.join(problem.split())}"))


def library(module: str, package: str) -> Any:
    """A library of the extra `datasets`. Raises OutputError if it is not installed."""
    if find_spec(module) is None:
        raise OutputError(f"this format needs {package}: pip install 'grasp3d[datasets]'")
    return import_module(module)


def short_list(names: Sequence[str], most: int = 12) -> str:
    """The first of some names, for messages."""
    return " ".join(names[:most]) + (" ..." if len(names) > most else "")


def load_yaml(path: Path) -> Any:
    """Content of a YAML file of plain values. Raises ContactError, ValueError, OSError."""
    yaml = library("yaml", "PyYAML")
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    text = file_bytes(path)
    try:
        return yaml.load(text, loader)
    except yaml.YAMLError as error:
        raise ContactError(f"is no YAML: {' '.join(str(error).split())[:200]}") from error
    except (ValueError, TypeError, AttributeError, OverflowError, RecursionError) as error:
        # Dates such as 2026-13-45, numbers of thousands of digits, keys that are lists.
        raise ContactError(f"is no YAML: {error}") from error


def load_array(path: Path) -> npt.NDArray[Any]:
    """Numbers of a .npy file, which are not in memory. Raises ContactError, OSError."""
    with path.open("rb") as stream:
        if stream.read(6) != b"\x93NUMPY":
            raise ContactError("is no .npy file")
    try:
        array: npt.NDArray[Any] = np.load(path, mmap_mode="r", allow_pickle=False)
    except HEADER_ERRORS as error:
        raise ContactError(f"is no .npy file of numbers ({reason_of(error)})") from error
    return array


def has(*paths: str) -> Any:
    """Whether content has keys, within each other a.b; 0 is the first of a list, or all of one."""
    return lambda content: all(_holds(content, *path.split(".")) for path in paths)


def _holds(content: Any, key: str, *further: str) -> bool:
    if key == "0":
        return _holds(content[0] if isinstance(content, list) and content else content, *further)
    found = isinstance(content, dict) and key in content
    return found and (not further or _holds(content[key], *further))


def mapping(value: object, what: str) -> dict[str, Any]:
    """The value, if it is an object of keys and values. Raises ContactError."""
    if not isinstance(value, dict):
        raise ContactError(f"{what} must be an object of keys and values; got {described(value)}")
    return value


def grasp_list(value: object, what: str) -> list[Any]:
    """The value, if it is a list of at least one grasp. Raises ContactError."""
    if not isinstance(value, list):
        raise ContactError(f"{what} must be a list; got {described(value)}")
    if not value:
        raise ContactError("there are no grasps in it")
    return value


def entries_of(grasps: Iterable[object]) -> list[dict[str, Any]]:
    """Grasps that are objects of keys and values each. Raises ContactError."""
    return [mapping(entry, f"grasp {number}") for number, entry in enumerate(grasps, 1)]


def required(document: Mapping[str, Any], key: str, where: str = "") -> Any:
    """The value of a key. Raises ContactError if it is missing."""
    if key not in document:
        raise ContactError(f"{where}the key {key} is missing")
    return document[key]


def each(entries: Entries, *keys: str) -> list[Any]:
    """The value of nested keys in every entry. Raises ContactError if one is missing."""
    values: list[Any] = []
    for number, entry in enumerate(entries, 1):
        value: Any = entry
        for depth, key in enumerate(keys):
            where = f"grasp {number}: "
            value = required(mapping(value, where + (".".join(keys[:depth]) or "it")), key, where)
        values.append(value)
    return values


def numbers(values: Sequence[Any], shape: tuple[int, ...], what: str) -> Floats:
    """Numbers of each grasp, shape (k, *shape); null is nan.

    Numbers as text are accepted: YAML reads 1e-05 as text.

    Raises:
        ContactError: Values that are no numbers, or lists of other lengths.
    """
    flat, of_one = list(values), 1
    for size in shape:
        wrong = next((k for k, one in enumerate(flat) if not _is_list(one, size)), None)
        if wrong is not None:
            raise _no_numbers(values, wrong // of_one, shape, what)
        flat, of_one = list(chain.from_iterable(flat)), of_one * size
    try:
        if all(isinstance(one, int | float | str | None) for one in flat):
            return np.array(flat, dtype=np.float64).reshape(len(values), *shape)
    except (TypeError, ValueError, OverflowError):
        pass
    wrong = next(k for k, one in enumerate(flat) if not _is_number(one))
    raise _no_numbers(values, wrong // of_one, shape, what)


def _is_list(value: object, size: int) -> bool:
    return isinstance(value, list) and len(value) == size


def _is_number(value: object) -> bool:
    return value is None or isinstance(value, bool) or str(value).strip().lower() == "nan" or (
        isinstance(value, int | float | str) and not math.isnan(number_of(value))
    )  # fmt: skip


def _no_numbers(values: Sequence[Any], row: int, shape: tuple[int, ...], what: str) -> ContactError:
    words = "a number" if not shape else " x ".join(map(str, shape)) + " numbers, in lists"
    words = f"a list of {shape[0]} numbers" if len(shape) == 1 else words
    return ContactError(f"grasp {row + 1}: {what} must be {words}; got {described(values[row])}")


def optional_numbers(entries: Entries, key: str) -> Floats:
    """Numbers of a key that entries need not have, shape (k,); nan where it is missing."""
    return numbers([entry.get(key) for entry in entries], (), key)


def joints_of(values: Sequence[Any], what: str) -> tuple[tuple[str, ...], Floats]:
    """Values of the joints of each grasp: their names, and shape (k, p).

    Args:
        values: Of each grasp, an object of names and numbers.
        what: What they are, for messages.

    Raises:
        ContactError: The joints of two grasps differ, or values are no numbers.
    """
    rows = [mapping(one, f"grasp {number}: {what}") for number, one in enumerate(values, 1)]
    first = rows[0]
    for number, row in enumerate(rows, 1):
        if other := sorted(map(str, row.keys() ^ first.keys())):
            raise ContactError(
                f"grasp {number}: {what} must have the joints of grasp 1; {other[0]!r} is in one "
                "of them only"
            )
    columns = [numbers([row[name] for row in rows], (), f"{what} {name}") for name in first]
    return tuple(map(str, first)), np.reshape(columns, (len(first), len(rows))).T.copy()


def number_or_none(value: object, what: str) -> float | None:
    """A finite number, or none. Raises ContactError."""
    if value is not None and not math.isfinite(number_of(value)):
        raise ContactError(f"{what} must be a finite number; got {described(value)}")
    return None if value is None else number_of(value)


def text_or_none(value: object, what: str) -> str | None:
    """A text, or none. Raises ContactError."""
    if value is not None and not isinstance(value, str):
        raise ContactError(f"{what} must be text; got {described(value)}")
    return value


def json_numbers(values: npt.NDArray[Any]) -> Any:
    """Lists of numbers or text for JSON; nan and infinite numbers, which it has not, are null."""
    if values.dtype.kind != "f":
        return values.tolist()
    numbers_or_none = values.astype(object)
    numbers_or_none[~np.isfinite(values)] = None
    return numbers_or_none.tolist()


def json_text(values: object) -> str:
    """JSON text of a value without nan."""
    return json.dumps(values, allow_nan=False)


def write_text(path: Path, text: str) -> None:
    """Make or replace a file. Raises OutputError."""
    with atomic_write(path) as part:
        part.write_text(text, encoding="utf-8")


def write_array(path: Path, values: npt.NDArray[Any]) -> None:
    """Make or replace an .npy file. Raises OutputError."""
    with atomic_write(path) as part, part.open("wb") as stream:
        np.save(stream, values)


def write_yaml(path: Path, document: Mapping[str, Any]) -> None:
    """Write a YAML file that says which program wrote it."""
    yaml = library("yaml", "PyYAML")
    dumper = getattr(yaml, "CSafeDumper", yaml.SafeDumper)
    text = yaml.dump(
        document, Dumper=dumper, sort_keys=False, default_flow_style=None, allow_unicode=True
    )
    write_text(path, f"# written by grasp3d {package_version()}\n{text}")


def rows_of(columns: Mapping[str, Any], count: int) -> Iterator[dict[str, Any]]:
    """An entry for each grasp, from the values of all, as JSON has them."""
    return ({name: values[row] for name, values in columns.items()} for row in range(count))


def write_rows(path: Path, header: str, rows: Iterable[Mapping[str, Any]]) -> None:
    """Write what applies to all grasps, then one line for each grasp.

    Args:
        path: JSON file to make or replace.
        header: JSON text of what applies to all.
        rows: The entries.
    """
    with atomic_write(path) as part, part.open("w", encoding="utf-8") as stream:
        stream.write(f'{{"grasp3d": {header},\n"grasps": [')
        for number, row in enumerate(rows):
            stream.write(("," if number else "") + "\n" + json_text(row))
        stream.write("\n]}\n")
