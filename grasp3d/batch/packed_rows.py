"""Rows of many meshes, packed so that a million of them fit in memory."""

import pickle
import zlib
from collections.abc import Iterable, Iterator, Mapping, MutableMapping
from dataclasses import fields

from grasp3d.batch.row import AreaFractions, BestGrasp, Row

_COMMON_BYTES = b"".join(
    pickle.dumps(tuple(field.name for field in fields(kind)))
    for kind in (BestGrasp, AreaFractions, Row)
)
"""Bytes that occur in every packed row: the dictionary of the compression."""


class PackedRows(MutableMapping[str, Row]):
    """Rows by the name of their mesh, each packed to a fraction of its size as an object."""

    def __init__(self, rows: "Mapping[str, Row] | PackedRows | None" = None) -> None:
        self._packed: dict[str, bytes] = {}
        self.add_all(rows or {})

    def add_all(self, rows: "Mapping[str, Row] | PackedRows") -> None:
        """Add or replace rows; packed ones are not packed again."""
        if isinstance(rows, PackedRows):
            self._packed.update(rows._packed)  # noqa: SLF001, of the same class
        else:
            self.update(rows)

    def subset(self, names: Iterable[str]) -> "PackedRows":
        """The rows of some meshes."""
        rows = PackedRows()
        rows._packed = {name: self._packed[name] for name in names}
        return rows

    def __getitem__(self, name: str) -> Row:
        decompressor = zlib.decompressobj(zdict=_COMMON_BYTES)
        row: Row = pickle.loads(decompressor.decompress(self._packed[name]))  # noqa: S301, our own
        return row

    def __setitem__(self, name: str, row: Row) -> None:
        compressor = zlib.compressobj(1, zdict=_COMMON_BYTES)
        self._packed[name] = compressor.compress(pickle.dumps(row)) + compressor.flush()

    def __delitem__(self, name: str) -> None:
        del self._packed[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._packed)

    def __len__(self) -> int:
        return len(self._packed)
