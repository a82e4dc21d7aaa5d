"""Values of JSON and YAML documents, checked.

Nothing here walks a document deeper than the shape that is expected: YAML may refer to one list
many times.
"""

import json
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from importlib.util import find_spec
from itertools import chain
from pathlib import Path
from types import NoneType
from typing import Any

import numpy as np
import numpy.typing as npt

from grasp3d.arrays import HEADER_ERRORS, Floats
from grasp3d.errors import ContactError, OutputError
from grasp3d.system import documents
from grasp3d.system.documents import (
    described,
    file_bytes,
    number_of,
    problem_of_file,
)
from grasp3d.system.files import atomic_write
from grasp3d.system.names import printable
from grasp3d.system.stored_arrays import RefusedError, StoredArray, array_in
from grasp3d.system.versions import package_version

Entries = Sequence[Mapping[str, Any]]


def check_file(path: Path) -> None:
    """Raise ContactError unless there is such a file, or a folder of files."""
    if documents.is_folder(path) and not path.suffix:
        return
    if problem := problem_of_file(path):
        raise ContactError(printable(f"{path}: {problem}"))


def one_line(path: Path, problem: str) -> ContactError:
    """The error of a file; the messages of libraries can have several lines."""
    return ContactError(printable(f"{path}: {' '.join(problem.split())}"))


def load_yaml(path: Path) -> Any:
    """Content of a YAML file of plain values. Raises ContactError, ValueError, OSError."""
    yaml = yaml_module()
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
        reason = " ".join(str(error).split())[:200]
        raise ContactError(f"is no .npy file of numbers ({reason})") from error
    return array


def yaml_module() -> Any:
    """PyYAML. Raises OutputError if it is not installed."""
    if find_spec("yaml") is None:
        raise OutputError("YAML needs PyYAML: pip install 'grasp3d[datasets]'")
    import yaml

    return yaml


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


def as_many(values: object, what: str, count: int) -> list[Any]:
    """A list of as many values as there are grasps; lists of one value are that value."""
    entries = grasp_list(values, what)
    if len(entries) != count:
        raise ContactError(f"{what} must have {count} values, one of each grasp")
    return [value[0] if isinstance(value, list) and len(value) == 1 else value for value in entries]


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
    if (plain := _plain(values, shape)) is not None:
        return plain
    flat: list[float] = []
    for number, value in enumerate(values, 1):
        try:
            flat += _flattened(value, shape)
        except (TypeError, ValueError, OverflowError) as error:
            raise ContactError(
                f"grasp {number}: {what} must be {_expected(shape)}; got {described(value)}"
            ) from error
    return np.array(flat, dtype=np.float64).reshape(len(values), *shape)


def numbers_in(value: object, what: str) -> npt.NDArray[Any]:
    """The array of numbers that a file holds, or lists of them. Raises ContactError."""
    try:
        return array_in(value)
    except RefusedError as error:
        stored = isinstance(value, StoredArray)
        got = described(np.ravel(value.values).tolist() if stored else value)  # type: ignore[attr-defined]
        raise ContactError(f"{what} must be numbers; got {got}") from error


def joints_of(values: Sequence[Any], what: str) -> tuple[tuple[str, ...], Floats]:
    """Values of the joints of each grasp, by name or in lists: their names, and shape (k, p).

    Args:
        values: Of each grasp, an object of names and numbers, or a list.
        what: What they are, for messages.

    Raises:
        ContactError: The joints of two grasps differ, or values are no numbers.
    """
    first = values[0] if values else None
    if not isinstance(first, Mapping):
        joints = len(first) if isinstance(first, list) else 0
        return (), numbers(values, (joints,), what)
    rows = []
    for number, one in enumerate(values, 1):
        named = mapping(one, f"grasp {number}: {what}")
        if other := sorted(map(str, named.keys() ^ first.keys())):
            raise ContactError(
                f"grasp {number}: {what} must have the joints of grasp 1; {other[0]!r} is in one "
                "of them only"
            )
        rows.append(named)
    columns = [numbers([row[name] for row in rows], (), f"{what} {name}") for name in first]
    return tuple(map(str, first)), np.reshape(columns, (len(first), len(rows))).T.copy()


def optional_numbers(entries: Entries, key: str) -> Floats:
    """Numbers of a key that entries need not have, shape (k,); nan where it is missing."""
    return numbers([entry.get(key) for entry in entries], (), key)


def one_number(value: object, what: str) -> float:
    """A finite number. Raises ContactError."""
    number = number_of(value)
    if not math.isfinite(number):
        raise ContactError(f"{what} must be a finite number; got {described(value)}")
    return number


def number_or_none(value: object, what: str) -> float | None:
    """A finite number, or none. Raises ContactError."""
    return None if value is None else one_number(value, what)


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


def write_json(path: Path, document: object) -> None:
    """Write a JSON file without nan."""
    with atomic_write(path) as part:
        part.write_text(json_text(document), encoding="utf-8")


def write_yaml(path: Path, document: Mapping[str, Any]) -> None:
    """Write a YAML file that says which program wrote it."""
    yaml = yaml_module()
    dumper = getattr(yaml, "CSafeDumper", yaml.SafeDumper)
    with atomic_write(path) as part, part.open("w", encoding="utf-8") as stream:
        stream.write(f"# written by grasp3d {package_version()}\n")
        yaml.dump(
            document, stream, dumper, sort_keys=False, default_flow_style=None, allow_unicode=True
        )


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


def _plain(values: Sequence[Any], shape: tuple[int, ...]) -> Floats | None:
    """Numbers of lists of this shape; None: there is another value. Quick, where most are right."""
    flat = values
    for size in shape:
        if not set(map(type, flat)) <= {list} or not set(map(len, flat)) <= {size}:
            return None
        flat = list(chain.from_iterable(flat))
    if not set(map(type, flat)) <= {float, int, bool, NoneType}:
        return None
    try:
        return np.array(flat, dtype=np.float64).reshape(len(values), *shape)
    except OverflowError:
        return None


def _flattened(value: object, shape: tuple[int, ...]) -> list[float]:
    if not shape:
        return [_number(value)]
    if not isinstance(value, list) or len(value) != shape[0]:
        raise ValueError
    return [number for part in value for number in _flattened(part, shape[1:])]


def _number(value: object) -> float:
    if value is None:
        return math.nan
    if not isinstance(value, int | float | str):
        raise TypeError
    return float(value)


def _expected(shape: tuple[int, ...]) -> str:
    if not shape:
        return "a number"
    if len(shape) == 1:
        return f"a list of {shape[0]} numbers"
    return " x ".join(map(str, shape)) + " numbers, in lists"
