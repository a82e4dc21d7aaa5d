"""Outcomes of grasps, from the values that files have of each."""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from grasp3d.arrays import Floats
from grasp3d.errors import ContactError
from grasp3d.formats.checks import Entries
from grasp3d.formats.poses import GraspPoses
from grasp3d.system.documents import described

OUTCOMES = ("outcome", "success")
"""Names that state outcomes in grasp3d's own formats, which writes the first."""

WORDS = {"1": 1.0, "1.0": 1.0, "true": 1.0, "0": 0.0, "0.0": 0.0, "false": 0.0}
"""Outcomes as text, in lower case."""

MOST_LISTED = 30
"""Most names of a file that an error message lists."""

Values = npt.NDArray[Any] | Sequence[Any]
"""One value of each grasp."""


def outcomes_of(
    outcome: str | None,
    count: int,
    names: Iterable[str],
    read: Callable[[str], Values],
    *,
    default: Sequence[str] = OUTCOMES,
) -> Floats:
    """Outcomes of grasps: 1 held, 0 failed, nan not tried, shape (count,).

    Args:
        outcome: Name of the values; None: those of the format.
        count: Number of grasps.
        names: Names of the values that the file has of each grasp; parts of paths are separated
            by /, and the last ones alone may name one.
        read: The values of a name, one of each grasp.
        default: Names of the format, of which a file has one.

    Raises:
        ContactError: The file has no such values, one of them is no outcome, or it has values
            of two names.
    """
    names = list(names)
    if outcome is not None:
        name = _named(outcome, names)
        return _stated(read(name), name)
    own = [name for name in default if name in names]
    if len(own) > 1:
        raise ContactError(
            f"it has both {' and '.join(own)}: give the one that is meant (--outcome)"
        )
    return _stated(read(own[0]), own[0]) if own else np.full(count, math.nan)


def outcomes_of_entries(outcome: str | None, entries: Entries) -> Floats:
    """Outcomes of grasps that have keys each, of a format without outcomes. As `outcomes_of`."""
    keys = dict.fromkeys(key for entry in entries for key in entry) if outcome else ()
    return outcomes_of(outcome, len(entries), keys, lambda key: [one.get(key) for one in entries])


def with_outcomes(poses: GraspPoses, outcome: str | None) -> GraspPoses:
    """Poses with the outcomes that their scores or further columns state; None: their own."""
    if outcome is None:
        return poses
    values = {"score": poses.scores, **poses.columns}
    found = outcomes_of(outcome, poses.count, values, values.__getitem__)
    return replace(poses, outcome=found)


def _named(name: str, names: list[str]) -> str:
    """The name or the path that is meant. Raises ContactError."""
    found = [name] if name in names else [path for path in names if path.endswith(f"/{name}")]
    if len(found) == 1:
        return found[0]
    if found:
        raise ContactError(f"{name!r} names {len(found)} values: give one of {', '.join(found)}")
    listed = ", ".join(names[:MOST_LISTED]) + (", ..." if len(names) > MOST_LISTED else "")
    raise ContactError(f"no outcome is called {name!r}: its grasps have {listed or 'nothing'}")


def _stated(values: Values, name: str) -> Floats:
    """Outcomes of values, nan where they are empty, shape (k,). Raises ContactError."""
    found = []
    for number, value in enumerate(np.asarray(values, dtype=object).tolist(), 1):
        text = "" if value is None else str(value).strip().lower()
        if text not in {"", "nan"} and text not in WORDS:
            raise ContactError(
                f"grasp {number}: {name} must be 1 or true (it held), 0 or false (it failed), or "
                f"empty (not tried); got {described(value)}"
            )
        found.append(WORDS.get(text, math.nan))
    return np.array(found, dtype=np.float64)
