"""Tables of columns, rows or records: in memory as Arrow tables, and as CSV and Parquet files.

Records are instances of a dataclass, one row each. Its type hints define the columns: text,
numbers, booleans, enumerations of text, nested dataclasses, `tuple[X, ...]` as lists, and
`tuple[X, X, X]` as lists of fixed length.
"""

import json
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import is_dataclass
from enum import StrEnum
from importlib.util import find_spec
from pathlib import Path
from types import NoneType
from typing import TYPE_CHECKING, Any, TypeVar, get_args, get_origin, get_type_hints

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.csv as pc
import pyarrow.parquet as pq

from grasp3d.errors import OutputError
from grasp3d.system.documents import parse_json
from grasp3d.system.files import atomic_write, check_suffix
from grasp3d.system.names import as_unicode

if TYPE_CHECKING:
    import pandas as pd

SUFFIXES = (".csv", ".parquet")
"""Endings of the files that tables are written to."""

_NUMBER = re.compile(r"[-+\d.,;\se]+", re.IGNORECASE)

_QUOTED = re.compile(r'"[^"]*"')

_TYPES = {str: pa.string(), int: pa.int64(), float: pa.float64(), bool: pa.bool_()}

RecordT = TypeVar("RecordT")


def write_table(
    path: Path,
    rows: Sequence[Mapping[str, Any]],
    columns: Mapping[str, type],
    *,
    settings: Mapping[str, Any],
) -> None:
    """Write a table of rows; Parquet stores the settings as JSON in the schema's metadata.

    Args:
        path: File to create or replace, with a suffix of `SUFFIXES`.
        rows: Values by column name; a missing value or None leaves the cell empty.
        columns: Type of each column: str, int, float or bool; in the order of the file.
        settings: Settings that the rows were computed with, stored under `grasp3d`.

    Raises:
        OutputError: The suffix is unknown, or the file cannot be written.
    """
    _write(path, table_of_rows(rows, columns, settings=settings))


def table_of_rows(
    rows: Sequence[Mapping[str, Any]],
    columns: Mapping[str, type],
    *,
    settings: Mapping[str, Any],
) -> pa.Table:
    """Make a table of rows; see `write_table`."""
    schema = _schema(columns, settings)
    return pa.Table.from_pylist([_unicode(row) for row in rows], schema=schema)


def write_columns(
    path: Path, columns: Mapping[str, npt.NDArray[Any]], *, settings: Mapping[str, Any]
) -> None:
    """Write a table of columns; nan leaves the cell empty.

    Args:
        path: File to create or replace, with a suffix of `SUFFIXES`.
        columns: Values of each column, shape (rows,), in the order of the file.
        settings: As in `write_table`.

    Raises:
        OutputError: The suffix is unknown, or the file cannot be written.
    """
    _write(path, table_of_columns(columns, settings=settings))


def table_of_columns(
    columns: Mapping[str, npt.NDArray[Any]], *, settings: Mapping[str, Any]
) -> pa.Table:
    """Make a table of columns; nan leaves the cell empty. See `write_columns`."""
    arrays = {name: pa.array(values, from_pandas=True) for name, values in columns.items()}
    return pa.table(arrays, metadata={"grasp3d": json.dumps(settings)})


def table_of_arrays(
    columns: Mapping[str, npt.NDArray[Any]],
    categories: Mapping[str, Sequence[str]],
    *,
    settings: Mapping[str, Any],
) -> pa.Table:
    """Make a table of columns; nan and inf are kept.

    Args:
        columns: Values of each column, shape (rows,), in the order of the table.
        categories: For columns of codes 0, 1, ...: the text of each code, which is stored.
        settings: As in `write_table`.
    """
    arrays = {
        name: pa.DictionaryArray.from_arrays(pa.array(values.astype("i1")), list(categories[name]))
        if name in categories
        else pa.array(values)
        for name, values in columns.items()
    }
    return pa.table(arrays, metadata={"grasp3d": json.dumps(settings)})


def write_arrow(path: Path, table: pa.Table, metadata: Mapping[str, bytes]) -> None:
    """Write a table to compressed Parquet.

    Args:
        path: File to create or replace.
        table: The table; its columns of texts with codes are stored as such.
        metadata: Further metadata of the file, ASCII.

    Raises:
        OutputError: The file cannot be written.
    """
    texts = [field.name for field in table.schema if pa.types.is_dictionary(field.type)]
    with (
        atomic_write(path) as temporary,  # numbers seldom repeat
        pq.ParquetWriter(
            temporary, table.schema, compression="zstd", use_dictionary=texts
        ) as writer,
    ):
        writer.write_table(table)
        writer.add_key_value_metadata(metadata)


def read_arrow(
    path: Path, check_size: Callable[[int], None]
) -> tuple[dict[str, npt.NDArray[Any]], dict[str, str]]:
    """Read a Parquet table of columns without missing values, and the metadata of its file.

    Args:
        path: The file.
        check_size: Called with the size that the columns will have [bytes], before they are read.

    Raises:
        ValueError: It is damaged, or has other columns.
        OSError: The file cannot be read.
    """
    try:
        with pq.ParquetFile(path) as file:
            metadata = file.metadata
            groups = (metadata.row_group(number) for number in range(metadata.num_row_groups))
            declared = sum(group.total_byte_size for group in groups)
            check_size(max(declared, 8 * metadata.num_rows * metadata.num_columns))
            table = file.read()
    except pa.ArrowException as error:
        raise ValueError(str(error).splitlines()[0]) from error
    if any(column.null_count for column in table.columns):
        raise ValueError("values are missing")
    columns = {
        name: column.to_numpy()
        for name, column in zip(table.column_names, table.columns, strict=True)
    }
    texts = {name.decode(): text.decode() for name, text in (metadata.metadata or {}).items()}
    return columns, texts


def data_frame(table: pa.Table) -> "pd.DataFrame":
    """Convert a table to a data frame of pandas; columns of texts with codes become categories.

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
        The settings as they were written, or None where it is no Parquet file or holds none.
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
    try:
        table = _read_csv(path) if path.suffix.lower() == ".csv" else pq.read_table(path)
        names = [name.strip() for name in table.column_names]
        if all(_NUMBER.fullmatch(name) for name in names):
            raise ValueError(f"its first line must be names of columns; found {' '.join(names)}")
        duplicates = [name for number, name in enumerate(names) if name in names[:number]]
        if duplicates:
            raise ValueError(f"two columns are called {duplicates[0]!r}")
        return {
            name: column.to_numpy(zero_copy_only=False)
            for name, column in zip(names, table.columns, strict=True)
        }
    except pa.ArrowException as error:
        raise ValueError(str(error).splitlines()[0]) from error


def _read_csv(path: Path) -> pa.Table:
    """A CSV file, with the delimiter and the decimal separator that it has."""
    with path.open(encoding="utf-8-sig", errors="replace") as lines:
        head = next((line for line in lines if line.strip()), "")
    if not head:
        raise ValueError("the file is empty")
    if "\0" in head:
        raise ValueError("it is no text in UTF-8")
    delimiter = max(",;\t", key=_QUOTED.sub("", head).count)
    options = pc.ParseOptions(delimiter=delimiter)
    table = pc.read_csv(path, parse_options=options)
    if delimiter != ";":
        return table
    convert = pc.ConvertOptions(decimal_point=",")
    other = pc.read_csv(path, parse_options=options, convert_options=convert)
    return other if _numeric(table) < _numeric(other) else table


def _numeric(table: pa.Table) -> set[str]:
    return {field.name for field in table.schema if not pa.types.is_string(field.type)}


def _write(path: Path, table: pa.Table) -> None:
    check_suffix(path, SUFFIXES, "table")
    with atomic_write(path) as temporary:
        if path.suffix.lower() == ".csv":
            pc.write_csv(table, temporary)
        else:
            pq.write_table(table, temporary)


def _unicode(row: Mapping[str, Any]) -> dict[str, Any]:
    """Replace undecodable bytes of file names in a row by escapes."""
    return {
        key: as_unicode(value) if isinstance(value, str) else value for key, value in row.items()
    }


def pack_records(
    records: Sequence[RecordT], kind: type[RecordT], settings: Mapping[str, Any]
) -> bytes:
    """Return records as the bytes of a Parquet file; the schema depends on the dataclass only.

    Args:
        records: Instances of `kind`; text must be valid Unicode.
        kind: The dataclass; only fields of plain values may be None.
        settings: Stored as JSON in the schema's metadata under `grasp3d`.
    """
    table = table_of_records(records, kind, settings)
    sink = pa.BufferOutputStream()
    pq.write_table(table, sink, compression="zstd", write_page_checksum=True)
    return bytes(sink.getvalue())


def table_of_records(
    records: Sequence[RecordT], kind: type[RecordT], settings: Mapping[str, Any]
) -> pa.Table:
    """Return records as a table, whose schema depends on the dataclass only; see `pack_records`."""
    hints = get_type_hints(kind)
    arrays = [_array([getattr(record, name) for record in records], hints[name]) for name in hints]
    return pa.Table.from_arrays(arrays, schema=_schema(hints, settings))


def _schema(kinds: Mapping[str, Any], settings: Mapping[str, Any]) -> pa.Schema:
    """Names and types of columns, with settings as JSON in the metadata."""
    fields = [(name, _type(kind)) for name, kind in kinds.items()]
    return pa.schema(fields, metadata={"grasp3d": json.dumps(settings)})


def unpack_records(data: bytes, kind: type[RecordT]) -> tuple[list[RecordT], bool]:
    """Read records from the bytes of `pack_records`; missing columns get the fields' defaults.

    Args:
        data: Content of the Parquet file.
        kind: The dataclass of the records.

    Returns:
        The records, and whether the columns are exactly the fields of `kind`.

    Raises:
        ValueError: The file is damaged or was not written by `pack_records`; the message gives the
            reason.
    """
    hints = get_type_hints(kind)
    try:
        table = pq.read_table(pa.BufferReader(data), page_checksum_verification=True)
        _check_origin(table)
        _check_complete(table, hints)
        present = [name for name in hints if name in table.column_names]
        columns = [
            _values(table.column(name).cast(_type(hints[name])).combine_chunks(), hints[name])
            for name in present
        ]
        records = [
            kind(**dict(zip(present, row, strict=True))) for row in zip(*columns, strict=True)
        ]
    except (pa.ArrowException, OSError, TypeError, ValueError) as error:
        raise ValueError(" ".join(str(error).split())[:200] or type(error).__name__) from error
    return records, table.column_names == list(hints)


def _check_origin(table: pa.Table) -> None:
    if b"grasp3d" not in (table.schema.metadata or {}):
        raise ValueError("it was not written by grasp3d")


def _check_complete(table: pa.Table, hints: Mapping[str, Any]) -> None:
    for name in set(hints) & set(table.column_names):
        if NoneType not in get_args(hints[name]) and table.column(name).null_count:
            raise ValueError(f"its column {name} has missing values")


def _plain(hint: Any) -> Any:
    """Return the type of a field without its None."""
    kinds = [kind for kind in get_args(hint) if kind is not NoneType]
    return hint if get_origin(hint) is tuple or not kinds else kinds[0]


def _is_list(kind: Any) -> bool:
    return get_args(kind)[-1] is Ellipsis


def _type(hint: Any) -> pa.DataType:
    kind = _plain(hint)
    if get_origin(kind) is tuple:
        item = _type(get_args(kind)[0])
        return pa.list_(item) if _is_list(kind) else pa.list_(item, len(get_args(kind)))
    if is_dataclass(kind):
        return pa.struct([(name, _type(each)) for name, each in get_type_hints(kind).items()])
    return pa.string() if issubclass(kind, StrEnum) else _TYPES[kind]


def _array(values: list[Any], hint: Any) -> pa.Array:
    """Return a column of values; nested types are converted by component, for speed."""
    kind = _plain(hint)
    if is_dataclass(kind):
        parts = [
            _array([getattr(value, name) for value in values], each)
            for name, each in get_type_hints(kind).items()
        ]
        return pa.StructArray.from_arrays(parts, fields=list(_type(kind)))
    if get_origin(kind) is tuple and _is_list(kind):
        ends = np.cumsum([0, *map(len, values)], dtype=np.int32)
        items = _array([item for value in values for item in value], get_args(kind)[0])
        return pa.ListArray.from_arrays(pa.array(ends), items, type=_type(kind))
    return pa.array(values, type=_type(kind))


def _values(array: pa.Array, hint: Any) -> Iterable[Any]:
    """Return the values of a column in the types of the record's field."""
    kind = _plain(hint)
    if is_dataclass(kind):
        parts = [
            _values(array.field(n), each) for n, each in enumerate(get_type_hints(kind).values())
        ]
        return [kind(*values) for values in zip(*parts, strict=True)]  # type: ignore[operator]
    if get_origin(kind) is tuple and _is_list(kind):
        items = list(_values(array.flatten(), get_args(kind)[0]))
        ends = np.cumsum(array.value_lengths().fill_null(0).to_numpy())
        return [tuple(items[start:end]) for start, end in zip([0, *ends[:-1]], ends, strict=False)]
    if get_origin(kind) is tuple:
        return [None if value is None else tuple(value) for value in _rows(array)]
    if issubclass(kind, StrEnum):
        return [kind(value) for value in array.to_pylist()]
    return _rows(array)


def _rows(array: pa.Array) -> list[Any]:
    """Return plain values or lists of fixed length; through NumPy if none is null, for speed."""
    fixed = pa.types.is_fixed_size_list(array.type)
    if array.null_count or not (fixed or pa.types.is_floating(array.type)):
        return list(array.to_pylist())
    if not fixed:
        return list(array.to_numpy().tolist())
    return list(array.flatten().to_numpy().reshape(-1, array.type.list_size).tolist())
