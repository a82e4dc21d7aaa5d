"""Rows of many meshes, kept small in memory: a million of them must fit."""

import pickle
import zlib
from collections.abc import Iterable, Iterator, Mapping, MutableMapping
from dataclasses import fields

from grasp3d.batch.row import BestGrasp, Row, Share

_WORDS = b"".join(
    pickle.dumps(tuple(field.name for field in fields(kind))) for kind in (BestGrasp, Share, Row)
)
"""What stands in every packed row, so that it need not be kept with each."""


class RowBox(MutableMapping[str, Row]):
    """Rows by the name of their mesh, each packed to a fraction of what it takes as objects."""

    def __init__(self, rows: "Mapping[str, Row] | RowBox | None" = None) -> None:
        self._packed: dict[str, bytes] = {}
        self.take(rows or {})

    def take(self, rows: "Mapping[str, Row] | RowBox") -> None:
        """Add rows, or replace them; those of another box are shared with it."""
        if isinstance(rows, RowBox):
            self._packed.update(rows._packed)  # noqa: SLF001, its own kind
        else:
            self.update(rows)

    def only(self, names: Iterable[str]) -> "RowBox":
        """A box of some of the rows."""
        box = RowBox()
        box._packed = {name: self._packed[name] for name in names}
        return box

    def __getitem__(self, name: str) -> Row:
        unpacker = zlib.decompressobj(zdict=_WORDS)
        row: Row = pickle.loads(unpacker.decompress(self._packed[name]))  # noqa: S301, our own
        return row

    def __setitem__(self, name: str, row: Row) -> None:
        packer = zlib.compressobj(1, zdict=_WORDS)
        self._packed[name] = packer.compress(pickle.dumps(row)) + packer.flush()

    def __delitem__(self, name: str) -> None:
        del self._packed[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._packed)

    def __len__(self) -> int:
        return len(self._packed)
