"""Outcomes of grasps in tables: the columns `outcome` and `success`."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from grasp3d.arrays import Floats
from grasp3d.errors import ContactError
from grasp3d.grasps.pose_files.documents import kind

NAMES = ("outcome", "success")
"""Columns that state outcomes; grasp3d writes the first."""

WORDS = {
    "1": 1.0, "true": 1.0, "yes": 1.0,
    "0": 0.0, "false": 0.0, "no": 0.0,
    "": math.nan, "nan": math.nan,
}  # fmt: skip
"""Outcomes as text, in lower case; empty: not tried."""


def outcomes_of(columns: Mapping[str, npt.NDArray[Any]], count: int) -> Floats:
    """Outcomes of a table's grasps: 1 held, 0 failed, nan not tried, shape (count,).

    Args:
        columns: Columns of the table.
        count: Number of its rows.

    Raises:
        ContactError: A value is no outcome, or the two columns contradict each other.
    """
    found = [_outcomes(columns[name], name) for name in NAMES if name in columns]
    if not found:
        return np.full(count, math.nan)
    merged = found[0]
    for other in found[1:]:
        known = ~np.isnan(merged) & ~np.isnan(other)
        differing = np.flatnonzero(known & (merged != other))
        if len(differing):
            raise ContactError(
                f"grasp {differing[0] + 1}: its columns {' and '.join(NAMES)} contradict each other"
            )
        merged = np.where(np.isnan(merged), other, merged)
    return merged


def _outcomes(values: npt.NDArray[Any], name: str) -> Floats:
    if values.dtype.kind in "fiub":
        return _checked(values.astype(np.float64), values, name)
    return _checked(np.array([_outcome(value) for value in values.tolist()]), values, name)


def _checked(numbers: Floats, values: npt.NDArray[Any], name: str) -> Floats:
    """Refuse what is neither 0 nor 1 nor missing; -1 stands for what is no outcome."""
    bad = np.flatnonzero(~(np.isnan(numbers) | (numbers == 0.0) | (numbers == 1.0)))
    if len(bad):
        raise ContactError(
            f"grasp {bad[0] + 1}: {name} must be 1, true or yes (it held), 0, false or no (it "
            f"failed), or empty (not tried); got {kind(values.tolist()[bad[0]])}"
        )
    return numbers


def _outcome(value: object) -> float:
    """The outcome that a value is or spells; -1: it is none."""
    if value is None:
        return math.nan
    if isinstance(value, str):
        return WORDS.get(value.strip().lower(), -1.0)
    return float(value) if isinstance(value, bool | int | float) else -1.0
