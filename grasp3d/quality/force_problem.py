"""Grip forces of batches of grasps, evaluated by the compiled kernels in chunks and threads.

That contacts cannot apply a wrench, however hard they press, is proven by projecting it onto a
polyhedral cone that contains all that they can apply; where something remains, it is a direction
along which no contact can push.

Wrench spaces may be over all normals that a sensor cannot distinguish from the given ones. The true
normal of each contact lies anywhere within the tilt a = alpha/2 of the perceived one (Wan & Howe
2018, Sec. III), each independently. Two convex sets of contact forces bound what that means:

* 'worst_case': forces that a contact can apply whichever its normal is. Some force of them suffices
  at every tilt. Of hard fingers it is the cone of half-angle beta - a; where lengths of forces are
  bounded the force that it needs is exactly the largest over all tilts: a tilt by a turns the
  normal away from any direction, so that the smallest support function over the tilts is that of
  the smaller cone. Of two soft fingers see `_kernels.forces.worst_case_forces`; more of them are
  taken as hard.
* 'best_case': forces that it can apply at some of the normals, and of a soft finger the moments
  that it can, each by itself. No tilt needs less. It holds the convex hull of the tilted cones and
  limit surfaces.
"""

import math
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, Literal

import numpy as np
from scipy.spatial import ConvexHull

from grasp3d._kernels.forces import grip_force as kernels
from grasp3d._kernels.forces.grip_force import ForceResults
from grasp3d._kernels.forces.tasks import POINTS, SIZE, TERM
from grasp3d._kernels.forces.worst_case_forces import write_worst_case_forces
from grasp3d._kernels.hull.growing_hull import CONVERGED
from grasp3d._kernels.hull.polytope import SCRATCH_ROWS
from grasp3d._kernels.hull.support_functions import ELLIPTIC, LINEAR, NO_TORSION, PER_FINGER
from grasp3d._kernels.hull.tilted_forces import BEST_CASE, COLUMNS, MODES, WORST_CASE
from grasp3d._kernels.hull.wrench_problem import Workspace
from grasp3d.arrays import ArrayLike, Floats, Ints
from grasp3d.contact.contacts import Contacts, per_contact
from grasp3d.contact.friction_cones import edge_angles, tangents
from grasp3d.quality.closure import forces_of_components
from grasp3d.quality.tasks import Task, Terms
from grasp3d.quality.wrench_problem import WrenchProblem, part_of
from grasp3d.quality.wrenches import EpsilonOptions, check_rtol, read_only, wrench_axes
from grasp3d.settings import check_choice
from grasp3d.system.context import in_threads

Side = Literal["worst_case", "best_case"]
"""Which of the two sets of forces."""

SURFACES = {"worst_case": WORST_CASE, "best_case": BEST_CASE}
"""Limit surfaces of the kernels."""

LEVELS = 5
"""Largest torsional moments of two soft fingers for which their worst-case forces are computed."""

CHUNK = 256
"""Grasps whose worst-case forces one thread computes at a time."""

SENSES = np.array([[1.0, 1.0, 1.0, 1.0], [-1.0, 1.0, 1.0, 1.0]])
"""Factors of the axes of moments about a normal, for either sense."""


def problem_over_tilts(
    contacts: Contacts, tilts: Floats, side: Side, *, spherical: bool, each: bool
) -> WrenchProblem:
    """The wrench spaces of a flat batch of contacts.

    Args:
        contacts: The contacts, of a size of about 1.
        tilts: Largest tilts a [rad], shape (b, n).
        side: Which forces.
        spherical: Whether lengths of forces are bounded by 1, instead of normal components.
        each: Whether the force of each contact is bounded, instead of all together: then torsion
            counts for worst-case forces.
    """
    points, normals, torsion = contacts.points, contacts.normals, contacts.torsion_radius
    any_soft = bool((torsion > 0.0).any())
    angles = contacts.friction_angle
    tilts = np.array(tilts, order="C")  # one that kernels are compiled for
    if side == "worst_case":
        modes = LEVELS * MODES if any_soft and each and contacts.count == 2 else 1
        cones, moments = np.empty((*tilts.shape, modes * COLUMNS)), np.empty(points.shape)
        given = [read_only(one, one.shape) for one in (points, normals, torsion)]
        arrays = (*given, angles, tilts)

        def write(rows: slice, scratch: Any) -> None:
            parts = (array[rows] for array in arrays)
            write_worst_case_forces(spherical, *parts, *scratch, cones[rows], moments[rows])

        in_threads(write, len(tilts), CHUNK, lambda: np.zeros((2, 2)))
        tangential = cones[..., COLUMNS - 1] > 0.0
    else:
        widest = np.minimum(angles + tilts, math.pi)
        turns = (turn(angle) for angle in (tilts, widest) for turn in (np.cos, np.sin))
        cones = np.stack([contacts.friction, *turns], axis=-1)
        moments, tangential = np.zeros(points.shape), angles + tilts > 0.0
        if any_soft:
            # Moments about a normal are as forces of further contacts. Each of these is there
            # twice, once for either sense, and so are the contacts: two always share a bound.
            cosine, sine = np.cos(tilts), np.sin(tilts)
            own = np.stack([np.zeros_like(tilts), cosine, sine, cosine, sine], axis=-1)
            cones = np.concatenate([cones, own], axis=1).repeat(2, axis=1)
            tangential = np.concatenate([tangential, tilts > 0.0], axis=1).repeat(2, axis=1)

    def wrenches_of(chunk: slice | Ints) -> Floats:
        axes = wrench_axes(points[chunk], normals[chunk], torsion[chunk], 1.0)
        axes[..., 3, 3:] = moments[chunk]
        if cones.shape[1] == contacts.count:
            return axes
        turning = np.zeros_like(axes)
        turning[..., :3, 3:] = torsion[chunk][..., None, None] * axes[..., :3, :3]
        senses = np.tile(SENSES, (contacts.count, 1))[..., None]  # (2 n, 4, 1)
        both = axes.repeat(2, axis=1), turning.repeat(2, axis=1) * senses
        return np.concatenate(both, axis=1)

    return WrenchProblem(
        kind=PER_FINGER,
        size=len(points),
        count=cones.shape[1],
        wrenches_of=wrenches_of,
        tangential=tangential.astype(float),
        cones=cones,
        tilts_exceed_friction=np.zeros(len(points), dtype=np.bool_),
        spherical=spherical,
        soft=any_soft,
    )


ForceBound = Literal["normal", "norm", "total"]
"""What of the contact forces is limited: the normal component of each, the length of each, or the
sum of the normal components of all."""

LimitSurface = Literal["none", "ellipse", "linear"]
"""What soft fingers were taken to resist: nothing, for hard fingers; the elliptic limit surface of
Howe & Cutkosky (IJRR 1996), for circular cones; or, for polygonal cones, the convex hull of the
cone's edges and of the pure normal force with its torsional moment, as epsilon takes it."""


EDGES = 64
"""Edges of the circumscribed polygon of a friction cone."""

SPHERE_POINTS = 400
"""Vertices of the circumscribed polyhedron of the elliptic limit surface."""

ROUNDING = 1e-11
"""Rounding errors of unit wrenches along the direction."""

DECIDED = 64
"""Grasps whose pushes are computed together."""

APART = 1e-9
"""Remainder, relative to the wrench, that is not a rounding error."""


@dataclass(frozen=True, eq=False)
class ForceProblem:
    """Wrench spaces of a flat batch of grasps whose contact forces are bounded by 1."""

    problem: WrenchProblem
    """The contacts, with points divided by the grasps' sizes: a torque scale for each."""
    contacts: Contacts
    sizes: Floats
    """Largest distance of a contact from the centre of mass; 1 where that is 0 (b,)."""
    limit_surface: LimitSurface
    bound: ForceBound
    torsion: int
    """Limit surface, as in `WrenchSpace`."""
    group: int = 1
    """As in `WrenchSpace`."""
    plain: bool = False
    """Whether contacts have circular cones of their own angles and normals."""

    @classmethod
    def of_contacts(
        cls,
        contacts: Contacts,
        *,
        bound: ForceBound,
        edges: int | None = None,
        cone_offset: ArrayLike = 0.0,
    ) -> "ForceProblem":
        """The problem of contacts.

        Args:
            contacts: The contacts.
            bound: As in `grip_force`.
            edges: As in `grip_force`.
            cone_offset: As in `grip_force`.
        """
        check_choice("bound", bound, ForceBound)
        sizes = _sizes(contacts)
        problem = WrenchProblem.of_contacts(
            contacts.of_size(contacts.points / sizes[..., None, None], sizes),
            EpsilonOptions(edges, "total" if bound == "total" else "per_finger"),
            cone_offset=cone_offset,
            bounded="force" if bound == "norm" else "normal",
        )
        surface: LimitSurface = "none"
        if problem.soft:
            surface = "ellipse" if edges is None else "linear"
        return cls(
            problem, contacts, sizes.reshape(-1), surface, bound,
            torsion={"none": NO_TORSION, "ellipse": ELLIPTIC, "linear": LINEAR}[surface],
            plain=edges is None and not np.any(cone_offset),
        )  # fmt: skip

    @classmethod
    def over_tilts(
        cls,
        contacts: Contacts,
        tilt: ArrayLike,
        side: Side,
        *,
        bound: ForceBound,
        group: int = 1,
    ) -> "ForceProblem":
        """The problem of the forces that contacts apply in the worst or the best case.

        Args:
            contacts: The contacts.
            tilt: Largest tilts [rad], one value or shape (..., n).
            side: Which of the two sets of forces.
            bound: As in `grip_force`.
            group: As in `payload`.
        """
        sizes = _sizes(contacts)
        flat = contacts.of_size(contacts.points / sizes[..., None, None], sizes).reshape((-1,))
        tilts = per_contact("tilt", tilt, contacts).reshape(flat.friction.shape)
        surface: LimitSurface = "ellipse" if (flat.torsion_radius > 0.0).any() else "none"
        problem = problem_over_tilts(
            flat, tilts, side, spherical=bound == "norm", each=bound != "total"
        )
        group = flat.count if bound == "total" else group
        if problem.count > flat.count:
            group *= 2
        code = SURFACES[side]
        return cls(problem, contacts, sizes.reshape(-1), surface, bound, code, group)

    @property
    def _form(self) -> tuple[int, bool, int, int]:
        return self.problem.kind, self.problem.spherical, self.torsion, self.group

    def of_task(self, task: Task, rtol: float, masses: Floats | None = None) -> ForceResults:
        """Bounds of the force that resists a whole task, for masses (b,) or the task's own."""
        check_rtol(rtol)
        if masses is None:
            return self.of_terms(task.arrays(), np.ones(self.problem.size), rtol)
        return self.of_terms(task.scaled_to(1.0).arrays(), masses, rtol)

    def of_wrenches(self, wrenches: Floats, rtol: float, *, certified: bool = True) -> ForceResults:
        """Bounds of the force that resists one wrench for each grasp (b, 6), and contact forces.

        Args:
            wrenches: Shape (b, 6).
            rtol: As in `grip_force`.
            certified: Whether a linear program proves that no force suffices, where none was found.
        """
        check_rtol(rtol)
        problem = self.problem
        results = problem.unwritten(ForceResults)

        def evaluate(chunk: slice, workspace: Workspace) -> None:
            kernels.wrench_forces(
                self._form, problem.wrenches_of(chunk), problem.tangential[chunk],
                problem.cones[chunk], problem.rim, np.ascontiguousarray(wrenches[chunk]),
                self.sizes[chunk], rtol, workspace, np.zeros((SCRATCH_ROWS, 8)),
                part_of(results, chunk),
            )  # fmt: skip

        problem.in_chunks(evaluate)
        unfinished = np.flatnonzero(results.status == kernels.UNFINISHED)
        results.reason[unfinished] = kernels.NOT_RESISTED
        if certified and self.torsion not in SURFACES.values():
            unfinished = self._decide(unfinished, wrenches, results)
        self._decide_by_hulls(unfinished, wrenches, rtol, results)
        return results

    def in_contact_frame(self, components: Floats) -> Floats:
        """Contact forces as of `ForceCertificate` from components along axes (b, n, 4)."""
        return forces_of_components(self.contacts, components[:, : self.contacts.count])

    def of_terms(
        self, terms: Terms, masses: Floats, rtol: float, *, small: bool = False
    ) -> ForceResults:
        """Bounds for the terms of a task and masses (b,); `small`: hulls of a few facets only."""
        problem, results = self.problem, self.problem.unwritten(ForceResults)
        forces = terms.rows[:, SIZE].max() * masses.max(initial=0.0)
        size = float(max(forces, np.abs(terms.points).max(initial=0.0)))  # of the task's wrenches

        def evaluate(chunk: slice, workspace: Workspace) -> None:
            axes, part = problem.wrenches_of(chunk), part_of(results, chunk)
            scratch = kernels.make_scratch(len(terms.rows), problem.count)
            problem.with_polytope(
                len(axes),
                lambda first, polytope: kernels.task_forces(
                    self._form, axes, problem.tangential[chunk], problem.cones[chunk],
                    problem.rim, terms.rows, terms.points, masses[chunk], size, self.sizes[chunk],
                    rtol, first, workspace, polytope, scratch, part,
                ),
                small=small,
            )  # fmt: skip

        problem.in_chunks(evaluate)
        return results

    def _decide(self, grasps: Ints, wrenches: Floats, results: ForceResults) -> Ints:
        """Prove that no force resists wrenches for which none was found; returns the others."""
        flat, left = self.contacts.reshape((-1,)), []
        soft = (flat.torsion_radius[grasps] > 0.0).any(axis=-1)  # they push in more directions
        for block in (*blocks_of(grasps[soft]), *blocks_of(grasps[~soft])):
            size = self.sizes[block, None]
            generators = pushes(
                flat.points[block] / size[..., None],
                flat.normals[block],
                self.problem.cones[block, :, 1] / self.problem.cones[block, :, 0],
                flat.torsion_radius[block] / size,
            )
            for g, pushed in zip(block, generators, strict=True):
                sizes = np.append(np.ones(3), np.full(3, self.sizes[g]))
                direction = separating_direction(pushed, -wrenches[g] / sizes)
                if direction is None:
                    left.append(int(g))
                else:
                    results.lower[g] = results.upper[g] = math.inf
                    results.status[g] = CONVERGED
                    results.direction[g] = direction / sizes
        return np.array(left, dtype=int)

    def _decide_by_hulls(
        self, grasps: Ints, wrenches: Floats, rtol: float, results: ForceResults
    ) -> None:
        """Prove by the growing hull that no force resists single wrenches, or find one."""
        different, which = np.unique(wrenches[grasps], axis=0, return_inverse=True)
        for k, wrench in enumerate(different):
            rows = grasps[which.reshape(-1) == k]
            row = np.zeros((1, TERM))
            row[0, :3] = POINTS, 0, 1
            some = replace(self, problem=self.problem.take(rows), sizes=self.sizes[rows])
            terms = Terms(row, wrench[None].copy())
            bounds = some.of_terms(terms, np.ones(len(rows)), rtol, small=True)
            for name in ("lower", "upper", "status", "reason", "direction"):
                getattr(results, name)[rows] = getattr(bounds, name)
            open_ = rows[np.isinf(bounds.upper)]
            results.reason[open_] = np.maximum(results.reason[open_], kernels.NOT_RESISTED)


def blocks_of(grasps: Ints) -> list[Ints]:
    """Grasps whose pushes are computed together; none for no grasps."""
    return [grasps[start : start + DECIDED] for start in range(0, len(grasps), DECIDED)]


def pushes(points: Floats, normals: Floats, friction: Floats, torsion: Floats) -> Floats:
    """Wrenches of which every wrench of the contacts' forces is a combination, without minus.

    Args:
        points: Contact points of each grasp, of a size of about 1 (b, n, 3).
        normals: Inward unit normals (b, n, 3).
        friction: Coefficients (b, n).
        torsion: Torsion radii in the unit of the points (b, n): all 0, or one of each grasp above.

    Returns:
        Shape (b, k, 6).
    """
    if (torsion > 0.0).any():
        sections = _circumscribed_ball()
    else:
        sections = np.pad(_circumscribed_polygon(EDGES), ((0, 0), (0, 1)))
    across, along = tangents(normals)
    forces = normals[..., None, :] + friction[..., None, None] * (
        sections[:, 0, None] * across[..., None, :] + sections[:, 1, None] * along[..., None, :]
    )  # (b, n, m, 3)
    moments = np.cross(points[..., None, :], forces)
    moments += (torsion[..., None] * sections[:, 2])[..., None] * normals[..., None, :]
    return np.concatenate([forces, moments], axis=-1).reshape(len(points), -1, 6)


def separating_direction(generators: Floats, wrench: Floats) -> Floats | None:
    """A direction that proves that no contact forces apply a wrench; None: none was found.

    Args:
        generators: The wrenches that the contacts push with, of `pushes` (k, 6).
        wrench: Shape (6,).

    Returns:
        Direction (6,) along which the wrench has a positive component and no contact pushes.
    """
    size = np.linalg.norm(wrench)
    from scipy.optimize import nnls

    weights, residual = nnls(generators.T, wrench / size)
    if residual <= APART:
        return None
    direction = wrench / size - weights @ generators
    lengths = np.linalg.norm(generators, axis=-1)
    separates = ((generators @ direction) <= ROUNDING * lengths).all()
    return np.asarray(direction) if separates else None


def _sizes(contacts: Contacts) -> Floats:
    """Largest distance of a contact from the centre of mass, 1 where that is 0, (...)."""
    sizes = np.linalg.norm(contacts.points, axis=-1).max(axis=-1)
    return np.asarray(np.where(sizes > 0.0, sizes, 1.0))


@cache
def _circumscribed_polygon(corners: int) -> Floats:
    """Vertices of a regular polygon around the unit circle, (corners, 2)."""
    angles = edge_angles(corners)
    vertices = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    return np.asarray(vertices / math.cos(math.pi / corners))


@cache
def _circumscribed_ball() -> Floats:
    """Vertices of a polyhedron around the unit ball, evenly on a spiral, (m, 3)."""
    k = np.arange(SPHERE_POINTS) + 0.5
    height, turn = 1.0 - 2.0 * k / SPHERE_POINTS, math.pi * (1.0 + math.sqrt(5.0)) * k
    ring = np.sqrt(1.0 - height**2)
    points = np.stack([ring * np.cos(turn), ring * np.sin(turn), height], axis=-1)
    inside = -ConvexHull(points).equations[:, -1].max()
    return np.asarray(points / inside)
