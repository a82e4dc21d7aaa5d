"""What measures are, take, the geometry of a batch of grasps, and return: values with reasons."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from grasp3d.arrays import Bools, Floats, Ints
from grasp3d.contact.contacts import Contacts, centred
from grasp3d.quality.wrenches import wrench_axes, wrenches

RANK_TOLERANCE = 1e-10
"""Size of a singular value, relative to the largest, from which it adds to the rank."""

SAME_POINT = 1e-12
"""Size of a grasp, relative to its distance from the centre of mass, that is rounding alone."""

Texts = npt.NDArray[Any]
"""Texts, shape (b,)."""

Better = Literal["larger", "smaller"]
"""Which values of a measure are better."""

Unit = Literal["", "length", "length²", "rad"]
"""Unit of a measure; '': it has none."""


class Span(NamedTuple):
    """Orthonormal coordinates of the wrenches' equilibrium conditions."""

    rows: Floats
    """One row for each wrench, shape (b, k, 6): weights x are in equilibrium if x @ rows = 0."""
    sizes: Floats
    """Singular values, descending, shape (b, 6): 0 beyond the rank."""


@dataclass(frozen=True, eq=False)
class GraspGeometry:
    """A flat batch of grasps with the settings of the measures."""

    contacts: Contacts
    """Shape of the batch (b,)."""
    torque_scale: float
    """rho [mesh unit]."""
    edges: int
    """Edges of polygonal friction cones."""
    tolerance: float
    """Largest error of critical friction angles [rad]."""
    principal_axis: Floats
    """Longest principal axis of the object, shape (b, 3); nan: not given."""

    @property
    def size(self) -> int:
        """Number of grasps."""
        return self.contacts.batch[0]

    @property
    def count(self) -> int:
        """Number of fingers."""
        return self.contacts.count

    @cached_property
    def centred_points(self) -> Floats:
        """Contact points relative to their mean, divided by their size, shape (b, n, 3)."""
        return centred(self.contacts.points)[0]

    @cached_property
    def extent(self) -> Floats:
        """Largest distance of a contact from the contacts' mean [mesh unit], shape (b,)."""
        _, mean, _ = centred(self.contacts.points)
        return np.asarray(np.linalg.norm(self.contacts.points - mean, axis=-1).max(axis=-1))

    @cached_property
    def at_one_point(self) -> Bools:
        """Whether all contacts coincide, shape (b,)."""
        reach = np.linalg.norm(self.contacts.points, axis=-1).max(axis=-1)
        return np.asarray(self.extent <= SAME_POINT * reach)

    @cached_property
    def used_axes(self) -> Bools:
        """Which of normal, tangents and torsional moment each contact transmits, (b, n, 4)."""
        mask = np.ones((*self.contacts.friction.shape, 4), dtype=bool)
        mask[..., 1:3] = (self.contacts.friction > 0.0)[..., None]
        mask[..., 3] = self.contacts.torsion_radius > 0.0
        return mask

    @cached_property
    def grasp_matrix(self) -> Floats:
        """Columns of the grasp matrix, one in each row, shape (b, 4 n, 6).

        Wrenches of unit forces along normal and tangents, and of the torsional moment that a unit
        normal force allows; 0 for what a contact does not transmit.
        """
        return self._axes(self.contacts.points, self.contacts.torsion_radius, self.torque_scale)

    @cached_property
    def singular_values(self) -> Floats:
        """Singular values of the grasp matrix, descending, 0 beyond the rank, shape (b, 6)."""
        values = _six(np.asarray(np.linalg.svd(self.grasp_matrix, compute_uv=False)))
        return np.where(np.arange(6) < self.rank[:, None], values, 0.0)

    @cached_property
    def rank(self) -> Ints:
        """Rank of the grasp matrix, shape (b,)."""
        return np.asarray((self.axis_span.sizes > 0.0).sum(axis=1), dtype=np.int64)

    @cached_property
    def axis_span(self) -> Span:
        """Coordinates of the contacts' axes, as those of `grasp_matrix`, for equilibria."""
        return _span(self._axes(self.centred_points, self._relative_torsion, 1.0))

    @cached_property
    def primitives(self) -> Floats:
        """Primitive wrenches of the polygonal cones, shape (b, k, 6); see `wrenches`."""
        return wrenches(self.contacts, edges=self.edges, torque_scale=self.torque_scale)

    @cached_property
    def used_primitives(self) -> Bools:
        """Which primitive wrenches are no mere copies, shape (b, k)."""
        soft = self.contacts.torsion_radius > 0.0
        rows = self.primitives.shape[1] // self.count
        mask = np.ones((self.size, self.count, rows), dtype=bool)
        mask[..., self.edges :] = soft[..., None]
        return mask.reshape(self.size, -1)

    @cached_property
    def primitive_span(self) -> Span:
        """Coordinates of the primitive wrenches; equilibria depend on no centre and no scale."""
        contacts = Contacts(
            self.centred_points,
            self.contacts.normals,
            self.contacts.friction,
            self._relative_torsion,
        )
        rows = wrenches(contacts, edges=self.edges, torque_scale=1.0)
        return _span(np.where(self.used_primitives[..., None], rows, 0.0))

    @property
    def _relative_torsion(self) -> Floats:
        """Torsion radii divided by the size of the grasp, shape (b, n)."""
        size = np.where(self.extent > 0.0, self.extent, 1.0)
        return self.contacts.torsion_radius / size[:, None]

    def _axes(self, points: Floats, torsion_radius: Floats, torque_scale: float) -> Floats:
        axes = wrench_axes(points, self.contacts.normals, torsion_radius, torque_scale)
        return np.where(self.used_axes[..., None], axes, 0.0).reshape(self.size, 4 * self.count, 6)


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
        numbers = np.array(values, dtype=np.float64)
        reasons = np.full(numbers.shape, "", dtype=object)
        for mask, text in reversed(undefined):
            numbers[mask], reasons[mask] = np.nan, text
        return cls(numbers, reasons)

    @classmethod
    def undefined(cls, size: int, reason: str) -> "Measured":
        """No values, for one reason."""
        return cls(np.full(size, np.nan), np.full(size, reason, dtype=object))


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
    torsion: str = "torsion does not matter"
    """What it does with the torsional moment of soft fingers."""
    least: float = 0.0
    """Lower end of its range."""
    most: float = math.inf
    """Upper end of its range."""
    unit: Unit = ""
    """Lengths are in the unit of the contacts."""
    fingers: int = 2
    """Smallest number of fingers for which it is defined."""
    measure: Callable[..., Any] = field(kw_only=True, repr=False, compare=False)
    """The function of the package that computes it."""


def _span(rows: Floats) -> Span:
    """Left singular vectors of wrenches (b, k, 6), forces and torques weighted alike."""
    balanced = np.array(rows)
    for part in (slice(0, 3), slice(3, 6)):
        largest = np.linalg.norm(rows[..., part], axis=-1).max(axis=-1)
        balanced[..., part] /= np.where(largest > 0.0, largest, 1.0)[:, None, None]
    left, sizes, _ = np.linalg.svd(balanced, full_matrices=False)
    inside = sizes > RANK_TOLERANCE * sizes[:, :1]
    return Span(left * inside[:, None], _six(np.where(inside, sizes, 0.0)))


def _six(values: Floats) -> Floats:
    """Pad to six columns with 0."""
    return np.pad(values, ((0, 0), (0, 6 - values.shape[1])))
