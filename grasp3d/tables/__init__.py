"""Tables of columns or of records, in memory and as CSV and Parquet files."""

from grasp3d.tables.columns import (
    SUFFIXES,
    data_frame,
    read_columns,
    read_settings,
    table_of_arrays,
    table_of_columns,
    table_of_rows,
    write_arrow,
    write_columns,
    write_table,
)
from grasp3d.tables.records import pack_records, table_of_records, unpack_records

__all__ = [
    "SUFFIXES",
    "data_frame",
    "pack_records",
    "read_columns",
    "read_settings",
    "table_of_arrays",
    "table_of_columns",
    "table_of_records",
    "table_of_rows",
    "unpack_records",
    "write_arrow",
    "write_columns",
    "write_table",
]
