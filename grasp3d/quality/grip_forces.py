"""Grip force: how hard fingers must press to hold, and what they can then carry, in newtons.

The smallest bound t of the contact forces for which they can balance every wrench of a task T is

    F = max over u of h_T(-u) / h(u),

where h and h_T are the support functions of the grasp wrench space, with contact forces bounded by
1, and of the task. This is epsilon of Ferrari & Canny (ICRA 1992), measured by the task instead of
a ball. The same growing hull finds it, with facets ranked by h / h_T; for one wrench, the simplex
method along its ray.

Compiled kernels evaluate batches of grasps in chunks and threads.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import IntEnum
from functools import cached_property, partial
from typing import Any, Literal

import numpy as np

from grasp3d._kernels.hull import grip_force as kernels
from grasp3d._kernels.hull.grip_force import ForceResults
from grasp3d._kernels.hull.polytope import SCRATCH_ROWS
from grasp3d._kernels.hull.support_functions import POINTS, SIZE, TERM
from grasp3d._kernels.hull.wrench_problem import Workspace
from grasp3d.arrays import ArrayLike, Bools, Bytes, Floats, Ints, shaped, short_repr
from grasp3d.contact.contacts import LARGEST, Contacts, finite_numbers, of_shape
from grasp3d.errors import ContactError, SettingError
from grasp3d.quality.critical_angle import forces_of_components
from grasp3d.quality.tasks import Task, Terms
from grasp3d.quality.wrench_problem import WrenchProblem, part_of
from grasp3d.quality.wrenches import EpsilonOptions, check_rtol
from grasp3d.settings import check_choice

ForceBound = Literal["normal", "norm", "total"]
"""Which sum of contact forces is limited: of the normal components for each finger, of the lengths
for each finger, or of the normal components of all fingers."""

Size = Literal["normal", "length"]
"""Which size of a contact force counts: its normal component, or its length."""


@dataclass(frozen=True, eq=False)
class ForceProblem:
    """Wrench spaces of a flat batch of grasps whose contact forces are bounded by 1."""

    problem: WrenchProblem
    """Wrench spaces of the contact points, ordered by finger and divided by the size of the grasp,
    which thus is its torque scale."""
    contacts: Contacts
    order: Ints
    """The contact of each of these points; some contacts occur more than once, (p,)."""
    sizes: Floats
    """Largest distance of a contact from the centre of mass; 1 where that is 0 (b,)."""

    @classmethod
    def of_contacts(
        cls, contacts: Contacts, *, size: Size = "normal", total: bool = False
    ) -> "ForceProblem":
        """The problem of contacts.

        Args:
            contacts: The contacts.
            size: Which size of a force counts: its normal component, or its length.
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
        """The problem of contacts whose forces are bounded as in `grip_force`."""
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
        """Convert components of `of_wrenches` to forces along x, y, z, and moments (b, n, 4)."""
        return forces_of_components(self.contacts, components, self.order)

    def _of_terms(
        self, terms: Terms, masses: Floats, rtol: float, *, small: bool = False
    ) -> ForceResults:
        """Bounds for the terms of a task and masses (b,); `small`: only hulls of a few facets."""
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
        """With the growing hull, prove that no force resists single wrenches, or find one."""
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


class Resistance(IntEnum):
    """Whether some force resists a wrench or task, or why none does."""

    RESISTED = kernels.FINITE
    """A finite force does."""
    NO_PUSH = kernels.NOT_RESISTED
    """The contacts, which can only push, cannot push that way, however hard they press."""
    NO_SUCH_WRENCH = kernels.NOT_IN_SPAN
    """The contacts can apply no wrench of that kind in either sense: hard fingers on a line resist
    no torque about it. A torsion radius (soft fingers) or a further contact off the line helps."""


@dataclass(frozen=True, eq=False)
class ForceCertificate:
    """Proof of a grip force that linear algebra can verify."""

    direction: Floats
    """Direction u of wrenches, shape (..., 6): the task reaches h_T(-u) against it, and the grasp
    wrench space only h(u) along it. `lower` is their ratio; where no force suffices h(u) is 0."""
    _balance: Callable[[], tuple[Floats, Floats]]
    """Computes `wrench` and `forces`."""

    __repr__ = short_repr

    @cached_property
    def _balanced(self) -> tuple[Floats, Floats]:
        return self._balance()

    @property
    def wrench(self) -> Floats:
        """The wrench of the task that needs the most force, or the given one, shape (..., 6)."""
        return self._balanced[0]

    @property
    def forces(self) -> Floats:
        """Contact forces that balance that wrench, computed when they are first read.

        Each is inside its friction cone or limit surface, shape (..., n, 4): force along x, y, z
        [N], and torsional moment about the normal [N x mesh unit]; nan where no force suffices.
        """
        return self._balanced[1]

    def __reduce__(self) -> tuple[Any, ...]:
        return ForceCertificate, (self.direction, partial(tuple, self._balanced))


@dataclass(frozen=True, eq=False)
class GripForce:
    """The smallest contact forces that resist a wrench or a task, with certified bounds."""

    lower: Floats
    """Lower bound: no smaller force suffices [N], shape (...)."""
    upper: Floats
    """Upper bound: this force suffices [N], shape (...); inf where none is known to suffice."""
    resistance: Bytes
    """`Resistance` codes, shape (...)."""
    certificate: ForceCertificate

    __repr__ = short_repr

    @property
    def value(self) -> Floats:
        """The upper bound [N]: a force that suffices."""
        return self.upper

    @property
    def finite(self) -> Bools:
        """Whether some force resists, shape (...)."""
        return np.asarray(np.isfinite(self.upper))[()]


def grip_force(
    contacts: Contacts,
    task: Task | ArrayLike,
    *,
    bound: ForceBound = "normal",
    masses: ArrayLike | None = None,
    rtol: float = 1e-3,
) -> GripForce:
    """Smallest contact forces that resist a wrench, or any wrench of a task.

    The fingers may press differently for each wrench, within the bound: it is the force that the
    gripper must be capable of.

    Args:
        contacts: The contacts. Soft fingers have the elliptic limit surface of Howe & Cutkosky
            (IJRR 1996), (f_t / friction)^2 + (moment / torsion_radius)^2 <= f_n^2. Contacts of one
            finger share the bound.
        task: A `Task`, the same for all grasps; or wrenches that act on the object, shape (..., 6):
            force [N] and torque about the centre of mass [N m].
        bound: What is limited: 'normal', the normal components of every finger's forces, which the
            data sheets of grippers call force per finger; 'norm', their lengths; 'total', the sum
            of the normal components of all fingers.
        masses: Masses [kg] that replace the task's own, one for all grasps or shape (...).
        rtol: Largest difference of the bounds, as a fraction of the upper one.

    Returns:
        Bounds and proof for each grasp of the batch, and the reason where no force suffices.

    Raises:
        ContactError: Wrenches have another shape, or values are not finite.
        SettingError: A setting is outside its range.

    Example:
        Two soft fingers on opposite sides of a part of 0.5 kg: gravity acts across their line,
        where the force is m g / (2 friction), then in any direction:

        >>> import grasp3d
        >>> from grasp3d.quality import Weight
        >>> points, normals = [[-0.02, 0, 0], [0.02, 0, 0]], [[1, 0, 0], [-1, 0, 0]]
        >>> contacts = grasp3d.Contacts(points, normals, friction=0.5, torsion_radius=0.003)
        >>> print(f"{grasp3d.grip_force(contacts, [0, 0, -4.903, 0, 0, 0]).value:.2f} N")
        4.90 N
        >>> print(f"{grasp3d.grip_force(contacts, Weight(0.5)).value:.2f} N")
        6.94 N
    """
    problem = ForceProblem.bounded(contacts, bound)
    options = ForceOptions(task, masses, rtol).flat(contacts)
    results, wrenches = options.found(problem)
    batch = contacts.batch

    def balance() -> tuple[Floats, Floats]:
        hardest, forces = wrenches, results.forces
        if hardest is None:
            hardest = options.farthest(-results.direction)
            forces = problem.of_wrenches(hardest, rtol).forces
        return shaped(hardest, batch), shaped(problem.in_contact_frame(forces), batch)

    return GripForce(
        lower=shaped(results.lower, batch),
        upper=shaped(results.upper, batch),
        resistance=shaped(results.reason, batch),
        certificate=ForceCertificate(shaped(results.direction, batch), balance),
    )


def wrenches_of(values: ArrayLike, contacts: Contacts) -> Floats:
    """One wrench for each grasp of the flat batch (b, 6). Raises ContactError."""
    try:
        wrenches = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ContactError(f"a task must be a Task or an array of numbers: {error}") from error
    if wrenches.ndim == 0 or wrenches.shape[-1] != 6:
        raise ContactError(
            "a wrench must be six numbers, force and torque about the centre of mass; got shape "
            f"{wrenches.shape}"
        )
    if not np.isfinite(wrenches).all() or (np.abs(wrenches) > LARGEST).any():
        raise ContactError(f"wrenches must be finite and not exceed {LARGEST:g}")
    try:
        return np.broadcast_to(wrenches, (*contacts.batch, 6)).reshape(-1, 6).copy()
    except ValueError as error:
        raise ContactError(
            f"wrenches must be one, or have shape {(*contacts.batch, 6)}; got {wrenches.shape}"
        ) from error


def masses_of(values: ArrayLike, contacts: Contacts) -> Floats:
    """One mass for each grasp of the flat batch (b,). Raises SettingError."""
    masses = finite_numbers("masses", values, SettingError)
    if not (masses >= 0.0).all():
        raise SettingError(f"masses must be at least 0 [kg]; got {masses}")
    return of_shape("masses", masses, contacts.batch).reshape(-1).copy()


@dataclass(frozen=True, eq=False)
class ForceOptions:
    """Arguments of `grip_force` besides the contacts, for a batch or a part of it."""

    task: Task | ArrayLike
    masses: ArrayLike | None
    rtol: float

    def flat(self, contacts: Contacts) -> "ForceOptions":
        """The options with one wrench and one mass for each grasp of a flat batch."""
        task = self.task if isinstance(self.task, Task) else wrenches_of(self.task, contacts)
        masses = None if self.masses is None else masses_of(self.masses, contacts)
        return replace(self, task=task, masses=masses)

    def take(self, rows: slice | Ints) -> "ForceOptions":
        """The options of chosen grasps."""
        task = self.task if isinstance(self.task, Task) else np.asarray(self.task)[rows]
        masses = None if self.masses is None else np.asarray(self.masses)[rows]
        return replace(self, task=task, masses=masses)

    @property
    def has_torques(self) -> bool:
        """Whether some wrench has a torque."""
        given = self.task.arrays().points if isinstance(self.task, Task) else np.asarray(self.task)
        return bool(given[..., 3:].any())

    def farthest(self, directions: Floats) -> Floats:
        """The wrenches of the task that reach farthest along directions (b, 6)."""
        assert isinstance(self.task, Task)
        masses = None if self.masses is None else np.asarray(self.masses)
        return self.task.farthest_for(masses, directions)

    def found(self, problem: ForceProblem) -> tuple[ForceResults, Floats | None]:
        """Results of a flat batch, and the hardest wrenches (b, 6), which the forces balance.

        If the task is evaluated as a whole, the wrenches are None, and there are no forces.
        """
        task = self.task
        if isinstance(task, Task):
            masses = None if self.masses is None else np.asarray(self.masses)
            wrenches = task.corners_for(masses, problem.problem.size)
            if wrenches is None:
                return problem.of_task(task, self.rtol, masses), None
        else:
            wrenches = np.asarray(task)[:, None]
        return self._hardest(problem, wrenches)

    def _hardest(self, problem: ForceProblem, wrenches: Floats) -> tuple[ForceResults, Floats]:
        """Force of the hardest of k wrenches (b, k, 6) for each grasp, and that wrench (b, 6)."""
        size, count = wrenches.shape[:2]
        each = [problem.of_wrenches(wrenches[:, k], self.rtol) for k in range(count)]
        if count == 1:
            return each[0], wrenches[:, 0]
        columns = ForceResults(*map(np.stack, zip(*each, strict=True)))  # (k, b, ...)
        grasps = np.arange(size)
        worst, best = columns.upper.argmax(axis=0), columns.lower.argmax(axis=0)
        results = ForceResults(*(column[worst, grasps] for column in columns))
        proof = {"lower": columns.lower[best, grasps], "direction": columns.direction[best, grasps]}
        return results._replace(**proof), wrenches[grasps, worst]
