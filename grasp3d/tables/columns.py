"""Tables of columns: in memory as Arrow tables, and as CSV and Parquet files."""

import json
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy.typing as npt
import pyarrow as pa
import pyarrow.csv as pc
import pyarrow.parquet as pq

from grasp3d.errors import OutputError
from grasp3d.system.files import atomic_write, check_suffix
from grasp3d.system.names import as_unicode

if TYPE_CHECKING:
    import pandas as pd

SUFFIXES = (".csv", ".parquet")
"""Endings of the files that tables are written to."""

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
    _write(path, table_of_rows(rows, columns, settings=settings))


def table_of_rows(
    rows: Sequence[Mapping[str, Any]],
    columns: Mapping[str, type],
    *,
    settings: Mapping[str, Any],
) -> pa.Table:
    """Make a table of rows; see `write_table`."""
    schema = pa.schema(
        [(name, _TYPES[kind]) for name, kind in columns.items()],
        metadata={"grasp3d": json.dumps(settings)},
    )
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
        found = json.loads(metadata[b"grasp3d"])
    except (OSError, ValueError, KeyError):  # pyarrow's errors are ValueErrors
        return None
    return found if isinstance(found, dict) else None


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
