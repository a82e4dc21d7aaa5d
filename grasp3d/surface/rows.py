"""Rows of tables of grasps, and places, such as vertices or poses, that have such a row or none."""

from typing import Any

import numpy as np
import numpy.typing as npt

from grasp3d.arrays import Bools, Ints, locked

NO_ROW = -1
"""Row of a place that has no grasp."""


def gathered(values: npt.NDArray[Any], row: Ints, missing: float) -> npt.NDArray[Any]:
    """Values of the rows of a table at the places that have these rows.

    Args:
        values: A row for each grasp, shape (b, ...).
        row: Row of each place, -1: none, shape (k,).
        missing: Value of places without a row.

    Returns:
        Shape (k, ...), read-only.

    Example:
        >>> import numpy as np
        >>> from grasp3d.surface.rows import gathered
        >>> gathered(np.array([0.5, 0.7]), np.array([1, 0, -1, 1]), 0.0).tolist()
        [0.7, 0.5, 0.0, 0.7]
    """
    result = np.full((len(row), *values.shape[1:]), missing, dtype=values.dtype)
    has_row = row != NO_ROW
    result[has_row] = values[row[has_row]]
    return locked(result)


def rows_where(has_row: Bools) -> Ints:
    """Rows of places in a table of those that have one, in their order; -1: none, shape (k,).

    Args:
        has_row: Whether each place has a row, shape (k,).
    """
    return locked(np.where(has_row, np.cumsum(has_row) - 1, NO_ROW))


def rows_of(values: Any, rows: Ints) -> Any:
    """The chosen rows of what was computed: an array, a tuple, or a class that takes rows."""
    if values is None:
        return None
    if isinstance(values, tuple):
        return tuple(rows_of(one, rows) for one in values)
    return locked(values[rows]) if isinstance(values, np.ndarray) else values.take(rows)
