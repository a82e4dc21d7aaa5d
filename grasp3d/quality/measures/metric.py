"""What a quality measure is, and the values of one for a batch of grasps."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from grasp3d.arrays import Bools, Floats

Better = Literal["larger", "smaller"]
"""Which values of a measure are better."""

Unit = Literal["", "length", "length²", "rad", "N"]
"""Unit of a measure; '': it has none."""

Texts = npt.NDArray[Any]
"""Texts, shape (b,)."""

NO_EQUILIBRIUM = "no forces of the fingers are in equilibrium"
"""Why measures of internal forces are undefined."""

AT_ONE_POINT = "all contacts are at one point"
"""Why measures of forces and of directions are undefined."""


@dataclass(frozen=True)
class Measured:
    """Values of one measure; nan where it is undefined, with the reason."""

    values: Floats
    """Shape (b,)."""
    reasons: Texts
    """Shape (b,); '' where the value is defined."""

    @classmethod
    def of(cls, values: Floats, *undefined: tuple[Bools, str]) -> "Measured":
        """Values with the masks where they are undefined; the first reason that applies counts."""
        found = np.array(values, dtype=np.float64)
        reasons = np.full(found.shape, "", dtype=object)
        for mask, text in reversed(undefined):
            found[mask], reasons[mask] = np.nan, text
        return cls(found, reasons)


@dataclass(frozen=True)
class Metric:
    """Description of a quality measure.

    Example:
        >>> from grasp3d.quality import METRICS
        >>> metric = METRICS["grasp_isotropy"]
        >>> metric.better, metric.least, metric.most, metric.source
        ('larger', 0.0, 1.0, 'Kim et al. 2001')
    """

    name: str
    """Name of the column, such as 'min_weight'."""
    term: str
    """Standard term."""
    text: str
    """What it measures, in a sentence."""
    formula: str
    """In LaTeX, with the symbols of the documentation."""
    source: str
    """Authors and year; the documentation lists the papers."""
    better: Better
    """Which values are better."""
    torsion: str
    """What it does with the torsional moment of soft fingers."""
    least: float = 0.0
    """Lower end of its range."""
    most: float = math.inf
    """Upper end of its range."""
    unit: Unit = ""
    """Lengths are in the unit of the contacts."""
    fingers: int = 2
    """Smallest number of fingers for which it is defined."""
    of_wrench: bool = False
    """Whether it is that of a given wrench."""
    measure: Callable[..., Any] = field(kw_only=True, repr=False, compare=False)
    """The function of the package that computes it."""
