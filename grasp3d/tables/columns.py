"""Tables as files: CSV or Parquet, by the file's suffix."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy.typing as npt
import pyarrow as pa
import pyarrow.csv as pc
import pyarrow.parquet as pq

from grasp3d.system.files import check_suffix, written_whole
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
    """Write a table; in Parquet the settings are in the schema's metadata, as JSON.

    Args:
        path: File to make or replace.
        rows: Values by column; one that is missing or None is left empty.
        columns: Type of each column: str, int, float or bool; in the order of the file.
        settings: What the rows were made with, kept under `grasp3d`.

    Raises:
        OutputError: No table has that suffix, or the file cannot be written.
    """
    check_suffix(path, SUFFIXES, "table")
    schema = pa.schema([(name, _TYPES[kind]) for name, kind in columns.items()])
    _write(path, pa.Table.from_pylist([_printable(row) for row in rows], schema=schema), settings)


def write_columns(
    path: Path, columns: Mapping[str, npt.NDArray[Any]], *, settings: Mapping[str, Any]
) -> None:
    """Write a table of many rows, column by column; nan is left empty.

    Args:
        path: File to make or replace.
        columns: Values of each, shape (rows,), in the order of the file.
        settings: As in `write_table`.

    Raises:
        OutputError: No table has that suffix, or the file cannot be written.
    """
    check_suffix(path, SUFFIXES, "table")
    arrays = {name: pa.array(values, from_pandas=True) for name, values in columns.items()}
    _write(path, pa.table(arrays), settings)


def write_arrays(
    path: Path,
    columns: Mapping[str, npt.NDArray[Any]],
    words: Mapping[str, Sequence[str]],
    *,
    settings: Mapping[str, Any],
) -> None:
    """Write arrays to Parquet as they are, nan and inf included; packed tightly.

    Args:
        path: File to make or replace.
        columns: Values of each, shape (rows,), in the order of the file.
        words: Of columns that hold codes the text that 0, 1, ... stand for; written as text.
        settings: As in `write_table`.

    Raises:
        OutputError: The file cannot be written.
    """
    arrays = {
        name: pa.DictionaryArray.from_arrays(pa.array(values.astype("i1")), list(words[name]))
        if name in words
        else pa.array(values)
        for name, values in columns.items()
    }
    metadata = {"grasp3d": json.dumps(settings)}
    with written_whole(path) as part:
        pq.write_table(
            pa.table(arrays, metadata=metadata),
            part,
            compression="zstd",
            use_dictionary=list(words),  # numbers seldom come twice
        )


def read_columns(path: Path) -> dict[str, npt.NDArray[Any]]:
    """Read a CSV or Parquet table.

    Args:
        path: File with that suffix.

    Returns:
        The columns in order; numbers that are missing are nan, columns that are not all numbers
        hold whatever stands there.

    Raises:
        ValueError: The file is no such table; the message says why.
        OSError: It cannot be read.
    """
    try:
        table = pc.read_csv(path) if path.suffix.lower() == ".csv" else pq.read_table(path)
        names = [name.strip() for name in table.column_names]
        twice = [name for number, name in enumerate(names) if name in names[:number]]
        if twice:
            raise ValueError(f"two columns are called {twice[0]!r}")
        return {
            name: column.to_numpy(zero_copy_only=False)
            for name, column in zip(names, table.columns, strict=True)
        }
    except pa.ArrowException as error:
        raise ValueError(str(error).splitlines()[0]) from error


def _write(path: Path, table: pa.Table, settings: Mapping[str, Any]) -> None:
    with written_whole(path) as part:
        if path.suffix.lower() == ".csv":
            pc.write_csv(table, part)
        else:
            metadata = {"grasp3d": json.dumps(settings)}
            pq.write_table(table.replace_schema_metadata(metadata), part)


def _printable(row: Mapping[str, Any]) -> dict[str, Any]:
    """Write out the bytes of file names that are no Unicode."""
    return {
        key: as_unicode(value) if isinstance(value, str) else value for key, value in row.items()
    }
