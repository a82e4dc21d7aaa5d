"""Conversion of dataclass records to and from the bytes of a Parquet file, one row per record.

The type hints of the dataclass define the columns: text, numbers, booleans, enumerations of text,
nested dataclasses, `tuple[X, ...]` as lists, and `tuple[X, X, X]` as lists of fixed length.
"""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import is_dataclass
from enum import StrEnum
from types import NoneType
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

RecordT = TypeVar("RecordT")

_TYPES = {str: pa.string(), int: pa.int64(), float: pa.float64(), bool: pa.bool_()}


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
    schema = pa.schema(
        [(name, _type(hint)) for name, hint in hints.items()],
        metadata={"grasp3d": json.dumps(settings)},
    )
    return pa.Table.from_arrays(arrays, schema=schema)


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
