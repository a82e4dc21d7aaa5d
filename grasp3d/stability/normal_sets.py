"""Sets of normals of contacts on creases and corners, and critical angles over all of them.

A set holds all normals between those of the faces that meet there.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from grasp3d._kernels.hull.wrench_problem import SIGN
from grasp3d._kernels.search.coplanar_contacts import critical_of_sets, make_plane
from grasp3d._kernels.surface.surface_contacts import order_normal_sets
from grasp3d.arrays import RIGHT_ANGLE, ArrayLike, Bools, Floats, Ints, angles_between, unit_rows
from grasp3d.contact.contacts import Contacts
from grasp3d.contact.friction_cones import on_arcs
from grasp3d.errors import ContactError
from grasp3d.quality.closure import Status
from grasp3d.quality.critical_angle import critical_friction_angle
from grasp3d.quality.wrench_problem import WrenchProblem
from grasp3d.quality.wrenches import EpsilonOptions
from grasp3d.stability.enumeration import GOLDEN_RATIO

STEP = math.radians(5.0)
"""Width of the caps that contain groups of sampled normals [rad]; see `sampled_set`."""

MIN_WIDTH = 1e-9
"""Width of a set below which it is sampled by a single normal [rad]."""

Creases = dict[int, Floats]
"""For contacts on creases, by number, the unit normals of the faces that meet there, (b, k, 3)."""

WorstAndBest = tuple[Floats, Floats]
"""Critical friction angles over the worst and over the best normals [rad]."""


def face_normals(creases: Mapping[int, ArrayLike], contacts: Contacts) -> Creases:
    """Check the normals of faces that meet at contacts, and broadcast them to a flat batch.

    Args:
        creases: For contacts on creases, by number, inward normals of shape (..., k, 3), or
            (k, 3) for every grasp of the batch; k is 2 on a crease and more at a corner.
        contacts: The contacts.

    Returns:
        Corners of convex sets, in order around each; the last is repeated where there are fewer
        than k.

    Raises:
        ContactError: A contact that does not exist, shapes that do not match, normals of length 0,
            or not within a hemisphere.
    """
    if not isinstance(creases, Mapping):
        raise ContactError(
            "creases must map numbers of contacts to normals, as {0: [[1, 0, 0], [0, 1, 0]]}; "
            f"got {type(creases).__name__}"
        )
    return {i: _checked(i, rows, contacts) for i, rows in creases.items()}


def _checked(contact: int, values: ArrayLike, contacts: Contacts) -> Floats:
    if contact not in range(contacts.count):
        raise ContactError(
            f"creases name contact {contact}, but a grasp has contacts 0 to {contacts.count - 1}"
        )
    try:
        normals = np.asarray(values, dtype=np.float64)
        shape = (*contacts.batch, *normals.shape[-2:])
        normals = np.broadcast_to(normals, shape).reshape(-1, *normals.shape[-2:])
    except (TypeError, ValueError) as error:
        raise ContactError(
            f"normals at the crease of contact {contact} must be numbers of shape (k, 3) or "
            f"{(*contacts.batch, 'k', 3)}"
        ) from error
    if normals.ndim != 3 or normals.shape[2] != 3 or normals.shape[1] < 2:
        raise ContactError(
            f"contact {contact}: a crease needs two normals or more, shape (..., k, 3); "
            f"got {np.shape(values)}"
        )
    lengths = np.linalg.norm(normals, axis=2)
    if not (np.isfinite(normals).all() and (lengths > 0.0).all()):
        raise ContactError(f"contact {contact}: a normal at the crease has no direction")
    size, corners = normals.shape[:2]
    rows = unit_rows(normals).reshape(-1, 3)
    counts = np.zeros(size, dtype=np.int64)
    start = np.arange(size + 1) * corners
    order_normal_sets(start, rows, counts, np.zeros((size, 3)), np.zeros(size))
    if (counts == 0).any():
        raise ContactError(
            f"contact {contact}: the crease's normals do not lie within a hemisphere"
        )
    last = np.minimum(np.arange(corners), counts[:, None] - 1)  # (b, k)
    return np.take_along_axis(rows.reshape(normals.shape), last[..., None], axis=1)


def sampled_set(normals: Floats, step: float = STEP) -> Floats:
    """Samples of convex sets of normals (b, k, 3), in groups that caps of width `step` contain.

    Any normal of a set is then a combination, with weights of sum at most 1 / cos(step / 2), of
    samples in one such cap: what holds at all samples, with cones narrower or wider by that factor,
    holds for all normals of the set.

    Args:
        normals: Corners of the sets, in order around each.
        step: Width of the caps [rad], below pi.

    Returns:
        Shape (b, m, 3).
    """
    corners = normals.shape[1]
    if corners == 2:
        widest = float(angles_between(normals[:, 0], normals[:, 1]).max(initial=0.0))
        fractions = np.linspace(0.0, 1.0, max(1, math.ceil(widest / step)) + 1)
        return on_arcs(normals[:, 0], normals[:, 1], fractions)
    middle = unit_rows(normals.sum(axis=1))
    triangles = [
        np.stack([middle, normals[:, i], normals[:, (i + 1) % corners]], axis=1)
        for i in range(corners)
    ]
    weights = _grid_weights(max(_grid_steps(triangle, step) for triangle in triangles))
    own = weights[weights[:, 1] > 0.0]  # the side opposite to corner i belongs to the next triangle
    samples = [_at(triangle, own) for triangle in triangles]
    return np.concatenate([middle[:, None], *samples], axis=1)


def sampled_sets(start: Ints, normals: Floats, step: float) -> tuple[list[Floats], Floats]:
    """Sample many convex sets of normals with different numbers of corners.

    Args:
        start: First row of each set in `normals`, shape (b + 1,).
        normals: Corners of the sets, in order around each; one where it is a single normal.
        step: As in `sampled_set`.

    Returns:
        The samples of each set, (m, 3), and the widths of the caps that contain groups of them,
        at most `step`, shape (b,); 0 for a single normal.
    """
    first, corners = start[:-1], np.diff(start)
    steps = np.zeros(len(first))
    samples = [normals[k : k + 1] for k in first]
    arcs = np.flatnonzero(corners == 2)
    begin, end = normals[first[arcs]], normals[first[arcs] + 1]
    widths = angles_between(begin, end)
    divisions = np.where(widths > MIN_WIDTH, np.ceil(widths / step), 0.0).astype(np.int64)
    for division in np.unique(divisions[divisions > 0]):
        group = np.flatnonzero(divisions == division)
        steps[arcs[group]] = widths[group] / division
        fractions = np.linspace(0.0, 1.0, division + 1)
        on_chosen = on_arcs(begin[group], end[group], fractions)
        for k, rows in zip(arcs[group], on_chosen, strict=True):
            samples[k] = rows
    for k in np.flatnonzero(corners > 2):
        samples[k] = sampled_set(normals[None, start[k] : start[k + 1]], step)[0]
        steps[k] = step
    return samples, steps


def _grid_steps(triangle: Floats, step: float) -> int:
    """Divisions of the sides of triangles (b, 3, 3) so that each grid triangle fits into a cap."""
    # Jung's theorem on the sphere: triangles with shorter sides fit into a cap of that width.
    longest = 2.0 * math.asin(math.sqrt(3.0) / 2.0 * math.sin(step / 2.0))
    sides = angles_between(triangle, np.roll(triangle, 1, axis=1))
    steps = max(1, math.ceil(float(sides.max(initial=0.0)) / longest))
    while (widest := _longest_grid_side(triangle, steps)) > longest:
        steps = max(steps + 1, math.floor(steps * widest / longest))
    return steps


def _longest_grid_side(triangle: Floats, steps: int) -> float:
    """Largest angle between neighbours on the grids of triangles (b, 3, 3)."""
    weights = _grid_weights(steps)
    largest = 0.0
    for i in range(3):
        shift = (np.eye(3)[i] - np.eye(3)[i - 1]) / steps
        ends = weights[weights[:, i - 1] > 0.5 / steps]
        sides = angles_between(_at(triangle, ends), _at(triangle, ends + shift))
        largest = max(largest, float(sides.max(initial=0.0)))
    return largest


def _grid_weights(steps: int) -> Floats:
    """Weights of three corners at the points of an even grid, shape (m, 3)."""
    first, second = np.indices((steps + 1, steps + 1)).reshape(2, -1)
    rows = np.stack([first, second, steps - first - second], axis=1)
    return rows[rows[:, 2] >= 0] / steps


def _at(corners: Floats, weights: Floats) -> Floats:
    return unit_rows(np.einsum("mk,bkc->bmc", weights, corners))


@dataclass(frozen=True, eq=False)
class NormalSamples:
    """Sampled normals of the contacts of grasps, to be combined in every way."""

    normals: Floats
    """Shape (m, 3)."""
    first: Ints
    """First row of each contact's normals, shape (b, n)."""
    sizes: Ints
    """Number of normals of each contact, shape (b, n)."""
    steps: Floats
    """Largest step between the samples of a grasp [rad], shape (b,); see `sampled_set`."""

    @classmethod
    def of_sets(cls, start: Ints, normals: Floats, count: int, step: float) -> "NormalSamples":
        """Sample the sets of grasps' contacts.

        Args:
            start: First row of each contact's set in `normals`, shape (b * count + 1,).
            normals: Corners of the sets, in order around each; one where the surface is smooth.
            count: Number of contacts of a grasp.
            step: Largest step between samples [rad], as in `sampled_set`.
        """
        numbers, first = _distinct_sets(start, normals)
        chosen = np.concatenate([start[:0], *(np.arange(start[k], start[k + 1]) for k in first)])
        chosen_start = np.concatenate([[0], np.cumsum(np.diff(start)[first])]).astype(np.int64)
        samples, steps = sampled_sets(chosen_start, normals[chosen], step)
        sizes = np.array([len(rows) for rows in samples], dtype=np.int64)
        first_rows = np.cumsum(sizes) - sizes
        return cls(
            normals=np.concatenate([np.zeros((0, 3)), *samples]),
            first=first_rows[numbers].reshape(-1, count),
            sizes=sizes[numbers].reshape(-1, count),
            steps=steps[numbers].reshape(-1, count).max(axis=1),
        )

    @property
    def combinations(self) -> Floats:
        """Number of combinations of normals of each grasp, shape (b,)."""
        return np.asarray(self.sizes.astype(np.float64).prod(axis=1))

    def take(self, which: Ints) -> "NormalSamples":
        """The samples of chosen grasps."""
        return replace(
            self, first=self.first[which], sizes=self.sizes[which], steps=self.steps[which]
        )

    def at(self, grasps: Ints, numbers: Ints) -> Floats:
        """Normals of grasps (m,), each at its combination number (m,), shape (m, n, 3)."""
        choices = np.empty((len(grasps), self.sizes.shape[1]), dtype=np.int64)
        for i in range(choices.shape[1]):
            numbers, choices[:, i] = np.divmod(numbers, self.sizes[grasps, i])
        return np.asarray(self.normals[self.first[grasps] + choices])


def _distinct_sets(start: Ints, normals: Floats) -> tuple[Ints, Ints]:
    """(index of each set among the distinct ones (b,), first set of each index (d,))."""
    numbers: dict[bytes, int] = {}
    first: list[int] = []
    indices = np.empty(len(start) - 1, dtype=np.int64)
    for k in range(len(indices)):
        key = normals[start[k] : start[k + 1]].tobytes()
        if key not in numbers:
            numbers[key] = len(first)
            first.append(k)
        indices[k] = numbers[key]
    return indices, np.array(first, dtype=np.int64)


def angle_bounds(points: Floats, samples: NormalSamples, *, tolerance: float) -> WorstAndBest:
    """Critical friction angles over the worst and over the best of the combinations.

    They include a margin for the normals between the samples (see `sampled_set`), so that they
    are bounds for all normals of the sets.

    Args:
        points: Contact points, n >= 3, shape (b, n, 3).
        samples: Sampled normals of the contacts.
        tolerance: As in `critical_friction_angle` [rad].

    Returns:
        (worst, best), shape (b,) each, from 0 to pi/2: no combination has a larger angle than the
        worst, and none a smaller one than the best.
    """
    problem = _CombinationProblem(points, samples, tolerance / 2.0)
    return _with_margin(*problem.extremes(), samples)


def planar_bounds(points: Floats, samples: NormalSamples, *, tolerance: float) -> WorstAndBest:
    """The bounds of `angle_bounds` for three contacts, computed in the plane through them.

    There the combinations need not be enumerated: the force directions that a contact's normals
    allow are intervals in the plane, of which the first and the last direction are enough.

    Returns:
        (worst, best), shape (b,) each; nan for contacts on one line, which have no plane.
    """
    worst, best = np.empty((2, len(points)))
    critical_of_sets(
        points, samples.first, samples.sizes, samples.normals, tolerance,
        make_plane(int(samples.sizes.max(initial=1))), worst, best,
    )  # fmt: skip
    return _with_margin(worst, best, samples)


def _with_margin(worst: Floats, best: Floats, samples: NormalSamples) -> WorstAndBest:
    """Bounds for all normals of the sets, also between the samples; see `sampled_set`."""
    shrink = np.cos(samples.steps / 2.0)
    sine = np.sin(np.clip(worst, 0.0, RIGHT_ANGLE)) / shrink
    cosine = np.cos(np.clip(best, 0.0, RIGHT_ANGLE)) / shrink
    return np.arcsin(np.minimum(sine, 1.0)), np.arccos(np.minimum(cosine, 1.0))


class _CombinationProblem(NamedTuple):
    """Search for the largest and smallest critical angle among combinations of sampled normals."""

    points: Floats
    """Shape (b, n, 3)."""
    samples: NormalSamples
    tolerance: float

    def extremes(self) -> WorstAndBest:
        """Bounds on the largest and on the smallest angle of each grasp, shape (b,) each."""
        grasps, numbers = self._combinations()
        first = np.flatnonzero(np.diff(grasps, prepend=-1))
        nominal = self.angles(grasps[first], numbers[first])
        others = np.delete(grasps, first), np.delete(numbers, first)
        return self._search(nominal.copy(), *others, 1), self._search(nominal.copy(), *others, -1)

    def _combinations(self) -> tuple[Ints, Ints]:
        """(grasps, numbers) of all combinations, grasp by grasp.

        Those of a grasp start with the middle one and are in an order whose beginnings are spread
        evenly over all of them.
        """
        totals = self.samples.combinations.astype(np.int64)
        grasps = np.repeat(np.arange(len(totals)), totals)
        numbers = np.arange(len(grasps)) - np.repeat(np.cumsum(totals) - totals, totals)
        key = (numbers - totals[grasps] // 2) * GOLDEN_RATIO % 1.0
        return grasps, numbers[np.lexsort((key, grasps))]

    def _search(self, bounds: Floats, grasps: Ints, numbers: Ints, sign: int) -> Floats:
        """Bounds on the largest (sign 1) or smallest (-1) angles, starting from those found.

        A closure test excludes most combinations. Of those with a larger (smaller) angle than found
        so far, the angle of one for each grasp is computed, then the others are tested again.
        """
        while grasps.size:
            limit = np.maximum(bounds, 0.0)[grasps] + sign * self.tolerance
            possible = (limit > 0.0) & (limit < RIGHT_ANGLE)
            grasps, numbers, limit = grasps[possible], numbers[possible], limit[possible]
            closed, failed = self.closed_at(grasps, numbers, limit)
            better = ~failed if sign < 0 else ~closed  # undecided ones are not excluded
            grasps, numbers = grasps[better], numbers[better]
            which, first = np.unique(grasps, return_index=True)
            angles = self.angles(which, numbers[first])
            bounds[which] = sign * np.maximum(sign * bounds[which], sign * angles)
            grasps, numbers = np.delete(grasps, first), np.delete(numbers, first)
        # Add the tolerance, except where no combination is force-closed at any friction.
        never_closed = (sign < 0) & (bounds >= RIGHT_ANGLE)
        return np.where(never_closed, bounds, bounds + sign * self.tolerance)

    def angles(self, grasps: Ints, numbers: Ints) -> Floats:
        """Critical angles of grasps (m,), each at its combination number (m,)."""
        contacts = Contacts(self.points[grasps], self.samples.at(grasps, numbers), friction=0.0)
        return np.array(critical_friction_angle(contacts, tolerance=self.tolerance))

    def closed_at(self, grasps: Ints, numbers: Ints, angles: Floats) -> tuple[Bools, Bools]:
        """Force closure of grasps (m,), each at its combination and friction angle (m,).

        Returns:
            (surely force-closed, surely not force-closed), shape (m,) each.
        """
        contacts = Contacts(self.points[grasps], self.samples.at(grasps, numbers), friction=0.0)
        problem = WrenchProblem.of_contacts(contacts, EpsilonOptions())
        at_angles = problem.at_angles(angles)
        results = at_angles.solve(SIGN, with_forces=False)
        return results.closed, ~results.closed & (results.status != Status.UNDECIDED)
