"""Epsilon over all the normals that a sensor cannot tell from the perceived ones.

The true normal of each contact lies anywhere within the tilt a = alpha/2 of the perceived one
(Wan & Howe 2018, Sec. III, who sample extreme normals).
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from grasp3d._kernels.support_functions import TOTAL
from grasp3d.arrays import Bools, Floats, Ints, locked
from grasp3d.contact.contacts import Contacts, per_contact
from grasp3d.contact.friction_cones import tilted_normals
from grasp3d.errors import SettingError
from grasp3d.quality.ferrari_canny import UNDECIDED_WITHIN, epsilon, smallest_epsilon
from grasp3d.quality.wrench_problem import WrenchProblem
from grasp3d.quality.wrenches import wrench_axes
from grasp3d.settings import Actuation
from grasp3d.system.progress import Progress

PART = 32_768
"""Grasps, or tilted ones, in memory at once."""

MOST_SAMPLED = 5
"""Soft fingers whose tilts are sampled: 9 normals each, in all combinations."""


@dataclass(frozen=True, eq=False)
class EpsilonRange:
    """Epsilon at the given normals and over all tilts of them."""

    nominal: Floats
    """At the given normals, certified from below, shape (...)."""
    minimum: Floats
    """Smallest over all tilts, from below, shape (...); how it is taken: see `epsilon_range`."""
    maximum: Floats
    """No tilt has more, shape (...): a bound, which need not be reached."""


class _Question(NamedTuple):
    """What is asked about some grasps; see `epsilon_range`."""

    tilt: Floats
    """Shape (b, n)."""
    edges: int | None
    actuation: Actuation
    torque_scale: float
    rtol: float
    bound_rtol: float
    threads: int | None

    @property
    def common(self) -> dict[str, Any]:
        """The settings that `quality` shares."""
        return {
            "actuation": self.actuation,
            "torque_scale": self.torque_scale,
            "rtol": self.rtol,
            "threads": self.threads,
        }


def epsilon_range(
    contacts: Contacts,
    tilt: npt.ArrayLike,
    *,
    edges: int | None = None,
    actuation: Actuation = "total",
    torque_scale: float = 1.0,
    rtol: float = 1e-3,
    bound_rtol: float | None = None,
    threads: int | None = 1,
    progress: Progress | None = None,
) -> EpsilonRange:
    """Epsilon at the given normals, its minimum and a bound on its maximum over all tilts.

    The minimum is, for

    * hard fingers with circular cones: exact. The worst tilt takes the angle a from a contact's
      cone whatever the direction of the disturbance, so the minimum is epsilon at beta - a. Where
      a exceeds beta at some contact it is given as 0, a bound;
    * hard fingers with polygonal cones: epsilon of polygons of the effective friction, half-angle
      beta - a, as in the paper. A tilted polygon does not hold that polygon exactly, so some tilt
      may do slightly worse;
    * soft fingers: the smallest among sampled tilts, the given normal and 8 at the angle a around
      it, all combinations of the contacts. Torsion turns with the normal, so that no such formula
      holds, and tilts between the samples may do worse.

    The maximum of hard fingers is at most epsilon of circular cones at beta + a. That of soft
    fingers is at most epsilon of what the contacts can do with any of their normals: forces in
    circular cones at beta + a, and forces in cones of half-angle a, each with the torsional moment
    along itself, one way and the other. With actuation 'per_finger' it is at most the number of
    fingers times that bound for 'total', since a sum of supports is at most so many times their
    largest.

    Args:
        contacts: The contacts.
        tilt: How far each normal may turn, a [rad], from 0 to below pi/2: one, or shape (..., n).
        edges: As in `quality.epsilon`.
        actuation: As in `quality.epsilon`.
        torque_scale: As in `quality.epsilon` [mesh unit].
        rtol: As in `quality.epsilon`.
        bound_rtol: The same for the maximum, always of circular cones; None: `rtol`.
        threads: Threads for a batch; None: one per processor.
        progress: Called with the share of the work done, from 0 to 1.

    Raises:
        SettingError: A setting outside its range, friction 0, or too many soft fingers.
    """
    turns = per_contact("tilt", tilt, contacts).reshape(-1, contacts.count)
    if not ((turns >= 0.0) & (turns < math.pi / 2.0)).all():
        raise SettingError(f"tilt must be from 0 to below pi/2; got {turns}")
    bound_rtol = rtol if bound_rtol is None else bound_rtol
    question = _Question(turns, edges, actuation, torque_scale, rtol, bound_rtol, threads)
    if ((turns > 0.0) & (contacts.friction.reshape(turns.shape) == 0.0)).any():
        raise SettingError("friction must be above 0 where normals may tilt")
    soft = (contacts.torsion_radius > 0.0).any(axis=-1).reshape(-1)
    tilted = bool(turns.any())
    if tilted and soft.any() and contacts.count > MOST_SAMPLED:
        raise SettingError(
            f"tilts of soft fingers are sampled, for at most {MOST_SAMPLED} of them; "
            f"got {contacts.count}"
        )
    values, done = np.empty((3, len(soft))), 0
    flat = contacts.reshape((-1,))
    for part in _parts(contacts.count, soft, tilted=tilted):
        few, asked = flat.take(part), question._replace(tilt=turns[part])
        nominal = epsilon(few, edges=edges, **question.common).lower
        most = _most_soft(few, asked) if soft[part[0]] else _most_hard(few, asked)
        values[:, part] = nominal, np.minimum(_least(few, asked, nominal), nominal), most
        done += len(part)
        if progress is not None:
            progress(done / len(soft))
    return EpsilonRange(*(locked(row.reshape(contacts.batch))[()] for row in values))


def _parts(count: int, soft: Bools, *, tilted: bool) -> Iterator[Ints]:
    """Numbers of hard grasps, then of soft ones, so many that a part and its tilts fit."""
    for kind in (False, True):
        chosen = np.flatnonzero(soft == kind)
        step = max(1, PART // len(_tilts(count))) if kind and tilted else PART
        for start in range(0, len(chosen), step):
            yield chosen[start : start + step]


def _least(contacts: Contacts, question: _Question, nominal: Floats) -> Floats:
    """The smallest over all tilts, shape (b,); see `epsilon_range`."""
    if not question.tilt.any():
        return nominal
    if (contacts.torsion_radius > 0.0).any():
        return smallest_epsilon(
            _tilted(contacts, question.tilt), edges=question.edges, **question.common
        ).lower
    return epsilon(
        contacts, edges=question.edges, cone_offset=-question.tilt, **question.common
    ).lower


def _tilts(count: int) -> np.ndarray[Any, np.dtype[np.int64]]:
    """Numbers of the normals in every combination of sampled tilts, shape (k ** n, n)."""
    around = tilted_normals(np.array([0.0, 0.0, 1.0]), 0.0).shape[0]
    return np.indices((around,) * count).reshape(count, -1).T


def _tilted(contacts: Contacts, tilt: Floats) -> Contacts:
    """Every grasp (b,) with every combination of sampled tilts, batch (b, k ** n)."""
    sampled = tilted_normals(contacts.normals, tilt)  # (b, n, k, 3)
    choice = _tilts(contacts.count)
    normals = sampled[:, np.arange(contacts.count), choice]  # (b, k ** n, n, 3)
    return Contacts(
        np.broadcast_to(contacts.points[:, None], normals.shape),
        normals,
        np.broadcast_to(contacts.friction[:, None], normals.shape[:-1]),
        np.broadcast_to(contacts.torsion_radius[:, None], normals.shape[:-1]),
    )


def _most_hard(contacts: Contacts, question: _Question) -> Floats:
    """What epsilon of hard fingers reaches at most, shape (b,); polygons lie in their cones."""
    common = {**question.common, "rtol": question.bound_rtol}
    return epsilon(contacts, cone_offset=question.tilt, **common).upper


def _most_soft(contacts: Contacts, question: _Question) -> Floats:
    """What epsilon of soft fingers reaches at most, shape (b,).

    A contact stands here three times: with its forces, and with its normals n as wrenches of the
    force n and the moment +e n or -e n. All three are circular cones, and the support of each is
    exactly the largest that a tilt gives.
    """
    size, count = len(contacts.points), contacts.count
    hard = wrench_axes(
        contacts.points, contacts.normals, np.zeros((size, count)), question.torque_scale
    )  # (b, n, 4, 6)
    axes = np.tile(hard, (1, 3, 1, 1))  # (b, 3 n, 4, 6)
    moments = hard[..., :3] * (contacts.torsion_radius / question.torque_scale)[..., None, None]
    axes[:, count : 2 * count, :, 3:] += moments
    axes[:, 2 * count :, :, 3:] -= moments
    wide = np.minimum(contacts.friction_angle + question.tilt, math.pi)
    angles = np.concatenate([wide, np.tile(question.tilt, 2)], axis=1)
    problem = WrenchProblem(
        kind=TOTAL,
        spherical=True,
        soft=False,
        size=size,
        count=3 * count,
        lay_out=partial(_rows_of, axes),
        reach=np.sin(np.minimum(angles, math.pi / 2.0)),
        cones=np.stack([np.cos(angles), np.sin(angles)], axis=-1),
        rim=np.zeros((0, 2)),
        beyond=np.zeros(size, dtype=np.bool_),
    )
    goal = (question.bound_rtol, UNDECIDED_WITHIN, math.inf, 0.0)
    most = problem.solve(goal, prove=False, threads=question.threads).upper
    return most if question.actuation == "total" else count * most


def _rows_of(axes: Floats, part: slice) -> Floats:
    return np.ascontiguousarray(axes[part])
