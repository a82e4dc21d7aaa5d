"""The hardest of a few wrenches: a task with corners needs as much force as its hardest one."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from grasp3d._kernels.grip_force import ForceResults
from grasp3d.arrays import Floats
from grasp3d.quality.force_problem import ForceProblem
from grasp3d.quality.opposed_fingers import are_opposed, opposed_forces


@dataclass(frozen=True, eq=False)
class WrenchForces:
    """Grip forces of a flat batch, the wrenches that need them, and contact forces that do."""

    results: ForceResults
    wrenches: Floats
    """Shape (b, 6)."""
    forces: Floats
    """As of `ForceCertificate`, shape (b, n, 4)."""


def hardest(
    problem: ForceProblem, wrenches: Floats, rtol: float, threads: int | None
) -> WrenchForces:
    """Grip force of the hardest of k wrenches for each grasp.

    Args:
        problem: The grasps.
        wrenches: Shape (b, k, 6).
        rtol: As in `grip_force`.
        threads: As in `grip_force`.
    """
    size, count = wrenches.shape[:2]
    found = [against(problem, wrenches[:, k], rtol, threads) for k in range(count)]
    chosen = np.stack([one.results.upper for one in found]).argmax(axis=0)
    grasps = np.arange(size)

    def of_chosen(values: Sequence[Any]) -> Any:
        return np.stack(values)[chosen, grasps]

    results = ForceResults(*map(of_chosen, zip(*(one.results for one in found), strict=True)))
    lower = np.stack([one.results.lower for one in found])
    best = lower.argmax(axis=0)
    results.lower[:] = lower.max(axis=0)
    results.direction[:] = np.stack([one.results.direction for one in found])[best, grasps]
    return WrenchForces(results, wrenches[grasps, chosen], of_chosen([one.forces for one in found]))


def against(
    problem: ForceProblem, wrenches: Floats, rtol: float, threads: int | None
) -> WrenchForces:
    """Grip force against one wrench for each grasp, shape (b, 6); opposed fingers: closed form."""
    results = problem.of_wrenches(wrenches, rtol, threads)
    forces = problem.in_contact_frame(results.forces)
    if problem.plain:
        contacts = problem.contacts.reshape((-1,))
        opposed = np.flatnonzero(are_opposed(contacts))
        if opposed.size:
            chosen = contacts.take(opposed)
            exact = opposed_forces(chosen, wrenches[opposed])
            finite = np.isfinite(exact.normal).all(axis=-1)
            directions, proven = exact.proofs(chosen, problem.bound)
            results.direction[opposed[proven]] = directions[proven]
            opposed, values = opposed[finite], exact.bounded(problem.bound)[finite]
            results.lower[opposed] = results.upper[opposed] = values
            forces[opposed] = exact.in_contact_frame(chosen.normals)[finite]
    return WrenchForces(results, wrenches, forces)
