"""Wrench spaces of batches of grasps, evaluated by the compiled kernels in chunks and threads."""

import math
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

import numpy as np

from grasp3d._kernels.hull import wrench_problem as kernels
from grasp3d._kernels.hull.certificates import LARGEST_SLACK
from grasp3d._kernels.hull.critical_angle import Bracket, no_bracket
from grasp3d._kernels.hull.growing_hull import CONVERGED, UNDECIDED
from grasp3d._kernels.hull.pair_epsilon import make_pair_scratch, pair_epsilons
from grasp3d._kernels.hull.polytope import SCRATCH_ROWS, Polytope, make_polytope
from grasp3d._kernels.hull.support_functions import LINEAR, NO_TORSION, PER_FINGER, ROWS, SIX, TOTAL
from grasp3d._kernels.hull.wrench_problem import (
    NEAR_DEGENERATE,
    SIGN,
    Results,
    Workspace,
    make_workspace,
    verify,
)
from grasp3d._kernels.hull.wrenches import RANK_TOLERANCE
from grasp3d.arrays import ArrayLike, Bools, Floats, Ints
from grasp3d.contact.contacts import Contacts, not_nearly_degenerate, per_contact
from grasp3d.contact.friction_cones import edge_angles
from grasp3d.errors import SettingError
from grasp3d.quality.wrenches import Bounded, EpsilonOptions, Goal, cone_parts, wrench_axes
from grasp3d.system.context import thread_count

CHUNK = 1024
"""Grasps evaluated at once by a thread; limits the memory and divides the work."""

INITIAL_FACETS = (1 << 11) + 8
"""Capacity of a thread's first polytope, in facets; see `Polytope` on the 8."""

THREAD_CONTACTS = 512
"""Contacts of grasps that are worth another thread."""

MAX_FACETS = (1 << 18) + 8
"""Largest capacity of a polytope; a hull with more facets is not grown further."""

NO_TOLERANCE = 2e-15
"""Rank tolerance that is as small as rounding errors allow."""

TINIEST = 1e-300
"""Least divisor, which replaces a size of 0."""

MOST_TAKEN = 1 << 16
"""Grasps whose wrenches are written at once where forces in equilibrium are computed."""

ArraysT = TypeVar("ArraysT", bound=tuple[Any, ...])

_local = threading.local()


def _polytope(facets: int) -> Polytope:
    """The calling thread's polytope of at least so many facets, reused for all its grasps."""
    polytope = getattr(_local, "polytope", None)
    if polytope is None or polytope.planes.shape[1] < facets:
        polytope = _local.polytope = make_polytope(facets)
    return polytope


@dataclass(frozen=True, eq=False)
class WrenchProblem:
    """Wrench spaces of a flat batch of grasps, as the compiled kernels take them."""

    kind: int
    """`ROWS`, `TOTAL` or `PER_FINGER`."""
    size: int
    """Number of grasps."""
    count: int
    """Number of contacts, or of rows, of each grasp."""
    wrenches_of: Callable[[slice | Ints], Floats]
    """Axes of the contacts, or rows, of some of the grasps: (b, n, 4, 6) or
    (b, n, 1, 6)."""
    tangential: Floats
    """Factor of the tangential axes in the span of the wrenches: 0 without friction (b, n)."""
    cones: Floats
    """Normal and tangential component of a force on the rim of the cones (b, n, 2)."""
    tilts_exceed_friction: Bools
    """Whether the half-angle of some cone is negative, so that its contact was replaced by a
    frictionless one (b,)."""
    rim: Floats = field(default_factory=lambda: np.zeros((0, 2)))
    """Cosines and sines of the angles of the cones' edges (m, 2); empty: circular cones."""
    spherical: bool = True
    """Whether a force's length is bounded, rather than its normal component."""
    soft: bool = False
    """Whether any finger resists torsion."""
    points: Floats | None = None
    """Contact points (b, n, 3), which distinguish nearly coinciding contacts from coinciding ones.
    None: the wrenches are taken as they are."""
    rank_tolerance: float = RANK_TOLERANCE
    """As in `wrenches.span`."""

    @classmethod
    def of_rows(cls, rows: Floats) -> "WrenchProblem":
        """Hulls of given wrenches, shape (b, n, 6)."""
        size, count = rows.shape[:2]
        return cls(
            kind=ROWS,
            size=size,
            count=count,
            wrenches_of=lambda chunk: np.ascontiguousarray(rows[chunk, :, None]),
            tangential=np.ones((size, 1)),
            cones=np.ones((size, 1, 2)),
            tilts_exceed_friction=np.zeros(size, dtype=np.bool_),
        )

    @classmethod
    def of_contacts(
        cls,
        contacts: Contacts,
        options: EpsilonOptions,
        *,
        cone_offset: ArrayLike = 0.0,
        phase: float = 0.0,
        bounded: Bounded = "force",
    ) -> "WrenchProblem":
        """Grasp wrench spaces of contacts; the arguments are those of `ferrari_canny.epsilon`."""
        edges = options.edges
        offset = per_contact("cone_offset", cone_offset, contacts)
        if not math.isfinite(phase):
            raise SettingError(f"the phase of the edges must be finite; got {phase}")
        angles = np.clip(contacts.friction_angle + offset, 0.0, math.pi)
        if edges is not None and not (angles < math.pi / 2.0).all():
            raise SettingError("polygonal friction cones must stay below 90 degrees")
        rim_angles = edge_angles(edges, phase) if edges is not None else np.zeros(0)
        points = contacts.points.reshape(-1, contacts.count, 3)
        normals = contacts.normals.reshape(points.shape)
        torsion = contacts.torsion_radius.reshape(points.shape[:-1])
        cones = cone_parts(angles, bounded)
        tangential = cones[..., 1]
        if offset.any():
            nominal = cone_parts(contacts.friction_angle, bounded)
            tangential = np.maximum(tangential, nominal[..., 1])
        return cls(
            kind=TOTAL if options.actuation == "total" else PER_FINGER,
            spherical=bounded == "force",
            soft=bool((contacts.torsion_radius > 0.0).any()),
            size=len(points),
            count=contacts.count,
            wrenches_of=lambda chunk: wrench_axes(
                points[chunk], normals[chunk], torsion[chunk], options.torque_scale
            ),
            tangential=np.ascontiguousarray(tangential.reshape(-1, contacts.count)),
            cones=cones.reshape(-1, contacts.count, 2),
            rim=np.stack([np.cos(rim_angles), np.sin(rim_angles)], axis=-1),
            tilts_exceed_friction=(contacts.friction_angle + offset < 0.0).any(axis=-1).reshape(-1),
            points=points,
        )

    def take(self, grasps: Ints) -> "WrenchProblem":
        """The problem of chosen grasps (g,), in their order."""
        wrenches = self.wrenches_of(grasps)
        return self.with_wrenches(grasps, lambda chunk: np.ascontiguousarray(wrenches[chunk]))

    def with_wrenches(
        self, grasps: Ints, wrenches_of: Callable[[slice | Ints], Floats]
    ) -> "WrenchProblem":
        """The problem of chosen grasps (g,), any of them more than once, with other wrenches."""
        return replace(
            self,
            size=len(grasps),
            wrenches_of=wrenches_of,
            tangential=self.tangential[grasps],
            cones=self.cones[grasps],
            tilts_exceed_friction=self.tilts_exceed_friction[grasps],
            points=None if self.points is None else self.points[grasps],
        )

    def at_angles(self, angles: Floats) -> "WrenchProblem":
        """The same grasps with cones of half-angles (b,), in the span of wrenches with friction."""
        cones = np.stack([np.cos(angles), np.sin(angles)], axis=-1)[:, None]
        return replace(
            self,
            tangential=np.ones((self.size, self.count)),
            cones=np.ascontiguousarray(np.broadcast_to(cones, (self.size, self.count, 2))),
        )

    def solve(self, goal: Goal, *, with_forces: bool = True) -> Results:
        """Epsilon, force closure and certificates of every grasp.

        Args:
            goal: When a hull need not be grown further.
            with_forces: Whether equilibrium forces are computed.

        Raises:
            SettingError: Fewer than one thread.
        """
        results = self._grown(goal, with_forces=with_forces)
        # Cones of 90 degrees or more are not convex: sums of forces inside them may lie outside.
        convex = (self.cones[..., 0] > 0.0).all(axis=-1)
        results.forces[~convex] = math.nan
        unproven = results.closed & ~(results.slack < LARGEST_SLACK)
        for g in np.flatnonzero(unproven & convex):
            results.forces[g], results.slack[g] = self._equilibrium(int(g))
        unproven &= ~(results.slack < LARGEST_SLACK)
        # Where tilts exceed friction, closure without friction, which seven contacts can have, may
        # be lost by the rest of the tilt. Closure within rounding errors has no equilibrium forces.
        undecided = results.closed & self.tilts_exceed_friction | unproven
        near = np.flatnonzero(results.status == NEAR_DEGENERATE)
        if len(near):
            results.status[near] = CONVERGED
            undecided[near] = ~self._not_nearly_degenerate(near)
        thin = np.flatnonzero(results.closed & (results.rank < 6) & ~undecided)
        undecided[thin] = ~self._closed_at_any_rank(thin, results)
        results.lower[undecided], results.closed[undecided] = 0.0, False
        results.status[undecided], results.forces[undecided] = UNDECIDED, math.nan
        return results

    @property
    def _form(self) -> tuple[int, bool, int]:
        """Kind, boundedness and limit surface, as `WrenchSpace` takes them."""
        return self.kind, self.spherical, LINEAR if self.soft else NO_TORSION

    def _grown(self, goal: Goal, *, with_forces: bool) -> Results:
        """Results before their proofs are examined; see `solve`."""
        results = self.unwritten(Results)
        if not self.is_pairs(goal):
            self.grow_hulls(results, goal, with_forces=with_forces)
            return results
        left = np.flatnonzero(self.solve_pairs(results, goal))
        if len(left):
            others = self.take(left)
            hulls = others.unwritten(Results)
            others.grow_hulls(hulls, goal, with_forces=with_forces)
            for name in Results._fields:
                getattr(results, name)[left] = getattr(hulls, name)
        return results

    def is_pairs(self, goal: Goal) -> bool:
        """Whether epsilon is that of two hard fingers with circular cones, within a tolerance."""
        plain = self.kind != ROWS and not (len(self.rim) or self.soft)
        return plain and self.count == 2 and goal[0] > 0.0 and goal[2:] == (math.inf, 0.0)

    def balanced_forces(self, closed: Bools, goal: Goal) -> Floats:
        """Equilibrium forces of the grasps that were found to be closed, in the contacts' axes.

        A small hull, grown only until closure is known, mostly has them.

        Args:
            closed: Which grasps are closed, shape (b,).
            goal: That of `solve`.

        Returns:
            Shape (b, n, 4 or 6); nan for other grasps, and where no forces prove closure.
        """
        forces = np.full((self.size, self.count, 4), math.nan)
        balanced = closed & (self.cones[..., 0] > 0.0).all(axis=-1)  # see `solve`
        goals = (goal, SIGN) if self.is_pairs(goal) else (SIGN, goal)  # pairs need no hull
        for each in dict.fromkeys(goals):
            left = np.flatnonzero(balanced & np.isnan(forces).any(axis=(1, 2)))
            for rows in np.split(left, range(MOST_TAKEN, len(left), MOST_TAKEN)):
                forces[rows] = self.take(rows).solve(each).forces
        return forces

    def solve_pairs(self, results: Results, goal: Goal) -> Bools:
        """Write the results of pairs; returns which are left to the growing hull (b,)."""
        left = np.zeros(self.size, dtype=np.bool_)

        def evaluate(chunk: slice, _: Workspace) -> None:
            pair_epsilons(
                self._form, self.wrenches_of(chunk), self.tangential[chunk], self.cones[chunk],
                goal[0], make_pair_scratch(), part_of(results, chunk), left[chunk],
            )  # fmt: skip

        self.in_chunks(evaluate)
        return left

    def narrow(self, bracket: Bracket) -> None:
        """Narrow the intervals of critical angles, from cones of one angle in each, as far as sure.

        Args:
            bracket: An interval of each grasp; written, as the cones are.
        """
        self.grow_hulls(self.unwritten(Results), SIGN, with_forces=True, bracket=bracket)

    def grow_hulls(
        self,
        results: Results,
        goal: Goal,
        *,
        with_forces: bool,
        bracket: Bracket | None = None,
    ) -> None:
        """Write the results of the growing hulls; see `solve`."""

        def evaluate(chunk: slice, workspace: Workspace) -> None:
            written, wrenches = part_of(results, chunk), self.wrenches_of(chunk)
            intervals = no_bracket() if bracket is None else part_of(bracket, chunk)
            settings = (
                self._form, wrenches, self.tangential[chunk], self.cones[chunk], self.rim,
                self.rank_tolerance, goal, with_forces,
            )  # fmt: skip

            def run(first: int, polytope: Polytope) -> int:
                arrays = (intervals, workspace, polytope, written)
                if not thin:
                    first = int(kernels.epsilons(*settings, first, 6, SIX, *arrays))
                    if first == len(wrenches) or written.status[first] != kernels.OTHER_RANK:
                        return first
                return int(kernels.epsilons(*settings, first, 1, workspace.dims, *arrays))

            self.with_polytope(len(wrenches), run)

        # Two hard fingers have no torque about their line: loops for rank 6 alone are of no use.
        thin = self.kind != ROWS and self.count == 2 and not self.soft
        self.in_chunks(evaluate)

    def _not_nearly_degenerate(self, grasps: Ints) -> Bools:
        """Whether contacts of chosen grasps are at one point, or on one line, exactly or not."""
        if self.points is None:
            return np.ones(len(grasps), dtype=np.bool_)
        return not_nearly_degenerate(self.points[grasps])

    def _closed_at_any_rank(self, grasps: Ints, results: Results) -> Bools:
        """Whether force closure in fewer than six dimensions does not depend on rounding, (g,).

        Contacts nearly on a line span a sixth dimension that the rank leaves out as too thin, but
        in which forces must balance as well. Force closure counts where it holds in both.
        """
        if self.soft or not grasps.size:
            return np.ones(len(grasps), dtype=np.bool_)
        closed = self._not_nearly_degenerate(grasps)
        doubtful = np.flatnonzero(~closed)
        if doubtful.size:
            problem = replace(self.take(grasps[doubtful]), points=None, rank_tolerance=NO_TOLERANCE)
            in_full = problem.solve(SIGN)
            closed[doubtful] = in_full.closed & (in_full.rank == 6)
            results.forces[grasps[doubtful]] = in_full.forces
            results.slack[grasps[doubtful]] = in_full.slack
            still_open = doubtful[~in_full.closed]
            results.direction[grasps[still_open]] = in_full.direction[~in_full.closed]
        return closed

    def _equilibrium(self, g: int) -> tuple[Floats, float]:
        """Equilibrium forces of one grasp, (n, 4), where the hull is too thin to yield them.

        Nonnegative least squares find the forces that balance a unit normal force at every contact.

        Returns:
            The forces and their slack, inf where they prove nothing.
        """
        from scipy.optimize import nnls

        axes = self.wrenches_of(slice(g, g + 1))[0]  # (n, 4 or 1, 6)
        wrenches, cones = axes, self.cones[g]
        if self.kind == ROWS:
            components = np.array([[1.0, 0.0, 0.0, 0.0]])
            axes = np.pad(axes, ((0, 0), (0, 3), (0, 0)))
        else:
            angles = np.arctan2(*self.rim.T[::-1]) if len(self.rim) else edge_angles(32)
            normal, tangential = cones[:, :1], cones[:, 1:]
            normals = np.tile(normal, len(angles))
            first, second = tangential * np.cos(angles), tangential * np.sin(angles)
            components = np.stack(
                [normals, first, second, np.zeros_like(normals)], axis=-1
            )  # (n, m, 4)
        rows = components @ axes  # (n, m, 6)
        size = np.abs(rows).max(axis=(0, 1), initial=TINIEST)
        balance = -axes[:, 0].sum(axis=0)
        weights, _ = nnls((rows.reshape(-1, 6) / size).T, balance / size)
        forces = np.ascontiguousarray(
            (weights.reshape(len(axes), -1, 1) * components).sum(axis=1), dtype=np.float64
        )
        forces[:, 0] += 1.0
        slack = verify(
            self._form, wrenches, self.tangential[g], cones, self.rim,
            self.rank_tolerance, make_workspace(self.kind, self.count),
            np.zeros((SCRATCH_ROWS, 8)), forces,
        )  # fmt: skip
        return (forces if slack < LARGEST_SLACK else np.full_like(forces, math.nan)), float(slack)

    def unwritten(self, kind: type[ArraysT]) -> ArraysT:
        """Results of a kind for every grasp, which the kernels write."""
        arrays: dict[str, np.ndarray[Any, Any]] = {
            "rank": np.zeros(self.size, dtype=np.int64),
            "status": np.zeros(self.size, dtype=np.uint8),
            "reason": np.zeros(self.size, dtype=np.uint8),
            "closed": np.zeros(self.size, dtype=np.bool_),
            "direction": np.zeros((self.size, 6)),
            "forces": np.full((self.size, self.count, 4), math.nan),
            "slack": np.full(self.size, math.inf),
        }
        names: tuple[str, ...] = kind._fields  # type: ignore[attr-defined]
        return kind(*(arrays.get(name, np.zeros(self.size)) for name in names))

    def with_polytope(
        self, size: int, run: Callable[[int, Polytope], int], *, small: bool = False
    ) -> None:
        """Call `run(first grasp, polytope)`, again with a larger polytope where it stops early.

        `small`: never with a larger one.
        """
        first = 0
        while first < size:
            polytope = make_polytope(INITIAL_FACETS) if small else _polytope(INITIAL_FACETS)
            stopped = run(first, polytope)
            if not small and stopped < size and polytope.planes.shape[1] < MAX_FACETS:
                _polytope(min(4 * polytope.planes.shape[1] + 8, MAX_FACETS))
                first = stopped
            else:
                first = stopped + 1

    def in_chunks(self, evaluate: Callable[[slice, Workspace], None]) -> None:
        """Evaluate chunks, in threads if there are several."""
        # A few grasps take less time than the start of a thread.
        workers = min(thread_count(), 1 + self.size * self.count // THREAD_CONTACTS)
        part = self.size if workers == 1 else -(-self.size // (4 * workers))
        step = max(1, min(CHUNK, part))
        chunks = [slice(i, min(i + step, self.size)) for i in range(0, self.size, step)]

        def with_own_workspace(chunk: slice) -> None:
            evaluate(chunk, make_workspace(self.kind, self.count))

        if workers == 1 or len(chunks) < 2:
            for chunk in chunks:
                with_own_workspace(chunk)
            return
        with ThreadPoolExecutor(workers) as executor:
            list(executor.map(with_own_workspace, chunks))


def part_of(results: ArraysT, chunk: slice | Ints) -> ArraysT:
    """Results of some of the grasps, as views where the chunk is a slice."""
    return type(results)(*(values[chunk] for values in results))
