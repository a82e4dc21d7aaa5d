"""Array aliases and locked copies, so that results cannot change under their readers."""

from typing import Any

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Bools = npt.NDArray[np.bool_]
Bytes = npt.NDArray[np.uint8]


def locked(array: npt.ArrayLike, dtype: npt.DTypeLike | None = None) -> npt.NDArray[Any]:
    """Return a C-contiguous copy that nobody can write to."""
    copy = np.array(array, dtype=dtype, order="C", copy=True)
    copy.flags.writeable = False
    return copy


def shaped(values: npt.NDArray[Any], batch: tuple[int, ...]) -> Any:  # noqa: ANN401
    """Results of a flat batch (b, ...) in the batch's shape, locked; a plain number for one."""
    return locked(values.reshape((*batch, *values.shape[1:])))[()]


def unit_rows(vectors: Floats) -> Floats:
    """Scale the rows (..., 3) to length one; a row without a direction becomes zero."""
    lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
    scaled: Floats = np.divide(vectors, lengths, out=np.zeros_like(vectors), where=lengths > 0.0)
    return scaled


def first_at_position(vertices: Floats) -> Ints:
    """For each vertex the first one with exactly its position, shape (V,)."""
    rows = np.ascontiguousarray(vertices + 0.0)  # -0.0 and 0.0 are one place
    keys = rows.view(np.dtype((np.void, rows.dtype.itemsize * 3))).ravel()
    _, first, inverse = np.unique(keys, return_index=True, return_inverse=True)
    return np.asarray(first[inverse], dtype=np.int64)
