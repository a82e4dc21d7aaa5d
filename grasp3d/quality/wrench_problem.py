"""Wrench spaces of batches of grasps, evaluated by the compiled kernels in chunks and threads."""

import math
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np

from grasp3d._kernels.hull import wrench_problem as kernels
from grasp3d._kernels.hull.pair_epsilon import make_pair_scratch, pair_epsilons
from grasp3d._kernels.hull.polytope import Polytope, make_polytope
from grasp3d._kernels.hull.support_functions import PER_FINGER, ROWS, SIX, TOTAL
from grasp3d._kernels.hull.wrench_problem import SIGN, Bracket, Results, Workspace, make_workspace
from grasp3d.arrays import RIGHT_ANGLE, ArrayLike, Bools, Floats, Ints
from grasp3d.contact.contacts import Contacts, per_contact
from grasp3d.errors import SettingError
from grasp3d.quality.wrenches import (
    Bounded,
    EpsilonOptions,
    Goal,
    cone_parts,
    edge_forces,
    wrench_axes,
)
from grasp3d.system.context import thread_count

CHUNK = 1024
"""Grasps evaluated at once by a thread; limits the memory and divides the work."""

INITIAL_FACETS = (1 << 11) + 8
"""Capacity of a thread's first polytope, in facets; see `Polytope` on the 8."""

THREAD_CONTACTS = 512
"""Contacts in a batch that are worth another thread."""

MAX_FACETS = (1 << 18) + 8
"""Largest capacity of a polytope; a hull with more facets is not grown further."""

NOTHING = np.zeros(0)
NO_BRACKET = Bracket(NOTHING, NOTHING, NOTHING, NOTHING, np.zeros((0, 1)), NOTHING)
"""No intervals of critical angles: closure is tested at the given cones."""

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
    edge_forces: Floats | None = None
    """Polygonal cones, whose wrenches are the rows: forces along the edges, as components along the
    contacts' axes (b, n, m, 4)."""
    group: int = 1
    """As in `WrenchSpace`."""
    spherical: bool = True
    """Whether a force's length is bounded, rather than its normal component."""
    soft: bool = False
    """Whether any finger resists torsion."""

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
        group: int = 1,
    ) -> "WrenchProblem":
        """Grasp wrench spaces of contacts; the arguments are those of `ferrari_canny.epsilon`.

        `group` contacts, one after the other, are those of one finger.
        """
        offset = per_contact("cone_offset", cone_offset, contacts)
        if not math.isfinite(phase):
            raise SettingError(f"the phase of the edges must be finite; got {phase}")
        angles = np.maximum(contacts.friction_angle + offset, -RIGHT_ANGLE)
        np.minimum(angles, math.pi, out=angles)
        narrow = (contacts.torsion_radius > 0.0) | options.polygonal
        if (narrow & (angles >= RIGHT_ANGLE)).any():
            raise SettingError(
                "polygonal friction cones, and those of soft fingers, must stay below 90 degrees"
            )
        points = contacts.points.reshape(-1, contacts.count, 3)
        normals = contacts.normals.reshape(points.shape)
        torsion = contacts.torsion_radius.reshape(points.shape[:-1])

        def axes_of(chunk: slice | Ints) -> Floats:
            return wrench_axes(points[chunk], normals[chunk], torsion[chunk], options.torque_scale)

        cones = cone_parts(angles, bounded)
        if options.edges is not None:
            # The edges of cones without a width do not span what friction does.
            none = (contacts.friction_angle == 0.0) & (offset >= 0.0)
            sure = ((angles > 0.0) | none).all(axis=-1).reshape(-1)
            parts = cones.reshape(*torsion.shape, 2)
            forces = edge_forces(parts, torsion, options.edges, phase)
            return cls._of_polygons(axes_of, forces, sure, options, group)
        tangential = cones[..., 1]
        if offset.any():
            nominal = cone_parts(contacts.friction_angle, bounded)
            tangential = np.maximum(tangential, nominal[..., 1])
        return cls(
            kind=TOTAL if options.actuation == "total" else PER_FINGER,
            spherical=bounded == "force",
            soft=bool(contacts.torsion_radius.any()),
            size=len(points),
            count=contacts.count,
            wrenches_of=axes_of,
            tangential=np.ascontiguousarray(tangential.reshape(-1, contacts.count)),
            cones=cones.reshape(-1, contacts.count, 2),
            group=group,
        )

    @classmethod
    def _of_polygons(
        cls,
        axes_of: Callable[[slice | Ints], Floats],
        forces: Floats,
        sure: Bools,
        options: EpsilonOptions,
        group: int,
    ) -> "WrenchProblem":
        """Polygonal cones, by the wrenches of their edges; `sure` is whether each has a width."""
        size, count, edges, _ = forces.shape

        def rows_of(chunk: slice | Ints) -> Floats:
            return (forces[chunk] @ axes_of(chunk)).reshape(-1, count * edges, 1, 6)

        cones = np.ones((size, 1, 2))
        cones[~sure, :, 1] = -1.0
        return cls(
            kind=ROWS,
            size=size,
            count=count * edges,
            wrenches_of=rows_of,
            tangential=np.ones((size, 1)),
            cones=cones,
            edge_forces=forces,
            group=group * edges if options.actuation == "per_finger" else 1,
        )

    @classmethod
    def at_any_angle(cls, points: Floats, normals: Floats, torque_scale: float) -> "WrenchProblem":
        """Wrench spaces of hard contacts (b, n, 3) whose cones a `Bracket` determines."""
        none = np.zeros(points.shape[:2])
        return cls(
            kind=TOTAL,
            size=len(points),
            count=points.shape[1],
            wrenches_of=lambda chunk: wrench_axes(
                points[chunk], normals[chunk], none[chunk], torque_scale
            ),
            tangential=np.ones(points.shape[:2]),
            cones=np.ones((*points.shape[:2], 2)),
        )

    def take(self, grasps: Ints) -> "WrenchProblem":
        """The problem of chosen grasps (g,), in their order."""
        return replace(
            self,
            size=len(grasps),
            wrenches_of=lambda chunk: self.wrenches_of(grasps[chunk]),
            tangential=self.tangential[grasps],
            cones=self.cones[grasps],
            edge_forces=None if self.edge_forces is None else self.edge_forces[grasps],
        )

    def solve(self, goal: Goal, *, with_forces: bool = False) -> Results:
        """Epsilon, force closure and separating directions of every grasp.

        Args:
            goal: When a hull need not be grown further.
            with_forces: Whether equilibrium forces are computed.

        Raises:
            SettingError: Fewer than one thread.
        """
        results = self.unwritten(Results, with_forces=with_forces)
        if not self.is_pairs(goal):
            self.grow_hulls(results, goal)
            return results
        left = np.flatnonzero(self.solve_pairs(results, goal))
        if len(left):
            others = self.take(left)
            hulls = others.unwritten(Results)
            others.grow_hulls(hulls, goal)
            for name in Results._fields[:-1]:  # without forces
                getattr(results, name)[left] = getattr(hulls, name)
        return results

    @property
    def form(self) -> tuple[int, bool, bool, int]:
        """Kind, boundedness, softness and group, as `WrenchSpace` takes them."""
        return self.kind, self.spherical, self.soft, self.group

    def is_pairs(self, goal: Goal) -> bool:
        """Whether epsilon is that of two hard fingers with circular cones, within a tolerance."""
        plain = self.kind != ROWS and not self.soft and self.group == 1
        return plain and self.count == 2 and goal[0] > 0.0 and goal[2] == math.inf

    def balanced_forces(self, closed: Bools) -> Floats:
        """Equilibrium forces of the closed grasps, along the contacts' axes.

        Their lengths, or the weights of given wrenches, add up to 1.

        Args:
            closed: Which grasps are closed, shape (b,).

        Returns:
            Shape (b, n, 4); nan for other grasps, and where cones are of 90 degrees or more.
        """
        forces = np.full((self.size, self.count, 4), math.nan)
        # The hull of all wrenches contains the origin where their sums do.
        hull = replace(self, kind=TOTAL if self.kind == PER_FINGER else self.kind, group=1)
        rows = np.flatnonzero(closed)
        forces[rows] = hull.take(rows).solve(SIGN, with_forces=True).forces
        if self.edge_forces is not None:
            weights = forces[..., 0].reshape(*self.edge_forces.shape[:2], 1, -1)
            forces = (weights @ self.edge_forces)[:, :, 0]
        lengths = np.linalg.norm(forces[..., :3], axis=-1)
        return np.asarray(forces / lengths.sum(axis=1)[:, None, None])

    def solve_pairs(self, results: Results, goal: Goal) -> Bools:
        """Write the results of pairs; return which are left to the growing hull (b,)."""
        left = np.zeros(self.size, dtype=np.bool_)

        def evaluate(chunk: slice, _: Workspace) -> None:
            pair_epsilons(
                self.form, self.wrenches_of(chunk), self.tangential[chunk], self.cones[chunk],
                goal[0], make_pair_scratch(), part_of(results, chunk), left[chunk],
            )  # fmt: skip

        self.in_chunks(evaluate)
        return left

    def narrow(self, bracket: Bracket) -> None:
        """Narrow intervals of critical angles, for problems made by `at_any_angle`.

        Args:
            bracket: An interval for each grasp; overwritten.
        """
        self.grow_hulls(self.unwritten(Results), SIGN, bracket=bracket)

    def grow_hulls(self, results: Results, goal: Goal, *, bracket: Bracket | None = None) -> None:
        """Write the results of the growing hulls; see `solve`."""

        def evaluate(chunk: slice, workspace: Workspace) -> None:
            written, wrenches = part_of(results, chunk), self.wrenches_of(chunk)
            intervals = NO_BRACKET if bracket is None else part_of(bracket, chunk)
            settings = self.form, wrenches, self.tangential[chunk], self.cones[chunk], goal

            def run(first: int, polytope: Polytope) -> int:
                arrays = (intervals, workspace, polytope, written)
                if not thin:
                    first = int(kernels.epsilons(*settings, first, 6, SIX, *arrays))
                    if first == len(wrenches) or written.status[first] != kernels.OTHER_RANK:
                        return first
                return int(kernels.epsilons(*settings, first, 1, workspace.dims, *arrays))

            self.with_polytope(len(wrenches), run)

        # Two hard fingers have no torque about their line: loops for rank 6 alone do not apply.
        thin = self.kind != ROWS and self.count == 2 and not self.soft
        self.in_chunks(evaluate)

    def unwritten(self, kind: type[ArraysT], *, with_forces: bool = False) -> ArraysT:
        """Arrays for the results of every grasp, which the kernels write."""
        arrays: dict[str, np.ndarray[Any, Any]] = {
            "rank": np.zeros(self.size, dtype=np.int64),
            "status": np.zeros(self.size, dtype=np.uint8),
            "reason": np.zeros(self.size, dtype=np.uint8),
            "closed": np.zeros(self.size, dtype=np.bool_),
            "direction": np.zeros((self.size, 6)),
            "forces": np.zeros((self.size if with_forces else 0, self.count, 4)),
            "lower": np.zeros(self.size),
            "upper": np.zeros(self.size),
        }
        return kind(*map(arrays.__getitem__, kind._fields))  # type: ignore[attr-defined]

    def with_polytope(
        self, size: int, run: Callable[[int, Polytope], int], *, small: bool = False
    ) -> None:
        """Call `run(first grasp, polytope)`, and with a larger one if it stops, unless `small`."""
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
        each = self.count if self.edge_forces is None else self.edge_forces.shape[1]
        useful = 1 + self.size * each // THREAD_CONTACTS
        workers = min(thread_count(), useful) if useful > 1 else 1
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
