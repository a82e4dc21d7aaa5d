"""Grip force of soft fingers at tilts of their normals that are found by turns.

The torsional moment of a soft finger turns with its normal, so that no formula holds for the
largest force over all tilts. But for one direction u of wrenches the contacts tilt independently,
and the tilts that resist least along it are found contact by contact; at these tilts some wrench of
the task is the hardest one and has a direction of its own. So a direction, tilts and a wrench lead
to the next ones, with ever larger forces, from several starts; the last tilts are then evaluated
against the whole task. What is found is a force that some tilt needs: others may need more.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from grasp3d.arrays import Bools, Floats, Ints
from grasp3d.contact.contacts import Contacts
from grasp3d.contact.friction_cones import tilted_normals, turned
from grasp3d.quality.closure import force_closure
from grasp3d.quality.force_problem import ForceProblem
from grasp3d.quality.grip_forces import ForceOptions, GripForce
from grasp3d.quality.tasks import Task

ROUNDS = 5
"""Tilts that are tried from each start."""

EVALUATIONS = 3
"""Most evaluations of the tilts found against the whole task; each leads on to others."""

AROUND = 24
"""Sampled normals on the rim of a contact's possible normals."""

AXES = np.concatenate([np.eye(6)[:3], -np.eye(6)[:3]])
"""Directions of wrenches from which the search starts (s, 6)."""

STARTS = 3
"""Tilts in a few directions from which the search goes on, the worst ones."""

COARSE = 1e-2
"""Relative gap of bounds while the tilts are searched."""


@dataclass(frozen=True, eq=False)
class _Tilted:
    """The worst tilts of grasps so far (b, ...), and the forces that they need at least."""

    normals: Floats
    """Shape (b, n, 3)."""
    force: Floats
    """Shape (b,)."""

    def take(self, grasps: Ints | Bools) -> "_Tilted":
        """Those of chosen grasps."""
        return _Tilted(self.normals[grasps], self.force[grasps])

    def replaced(self, grasps: Ints, values: "_Tilted") -> "_Tilted":
        """With those of some grasps replaced."""
        normals, force = self.normals.copy(), self.force.copy()
        normals[grasps], force[grasps] = values.normals, values.force
        return _Tilted(normals, force)

    def worse(self, normals: Floats, force: Floats) -> "_Tilted":
        """Take other tilts where they need more force."""
        more = force > self.force
        return _Tilted(
            np.where(more[:, None, None], normals, self.normals), np.where(more, force, self.force)
        )


def largest_sampled(
    contacts: Contacts, tilt: Floats, options: ForceOptions, nominal: GripForce
) -> tuple[Floats, Floats]:
    """Largest force found among tilts, a certified upper bound at one of them.

    Args:
        contacts: Grasps, a flat batch.
        tilt: Largest tilts [rad], shape (b, n).
        options: The task and more.
        nominal: Their forces without tilts.

    Returns:
        The forces (b,) and the normals (b, n, 3) of these tilts.
    """
    found = _Tilted(contacts.normals, nominal.lower)
    found = found.worse(*_opened(contacts, tilt, options))
    weakest = nominal.certificate.direction
    wrenches = _hardest(options, -weakest)
    directions, forces = [], []
    for normals in _tilts_around(contacts, tilt):
        direction, force = _against(contacts.with_normals(normals), wrenches, options)
        found = found.worse(normals, force)
        directions.append(direction)
        forces.append(force)
    order = np.argsort(np.stack(forces), axis=0)[-STARTS:]  # (STARTS, b)
    starts = [
        _against(contacts, _hardest(options, along), options)[0]
        for along in np.broadcast_to(AXES[:, None], (len(AXES), len(tilt), 6))
    ]
    starts += [weakest, *np.take_along_axis(np.stack(directions), order[..., None], axis=0)]
    for start in starts:
        found = _ascend(contacts, tilt, options, start, found)
    largest, worst = np.array(nominal.upper), contacts.normals.copy()
    active = np.arange(len(tilt))
    for _ in range(EVALUATIONS):
        chosen, some, best = contacts.take(active), options.take(active), found.take(active)
        evaluated = some.force(chosen.with_normals(best.normals))
        larger = np.asarray(evaluated.upper > largest[active] * (1.0 + COARSE))
        more = active[evaluated.upper > largest[active]]
        worst[more] = best.normals[evaluated.upper > largest[active]]
        largest[active] = np.maximum(largest[active], evaluated.upper)
        active, best = active[larger], best.take(larger)
        if not len(active):
            break
        weakest = evaluated.certificate.direction[larger]
        best = _ascend(contacts.take(active), tilt[active], options.take(active), weakest, best)
        found = found.replaced(active, best)
    return largest, worst


def _tilts_around(contacts: Contacts, tilt: Floats) -> Iterator[Floats]:
    """Normals (b, n, 3) tilted in combinations of a few directions."""
    rim = tilted_normals(contacts.normals, tilt, count=4)[..., 1:, :]
    for first in range(4):
        for other in range(4):
            yield np.concatenate([rim[:, :1, first], rim[:, 1:, other]], axis=1)


def least_sampled(
    contacts: Contacts, tilt: Floats, options: ForceOptions, nominal: GripForce
) -> Floats:
    """Least force found among tilts, a certified lower bound at one of them, shape (b,).

    Normals turn toward the contact forces of the hardest wrench; where no force suffices, toward
    the middle of the contacts.
    """
    middle = contacts.points.mean(axis=1, keepdims=True)
    forces = nominal.certificate.forces[..., :3]
    goals = np.where(np.isfinite(forces), forces, middle - contacts.points)
    toward = turned(contacts.normals, goals, tilt)
    normals = np.where(np.isfinite(toward), toward, contacts.normals)
    found = options.force(contacts.with_normals(normals))
    forces = found.certificate.forces[..., :3]
    again = turned(contacts.normals, np.where(np.isfinite(forces), forces, normals), tilt)
    second = options.force(contacts.with_normals(again))
    return np.minimum(np.minimum(nominal.lower, found.lower), second.lower)


def _opened(contacts: Contacts, tilt: Floats, options: ForceOptions) -> tuple[Floats, Floats]:
    """Tilts (b, n, 3) away from the direction in which smaller cones are not force-closed.

    Without torsion no force is then safe along it, and torsion may not help. Returns the forces of
    these tilts too, 0 for grasps whose smaller cones are force-closed.
    """
    hard = Contacts(contacts.points, contacts.normals, contacts.friction, patch=contacts.patch)
    offset = -np.minimum(tilt, contacts.friction_angle)
    closure = force_closure(hard, cone_offset=offset, threads=options.threads)
    opened = np.flatnonzero(~closure.closed)
    force, normals = np.zeros(len(tilt)), contacts.normals.copy()
    chosen = contacts.take(opened)
    directions = closure.certificate.direction[opened]
    normals[opened] = _weakest(chosen, tilt[opened], directions)
    coarse = replace(options.take(opened), rtol=COARSE)
    force[opened] = coarse.force(chosen.with_normals(normals[opened])).lower
    return normals, force


def _ascend(
    contacts: Contacts, tilt: Floats, options: ForceOptions, directions: Floats, found: _Tilted
) -> _Tilted:
    """Tilt against directions (b, 6), and find directions for the tilts, by turns."""
    active = np.arange(len(tilt))
    for _ in range(ROUNDS):
        chosen, some = contacts.take(active), options.take(active)
        normals = _weakest(chosen, tilt[active], directions)
        turned_contacts = chosen.with_normals(normals)
        directions, force = _against(turned_contacts, _hardest(some, -directions), some)
        before = found.force[active]
        everywhere = found.normals.copy(), np.full(len(tilt), -math.inf)
        everywhere[0][active], everywhere[1][active] = normals, force
        found = found.worse(*everywhere)
        further = (force > before * (1.0 + COARSE)) & np.isfinite(force)
        active, directions = active[further], directions[further]
        if not len(active):
            break
    return found


def _hardest(options: ForceOptions, directions: Floats) -> Floats:
    """Wrenches of the task that reach farthest along directions (b, 6)."""
    if isinstance(options.task, Task):
        masses = None if options.masses is None else np.asarray(options.masses)
        return options.task.farthest_for(masses, directions)
    return np.asarray(options.task)


def _against(contacts: Contacts, wrenches: Floats, options: ForceOptions) -> tuple[Floats, Floats]:
    """Directions (b, 6) that prove the force that wrenches need, and that force (b,)."""
    problem = ForceProblem.of_contacts(contacts, bound=options.bound)
    found = problem.of_wrenches(wrenches, COARSE, options.threads, proven=False)
    return found.direction, found.lower


def _weakest(contacts: Contacts, tilt: Floats, directions: Floats) -> Floats:
    """Normals within the tilts that resist least along directions (b, 6), shape (b, n, 3)."""
    g = directions[:, None, :3] + np.cross(directions[:, None, 3:], contacts.points)
    away = turned(contacts.normals, -g, tilt)[..., None, :]
    candidates = np.concatenate(
        [tilted_normals(contacts.normals, tilt, count=AROUND), away], axis=-2
    )  # (b, n, k, 3)
    normal = (candidates * g[..., None, :]).sum(axis=-1)
    square = np.maximum((g * g).sum(axis=-1)[..., None] - normal**2, 0.0)
    twist = (candidates * directions[:, None, None, 3:]).sum(axis=-1)
    twist = twist * contacts.torsion_radius[..., None]
    if contacts.rolling_arms is not None:
        turning = (contacts.rolling_arms * directions[:, None, None, 3:]).sum(axis=-1)
        normal = normal + np.linalg.norm(turning, axis=-1)[..., None]
    support = normal + np.sqrt(contacts.friction[..., None] ** 2 * square + twist**2)
    least = support.argmin(axis=-1)[..., None, None]
    return np.asarray(np.take_along_axis(candidates, least, axis=-2)[..., 0, :])
