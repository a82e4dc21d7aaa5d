"""The known measures, with their sources."""

import difflib
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

from grasp3d.errors import SettingError
from grasp3d.quality.measures.formulas import (
    centroid_distance,
    friction_margin,
    grasp_isotropy,
    grasp_matrix_volume,
    internal_force_margin,
    min_weight,
    orthogonality,
    polygon_area,
    polygon_shape,
    smallest_singular_value,
    wrench_resistance,
    wrench_space_volume,
)

Better = Literal["larger", "smaller"]
"""Which values of a measure are better."""

Unit = Literal["", "length", "length²", "rad", "N"]
"""Unit of a measure; '': it has none."""

ALL = "all"
"""Stands for the names of all measures, of those of a wrench only where one is given."""

_COLUMN = "a soft finger adds the column e n of torsional moment per normal force"
_PRIMITIVES = "a soft finger adds its normal force with the moments +e and -e as primitive wrenches"
_NO_TORSION = "torsion does not matter"


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
    better: Better = "larger"
    """Which values are better."""
    torsion: str = _NO_TORSION
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


_ALL_METRICS = (
    Metric(
        "smallest_singular_value",
        "smallest singular value of the grasp matrix",
        "how far the grasp is from one that cannot move the object in some direction",
        r"\sigma_{min}(G)",
        "Li & Sastry 1988",
        torsion=_COLUMN,
        measure=smallest_singular_value,
    ),
    Metric(
        "grasp_matrix_volume",
        "volume of the ellipsoid in the wrench space",
        "how much wrench unit contact forces make in all directions together",
        r"\sqrt{\det(G G^T)} = \prod_k \sigma_k",
        "Li & Sastry 1988",
        torsion=_COLUMN,
        measure=grasp_matrix_volume,
    ),
    Metric(
        "grasp_isotropy",
        "grasp isotropy index",
        "how evenly contact forces contribute to wrenches of all directions",
        r"\sigma_{min}(G) / \sigma_{max}(G)",
        "Kim et al. 2001",
        torsion=_COLUMN,
        most=1.0,
        measure=grasp_isotropy,
    ),
    Metric(
        "wrench_space_volume",
        "volume of the grasp wrench space",
        "volume of the convex hull of the primitive wrenches, whether or not it contains 0",
        r"\operatorname{vol}(\operatorname{conv}\{w_j\})",
        "Miller & Allen 1999",
        torsion=_PRIMITIVES,
        measure=wrench_space_volume,
    ),
    Metric(
        "min_weight",
        "min-weight metric",
        "largest smallest weight with which the primitive wrenches combine to 0; above 0 exactly "
        "if the grasp with these polygonal cones is force-closed",
        r"\max_c \min_j c_j, \sum_j c_j w_j = 0, \sum_j c_j = 1",
        "Li et al. 2023",
        torsion=_PRIMITIVES,
        least=-math.inf,
        most=1.0,
        measure=min_weight,
    ),
    Metric(
        "internal_force_margin",
        "margin of internal forces",
        "largest distance of forces in equilibrium from the borders of the polygonal friction "
        "cones, their normal components being 1 together; below 0 they must leave the cones",
        r"\max_f \min_{i,k} d_k(f_i), \sum_i G_i f_i = 0, \sum_i n_i \cdot f_i = 1",
        "Kerr & Roth 1986",
        torsion="a soft finger may use torsion, which takes |moment|/e from its normal force",
        least=-math.inf,
        most=0.5,
        measure=internal_force_margin,
    ),
    Metric(
        "friction_margin",
        "margin of the friction angle",
        "largest smallest angle between forces in equilibrium and the borders of their circular "
        "friction cones",
        r"\beta - \beta^*",
        "Wan & Howe 2018",
        least=-math.pi,
        most=math.pi,
        unit="rad",
        measure=friction_margin,
    ),
    Metric(
        "centroid_distance",
        "distance between the grasp's centroid and the centre of mass",
        "lever arm of weight and inertia",
        r"\lVert \frac{1}{n} \sum_i p_i \rVert",
        "Ding et al. 2001",
        better="smaller",
        unit="length",
        measure=centroid_distance,
    ),
    Metric(
        "polygon_area",
        "area of the grasp polygon",
        "area of the polygon of the contacts, in the plane nearest to them",
        r"\operatorname{area}(p_1 \dots p_n)",
        "Mirtich & Canny 1994",
        unit="length²",
        fingers=3,
        measure=polygon_area,
    ),
    Metric(
        "polygon_shape",
        "shape of the grasp polygon",
        "difference of its inner angles from those of the regular polygon; 0: regular, 1: a line",
        r"\frac{1}{\theta_{max}} \sum_i \lvert \theta_i - \bar\theta \rvert",
        "Kim et al. 2001",
        better="smaller",
        most=1.0,
        fingers=3,
        measure=polygon_shape,
    ),
    Metric(
        "orthogonality",
        "orthogonality",
        "angle from the grasp's axis to the nearest of parallel and orthogonal to the object's "
        "longest principal axis; the grasp's axis is the line through the contacts, of three and "
        "more the normal of their plane",
        r"\min(\delta, \frac{\pi}{2} - \delta)",
        "Balasubramanian et al. 2012",
        better="smaller",
        most=math.pi / 4.0,
        unit="rad",
        measure=orthogonality,
    ),
    Metric(
        "wrench_resistance",
        "wrench resistance",
        "smallest normal force of every finger with which circular friction cones resist a given "
        "wrench, as `grip_force` finds it; the fingers may press less than that",
        r"\min\{t : -w \in t \, W\}",
        "Mahler et al. 2019",
        better="smaller",
        torsion="soft fingers have the elliptic limit surface",
        unit="N",
        of_wrench=True,
        measure=wrench_resistance,
    ),
)

METRICS: Mapping[str, Metric] = {metric.name: metric for metric in _ALL_METRICS}
"""Known quality measures by name, in the order of tables."""


def metric_names(names: str | Sequence[str], *, of_wrench: bool = False) -> tuple[str, ...]:
    """Names of known measures.

    Args:
        names: 'all', names in a list, or separated by commas in one text.
        of_wrench: Whether 'all' includes the measures of a given wrench.

    Returns:
        Each name once, in the order in which it was given; of 'all', that of `METRICS`.

    Raises:
        SettingError: A name that is not known, or none at all.

    Example:
        >>> from grasp3d.quality import metric_names
        >>> metric_names("min_weight, grasp_isotropy")
        ('min_weight', 'grasp_isotropy')
    """
    words = names.split(",") if isinstance(names, str) else list(names)
    parts = [str(name).strip() for name in words]
    everything = [metric.name for metric in _ALL_METRICS if of_wrench or not metric.of_wrench]
    wanted = [name for part in parts for name in (everything if part == ALL else [part])]
    if not any(wanted):
        raise SettingError(f"no metric is named; known: {ALL}, {', '.join(METRICS)}")
    for name in wanted:
        if name not in METRICS:
            near = difflib.get_close_matches(name, METRICS, 1)
            hint = f"did you mean {near[0]}? " if near else ""
            raise SettingError(
                f"no metric is called {name!r}; {hint}known: {ALL}, {', '.join(METRICS)}"
            )
    return tuple(dict.fromkeys(wanted))
