"""Grasp quality: epsilon, force closure and the critical friction angle, each with its proof."""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from grasp3d._kernels.wrench_problem import Answers
from grasp3d.arrays import Bools, Bytes, Floats, Ints, locked, shaped
from grasp3d.contact.contacts import LARGEST, Contacts
from grasp3d.errors import ContactError, SettingError
from grasp3d.quality.certificates import Certificate, Status, certificate_of, contact_forces
from grasp3d.quality.wrench_problem import Goal, WrenchProblem
from grasp3d.quality.wrenches import Bounded
from grasp3d.settings import Actuation

UNDECIDED_WITHIN = 1e4
"""Width, in tolerances of 1e-12 of the wrenches, of an interval about 0 that is left undecided."""


PLANAR = [0, 1, 5]
"""Where the force along x and y and the torque of a planar wrench stand among six numbers."""


@dataclass(frozen=True, eq=False)
class Epsilon:
    """Radius of the largest ball about the origin in the grasp wrench space.

    Ferrari & Canny 1992. Evaluated in the span of the grasp's wrenches: values of different rank do
    not compare.
    """

    lower: Floats
    """Certified lower bound, shape (...); 0 where the grasp is not closed."""
    upper: Floats
    """Certified upper bound, shape (...); for polygonal cones that have converged, `lower`."""
    rank: Ints
    """Dimensions that the wrenches span, shape (...): 5 for hard fingers on a line, mostly 6."""
    closed: Bools
    """Force closure, shape (...)."""
    status: Bytes
    """`Status` codes, shape (...)."""
    certificate: Certificate

    @property
    def value(self) -> Floats:
        """The lower bound."""
        return self.lower


@dataclass(frozen=True, eq=False)
class SmallestEpsilon:
    """The smallest epsilon among candidates."""

    lower: Floats
    """Certified lower bound of the smallest, shape (...)."""
    upper: Floats
    """Certified upper bound, shape (...)."""
    index: Ints
    """Which candidate it is, shape (...)."""
    status: Bytes
    """`Status` codes, shape (...): the worst of those candidates that may be the smallest."""

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
    cone_offset: npt.ArrayLike = 0.0,
    phase: float = 0.0,
    bounded: Bounded = "force",
    threads: int | None = 1,
) -> Epsilon:
    """Grasp quality of Ferrari & Canny (ICRA 1992).

    Args:
        contacts: The contacts.
        edges: Edges of polygonal friction cones; None: circular cones.
        actuation: 'total': all forces together are at most 1 (the hull of the contacts' wrenches);
            'per_finger': each finger's force is (the Minkowski sum).
        torque_scale: Length that torques are divided by [mesh unit]; `ObjectMesh.torque_scale`
            makes the value independent of the unit.
        rtol: Circular cones: how much of the upper bound may lie between the bounds.
        cone_offset: Angle added to the cones' half-angles [rad], one or shape (..., n). For hard
            fingers with circular cones, -a gives exactly the smallest epsilon over all tilts of the
            normals by up to a, and +a a bound on the largest. Where -a exceeds a cone the lower
            bound is 0; the status is UNDECIDED where the others close, or all without friction. For
            fewer than 7 contacts whose cones are all exceeded the minimum is 0.
        phase: Polygons: angle of the first edge about the normal, from the first of
            `cones.tangents` [rad].
        bounded: 'force': it is the length of a contact force that is at most 1; 'normal': its
            normal component, as some packages have it.
        threads: Threads for a batch; None: one per processor.

    Returns:
        Bounds, rank and proof, one for each grasp of the batch.

    Raises:
        SettingError: A setting outside its range.
    """
    problem = WrenchProblem.of_contacts(
        contacts, edges, actuation, torque_scale=torque_scale, cone_offset=cone_offset, phase=phase,
        bounded=bounded,
    )  # fmt: skip
    answers = problem.solve(goal_of(edges, rtol), threads=threads)
    forces = contact_forces(contacts, answers.forces)
    return _as_epsilon(answers, contacts.batch, forces, polygonal=edges is not None)


def epsilon_of_wrenches(wrenches: npt.ArrayLike, *, threads: int | None = 1) -> Epsilon:
    """Epsilon of the convex hull of given wrenches.

    Args:
        wrenches: Shape (..., n, 6), or (..., n, 3) in the plane: force along x and y, torque.
        threads: Threads for a batch; None: one per processor.

    Returns:
        Bounds, rank and proof; directions have 6 numbers, planar ones (u_x, u_y, 0, 0, 0, u_tau).

    Raises:
        ContactError: Another shape, or numbers that are not finite.
    """
    try:
        rows = np.asarray(wrenches, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ContactError(f"wrenches must be an array of numbers: {error}") from error
    if rows.ndim < 2 or rows.shape[-1] not in (3, 6) or rows.shape[-2] == 0:
        raise ContactError(f"wrenches must have shape (..., n, 6) or (..., n, 3); got {rows.shape}")
    if not np.isfinite(rows).all():
        where = tuple(int(i) for i in np.argwhere(~np.isfinite(rows))[0])
        raise ContactError(f"wrenches must be finite; {rows[where]} at {where}")
    if (np.abs(rows) > LARGEST).any():
        raise ContactError(f"wrenches must not exceed {LARGEST:g}; got {np.abs(rows).max():g}")
    batch = rows.shape[:-2]
    flat = np.zeros((math.prod(batch), rows.shape[-2], 6))
    flat[..., PLANAR if rows.shape[-1] == 3 else slice(6)] = rows.reshape(-1, *rows.shape[-2:])
    answers = WrenchProblem.of_rows(flat).solve((0.0, 0.0, math.inf, 0.0), threads=threads)
    return _as_epsilon(answers, batch, answers.forces[..., 0], polygonal=True)


def smallest_epsilon(
    contacts: Contacts,
    *,
    edges: int | None = None,
    actuation: Actuation = "total",
    torque_scale: float = 1.0,
    rtol: float = 1e-3,
    cone_offset: npt.ArrayLike = 0.0,
    phase: float = 0.0,
    bounded: Bounded = "force",
    threads: int | None = 1,
) -> SmallestEpsilon:
    """Smallest epsilon among candidates; most are rejected early, by bounds.

    Args:
        contacts: Candidates along the last batch axis, shapes (..., k, n, 3). They should have the
            same rank: values of different rank do not compare.
        edges: As in `epsilon`, like all that follow.
        actuation: As in `epsilon`.
        torque_scale: As in `epsilon`.
        rtol: As in `epsilon`.
        cone_offset: As in `epsilon`.
        phase: As in `epsilon`.
        bounded: As in `epsilon`.
        threads: As in `epsilon`.

    Returns:
        One value for each group of k candidates, shape (...).

    Raises:
        ContactError: The contacts are those of one grasp.
        SettingError: A setting outside its range.
    """
    if not contacts.batch or contacts.batch[-1] == 0:
        raise ContactError("minimum needs candidates along a batch axis: points (..., k, n, 3)")
    problem = WrenchProblem.of_contacts(
        contacts, edges, actuation, torque_scale=torque_scale, cone_offset=cone_offset, phase=phase,
        bounded=bounded,
    )  # fmt: skip
    group = contacts.batch[-1]
    answers = problem.solve(goal_of(edges, rtol), group=group, prove=False, threads=threads)
    found = _as_epsilon(answers, contacts.batch, answers.forces, polygonal=edges is not None)
    least = found.upper.min(axis=-1, keepdims=True)
    return SmallestEpsilon(
        lower=locked(found.lower.min(axis=-1))[()],
        upper=locked(found.upper.min(axis=-1))[()],
        index=locked(found.upper.argmin(axis=-1))[()],
        status=locked(np.where(found.lower <= least, found.status, 0).max(axis=-1))[()],
    )


def goal_of(edges: int | None, rtol: float) -> Goal:
    """How close the bounds must be, as `WrenchProblem.solve` takes it; 0 for polygonal cones."""
    if not 0.0 < rtol < 1.0:
        raise SettingError(f"rtol must lie between 0 and 1; got {rtol}")
    tolerances = (0.0, 0.0) if edges else (rtol, UNDECIDED_WITHIN)
    return (*tolerances, math.inf, 0.0)


def _as_epsilon(
    answers: Answers, batch: tuple[int, ...], equilibrium: Floats, *, polygonal: bool
) -> Epsilon:
    """Shape the answers like the batch."""
    return Epsilon(
        lower=shaped(certified(answers, polygonal=polygonal), batch),
        upper=shaped(answers.upper, batch),
        rank=shaped(answers.rank, batch),
        closed=shaped(answers.closed, batch),
        status=shaped(answers.status, batch),
        certificate=certificate_of(answers, batch, equilibrium),
    )


def certified(answers: Answers, *, polygonal: bool) -> Floats:
    """Lower bounds (b,); those of polygons that have converged meet their upper ones."""
    meets = polygonal & (answers.status == Status.CONVERGED)
    return np.where(meets, answers.upper, answers.lower)
