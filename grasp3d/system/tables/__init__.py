"""Tables of columns or of records, in memory and as CSV and Parquet files."""

from grasp3d.system.tables.columns import (
    SUFFIXES,
    data_frame,
    pack_records,
    read_arrow,
    read_columns,
    read_settings,
    table_of_arrays,
    table_of_columns,
    table_of_records,
    table_of_rows,
    unpack_records,
    write_arrow,
    write_columns,
    write_table,
)

__all__ = [
    "SUFFIXES",
    "data_frame",
    "pack_records",
    "read_arrow",
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
