"""Tables of columns or of records as CSV and Parquet files."""

from grasp3d.tables.columns import (
    SUFFIXES,
    read_columns,
    write_arrays,
    write_columns,
    write_table,
)
from grasp3d.tables.records import pack_records, unpack_records

__all__ = [
    "SUFFIXES",
    "pack_records",
    "read_columns",
    "unpack_records",
    "write_arrays",
    "write_columns",
    "write_table",
]
