"""Epsilon, the grasp quality of Ferrari & Canny, with certified bounds."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from grasp3d.arrays import ArrayLike, Floats, shaped, short_repr
from grasp3d.contact.contacts import LARGEST, Contacts, finite_numbers, per_contact
from grasp3d.errors import ContactError
from grasp3d.quality.critical_angle import (
    ForceClosure,
    Status,
    closure_fields,
    forces_of_components,
)
from grasp3d.quality.wrench_problem import WrenchProblem
from grasp3d.quality.wrenches import Actuation, Bounded, EpsilonOptions, Goal

PLANAR = [0, 1, 5]
"""Indices of the force along x and y and of the torque of a planar wrench among six components."""


@dataclass(frozen=True, eq=False)
class Epsilon(ForceClosure):
    """Radius of the largest ball about the origin in the grasp wrench space.

    Ferrari & Canny 1992. Computed in the span of the grasp's wrenches: values of different rank
    are not comparable.
    """

    lower: Floats
    """Certified lower bound, shape (...); 0 where the grasp is not force-closed."""
    upper: Floats
    """Certified upper bound, shape (...); equal to `lower` for converged polygonal cones."""

    __repr__ = short_repr

    @property
    def value(self) -> Floats:
        """The lower bound."""
        return self.lower


def epsilon(
    contacts: Contacts,
    *,
    edges: int | None = None,
    actuation: Actuation = "total",
    torque_scale: float = 1.0,
    rtol: float = 1e-3,
    cone_offset: ArrayLike = 0.0,
    phase: float = 0.0,
    bounded: Bounded = "force",
) -> Epsilon:
    """Grasp quality of Ferrari & Canny (ICRA 1992).

    Args:
        contacts: The contacts; soft ones have the elliptic limit surface of Howe & Cutkosky 1996.
        edges: Edges of polygonal friction cones; None: circular cones. The pyramid of a soft finger
            also has its pure normal force with the torsional moment in either sense.
        actuation: 'total': all forces together are at most 1 (the hull of the contacts' wrenches);
            'per_finger': all forces of one finger together are at most 1 (the Minkowski sum).
        torque_scale: Length that torques are divided by [m]; `ObjectMesh.torque_scale`
            makes the value independent of the unit.
        rtol: Circular cones: largest difference of the bounds, as a fraction of the upper one.
        cone_offset: Angle added to the cones' half-angles [rad], one value or shape (..., n). For
            hard fingers with circular cones, -a gives exactly the smallest epsilon over all tilts
            of the normals by up to a, and +a a bound on the largest. Where a exceeds the half-angle
            of some cone the lower bound is 0 and the status UNDECIDED. Polygons and the cones of
            soft fingers must stay below 90 degrees.
        phase: Polygons: angle of the first edge about the normal, from the first of
            `contacts.tangents` [rad].
        bounded: 'force': the length of a contact force is at most 1; 'normal': its normal
            component is, as in some packages.

    Returns:
        Bounds, rank and certificate of each grasp of the batch.

    Raises:
        SettingError: A setting outside its range.

    Example:
        Three fingers around a disc of radius 1, at 120 degrees from each other:

        >>> import numpy as np
        >>> import grasp3d
        >>> angle = np.radians([0.0, 120.0, 240.0])
        >>> points = np.stack([np.cos(angle), np.sin(angle), np.zeros(3)], axis=1)
        >>> contacts = grasp3d.Contacts(points, -points, friction=0.5)
        >>> found = grasp3d.epsilon(contacts)
        >>> print(f"{found.lower:.3f} to {found.upper:.3f}, rank {found.rank}, {found.closed}")
        0.264 to 0.264, rank 6, True
        >>> print(f"{grasp3d.epsilon(contacts, edges=8, actuation='per_finger').value:.3f}")
        0.600
    """
    options = EpsilonOptions(edges, actuation, torque_scale, rtol)
    return epsilon_with(contacts, options, cone_offset=cone_offset, phase=phase, bounded=bounded)


def epsilon_with(
    contacts: Contacts,
    options: EpsilonOptions,
    *,
    cone_offset: ArrayLike = 0.0,
    phase: float = 0.0,
    bounded: Bounded = "force",
) -> Epsilon:
    """Compute `epsilon` with its options given as `EpsilonOptions`."""
    order, group = contacts.by_finger()
    if contacts.groups is not None:
        cone_offset = per_contact("cone_offset", cone_offset, contacts)[..., order]
    problem = WrenchProblem.of_contacts(
        contacts.ordered(order), options, cone_offset=cone_offset, phase=phase, bounded=bounded,
        group=group,
    )  # fmt: skip
    forces_of = partial(forces_of_components, contacts, order=order)
    return _solved(problem, options.goal, contacts.batch, forces_of)


def epsilon_of_wrenches(wrenches: ArrayLike) -> Epsilon:
    """Epsilon of the convex hull of given wrenches.

    Args:
        wrenches: Shape (..., n, 6), or (..., n, 3) in the plane: force along x and y, torque.

    Returns:
        Bounds, rank and certificate; directions have 6 components, planar ones
        (u_x, u_y, 0, 0, 0, u_tau).

    Raises:
        ContactError: Another shape, or values that are not finite.

    Example:
        The corners of an octahedron, in the plane: forces along x and y, and torques:

        >>> import numpy as np
        >>> import grasp3d
        >>> wrenches = np.concatenate([np.eye(3), -np.eye(3)])
        >>> print(f"{grasp3d.epsilon_of_wrenches(wrenches).value:.4f}")
        0.5774
    """
    rows = finite_numbers("wrenches", wrenches, most=LARGEST)
    if rows.ndim < 2 or rows.shape[-1] not in (3, 6) or rows.shape[-2] == 0:
        raise ContactError(f"wrenches must have shape (..., n, 6) or (..., n, 3); got {rows.shape}")
    batch = rows.shape[:-2]
    flat = np.zeros((math.prod(batch), rows.shape[-2], 6))
    flat[..., PLANAR if rows.shape[-1] == 3 else slice(6)] = rows.reshape(-1, *rows.shape[-2:])
    problem = WrenchProblem.of_rows(flat)
    return _solved(problem, (0.0, 0.0, math.inf), batch, lambda w: w[..., 0])


def _solved(
    problem: WrenchProblem,
    goal: Goal,
    batch: tuple[int, ...],
    forces_of: Callable[[Floats], Floats],
) -> Epsilon:
    """Epsilon of a flat batch, in the batch's shape; see `closure_fields`."""
    results = problem.solve(goal)
    # The growth of a hull also ends where rounding hides whether a support point is above a facet.
    apart = results.closed & (results.lower < (1.0 - goal[0] - 1e-12) * results.upper)
    results.status[apart & (results.status == Status.CONVERGED)] = Status.STALLED
    return Epsilon(
        lower=shaped(results.lower, batch),
        upper=shaped(results.upper, batch),
        **closure_fields(problem, results, batch, forces_of),
    )
