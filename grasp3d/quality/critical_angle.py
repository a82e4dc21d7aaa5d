"""The critical friction angle: the friction angle above which a grasp is force-closed.

beta* = max over u of min_i phi_i(u) - pi / 2, where u is an infinitesimal motion of the object,
g_i = u_f + u_tau x p_i its velocity at contact i, and phi_i(u) the angle between g_i and the
normal of contact i. A grasp is force-closed exactly when the friction angle exceeds beta*.

Force closure itself is decided with certificates, which epsilon has as well.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property, partial
from typing import Any

import numpy as np

from grasp3d._kernels.hull import growing_hull
from grasp3d._kernels.hull.wrench_problem import SIGN, Bracket, Results
from grasp3d._kernels.search.coplanar_contacts import critical_of_three, make_plane
from grasp3d.arrays import (
    RIGHT_ANGLE,
    ArrayLike,
    Bools,
    Bytes,
    Floats,
    Ints,
    angles_between,
    shaped,
    short_repr,
    unit_rows,
)
from grasp3d.contact.contacts import Contacts, centred, tangents
from grasp3d.errors import SettingError
from grasp3d.quality.wrench_problem import WrenchProblem
from grasp3d.quality.wrenches import EpsilonOptions, read_only


class Status(IntEnum):
    """How a computation ended."""

    CONVERGED = growing_hull.CONVERGED
    """Within the requested tolerance."""
    UNDECIDED = growing_hull.UNDECIDED
    """Force closure is not decided: the hull contains no ball of 1e-8 of the largest wrench, and no
    direction was found in which wrenches reach at most 1e-12 of it; or tilts exceed friction (see
    `cone_offset`)."""
    STALLED = growing_hull.STALLED
    """Rounding errors stopped the search; the interval is valid."""
    EXHAUSTED = growing_hull.EXHAUSTED
    """The hull needed too much memory; the interval reached so far is valid."""


@dataclass(frozen=True, eq=False)
class Certificate:
    """Proof of a result that linear algebra can verify."""

    _direct: Callable[[], Floats]
    """Computes `direction`."""
    _balance: Callable[[], Floats]
    """Computes `equilibrium`."""

    __repr__ = short_repr

    @cached_property
    def direction(self) -> Floats:
        """Unit direction, shape (..., 6), computed when it is first read.

        If the grasp is not force-closed, the direction separates it from the origin: no wrench of
        any contact has a positive component along it. If it is, the disturbance that is hardest to
        resist acts against the direction: there the support function of the grasp wrench space is
        `upper`. In a `ForceClosure` it is meaningful only where the grasp is not force-closed.
        """
        return self._direct()

    @cached_property
    def equilibrium(self) -> Floats:
        """Forces in equilibrium, computed when they are first read.

        If the grasp is force-closed, nonzero forces in equilibrium, each inside its friction cone,
        shape (..., n, 4): force along x, y, z, and torsional moment about the normal [m]. For given
        wrenches, their weights, shape (..., n). nan where not force-closed, and where `cone_offset`
        makes cones of 90 degrees or more. Copies and pickles contain the forces.
        """
        return self._balance()

    def __reduce__(self) -> tuple[Any, ...]:
        return Certificate, (
            partial(np.asarray, self.direction), partial(np.asarray, self.equilibrium),
        )  # fmt: skip


def forces_of_components(
    contacts: Contacts, components: Floats, order: Ints | None = None
) -> Floats:
    """Forces along x, y, z and moments from components along the contacts' axes.

    Args:
        contacts: The contacts.
        components: Shape (b, p, 4).
        order: The contact of each row of components, as from `Contacts.by_finger`, shape (p,);
            None: one row for each contact.

    Returns:
        Forces and torsional moments, shape (b, n, 4).
    """
    if order is not None:
        rows, components = components, np.zeros((len(components), contacts.count, 4))
        for row, contact in enumerate(order):
            components[:, contact] += rows[:, row]
    normals = contacts.normals.reshape(*components.shape[:2], 3)
    axes = np.stack([normals, *tangents(normals)], axis=-2)  # (b, n, 3, 3)
    forces = (components[..., None, :3] @ axes)[..., 0, :]
    twist = components[..., 3] * contacts.torsion_radius.reshape(components.shape[:2])
    return np.concatenate([forces, twist[..., None]], axis=-1)


@dataclass(frozen=True, eq=False)
class ForceClosure:
    """Force closure of grasps."""

    closed: Bools
    """Whether the grasp is force-closed, shape (...)."""
    rank: Ints
    """Dimension of the span of the grasp's wrenches, shape (...)."""
    status: Bytes
    """`Status` codes, shape (...)."""
    certificate: Certificate

    __repr__ = short_repr


def closure_fields(
    problem: WrenchProblem,
    results: Results,
    batch: tuple[int, ...],
    forces_of: Callable[[Floats], Floats],
    directions_of: Callable[[Floats], Floats] = np.asarray,
) -> dict[str, Any]:
    """Fields of `ForceClosure`.

    Args:
        problem: The wrench spaces of a flat batch.
        results: Their results.
        batch: Shape of the batch.
        forces_of: Converts balanced forces along the contacts' axes.
        directions_of: Converts the directions of results.
    """
    return {
        "closed": shaped(results.closed, batch),
        "rank": shaped(results.rank, batch),
        "status": shaped(results.status, batch),
        "certificate": Certificate(
            lambda: shaped(directions_of(results.direction), batch),
            lambda: shaped(forces_of(problem.balanced_forces(results.closed)), batch),
        ),
    }


def force_closure(
    contacts: Contacts,
    *,
    edges: int | None = None,
    cone_offset: ArrayLike = 0.0,
    phase: float = 0.0,
) -> ForceClosure:
    """Whether grasps resist every wrench in the span of their own wrenches, with certificates.

    A grasp is force-closed if its wrench space contains a ball about the origin with a radius of
    1e-8 of the largest wrench. It surely is not if in some direction no wrench reaches farther than
    1e-12 of that. Cases in between are undecided, and count as not force-closed.

    The result depends neither on the centre of mass nor on a torque scale; the direction of the
    certificate is that for a torque scale of 1.

    Args:
        contacts: The contacts.
        edges: Edges of polygonal friction cones; None: circular cones.
        cone_offset: Angle added to the cones' half-angles [rad], one value or shape (..., n); where
            one becomes negative, tilts exceed friction, and nothing is decided.
        phase: As in `epsilon`.

    Raises:
        SettingError: A setting outside its range.

    Example:
        Two opposing fingers, and two that push in the same direction:

        >>> import grasp3d
        >>> points = [[-1, 0, 0], [1, 0, 0]]
        >>> normals = [[[1, 0, 0], [-1, 0, 0]], [[1, 0, 0], [1, 0, 0]]]
        >>> found = grasp3d.force_closure(grasp3d.Contacts([points, points], normals))
        >>> found.closed.tolist(), found.rank.tolist()
        ([True, False], [5, 5])
    """
    points, mean, size = centred(contacts.points)  # far from the origin precision is lost
    scaled = contacts.of_size(points, size[..., 0, 0])
    problem = WrenchProblem.of_contacts(
        scaled, EpsilonOptions(edges), cone_offset=cone_offset, phase=phase
    )

    def about_origin(directions: Floats) -> Floats:
        forces, torques = directions[:, :3], directions[:, 3:] / size.reshape(-1, 1)
        forces = forces - np.cross(torques, mean.reshape(-1, 3))
        return unit_rows(np.concatenate([forces, torques], axis=1))

    forces_of, results = partial(forces_of_components, contacts), problem.solve(SIGN)
    fields = closure_fields(problem, results, contacts.batch, forces_of, about_origin)
    return ForceClosure(**fields)


TORQUE_SCALE = 10.0
"""Torque scale of hulls that must contain a ball, in extents of the contacts: the larger, the
smaller the forces of the ball's wrenches."""


def critical_friction_angle(contacts: Contacts, *, tolerance: float = 1e-4) -> Floats:
    """Friction angle above which a grasp is force-closed.

    Two contacts have a closed form. For more the angle is bracketed by closure tests: three can be
    in equilibrium only in the plane through them, where six planar wrenches decide closure (Ponce &
    Faverjon 1995); for more see `angle_brackets`. Friction and torsion of the contacts have no
    effect.

    Args:
        contacts: The contacts.
        tolerance: Three contacts and more: width of the bracket [rad]; its upper end is returned.

    Returns:
        Angles [rad], shape (...). 0 where the grasp is force-closed without friction. For two
        contacts up to pi; for more, pi/2 where no friction makes the grasp force-closed. inf for
        one contact, where no forces are in equilibrium.

    Raises:
        SettingError: The tolerance is not above 0.

    Example:
        The second of two opposing fingers is beside the line of the first:

        >>> import numpy as np
        >>> import grasp3d
        >>> contacts = grasp3d.Contacts([[-1, 0, 0], [1, 0.6, 0]], [[1, 0, 0], [-1, 0, 0]])
        >>> print(f"{np.degrees(grasp3d.critical_friction_angle(contacts)):.1f} degrees")
        16.7 degrees
    """
    check_tolerance(tolerance)
    points = contacts.points.reshape(-1, contacts.count, 3)
    normals = contacts.normals.reshape(points.shape)
    if contacts.count == 1:
        angles = np.full(len(points), math.inf)
    elif contacts.count == 2:
        angles = _of_pairs(points, normals)
    else:
        _, angles = brackets_of_smooth(points, normals, tolerance)
    return shaped(angles, contacts.batch)


def check_tolerance(tolerance: float) -> None:
    """Raise SettingError unless the width of a bracket is above 0."""
    if not tolerance > 0.0:
        raise SettingError(f"tolerance must be above 0; got {tolerance}")


def _of_pairs(points: Floats, normals: Floats) -> Floats:
    """Closed form of two contacts: the better of squeezing and expanding."""
    line = points[:, 1] - points[:, 0]
    squeeze = np.maximum(angles_between(normals[:, 0], line), angles_between(normals[:, 1], -line))
    expand = np.maximum(angles_between(normals[:, 0], -line), angles_between(normals[:, 1], line))
    # Contacts at the same point push along any line; the best one lies midway.
    coincident = angles_between(normals[:, 0], -normals[:, 1]) / 2.0
    return np.where((line == 0.0).all(axis=1), coincident, np.minimum(squeeze, expand))


def brackets_of_smooth(points: Floats, normals: Floats, tolerance: float) -> tuple[Floats, Floats]:
    """Brackets of the critical friction angles of three contacts and more, (low, high), (b,) each.

    Args:
        points: Shape (b, n, 3).
        normals: Inward unit normals, shape (b, n, 3).
        tolerance: Width of the brackets [rad].
    """
    ends = np.empty((2, len(points)))
    left = np.arange(len(points))
    if points.shape[1] == 3:  # in the plane through them
        # Scaled by powers of 2, which keeps the differences of nearby points exact.
        _, _, size = centred(points)
        scaled = np.ldexp(points, -np.frexp(size)[1])
        critical_of_three(
            scaled, read_only(normals, normals.shape), tolerance, make_plane(), ends[1]
        )
        ends[0] = np.maximum(ends[1] - tolerance, 0.0)
        left = np.flatnonzero(np.isnan(ends[1]))  # on one line
    if len(left):
        ends[:, left] = angle_brackets(
            points[left], normals[left], np.zeros(points[left].shape[:2]), tolerance=tolerance
        )
    return ends[0], ends[1]


def angle_brackets(
    points: Floats,
    normals: Floats,
    wider: Floats,
    *,
    first: Floats | None = None,
    displacement: Floats | None = None,
    tolerance: Floats | float,
) -> tuple[Floats, Floats]:
    """Friction angles up to which grasps are surely open, and from which they are surely closed.

    They are found by bisection with closure tests: the direction that a test ends with separates
    the grasp up to an angle that may raise the lower end. Where closure is undecided at some
    angles, the ends are farther apart than the tolerance.

    Args:
        points: Contact points, n >= 3, shape (b, n, 3).
        normals: Inward unit normals, shape (b, n, 3).
        wider: Angle by which the cone of each contact exceeds the friction angle [rad], shape
            (b, n). No angle at which a cone would be negative or of 90 degrees is tested.
        first: Angles that are tested first [rad], shape (b,); None: the middle ones.
        displacement: Distance by which every contact may move, in any direction, while closed
            grasps stay force-closed, shape (b,). If a contact moves by d, its torque changes by up
            to d times its force, so its support function falls by at most d |u_tau|, and the hull
            must contain a ball of radius d / rho, where rho is the torque scale.
        tolerance: Width of the brackets [rad], shape (b,) or one for all; inf: only one angle is
            tested.

    Returns:
        (low, high), from 0 to pi/2, shape (b,) each: pi/2 less the widest of `wider` where the
        grasp is closed at no angle, 0 where it is open at none.
    """
    points, _, size = centred(points)
    low = np.clip(-wider.min(axis=1), 0.0, RIGHT_ANGLE)
    high = np.clip(RIGHT_ANGLE - wider.max(axis=1), low, RIGHT_ANGLE)
    middle = 0.5 * (low + high)
    first = middle if first is None else np.where((first > low) & (first < high), first, middle)
    scale, radius = 1.0, np.zeros(len(points))
    if displacement is not None:
        scale, radius = TORQUE_SCALE, displacement / (TORQUE_SCALE * size[:, 0, 0])
    width = np.full(len(points), tolerance, dtype=np.float64)
    bracket = Bracket(low, high.copy(), first, width, np.ascontiguousarray(wider), radius)
    WrenchProblem.at_any_angle(points, normals, scale).narrow(bracket)
    # A grasp closed only just below the last possible angle is closed at no angle.
    return np.maximum(bracket.low, 0.0), np.minimum(bracket.high, high)
