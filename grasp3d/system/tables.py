"""Tables of columns, rows or records: in memory as Arrow tables, and as CSV and Parquet files.

Records are instances of a dataclass, one row each. Its type hints define the columns: text,
numbers, booleans, enumerations of text, nested dataclasses, `tuple[X, ...]` as lists, and
`tuple[X, X, X]` as lists of fixed length.
"""

import csv
import json
import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import is_dataclass
from enum import StrEnum
from importlib.util import find_spec
from pathlib import Path
from types import NoneType
from typing import TYPE_CHECKING, Any, TypeVar, get_args, get_origin, get_type_hints

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.compute
import pyarrow.csv as pc
import pyarrow.parquet as pq

from grasp3d.errors import OutputError
from grasp3d.system.documents import parse_json, problem_of_file
from grasp3d.system.files import atomic_write, check_suffix
from grasp3d.system.names import as_unicode, reason_of

if TYPE_CHECKING:
    import pandas as pd

SUFFIXES = (".csv", ".parquet")
"""Suffixes of files that tables are written to."""

LONGEST_LINE = 2**20
"""Number of bytes at the start of a CSV file that must contain its first line."""

_NUMBER = re.compile(r"[-+\d.,;\se]+", re.IGNORECASE)

_QUOTED = re.compile(r'"[^"]*"')

_TYPES = {str: pa.string(), int: pa.int64(), float: pa.float64(), bool: pa.bool_()}

RecordT = TypeVar("RecordT")


def table_of_rows(
    rows: Sequence[Any], columns: Mapping[str, Any], *, settings: Mapping[str, Any]
) -> pa.Table:
    """Make a table from rows.

    Args:
        rows: Values by column name, or records; a missing value or None leaves the cell empty.
        columns: Type of each column, such as str, int, float or bool; in the order of the file.
        settings: Settings that the rows were computed with, stored as JSON in the schema's metadata
            under `grasp3d`.
    """
    return pa.Table.from_pylist([_plain(row) for row in rows], schema=_schema(columns, settings))


def write_columns(
    path: Path, columns: Mapping[str, npt.NDArray[Any]], *, settings: Mapping[str, Any]
) -> None:
    """Write a table of columns; nan leaves the cell empty.

    Args:
        path: File to create or replace, with a suffix of `SUFFIXES`.
        columns: Values of each column, shape (rows,), in the order of the file.
        settings: As in `table_of_rows`.

    Raises:
        OutputError: The suffix is unknown, or the file cannot be written.
    """
    write_table(path, table_of_columns(columns, settings=settings))


def table_of_columns(
    columns: Mapping[str, npt.NDArray[Any]],
    categories: Mapping[str, Sequence[str]] | None = None,
    *,
    settings: Mapping[str, Any],
) -> pa.Table:
    """Make a table from columns; nan leaves the cell empty, unless there are categories.

    Args:
        columns: Values of each column, shape (rows,), in the order of the table.
        categories: For columns of codes 0, 1, ...: the text of each code, stored in its place.
        settings: As in `table_of_rows`.
    """
    texts = {} if categories is None else categories
    arrays = {
        name: pa.DictionaryArray.from_arrays(pa.array(values.astype("i1")), list(texts[name]))
        if name in texts
        else pa.array(values, from_pandas=categories is None)
        for name, values in columns.items()
    }
    return pa.table(arrays, metadata={"grasp3d": json.dumps(settings)})


def write_arrow(path: Path, table: pa.Table) -> None:
    """Write a table to compressed Parquet; only columns of coded texts keep their codes.

    Raises:
        OutputError: The file cannot be written.
    """
    texts = [field.name for field in table.schema if pa.types.is_dictionary(field.type)]
    with atomic_write(path) as temporary:  # no codes for numbers: they seldom repeat
        pq.write_table(table, temporary, compression="zstd", use_dictionary=texts)


def data_frame(table: pa.Table) -> "pd.DataFrame":
    """Convert a table to a pandas data frame; columns of coded texts become categories.

    Raises:
        OutputError: pandas is not installed.
    """
    if find_spec("pandas") is None:
        raise OutputError("a data frame needs pandas: pip install 'grasp3d[pandas]'")
    frame: pd.DataFrame = table.to_pandas()
    return frame


def read_settings(path: Path) -> dict[str, Any] | None:
    """Read the settings of a Parquet file.

    Returns:
        The settings as they were written; None if the file is not Parquet or has no settings.
    """
    try:
        metadata = pq.read_schema(path).metadata or {}
        settings = parse_json(metadata[b"grasp3d"])
    except (OSError, ValueError, KeyError):  # pyarrow's errors are ValueErrors
        return None
    return settings if isinstance(settings, dict) else None


def read_columns(path: Path) -> dict[str, npt.NDArray[Any]]:
    """Read a CSV or Parquet table.

    Args:
        path: File whose suffix is .csv or .parquet. CSV is separated by commas, semicolons or tabs;
            with semicolons it may have decimal commas.

    Returns:
        The columns in the order of the file. Missing numbers are nan; a column with text has the
        type that pyarrow infers.

    Raises:
        ValueError: The content is not a valid table; the message gives the reason.
        OSError: The file cannot be read.
    """
    if problem := problem_of_file(path):
        raise ValueError(problem)
    try:
        table = _read_csv(path) if path.suffix.lower() == ".csv" else _read_parquet(path)
        names = _checked_names(table.column_names)
        return {name: _values_of(one) for name, one in zip(names, table.columns, strict=True)}
    except pa.ArrowException as error:
        raise ValueError(str(error).splitlines()[0]) from error


def column_names(path: Path) -> list[str]:
    """Read only the column names of a CSV or Parquet table. Raises as `read_columns`."""
    if problem := problem_of_file(path):
        raise ValueError(problem)
    try:
        if path.suffix.lower() == ".csv":
            return _checked_names(_head_of_csv(path)[0])
        return _checked_names(pq.read_schema(path).names)
    except pa.ArrowException as error:
        raise ValueError(str(error).splitlines()[0]) from error


def _checked_names(stated: Sequence[str]) -> list[str]:
    """Check that column names are names and differ, and strip them. Raises ValueError."""
    names = [name.strip() for name in stated]
    if all(_NUMBER.fullmatch(name) for name in names):
        raise ValueError(f"its first line must be names of columns; found {' '.join(names)[:80]}")
    twice = [name for name, count in Counter(names).items() if count > 1]
    if twice:
        raise ValueError(f"two columns are called {twice[0]!r}")
    return names


def _values_of(column: pa.ChunkedArray) -> npt.NDArray[Any]:
    """Values of a column; coded texts become texts, and lists the name of their type."""
    if pa.types.is_nested(column.type):  # code that needs the column reports this type
        return np.full(len(column), str(column.type), dtype=object)
    if not pa.types.is_dictionary(column.type):
        return np.asarray(column.to_numpy(zero_copy_only=False))
    codes = column.unify_dictionaries().combine_chunks()
    texts = np.array([*codes.dictionary.to_pylist(), None], dtype=object)
    return np.asarray(texts[codes.indices.cast(pa.int64()).fill_null(-1).to_numpy()])


def _read_parquet(path: Path) -> pa.Table:
    """Read a Parquet file with texts as codes, so that each text is in memory once."""
    texts = [one.name for one in pq.read_schema(path) if pa.types.is_string(one.type)]
    with pq.ParquetFile(path, read_dictionary=texts) as file:
        return file.read()


def _head_of_csv(path: Path) -> tuple[list[str], str]:
    """Names in the first line of a CSV file, and its delimiter. Raises ValueError."""
    with path.open("rb") as stream:
        data = stream.read(LONGEST_LINE)
    lines = data.decode("utf-8-sig", "replace").splitlines()
    head = next((line for line in lines if line.strip()), "")
    if not head:
        raise ValueError("the file is empty")
    if len(data) == LONGEST_LINE and head == lines[-1]:
        raise ValueError(f"its first line is longer than {LONGEST_LINE:,} bytes")
    if "\0" in head or data.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise ValueError("it is not text in UTF-8; write it in that encoding")
    delimiter = max(",;\t", key=_QUOTED.sub("", head).count)
    return next(csv.reader([head], delimiter=delimiter)), delimiter


def _read_csv(path: Path) -> pa.Table:
    """Read a CSV file, and detect its delimiter and its decimal separator."""
    names, delimiter = _head_of_csv(path)
    _checked_names(names)
    options = pc.ParseOptions(delimiter=delimiter)
    table = pc.read_csv(path, parse_options=options)
    if delimiter == ";":
        convert = pc.ConvertOptions(decimal_point=",")
        other = pc.read_csv(path, parse_options=options, convert_options=convert)
        table = other if _numeric(table) < _numeric(other) else table
    return table


def _numeric(table: pa.Table) -> set[str]:
    return {field.name for field in table.schema if not pa.types.is_string(field.type)}


def write_table(path: Path, table: pa.Table) -> None:
    """Write a table.

    Args:
        path: File to create or replace, with a suffix of `SUFFIXES`.
        table: The table.

    Raises:
        OutputError: The suffix is unknown, or the file cannot be written.
    """
    check_suffix(path, SUFFIXES, "table")
    write = pc.write_csv if path.suffix.lower() == ".csv" else pq.write_table
    with atomic_write(path) as temporary:
        write(table, temporary)


def table_of_records(
    records: Sequence[RecordT], kind: type[RecordT], settings: Mapping[str, Any]
) -> pa.Table:
    """Make a table from records; its schema depends on the dataclass only.

    Args:
        records: Instances of `kind`; text must be valid Unicode.
        kind: The dataclass; only fields of plain values may be None.
        settings: Stored as JSON in the schema's metadata under `grasp3d`.
    """
    return table_of_rows(records, get_type_hints(kind), settings=settings)


def _schema(kinds: Mapping[str, Any], settings: Mapping[str, Any]) -> pa.Schema:
    """Names and types of columns, with settings as JSON in the metadata."""
    fields = [(name, _type(kind)) for name, kind in kinds.items()]
    return pa.schema(fields, metadata={"grasp3d": json.dumps(settings)})


def records_of_table(table: pa.Table, kind: type[RecordT]) -> list[RecordT]:
    """Make records from a table; missing columns get the fields' defaults, others are ignored.

    Args:
        table: A table as `table_of_records` returns it.
        kind: The dataclass of the records.

    Raises:
        ValueError: A column has values of another type; the message gives the reason.
    """
    hints = get_type_hints(kind)
    try:
        present = {name: each for name, each in hints.items() if name in table.column_names}
        rows = table.select(list(present)).cast(_schema(present, {})).to_pylist()
        record = _reader(kind)
        assert record is not None  # of a dataclass
        return list(map(record, rows))
    except (pa.ArrowException, TypeError, ValueError) as error:
        raise ValueError(reason_of(error)) from error


def _without_none(hint: Any) -> Any:
    """Return the type of a field without its None."""
    kinds = [kind for kind in get_args(hint) if kind is not NoneType]
    return hint if get_origin(hint) is tuple or not kinds else kinds[0]


def _type(hint: Any) -> pa.DataType:
    kind = _without_none(hint)
    if get_origin(kind) is tuple:
        item = _type(get_args(kind)[0])
        parts = get_args(kind)
        return pa.list_(item) if parts[-1] is Ellipsis else pa.list_(item, len(parts))
    if is_dataclass(kind):
        return pa.struct([(name, _type(each)) for name, each in get_type_hints(kind).items()])
    return pa.string() if issubclass(kind, StrEnum) else _TYPES[kind]


def _plain(value: Any) -> Any:
    """Convert records to dictionaries, tuples to lists, undecodable bytes in names to escapes."""
    if isinstance(value, str):
        return as_unicode(value)
    if is_dataclass(value):
        value = vars(value)
    if isinstance(value, Mapping):
        return {name: _plain(one) for name, one in value.items()}
    return [_plain(one) for one in value] if type(value) is tuple else value


def _reader(hint: Any) -> Callable[[Any], Any] | None:
    """Return the function that makes a field's value from a plain one; None: they are the same."""
    kind = _without_none(hint)
    if get_origin(kind) is tuple:
        of_item, missing = _reader(get_args(kind)[0]), () if kind is hint else None
        return lambda items: (
            missing if items is None else tuple(map(of_item, items) if of_item else items)
        )
    if is_dataclass(kind):
        fields = {name: _reader(each) for name, each in get_type_hints(kind).items()}
        changed = {name: read for name, read in fields.items() if read is not None}

        def record(values: dict[str, Any]) -> Any:
            for name, read in changed.items():
                if name in values:
                    values[name] = read(values[name])
            return kind(**values)  # type: ignore[operator]

        return record
    return kind if issubclass(kind, StrEnum) else None
