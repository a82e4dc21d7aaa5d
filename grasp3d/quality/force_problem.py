"""Grip forces of batches of grasps, evaluated by the compiled kernels in chunks and threads."""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from grasp3d._kernels.forces import grip_force as kernels
from grasp3d._kernels.forces.grip_force import ForceResults
from grasp3d._kernels.forces.tasks import POINTS, SIZE, TERM
from grasp3d._kernels.hull.polytope import SCRATCH_ROWS
from grasp3d._kernels.hull.wrench_problem import Workspace
from grasp3d.arrays import Floats, Ints
from grasp3d.contact.contacts import Contacts
from grasp3d.quality.closure import forces_of_components
from grasp3d.quality.tasks import Task, Terms
from grasp3d.quality.wrench_problem import WrenchProblem, part_of
from grasp3d.quality.wrenches import EpsilonOptions, check_rtol
from grasp3d.settings import check_choice

ForceBound = Literal["normal", "norm", "total"]
"""What of the contact forces is limited: the sum of the normal components of each finger's, the sum
of the lengths of each finger's, or the sum of the normal components of all."""

Size = Literal["normal", "length"]
"""What of a contact force counts."""


@dataclass(frozen=True, eq=False)
class ForceProblem:
    """Wrench spaces of a flat batch of grasps whose contact forces are bounded by 1."""

    problem: WrenchProblem
    """The points, in the order in which fingers have them, divided by the grasps' sizes: a torque
    scale for each."""
    contacts: Contacts
    order: Ints
    """The contact of each of these points, some contacts more than once, (p,)."""
    sizes: Floats
    """Largest distance of a contact from the centre of mass; 1 where that is 0 (b,)."""

    @classmethod
    def of_contacts(
        cls, contacts: Contacts, *, size: Size = "normal", total: bool = False
    ) -> "ForceProblem":
        """The problem of contacts.

        Args:
            contacts: The contacts.
            size: What of a force counts: its normal component, or its length.
            total: Whether the forces of all fingers share one bound.
        """
        lengths = np.linalg.norm(contacts.points, axis=-1).max(axis=-1)
        sizes = np.asarray(np.where(lengths > 0.0, lengths, 1.0))
        order, group = contacts.by_finger()
        scaled = contacts.of_size(contacts.points / sizes[..., None, None], sizes)
        problem = WrenchProblem.of_contacts(
            scaled.ordered(order), EpsilonOptions(actuation="per_finger"),
            bounded="force" if size == "length" else "normal",
            group=len(order) if total else group,
        )  # fmt: skip
        return cls(problem, contacts, order, sizes.reshape(-1))

    @classmethod
    def bounded(cls, contacts: Contacts, bound: ForceBound) -> "ForceProblem":
        """The problem of contacts whose forces are bounded as `grip_force` takes it."""
        check_choice("bound", bound, ForceBound)
        size: Size = "length" if bound == "norm" else "normal"
        return cls.of_contacts(contacts, size=size, total=bound == "total")

    def of_task(self, task: Task, rtol: float, masses: Floats | None = None) -> ForceResults:
        """Bounds of the force that resists a whole task, for masses (b,) or the task's own."""
        check_rtol(rtol)
        if masses is None:
            return self._of_terms(task.arrays(), np.ones(self.problem.size), rtol)
        return self._of_terms(task.scaled_to(1.0).arrays(), masses, rtol)

    def of_wrenches(self, wrenches: Floats, rtol: float) -> ForceResults:
        """Bounds of the force that resists one wrench for each grasp (b, 6), and contact forces.

        Forces are components along the axes of the points (b, p, 4); see `in_contact_frame`.
        """
        check_rtol(rtol)
        problem = self.problem
        results = problem.unwritten(ForceResults, with_forces=True)

        def evaluate(chunk: slice, workspace: Workspace) -> None:
            kernels.wrench_forces(
                problem.form, problem.wrenches_of(chunk), problem.tangential[chunk],
                problem.cones[chunk], np.ascontiguousarray(wrenches[chunk]),
                self.sizes[chunk], rtol, workspace, np.zeros((SCRATCH_ROWS, 8)),
                part_of(results, chunk),
            )  # fmt: skip

        problem.in_chunks(evaluate)
        unfinished = np.flatnonzero(results.status == kernels.UNFINISHED)
        if len(unfinished):
            self._decide(unfinished, wrenches, rtol, results)
        return results

    def in_contact_frame(self, components: Floats) -> Floats:
        """Forces along x, y, z, and moments about the normals (b, n, 4), from those components."""
        return forces_of_components(self.contacts, components, self.order)

    def _of_terms(
        self, terms: Terms, masses: Floats, rtol: float, *, small: bool = False
    ) -> ForceResults:
        """Bounds for the terms of a task and masses (b,); `small`: hulls of a few facets only."""
        problem, results = self.problem, self.problem.unwritten(ForceResults)
        forces = terms.rows[:, SIZE].max() * masses.max(initial=0.0)
        size = float(max(forces, np.abs(terms.points).max(initial=0.0)))  # of the task's wrenches

        def evaluate(chunk: slice, workspace: Workspace) -> None:
            axes, part = problem.wrenches_of(chunk), part_of(results, chunk)
            scratch = kernels.make_scratch(len(terms.rows))
            problem.with_polytope(
                len(axes),
                lambda first, polytope: kernels.task_forces(
                    problem.form, axes, problem.tangential[chunk], problem.cones[chunk],
                    terms.rows, terms.points, masses[chunk], size, self.sizes[chunk],
                    rtol, first, workspace, polytope, scratch, part,
                ),
                small=small,
            )  # fmt: skip

        problem.in_chunks(evaluate)
        return results

    def _decide(self, grasps: Ints, wrenches: Floats, rtol: float, results: ForceResults) -> None:
        """Prove by the growing hull that no force resists single wrenches, or find one."""
        different, which = np.unique(wrenches[grasps], axis=0, return_inverse=True)
        for k, wrench in enumerate(different):
            rows = grasps[which.reshape(-1) == k]
            row = np.zeros((1, TERM))
            row[0, :3] = POINTS, 0, 1
            some = replace(self, problem=self.problem.take(rows), sizes=self.sizes[rows])
            bounds = some._of_terms(  # noqa: SLF001 - of the same class
                Terms(row, wrench[None].copy()), np.ones(len(rows)), rtol, small=True
            )
            for name in ("lower", "upper", "status", "reason", "direction"):
                getattr(results, name)[rows] = getattr(bounds, name)
            open_ = rows[np.isinf(bounds.upper)]
            results.reason[open_] = np.maximum(results.reason[open_], kernels.NOT_RESISTED)
