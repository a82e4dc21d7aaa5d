"""Quality measures of contacts, all in one table."""

import difflib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
import numpy.typing as npt

from grasp3d.arrays import ArrayLike, Floats, Ints, locked, shaped, short_repr
from grasp3d.contact.contacts import Contacts
from grasp3d.contact.friction_cones import edge_angles
from grasp3d.errors import SettingError
from grasp3d.quality.measures.formulas import METRICS
from grasp3d.quality.measures.geometry import GraspGeometry, Measured, Metric
from grasp3d.quality.wrenches import check_torque_scale

ALL = "all"
"""Stands for the names of all measures."""

UNDEFINED = "undefined_metrics"
"""Column of a table with the reasons why measures are undefined."""


def metric_names(names: str | Sequence[str]) -> tuple[str, ...]:
    """Names of known measures.

    Args:
        names: 'all', names in a list, or separated by commas in one text.

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
    keys = [name for part in parts for name in (METRICS if part == ALL else [part])]
    if not any(keys):
        raise SettingError(f"no metric is named; known: {ALL}, {', '.join(METRICS)}")
    for name in keys:
        if name not in METRICS:
            near = difflib.get_close_matches(name, METRICS, 1)
            hint = f"did you mean {near[0]}? " if near else ""
            raise SettingError(
                f"no metric is called {name!r}; {hint}known: {ALL}, {', '.join(METRICS)}"
            )
    return tuple(dict.fromkeys(keys))


@dataclass(frozen=True, eq=False)
class MetricValues:
    """Values of quality measures, one for each grasp; nan where undefined, with the reason.

    Example:
        >>> import grasp3d
        >>> from grasp3d.quality import metrics
        >>> contacts = grasp3d.Contacts([[-1, 0, 0], [1, 0, 0]], [[1, 0, 0], [-1, 0, 0]])
        >>> found = metrics(contacts, "grasp_isotropy,polygon_area")
        >>> print(found["grasp_isotropy"].round(6), found["polygon_area"], found.rank)
        1.0 nan 5
        >>> print(found.reasons["polygon_area"])
        needs 3 fingers, has 2
    """

    values: Mapping[str, Floats]
    """Values by name, of the shape of the batch each; a number for one grasp."""
    reasons: Mapping[str, npt.NDArray[np.str_]]
    """Why values are undefined, of that shape; '' where they are defined."""
    rank: Ints
    """Rank of the grasp matrix, of that shape: 5 for hard fingers on a line, mostly 6. Singular
    values and volumes of different rank are not comparable."""

    __repr__ = short_repr

    def __post_init__(self) -> None:
        for name in ("values", "reasons"):
            object.__setattr__(self, name, MappingProxyType(dict(getattr(self, name))))

    def __getitem__(self, name: str) -> Floats:
        return self.values[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.values)

    def __len__(self) -> int:
        return len(self.values)

    @property
    def descriptions(self) -> tuple[Metric, ...]:
        """What each measure is, in the order of `values`."""
        return tuple(METRICS[name] for name in self.values)

    @classmethod
    def undefined(cls, names: str | Sequence[str], size: int, reason: str) -> "MetricValues":
        """Measures of grasps that have none, for one reason, shape (size,) each."""
        keys = metric_names(names)
        return cls(
            {name: locked(np.full(size, np.nan)) for name in keys},
            {name: locked(np.full(size, reason)) for name in keys},
            locked(np.zeros(size, dtype=np.int64)),
        )

    def placed(self, rows: Ints, size: int, reason: str) -> "MetricValues":
        """These values (k,) in the given rows of a table; nan and the reason in the others.

        Args:
            rows: Numbers of the rows, shape (k,).
            size: Number of rows of the table.
            reason: Why the others have no values.
        """
        table = self.undefined(tuple(self), size, reason)
        values = {name: np.array(table[name]) for name in self}
        reasons = {name: table.reasons[name].astype(object) for name in self}
        rank = np.array(table.rank)
        rank[rows] = self.rank
        for name in self:
            values[name][rows] = self[name]
            reasons[name][rows] = self.reasons[name]
        return MetricValues(
            {name: locked(column) for name, column in values.items()},
            {name: locked(texts, np.str_) for name, texts in reasons.items()},
            locked(rank),
        )

    def take(self, rows: Ints) -> "MetricValues":
        """The chosen rows."""
        return MetricValues(
            {name: locked(self[name][rows]) for name in self},
            {name: locked(self.reasons[name][rows]) for name in self},
            locked(self.rank[rows]),
        )

    def columns(self) -> dict[str, npt.NDArray[Any]]:
        """Columns of a table with a row for each grasp: the values, and `undefined_metrics`.

        That column has the reasons, as 'name: reason; name: reason'.
        """
        flat = {name: np.ravel(values) for name, values in self.values.items()}
        reasons = {name: np.ravel(texts).tolist() for name, texts in self.reasons.items()}
        rows = zip(*reasons.values(), strict=True)
        undefined = [
            "; ".join(f"{name}: {text}" for name, text in zip(reasons, row, strict=True) if text)
            for row in rows
        ]
        return {**flat, UNDEFINED: np.array(undefined, dtype=np.str_)}


def metrics(
    contacts: Contacts,
    names: str | Sequence[str] = "all",
    *,
    torque_scale: float = 1.0,
    edges: int = 8,
    principal_axis: ArrayLike | None = None,
    tolerance: float = 1e-4,
) -> MetricValues:
    """Quality measures of the literature; `METRICS` has their formulas, sources and ranges.

    Singular values and the volume of the wrench space are those in the span of the grasp, as
    epsilon is. Measures of force closure alone (`min_weight`, `internal_force_margin`,
    `friction_margin`) depend neither on the centre of mass nor on the torque scale.

    Args:
        contacts: Point contacts.
        names: 'all', names of `METRICS` in a list, or separated by commas in one text.
        torque_scale: Length that torques are divided by [mesh unit]; with
            `ObjectMesh.torque_scale` only lengths and areas depend on the unit.
        edges: Edges of the polygonal friction cones of `wrench_space_volume`, `min_weight` and
            `internal_force_margin`; about the normal they lie as those of `epsilon`.
        principal_axis: Direction of the object's longest principal axis for `orthogonality`,
            shape (3,) or (..., 3); None or nan: there is none.
        tolerance: Largest error of `friction_margin` for three fingers and more [rad]; it is never
            too large.

    Returns:
        Values and reasons by name, of the batch's shape each.

    Raises:
        SettingError: An unknown name, a setting outside its range, or contacts with patches.

    Example:
        Three fingers around a disc of radius 1, at 120 degrees from each other:

        >>> import numpy as np
        >>> import grasp3d
        >>> from grasp3d.quality import metrics
        >>> angle = np.radians([0.0, 120.0, 240.0])
        >>> points = np.stack([np.cos(angle), np.sin(angle), np.zeros(3)], axis=1)
        >>> contacts = grasp3d.Contacts(points, -points, friction=0.5)
        >>> found = metrics(contacts, ["polygon_shape", "polygon_area", "internal_force_margin"])
        >>> {name: round(float(found[name]), 3) for name in found}
        {'polygon_shape': 0.0, 'polygon_area': 1.299, 'internal_force_margin': 0.14}
    """
    if contacts.patch is not None:
        raise SettingError(
            "the measures of the literature are those of point contacts; give "
            "contacts.without_patches()"
        )
    keys = metric_names(names)
    check_torque_scale(torque_scale)
    edge_angles(edges)
    batch = contacts.batch
    flat = contacts.reshape((-1,)) if contacts.points.size else contacts.reshape((0,))
    grasps = GraspGeometry(
        flat,
        torque_scale,
        int(edges),
        tolerance,
        _axes_of(principal_axis, batch).reshape(-1, 3),
    )
    measured = {name: _measure(grasps, METRICS[name]) for name in keys}
    return MetricValues(
        {name: shaped(one.values, batch) for name, one in measured.items()},
        {
            name: locked(one.reasons.astype(np.str_).reshape(batch))[()]
            for name, one in measured.items()
        },
        shaped(grasps.rank, batch),
    )


def _measure(grasps: GraspGeometry, metric: Metric) -> Measured:
    """Values of a measure; undefined for too few fingers."""
    if grasps.count < metric.fingers:
        reason = f"needs {metric.fingers} fingers, has {grasps.count}"
        return Measured.undefined(grasps.size, reason)
    if not grasps.size:
        return Measured.of(np.zeros(0))
    values: Measured = metric.measure(grasps)
    return values


def _axes_of(values: ArrayLike | None, batch: tuple[int, ...]) -> Floats:
    """Principal axes of the shape of the batch; nan where there is none."""
    axis = np.full(3, np.nan) if values is None else np.asarray(values, dtype=np.float64)
    try:
        axes = np.broadcast_to(axis, (*batch, 3))
    except ValueError as error:
        raise SettingError(
            f"principal_axis must have shape (3,) or {(*batch, 3)}; got {axis.shape}"
        ) from error
    if np.isinf(axes).any() or (axes == 0.0).all(axis=-1).any():
        raise SettingError("principal_axis must be a direction of finite numbers, or nan")
    return axes
