"""CSV and Parquet tables of columns."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy.typing as npt
import pyarrow as pa
import pyarrow.csv as pc
import pyarrow.parquet as pq

from grasp3d.system.files import atomic_write, check_suffix
from grasp3d.system.names import as_unicode

SUFFIXES = (".csv", ".parquet")

_TYPES = {str: pa.string(), int: pa.int64(), float: pa.float64(), bool: pa.bool_()}


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
    check_suffix(path, SUFFIXES, "table")
    schema = pa.schema([(name, _TYPES[kind]) for name, kind in columns.items()])
    _write(path, pa.Table.from_pylist([_unicode(row) for row in rows], schema=schema), settings)


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
    check_suffix(path, SUFFIXES, "table")
    arrays = {name: pa.array(values, from_pandas=True) for name, values in columns.items()}
    _write(path, pa.table(arrays), settings)


def write_arrays(
    path: Path,
    columns: Mapping[str, npt.NDArray[Any]],
    categories: Mapping[str, Sequence[str]],
    *,
    settings: Mapping[str, Any],
) -> None:
    """Write columns to compressed Parquet; nan and inf are kept.

    Args:
        path: File to create or replace.
        columns: Values of each column, shape (rows,), in the order of the file.
        categories: For columns of codes 0, 1, ...: the text of each code, which is written.
        settings: As in `write_table`.

    Raises:
        OutputError: The file cannot be written.
    """
    arrays = {
        name: pa.DictionaryArray.from_arrays(pa.array(values.astype("i1")), list(categories[name]))
        if name in categories
        else pa.array(values)
        for name, values in columns.items()
    }
    metadata = {"grasp3d": json.dumps(settings)}
    with atomic_write(path) as temporary:
        pq.write_table(
            pa.table(arrays, metadata=metadata),
            temporary,
            compression="zstd",
            use_dictionary=list(categories),  # numbers seldom repeat
        )


def read_columns(path: Path) -> dict[str, npt.NDArray[Any]]:
    """Read a CSV or Parquet table.

    Args:
        path: File whose suffix is .csv or .parquet.

    Returns:
        The columns in the order of the file. Missing numbers are nan; a column with text has the
        type that pyarrow infers.

    Raises:
        ValueError: The content is not a valid table; the message gives the reason.
        OSError: The file cannot be read.
    """
    try:
        table = pc.read_csv(path) if path.suffix.lower() == ".csv" else pq.read_table(path)
        names = [name.strip() for name in table.column_names]
        duplicates = [name for number, name in enumerate(names) if name in names[:number]]
        if duplicates:
            raise ValueError(f"two columns are called {duplicates[0]!r}")
        return {
            name: column.to_numpy(zero_copy_only=False)
            for name, column in zip(names, table.columns, strict=True)
        }
    except pa.ArrowException as error:
        raise ValueError(str(error).splitlines()[0]) from error


def _write(path: Path, table: pa.Table, settings: Mapping[str, Any]) -> None:
    with atomic_write(path) as temporary:
        if path.suffix.lower() == ".csv":
            pc.write_csv(table, temporary)
        else:
            metadata = {"grasp3d": json.dumps(settings)}
            pq.write_table(table.replace_schema_metadata(metadata), temporary)


def _unicode(row: Mapping[str, Any]) -> dict[str, Any]:
    """Replace undecodable bytes of file names in a row by escapes."""
    return {
        key: as_unicode(value) if isinstance(value, str) else value for key, value in row.items()
    }
