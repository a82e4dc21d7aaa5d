"""Records as the bytes of a Parquet file, and back: one row each, records within them nested.

The type hints of a dataclass say what the columns are: text, numbers, truth values, enumerations of
text, other dataclasses, `tuple[X, ...]` as lists, and `tuple[X, X, X]` as lists of fixed length.
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
    """Write records as a Parquet file, with the same schema whatever they hold.

    Args:
        records: Of that kind; text must be Unicode.
        kind: Their dataclass; only columns of plain values may be None.
        settings: Kept as JSON in the schema's metadata under `grasp3d`.
    """
    hints = get_type_hints(kind)
    arrays = [_array([getattr(one, name) for one in records], hints[name]) for name in hints]
    schema = pa.schema(
        [(name, _type(hint)) for name, hint in hints.items()],
        metadata={"grasp3d": json.dumps(settings)},
    )
    sink = pa.BufferOutputStream()
    table = pa.Table.from_arrays(arrays, schema=schema)
    pq.write_table(table, sink, compression="zstd", write_page_checksum=True)
    return bytes(sink.getvalue())


def unpack_records(data: bytes, kind: type[RecordT]) -> tuple[list[RecordT], bool]:
    """Read what `pack_records` wrote, also of a version that knew fewer columns.

    Args:
        data: Content of the file.
        kind: The records' dataclass.

    Returns:
        The records, and whether the file has exactly the columns that `pack_records` writes now.

    Raises:
        ValueError: The file is damaged, or another one; the message says why.
    """
    hints = get_type_hints(kind)
    try:
        table = pq.read_table(pa.BufferReader(data), page_checksum_verification=True)
        _check_ours(table)
        _check_whole(table, hints)
        there = [name for name in hints if name in table.column_names]
        columns = [
            _values(table.column(name).cast(_type(hints[name])).combine_chunks(), hints[name])
            for name in there
        ]
        records = [kind(**dict(zip(there, row, strict=True))) for row in zip(*columns, strict=True)]
    except (pa.ArrowException, OSError, TypeError, ValueError) as error:
        raise ValueError(" ".join(str(error).split())[:200] or type(error).__name__) from error
    return records, table.column_names == list(hints)


def _check_ours(table: pa.Table) -> None:
    if b"grasp3d" not in (table.schema.metadata or {}):
        raise ValueError("it is not written by grasp3d")


def _check_whole(table: pa.Table, hints: Mapping[str, Any]) -> None:
    for name in set(hints) & set(table.column_names):
        if NoneType not in get_args(hints[name]) and table.column(name).null_count:
            raise ValueError(f"its column {name} has gaps")


def _plain(hint: Any) -> Any:  # noqa: ANN401
    """Type of a field that may be None."""
    kinds = [kind for kind in get_args(hint) if kind is not NoneType]
    return hint if get_origin(hint) is tuple or not kinds else kinds[0]


def _is_list(kind: Any) -> bool:  # noqa: ANN401
    return get_args(kind)[-1] is Ellipsis


def _type(hint: Any) -> pa.DataType:  # noqa: ANN401
    kind = _plain(hint)
    if get_origin(kind) is tuple:
        item = _type(get_args(kind)[0])
        return pa.list_(item) if _is_list(kind) else pa.list_(item, len(get_args(kind)))
    if is_dataclass(kind):
        return pa.struct([(name, _type(each)) for name, each in _hints(kind).items()])
    return pa.string() if issubclass(kind, StrEnum) else _TYPES[kind]


def _hints(kind: Any) -> dict[str, Any]:  # noqa: ANN401
    return get_type_hints(kind)


def _array(values: list[Any], hint: Any) -> pa.Array:  # noqa: ANN401
    """A column from its values; nested ones part by part, since that is far faster."""
    kind = _plain(hint)
    if is_dataclass(kind):
        parts = [
            _array([getattr(value, name) for value in values], each)
            for name, each in _hints(kind).items()
        ]
        return pa.StructArray.from_arrays(parts, fields=list(_type(kind)))
    if get_origin(kind) is tuple and _is_list(kind):
        ends = np.cumsum([0, *map(len, values)], dtype=np.int32)
        items = _array([item for value in values for item in value], get_args(kind)[0])
        return pa.ListArray.from_arrays(pa.array(ends), items, type=_type(kind))
    return pa.array(values, type=_type(kind))


def _values(array: pa.Array, hint: Any) -> Iterable[Any]:  # noqa: ANN401
    """Values of a column, as a record has them."""
    kind = _plain(hint)
    if is_dataclass(kind):
        parts = [_values(array.field(n), each) for n, each in enumerate(_hints(kind).values())]
        return [kind(*values) for values in zip(*parts, strict=True)]  # type: ignore[operator]
    if get_origin(kind) is tuple and _is_list(kind):
        items = list(_values(array.flatten(), get_args(kind)[0]))
        ends = np.cumsum(array.value_lengths().fill_null(0).to_numpy())
        return [tuple(items[begin:end]) for begin, end in zip([0, *ends[:-1]], ends, strict=False)]
    if get_origin(kind) is tuple:
        return [None if value is None else tuple(value) for value in _rows(array)]
    if issubclass(kind, StrEnum):
        return [kind(value) for value in array.to_pylist()]
    return _rows(array)


def _rows(array: pa.Array) -> list[Any]:
    """Plain values and lists of fixed length; the quick way where none is missing."""
    fixed = pa.types.is_fixed_size_list(array.type)
    if array.null_count or not (fixed or pa.types.is_floating(array.type)):
        return list(array.to_pylist())
    if not fixed:
        return list(array.to_numpy().tolist())
    return list(array.flatten().to_numpy().reshape(-1, array.type.list_size).tolist())
