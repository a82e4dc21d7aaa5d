"""Batches of grasps through the compiled loops: layout, memory and threads."""

import math
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any, get_args

import numpy as np
import numpy.typing as npt
from scipy.optimize import nnls

from grasp3d._kernels import support_functions
from grasp3d._kernels import wrench_problem as kernels
from grasp3d._kernels.equilibrium import BALANCED
from grasp3d._kernels.growing_hull import UNDECIDED
from grasp3d._kernels.polytope import Polytope, make_polytope
from grasp3d._kernels.wrench_problem import Answers, Workspace, make_workspace
from grasp3d.arrays import Bools, Floats
from grasp3d.contact.contacts import Contacts, per_contact
from grasp3d.contact.friction_cones import edge_angles
from grasp3d.errors import SettingError
from grasp3d.quality.wrenches import Bounded, check_torque_scale, cone_parts, wrench_axes
from grasp3d.settings import Actuation
from grasp3d.system.processors import available_processors

Goal = tuple[float, float, float, float]

CHUNK = 1024
"""Grasps laid out at once; bounds the memory, and parts the work among threads."""

FIRST_FACETS = 1 << 11
"""Facets for which a thread has polytope at first."""

LAST_FACETS = 1 << 18
"""Facets beyond which the growth of a hull is given up."""

TINIEST = 1e-300
"""Stands for a size of nothing where it divides."""

_local = threading.local()


def _polytope(facets: int) -> Polytope:
    """This thread's polytope for a hull, used again from grasp to grasp."""
    polytope = getattr(_local, "polytope", None)
    if polytope is None or polytope.planes.shape[1] < facets:
        polytope = _local.polytope = make_polytope(facets)
    return polytope


@dataclass(frozen=True, eq=False)
class WrenchProblem:
    """Grasps with all that the compiled loops need to know of them, in a flat batch."""

    kind: int
    """`support_functions.ROWS`, TOTAL or PER_FINGER."""
    spherical: bool
    """Whether it is a force's length that is bounded."""
    soft: bool
    """Whether any finger resists torsion."""
    size: int
    """Grasps."""
    count: int
    """Contacts, or rows, of each."""
    lay_out: Callable[[slice], Floats]
    """Wrenches of some of the grasps, (b, n, 4, 6) or (b, n, 1, 6)."""
    reach: Floats
    """Tangential part of the forces that make the span (b, n)."""
    cones: Floats
    """Normal and tangential part of a force on the rim of the cones (b, n, 2)."""
    rim: Floats
    """Cosine and sine of the cones' edges (m, 2); none: circular."""
    beyond: Bools
    """Where tilts exceed friction, so that only a frictionless grasp is left to look at (b,)."""

    @classmethod
    def of_rows(cls, rows: Floats) -> "WrenchProblem":
        """Hulls of given wrenches, shape (b, n, 6)."""
        size, count = rows.shape[:2]
        return cls(
            kind=support_functions.ROWS,
            spherical=True,
            soft=False,
            size=size,
            count=count,
            lay_out=lambda part: np.ascontiguousarray(rows[part, :, None]),
            reach=np.ones((size, 1)),
            cones=np.ones((size, 1, 2)),
            rim=np.zeros((0, 2)),
            beyond=np.zeros(size, dtype=np.bool_),
        )

    @classmethod
    def of_contacts(
        cls,
        contacts: Contacts,
        edges: int | None,
        actuation: Actuation,
        *,
        torque_scale: float,
        cone_offset: npt.ArrayLike = 0.0,
        phase: float = 0.0,
        bounded: Bounded = "force",
    ) -> "WrenchProblem":
        """Grasp wrench spaces of contacts; the arguments are those of `quality.epsilon`."""
        if actuation not in get_args(Actuation):
            known = ", ".join(get_args(Actuation))
            raise SettingError(f"no actuation is called {actuation!r}; known: {known}")
        more = per_contact("cone_offset", cone_offset, contacts)
        if not math.isfinite(phase):
            raise SettingError(f"the phase of the edges must be finite; got {phase}")
        angles = np.clip(contacts.friction_angle + more, 0.0, math.pi)
        if edges is not None and not (angles < math.pi / 2.0).all():
            raise SettingError("polygonal friction cones must stay below 90 degrees")
        around = edge_angles(edges, phase) if edges is not None else np.zeros(0)
        check_torque_scale(torque_scale)
        points = contacts.points.reshape(-1, contacts.count, 3)
        normals = contacts.normals.reshape(points.shape)
        torsion = contacts.torsion_radius.reshape(points.shape[:-1])
        parts = cone_parts(angles, bounded)
        widest = np.maximum(parts[..., 1], cone_parts(contacts.friction_angle, bounded)[..., 1])
        return cls(
            kind=support_functions.TOTAL if actuation == "total" else support_functions.PER_FINGER,
            spherical=bounded == "force",
            soft=bool((contacts.torsion_radius > 0.0).any()),
            size=len(points),
            count=contacts.count,
            lay_out=lambda part: wrench_axes(
                points[part], normals[part], torsion[part], torque_scale
            ),
            reach=widest.reshape(-1, contacts.count),
            cones=parts.reshape(-1, contacts.count, 2),
            rim=np.stack([np.cos(around), np.sin(around)], axis=-1),
            beyond=(contacts.friction_angle + more < 0.0).any(axis=-1).reshape(-1),
        )

    def at_angles(self, angles: Floats) -> "WrenchProblem":
        """The same grasps, in the span that friction gives them, with cones of angles (b,)."""
        cones = np.stack([np.cos(angles), np.sin(angles)], axis=-1)[:, None]
        return replace(
            self,
            reach=np.ones((self.size, self.count)),
            cones=np.ascontiguousarray(np.broadcast_to(cones, (self.size, self.count, 2))),
        )

    def solve(
        self, goal: Goal, *, group: int = 1, prove: bool = True, threads: int | None = 1
    ) -> Answers:
        """Epsilon of every grasp, or of what matters in each group; see `grasps.epsilons`."""
        answers = _make_answers(self.size, self.count)

        def work(part: slice, workspace: Workspace) -> None:
            views: list[Any] = [values[part] for values in answers]
            few = Answers(*views)
            wrenches = self.lay_out(part)
            self._with_polytope(
                len(wrenches),
                lambda first, polytope: kernels.epsilons(
                    (self.kind, self.spherical, self.soft), wrenches, self.reach[part],
                    self.cones[part], self.rim, goal, group, prove, first, workspace, polytope, few,
                ),
            )  # fmt: skip

        self._in_parts(work, group, threads)
        # Cones of 90 degrees or more are not convex: sums of forces inside them may lie outside.
        convex = (self.cones[..., 0] > 0.0).all(axis=-1)
        answers.forces[~convex] = math.nan
        unproven = answers.closed & np.isnan(answers.forces[:, 0, 0]) & convex & prove
        for g in np.flatnonzero(unproven):
            answers.forces[g] = self._balance(slice(g, g + 1))
        # What closes without friction may still lose it by the tilts beyond: seven contacts can.
        # And what closes by no more than rounding has no forces to prove it.
        unsure = answers.closed & self.beyond | unproven & np.isnan(answers.forces[:, 0, 0])
        answers.lower[unsure], answers.closed[unsure] = 0.0, False
        answers.status[unsure], answers.forces[unsure] = UNDECIDED, math.nan
        return answers

    def _balance(self, one: slice) -> Floats:
        """Forces of one grasp that balance, (n, 4), where the hull is too thin to read them off.

        To every contact's normal force nonnegative least squares add what is missing.
        """
        axes = self.lay_out(one)[0]  # (n, 4 or 1, 6)
        if self.kind == support_functions.ROWS:
            mixes = np.array([[1.0, 0.0, 0.0, 0.0]])
            axes = np.pad(axes, ((0, 0), (0, 3), (0, 0)))
        else:
            around = np.arctan2(*self.rim.T[::-1]) if len(self.rim) else edge_angles(32)
            normal, across = self.cones[one][0, :, :1], self.cones[one][0, :, 1:]
            parts = (np.tile(normal, len(around)), across * np.cos(around), across * np.sin(around))
            mixes = np.stack([*parts, np.zeros_like(parts[0])], axis=-1)  # (n, m, 4)
        wrenches = mixes @ axes  # (n, m, 6)
        size = np.abs(wrenches).max(axis=(0, 1), initial=TINIEST)
        missing = -axes[:, 0].sum(axis=0)
        shares, rest = nnls((wrenches.reshape(-1, 6) / size).T, missing / size)
        if rest > BALANCED * len(axes):
            return np.full((len(axes), 4), math.nan)
        forces = (shares.reshape(len(axes), -1, 1) * mixes).sum(axis=1)
        forces[:, 0] += 1.0
        return np.asarray(forces / np.linalg.norm(forces[:, :3], axis=1).sum())

    def _with_polytope(self, size: int, run: Callable[[int, Polytope], int]) -> None:
        """Run a loop over grasps, with more polytope wherever it stops for want of it."""
        first = 0
        while first < size:
            polytope = _polytope(FIRST_FACETS)
            stopped = run(first, polytope)
            if stopped < size and polytope.planes.shape[1] < LAST_FACETS:
                _polytope(min(4 * polytope.planes.shape[1], LAST_FACETS))
                first = stopped
            else:
                first = stopped + 1

    def _in_parts(
        self, work: Callable[[slice, Workspace], None], group: int, threads: int | None
    ) -> None:
        """Do some work chunk by chunk of whole groups, in threads where there is enough of it."""
        workers = available_processors() if threads is None else threads
        if workers < 1:
            raise SettingError(f"threads must be at least 1; got {threads}")
        step = max(1, min(CHUNK, -(-self.size // (4 * workers))) // group) * group
        parts = [slice(i, min(i + step, self.size)) for i in range(0, self.size, step)]

        def with_own_workspace(part: slice) -> None:
            work(part, make_workspace(self.kind, self.count))

        if workers == 1 or len(parts) < 2:
            for part in parts:
                with_own_workspace(part)
            return
        with ThreadPoolExecutor(workers) as pool:
            list(pool.map(with_own_workspace, parts))


def _make_answers(size: int, count: int) -> Answers:
    return Answers(
        lower=np.zeros(size),
        upper=np.zeros(size),
        rank=np.zeros(size, dtype=np.int64),
        status=np.zeros(size, dtype=np.uint8),
        closed=np.zeros(size, dtype=np.bool_),
        direction=np.zeros((size, 6)),
        forces=np.full((size, count, 4), math.nan),
    )
