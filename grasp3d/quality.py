"""Grasp quality: epsilon, force closure and the critical friction angle, each with its proof."""

import math
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
import numpy.typing as npt

from grasp3d._kernels import hull
from grasp3d._kernels.grasps import SIGN, Answers
from grasp3d.arrays import Bools, Bytes, Floats, Ints, locked, shaped
from grasp3d.cones import tangents
from grasp3d.contacts import LARGEST, Contacts, centred
from grasp3d.errors import ContactError, SettingError
from grasp3d.settings import Actuation
from grasp3d.solving import Goal, Problem
from grasp3d.wrenches import Bounded

UNDECIDED_WITHIN = 1e4
"""Width, in tolerances of 1e-12 of the wrenches, of an interval about 0 that is left undecided."""


PLANAR = [0, 1, 5]
"""Where the force along x and y and the torque of a planar wrench stand among six numbers."""


class Status(IntEnum):
    """How an answer was reached."""

    CONVERGED = hull.CONVERGED
    """As close as asked for."""
    UNDECIDED = hull.UNDECIDED
    """Closed or not: the interval contains 0, and is narrower than rounding can tell, or tilts
    exceed friction (see `widen`)."""
    STALLED = hull.STALLED
    """Rounding stopped the search; the interval holds."""
    EXHAUSTED = hull.EXHAUSTED
    """The hull outgrew its memory; the interval reached holds."""


@dataclass(frozen=True, eq=False)
class Certificate:
    """What proves an answer; plain linear algebra checks it."""

    direction: Floats
    """Unit direction, shape (..., 6). Where the grasp is not closed it separates: no wrench of any
    contact has a positive product with it. Where it is closed, the wrench that is hardest to
    resist lies against it: the support of the grasp wrench space there is `upper`. In a `Closure`
    it says so only where not closed."""
    equilibrium: Floats
    """Where the grasp is closed, forces that balance, every one of them inside its friction cone
    and none zero, shape (..., n, 4): force along x, y, z, and torsional moment about the normal
    [mesh unit]. For given wrenches their weights, shape (..., n). nan where not closed, and where
    cones are widened to 90 degrees or more."""


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
class Minimum:
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


@dataclass(frozen=True, eq=False)
class Closure:
    """Whether grasps are in force closure."""

    closed: Bools
    """Shape (...)."""
    rank: Ints
    """Dimensions in which they are, shape (...)."""
    status: Bytes
    """`Status` codes, shape (...)."""
    certificate: Certificate


def epsilon(
    contacts: Contacts,
    *,
    edges: int | None = None,
    actuation: Actuation = "total",
    torque_scale: float = 1.0,
    rtol: float = 1e-3,
    widen: npt.ArrayLike = 0.0,
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
        widen: Angle added to the cones' half-angles [rad], one or shape (..., n). For hard fingers
            with circular cones, -a gives the smallest epsilon over all tilts of the normals by up
            to a, exactly, and +a a bound on the largest. Where -a exceeds a cone the lower bound
            is 0; the status is UNDECIDED where the others close, or all without friction. For fewer
            than 7 contacts whose cones are all exceeded the minimum is 0.
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
    problem = Problem.of_contacts(
        contacts, edges, actuation, torque_scale=torque_scale, widen=widen, phase=phase,
        bounded=bounded,
    )  # fmt: skip
    answers = problem.solve(goal_of(edges, rtol), threads=threads)
    forces = _forces(contacts, answers.forces)
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
    if rows.ndim < 2 or rows.shape[-1] not in (3, 6) or rows.shape[-2] == 0:  # noqa: PLR2004
        raise ContactError(f"wrenches must have shape (..., n, 6) or (..., n, 3); got {rows.shape}")
    if not np.isfinite(rows).all():
        where = tuple(int(i) for i in np.argwhere(~np.isfinite(rows))[0])
        raise ContactError(f"wrenches must be finite; {rows[where]} at {where}")
    if (np.abs(rows) > LARGEST).any():
        raise ContactError(f"wrenches must not exceed {LARGEST:g}; got {np.abs(rows).max():g}")
    batch = rows.shape[:-2]
    flat = np.zeros((math.prod(batch), rows.shape[-2], 6))
    flat[..., PLANAR if rows.shape[-1] == 3 else slice(6)] = rows.reshape(-1, *rows.shape[-2:])  # noqa: PLR2004
    answers = Problem.of_rows(flat).solve((0.0, 0.0, math.inf, 0.0), threads=threads)
    return _as_epsilon(answers, batch, answers.forces[..., 0], polygonal=True)


def force_closure(
    contacts: Contacts,
    *,
    edges: int | None = None,
    widen: npt.ArrayLike = 0.0,
    phase: float = 0.0,
    threads: int | None = 1,
) -> Closure:
    """Whether grasps resist every wrench in their span, with proof.

    It depends neither on the centre of mass nor on a torque scale; the direction of the certificate
    is one for a torque scale of 1.

    Args:
        contacts: The contacts.
        edges: Edges of polygonal friction cones; None: circular cones.
        widen: Angle added to the cones' half-angles [rad], one or shape (..., n).
        phase: As in `epsilon`.
        threads: Threads for a batch; None: one per processor.

    Raises:
        SettingError: A setting outside its range.
    """
    points, middle, size = centred(contacts.points)  # far from the origin digits are lost
    torsion = contacts.torsion_radius / size[..., 0]
    near = Contacts(points, contacts.normals, contacts.friction, torsion)
    problem = Problem.of_contacts(near, edges, "total", torque_scale=1.0, widen=widen, phase=phase)
    answers = problem.solve(SIGN, threads=threads)
    u = answers.direction
    u[:, 3:] /= size.reshape(-1, 1)
    u[:, :3] -= np.cross(u[:, 3:], middle.reshape(-1, 3))
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    batch = contacts.batch
    return Closure(
        closed=shaped(answers.closed, batch),
        rank=shaped(answers.rank, batch),
        status=shaped(answers.status, batch),
        certificate=_certificate(answers, batch, _forces(contacts, answers.forces)),
    )


def minimum(
    contacts: Contacts,
    *,
    edges: int | None = None,
    actuation: Actuation = "total",
    torque_scale: float = 1.0,
    rtol: float = 1e-3,
    widen: npt.ArrayLike = 0.0,
    phase: float = 0.0,
    bounded: Bounded = "force",
    threads: int | None = 1,
) -> Minimum:
    """Smallest epsilon among candidates; most are rejected early, by bounds.

    Args:
        contacts: Candidates along the last batch axis, shapes (..., k, n, 3). They should have the
            same rank: values of different rank do not compare.
        edges: As in `epsilon`, like all that follow.
        actuation: As in `epsilon`.
        torque_scale: As in `epsilon`.
        rtol: As in `epsilon`.
        widen: As in `epsilon`.
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
    problem = Problem.of_contacts(
        contacts, edges, actuation, torque_scale=torque_scale, widen=widen, phase=phase,
        bounded=bounded,
    )  # fmt: skip
    group = contacts.batch[-1]
    answers = problem.solve(goal_of(edges, rtol), group=group, prove=False, threads=threads)
    found = _as_epsilon(answers, contacts.batch, answers.forces, polygonal=edges is not None)
    least = found.upper.min(axis=-1, keepdims=True)
    return Minimum(
        lower=locked(found.lower.min(axis=-1))[()],
        upper=locked(found.upper.min(axis=-1))[()],
        index=locked(found.upper.argmin(axis=-1))[()],
        status=locked(np.where(found.lower <= least, found.status, 0).max(axis=-1))[()],
    )


def goal_of(edges: int | None, rtol: float) -> Goal:
    """How near the bounds must come, as `Problem.solve` takes it: polygons have an exact value."""
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
        certificate=_certificate(answers, batch, equilibrium),
    )


def certified(answers: Answers, *, polygonal: bool) -> Floats:
    """Lower bounds (b,); those of polygons that have converged meet their upper ones."""
    meets = polygonal & (answers.status == Status.CONVERGED)
    return np.where(meets, answers.upper, answers.lower)


def _certificate(answers: Answers, batch: tuple[int, ...], equilibrium: Floats) -> Certificate:
    return Certificate(shaped(answers.direction, batch), shaped(equilibrium, batch))


def _forces(contacts: Contacts, mixes: Floats) -> Floats:
    """Forces and torsional moments (b, n, 4) from their parts along the contacts' axes."""
    normals = contacts.normals.reshape(*mixes.shape[:2], 3)
    axes = np.stack([normals, *tangents(normals)], axis=-2)  # (b, n, 3, 3)
    forces = (mixes[..., None, :3] @ axes)[..., 0, :]
    moments = mixes[..., 3] * contacts.torsion_radius.reshape(mixes.shape[:2])
    return np.concatenate([forces, moments[..., None]], axis=-1)
