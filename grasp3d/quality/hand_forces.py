"""Payload of a hand with joints: the largest load that its motors hold, and what limits it.

Hard contacts whose normals are known to within tilts a hold, in the worst case, exactly what cones
of beta - a hold: a motion that proves that no more is possible also proves it for the full friction
cones, if the normals are turned away from the relative velocities that it causes.

How far the wrenches reach that the hand can exert at its contacts follows from a second-order cone
program, solved by Clarabel (Goulart & Chen 2024, arXiv:2405.12762).
"""

import math
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from grasp3d.arrays import ArrayLike, Floats, Ints, locked, short_repr
from grasp3d.contact.contacts import Contacts, finite_numbers, tangents, tilts_of
from grasp3d.errors import ContactError
from grasp3d.quality.actuation import Actuation
from grasp3d.quality.tasks import Sum, Task, Wrenches
from grasp3d.quality.wrenches import check_rtol, span, wrench_axes

FEASIBLE = 1e-7
"""Largest violation of a row with which a point counts as feasible, relative to the point's largest
number, or to 1 if that is larger."""


class Solution(NamedTuple):
    """A feasible point of a cone program, and a bound of the cost.

    Interior-point answers are approximate. The point is feasible to within `FEASIBLE`, which is
    checked whatever the solver reports. The bound is that of the dual, right to about 1e-8 of the
    numbers of the program. Where the solver gives up there is no bound.
    """

    x: Floats | None
    """The point; None: none is known."""
    least: float
    """No feasible point costs less; -inf: not known; inf: no point is feasible."""
    multipliers: Floats
    """Multipliers z of the rows, with cost + A^T z = 0."""


@dataclass(frozen=True, eq=False)
class ConeProgram:
    """Minimise cost . x where b - A x lies in the product of cones, in this order."""

    matrix: Floats
    """A, shape (m, k)."""
    bounds: Floats
    """b, shape (m,)."""
    equations: int
    """Number of rows whose values are 0."""
    inequalities: int
    """Number of rows whose values are at least 0; the rows after them are second-order cones."""
    cones: tuple[int, ...]
    """Sizes of the second-order cones."""

    @cached_property
    def _solver(self) -> Any:
        import clarabel
        from scipy import sparse

        kinds: list[Any] = [clarabel.ZeroConeT(self.equations)]
        kinds.append(clarabel.NonnegativeConeT(self.inequalities))
        kinds += [clarabel.SecondOrderConeT(size) for size in self.cones]
        count = self.matrix.shape[1]
        matrix, none = sparse.csc_matrix(self.matrix), sparse.csc_matrix((count, count))
        return clarabel.DefaultSolver(
            none, np.zeros(count), matrix, self.bounds, kinds, _settings()
        )

    def solve(self, cost: Floats) -> Solution:
        """Solve the program for a cost (k,)."""
        self._solver.update(q=cost)
        found = self._solver.solve()
        x, left = np.array(found.x), np.array(found.s)  # the slack is in the cones
        error = np.abs(self.bounds - self.matrix @ x - left).max()
        feasible = error <= FEASIBLE * max(1.0, np.abs(x).max())
        status = str(found.status)
        least = {"Solved": found.obj_val_dual, "PrimalInfeasible": np.inf}.get(status, -np.inf)
        known = feasible and least < np.inf
        return Solution(x if known else None, least, np.array(found.z))


@cache
def _settings() -> Any:
    import clarabel

    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.presolve_enable = False
    settings.max_threads = 1
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-9
    return settings


STRUCTURE = 1e3
"""Largest length of a contact's force [N]. It limits what preload between the palm and rigid links,
which no motor sets, can hold."""


@dataclass(frozen=True, eq=False, init=False)
class HandGrasp:
    """Hard point contacts of one grasp of a hand with joints."""

    contacts: Contacts
    jacobian: Floats
    """Velocities of the links' contact points per speed of the joints [m/rad], (n, 3, p); 0 at the
    palm."""
    actuation: Actuation
    most_force: float
    """Largest length of each contact's force [N]."""

    __repr__ = short_repr

    def __init__(
        self,
        contacts: Contacts,
        jacobian: ArrayLike,
        actuation: Actuation,
        *,
        most_force: float = STRUCTURE,
    ) -> None:
        """Check the shapes.

        Args:
            contacts: Hard contacts of one grasp.
            jacobian: As the field, shape (n, 3, p).
            actuation: Actuation of the p joints.
            most_force: Largest force that link and object bear [N], above 0.

        Raises:
            ContactError: There are several grasps or soft contacts, or shapes do not match.
        """
        if contacts.batch or contacts.torsion_radius.any() or contacts.groups is not None:
            raise ContactError(
                "joint torques are for hard contacts of one grasp: give the points of a patch as "
                "contacts of their own, without groups"
            )
        rows = finite_numbers("the Jacobian", jacobian)
        shape = (contacts.count, 3, actuation.joints)
        if rows.shape != shape:
            raise ContactError(f"the Jacobian must have shape {shape}; got {rows.shape}")
        if not 0.0 < most_force < np.inf:
            raise ContactError(
                f"the largest contact force must be above 0 and finite [N]; got {most_force}"
            )
        object.__setattr__(self, "contacts", contacts)
        object.__setattr__(self, "jacobian", locked(rows))
        object.__setattr__(self, "actuation", actuation)
        object.__setattr__(self, "most_force", float(most_force))

    @cached_property
    def scale(self) -> Floats:
        """Factors of a wrench's six numbers: 1, and for torques the size of the grasp."""
        length = float(np.linalg.norm(self.contacts.points, axis=1).max()) or 1.0
        return np.repeat([1.0, length], 3)

    @cached_property
    def torque(self) -> float:
        """Unit of torque [N m]: the largest finite limit of a motor."""
        limits = self.actuation.limits
        return float(limits[np.isfinite(limits)].max(initial=0.0)) or 1.0

    @cached_property
    def force(self) -> float:
        """Unit of force [N]: what the strongest motor exerts at the longest arm."""
        arm = float(np.linalg.norm(self.jacobian, axis=1).max(initial=0.0))
        return min(self.torque / arm, self.most_force) if arm > 0.0 else self.most_force

    @cached_property
    def wrenches(self) -> Floats:
        """Wrenches of unit forces along normals and tangents, torques over the size, (6, 3 n)."""
        contacts = self.contacts
        points = contacts.points / self.scale[-1]
        axes = wrench_axes(points, contacts.normals, np.zeros(contacts.count), 1.0)
        return np.ascontiguousarray(axes[:, :3].reshape(-1, 6).T)

    @cached_property
    def spanned(self) -> Floats:
        """Orthonormal rows that span `wrenches`, shape (r, 6)."""
        return span(self.wrenches.T)

    @cached_property
    def joint_torques(self) -> Floats:
        """Torques J^T of unit forces along normals and tangents [m], shape (p, 3 n)."""
        normals = self.contacts.normals
        frames = np.stack([normals, *tangents(normals)], axis=1)
        shape = (3 * self.contacts.count, self.actuation.joints)
        return np.reshape(frames @ self.jacobian, shape).T


OF_FORCE = "the largest contact force"
"""What limits the payload where no motor does."""


class Farthest(NamedTuple):
    """How far wrenches reach along a direction."""

    point: Floats | None
    """Coordinates of a wrench that reaches farthest [N], shape (k,); None: none is known."""
    upper: float
    """No wrench reaches farther [N]; -inf: there is no wrench; inf: not known."""
    shares: Floats
    """Parts of `upper` due to the limits of the motors, and to that of the contact forces,
    (k + 1,)."""
    work: Floats
    """Part of the direction that carries the links in the proof of `upper`, for links that weigh as
    much as with an object of 1 kg, (k,)."""


@dataclass(frozen=True, eq=False)
class HandWrenches:
    """The wrenches of a subspace that a hand can exert at its contacts."""

    grasp: HandGrasp
    basis: Floats
    """Orthonormal rows that span the subspace, torques by `grasp.scale`, within the span of the
    wrenches of the contacts, shape (k, 6)."""
    constant: Floats
    """Wrench that the contacts exert in addition [N], shape (6,)."""
    carried: Floats
    """Torques that the drives need not exert [N m], shape (p,)."""
    links: Floats | None = None
    """Torques that hold the links per acceleration, as in `Actuation`, where the wrench is that of
    the object's weight; None: the links are weightless."""
    mass: float = np.inf
    """Mass of the object in that case [kg]; inf: the weight of the links is negligible."""

    __repr__ = short_repr

    @cached_property
    def _held(self) -> Floats:
        """Scaled torques that hold the links, along the basis, for a 1 kg object, shape (p, k)."""
        grasp = self.grasp
        none = np.zeros((grasp.actuation.joints, 3))
        links = none if self.links is None else self.links
        return -(grasp.force / grasp.torque) * links @ self.basis[:, :3].T

    @property
    def _limited(self) -> Ints:
        """Numbers of the motors that have a limit."""
        return np.flatnonzero(np.isfinite(self.grasp.actuation.limits))

    @cached_property
    def program(self) -> ConeProgram:
        """The program; scaled unknowns: forces along normals and tangents, drives, coordinates."""
        grasp, actuation = self.grasp, self.grasp.actuation
        (joints, drives), motors = actuation.columns.shape, len(actuation.limits)
        count, limited = grasp.wrenches.shape[1], self._limited
        first, unknown = count + drives, count + drives + len(self.basis)
        units = np.ones(drives)
        units[limited] = actuation.limits[limited] / grasp.torque
        balanced = np.zeros((len(grasp.spanned), unknown))
        balanced[:, :count] = grasp.spanned @ grasp.wrenches
        balanced[:, first:] = -grasp.spanned @ self.basis.T
        driven = np.zeros((joints, unknown))
        driven[:, :count] = grasp.force / grasp.torque * grasp.joint_torques
        driven[:, count:first] = -actuation.columns * units
        driven[:, first:] = self._held / self.mass
        values = np.eye(drives, unknown, count)
        within = np.concatenate([values[limited], -values[limited], -values[motors:]])
        pressed = np.eye(count, unknown).reshape(-1, 3, unknown)
        angles = grasp.contacts.friction_angle
        factors = np.stack([np.sin(angles), *[np.cos(angles)] * 2], axis=1)
        rubbing = (factors[:, :, None] * pressed).reshape(-1, unknown)
        capped = np.pad(pressed, ((0, 0), (1, 0), (0, 0))).reshape(-1, unknown)
        cap = [grasp.most_force / grasp.force, 0.0, 0.0, 0.0]
        bounds = (
            grasp.spanned @ self.constant / grasp.force,
            self.carried / grasp.torque,
            np.repeat([1.0, 0.0], [2 * len(limited), drives - motors]),
            np.zeros(count),
            np.tile(cap, len(angles)),
        )
        return ConeProgram(
            np.concatenate([balanced, driven, within, -rubbing, -capped]),
            np.concatenate(bounds),
            len(balanced) + len(driven),
            len(within),
            (3,) * len(angles) + (4,) * len(angles),
        )

    def reach(self, direction: Floats) -> Farthest:
        """How far the wrenches reach along a unit direction of the subspace, (k,)."""
        grasp, program, limited = self.grasp, self.program, self._limited
        first = program.matrix.shape[1] - len(direction)
        x, least, multipliers = program.solve(np.pad(-direction, (first, 0)))
        parts = grasp.force * program.bounds * multipliers
        start, end = program.equations, program.equations + program.inequalities
        shares = np.zeros(len(grasp.actuation.limits) + 1)
        shares[limited] = parts[start : start + 2 * len(limited)].reshape(2, -1).sum(axis=0)
        shares[-1] = parts[end:].sum()
        work = multipliers[len(grasp.spanned) : start] @ self._held
        point = None if x is None else grasp.force * x[first:]
        return Farthest(point, -grasp.force * least, shares, work)


MOST_PROGRAMS = 600
"""Cone programs after which a search for the worst wrench ends with the bounds reached."""

FLAT = 1e-7
"""Reach, in the unit of force, and relative size of a wrench outside a span, that count as 0."""

NARROW = 1e-6
"""Smallest half-angle of a cone [rad]; narrower cones are treated as having this one."""

LINE = 5
"""Rank of contacts whose points are on a line."""

MOST_MASSES = 40
"""Most masses that are tried if the links have weight."""

LIGHT = 1e-2
"""Load, relative to the payload, at which it is tested whether the links alone are held."""

OF_LINKS = "the weight of the links"
OF_LINE = "the turn about the line of the contacts"
OF_CONTACTS = "what can be pressed at the contacts"
"""What limits where nothing is held: the links alone are too heavy, contacts on one line leave the
turn about it free, or another reason."""


@dataclass(frozen=True)
class HandPayload:
    """The largest load that a hand holds at all normals within the tilts, with bounds."""

    lower: float
    """Load that it surely holds: a mass [kg], or a factor of wrenches that have no mass."""
    upper: float
    """Load beyond which it fails at some of the normals; inf: not known."""
    limit: str
    """What limits it: a motor, or the largest contact force; or why nothing is held."""


def hand_payload(
    grasp: HandGrasp, task: Task | ArrayLike, *, tilt: ArrayLike = 0.0, rtol: float = 1e-3
) -> HandPayload:
    """The largest load that the motors of a hand hold at all normals within the tilts.

    They hold smaller loads too; with the weight of the links, down to a hundredth of the payload.
    The lower bound rests on contact forces that exceed no limit by more than 1e-7 of the largest of
    them, the upper bound on dual solutions that are about as accurate.

    Where `Actuation.links` is known, the weight of the links turns with that of the load. This is
    exact, also for weight in any direction. The weight of the links is neglected for tasks without
    a mass, and for tasks with a curved border that also have given wrenches.

    Args:
        grasp: Contacts, Jacobian and drives.
        task: What must be resisted; its own mass has no effect, the payload is a mass [kg]. For
            tasks without a mass, and wrenches of shape (6,) or (k, 6), force [N] and torque about
            the centre of mass [N x unit of the points], the payload is a factor instead.
        tilt: Largest angle a between true and given normals [rad], one value or shape (n,). Where
            it exceeds the friction angle, the contact is not used.
        rtol: For tasks with a curved border: largest difference of the bounds relative to the upper
            one. Bounds for wrenches agree to about 1e-7.

    Raises:
        SettingError: A setting outside its range.

    Example:
        Two fingers with one motor of 0.2 N m and a link of 50 mm each hold a part between them:

        >>> import grasp3d
        >>> from grasp3d.quality import Actuation, HandGrasp, Weight, hand_payload
        >>> points, normals = [[-0.02, 0, 0], [0.02, 0, 0]], [[1, 0, 0], [-1, 0, 0]]
        >>> contacts = grasp3d.Contacts(points, normals, friction=0.5)
        >>> jacobian = [[[0.05, 0], [0, 0], [0, 0]], [[0, -0.05], [0, 0], [0, 0]]]
        >>> motors = Actuation([0.2, 0.2], names=("left", "right"))
        >>> grasp = HandGrasp(contacts, jacobian, motors)
        >>> found = hand_payload(grasp, Weight(direction=(0, 0, -1)))
        >>> print(f"{found.lower:.3f} kg, {found.limit} limits")
        0.408 kg, left limits
    """
    check_rtol(rtol)
    contacts = grasp.contacts
    angles = contacts.friction_angle - tilts_of(tilt, contacts)[0]
    pressing = angles >= 0.0
    if not pressing.any():
        return HandPayload(0.0, 0.0, OF_CONTACTS)
    frictions = np.tan(np.maximum(angles[pressing], NARROW))
    narrowed = Contacts(contacts.points[pressing], contacts.normals[pressing], frictions)
    sure = HandGrasp(
        narrowed, grasp.jacobian[pressing], grasp.actuation, most_force=grasp.most_force
    )
    links = grasp.actuation.links if links_weigh(task) else None
    search = _Search(sure, *_parts(task), rtol, links)
    found = search.payload()
    if found.lower > 0.0 or search.links is None:
        return found
    without = replace(search, links=None).payload()
    return replace(found, limit=OF_LINKS) if without.lower > 0.0 else found


def links_weigh(task: Task | ArrayLike) -> bool:
    """Whether payloads of a task include the weight of the hand's links, where it is known."""
    growing, fixed = _parts(task)
    if growing.mass is None or fixed is None:
        return growing.mass is not None
    return all(one.corners_for(None, 1) is not None for one in (growing, fixed))


def _parts(task: Task | ArrayLike) -> tuple[Task, Task | None]:
    """Split a task into what grows with the mass, for 1 kg, and the rest; all if it has no mass."""
    task = task if isinstance(task, Task) else Wrenches(np.asarray(task))
    grows = [term for term in task.scaled_to(1.0).terms() if term.mass is not None]
    others = [term for term in task.terms() if term.mass is None]
    if not grows:
        return task, None
    return Sum(tuple(grows)), Sum(tuple(others)) if others else None


@dataclass(frozen=True, eq=False)
class _Search:
    """The search for the largest load at which the hardest wrench of a task is held."""

    grasp: HandGrasp
    growing: Task
    fixed: Task | None
    rtol: float
    links: Floats | None
    """Torques that hold the links, as `Actuation.links`; None: the links are weightless."""

    def payload(self) -> HandPayload:
        """Compute the payload."""
        parts = [self.growing] if self.fixed is None else [self.growing, self.fixed]
        corners = [one.corners_for(None, 1) for one in parts]
        rows = [
            _generators(part) if own is None else own[0]
            for part, own in zip(parts, corners, strict=True)
        ]
        scaled = np.concatenate(rows) / self.grasp.scale
        outside = scaled - scaled @ self.grasp.spanned.T @ self.grasp.spanned
        if np.abs(outside).max() > FLAT * np.abs(scaled).max():
            on_line = len(self.grasp.spanned) == LINE
            return HandPayload(0.0, 0.0, OF_LINE if on_line else OF_CONTACTS)
        if any(one is None for one in corners):
            return _Growth(self, span(scaled)).payload()
        growing, fixed = (*rows, np.zeros((1, 6)))[:2]
        each = [self.of_wrench(one, other) for one in growing if one.any() for other in fixed]
        if not each:
            return HandPayload(math.inf, math.inf, "nothing")
        worst = min(each, key=lambda one: (one.lower, one.upper))
        return replace(worst, upper=min(one.upper for one in each))

    def of_wrench(self, wrench: Floats, fixed: Floats) -> HandPayload:
        """The largest factor of a wrench that is held while a fixed one also acts on the object."""
        grasp, scaled = self.grasp, -wrench / self.grasp.scale
        size, joints = float(np.linalg.norm(scaled)), grasp.actuation.joints
        carried = np.zeros(joints) if self.links is None else -self.links @ wrench[:3]
        wrenches = HandWrenches(grasp, scaled[None] / size, -fixed / grasp.scale, carried)
        found = wrenches.reach(np.ones(1))
        point = 0.0 if found.point is None else float(found.point[0])
        lower = max(self.above_rounding(point) / size, 0.0)
        if lower > 0.0 and (fixed.any() or carried.any()):
            # Without the load the rest must be held as well; otherwise the payload is 0.
            back = wrenches.reach(-np.ones(1)).point
            lower = lower if back is not None and back[0] <= FLAT * grasp.force else 0.0
        upper = max(self.above_rounding(found.upper) / size, lower)
        return HandPayload(lower, upper, self.limit(found) if lower > 0.0 else OF_CONTACTS)

    def above_rounding(self, reach: float) -> float:
        """A reach, or 0 if it is only rounding."""
        return reach if abs(reach) > FLAT * self.grasp.force else 0.0

    def limit(self, found: Farthest) -> str:
        """The limit that contributes most to a reach."""
        names = self.grasp.actuation.names
        largest = int(found.shares.argmax())
        return names[largest] if largest < len(names) else OF_FORCE


class _Growth:
    """The search for the payload of a task with a curved border.

    A polytope inside the wrenches of the hand grows where it is nearest to the task, measured by
    the task. Its facets bound the load from below, and what the hand reaches beyond them bounds it
    from above.

    The weight of the links does not grow with the load. If it did, and were right at a load of m,
    the payload would be some f(m); m is held exactly if m <= f(m). 1 / f is a convex function of
    1 / m, and every proof that wrenches reach no farther bounds it from below by a line. So loads
    that fall from bound to bound end at the payload.
    """

    def __init__(self, search: _Search, basis: Floats) -> None:
        carried = np.zeros(search.grasp.actuation.joints)
        self.search, self.flat = search, FLAT * search.grasp.force
        self.wrenches = HandWrenches(search.grasp, basis, np.zeros(6), carried, search.links)
        self.programs = 0
        self.least, self.upper, self.limit = 0.0, math.inf, OF_CONTACTS
        """Bounds of the loads that may be held, and what limits them."""
        self.most = math.inf
        """Upper bound of f."""

    def payload(self) -> HandPayload:
        """Compute the payload."""
        rtol = self.search.rtol
        lower = self.grown(self.wrenches, rtol)
        if self.search.links is not None:
            lower, mass = 0.0, math.inf
            for _ in range(MOST_MASSES):
                mass = (1.0 - 0.5 * rtol) * min(mass, self.upper)
                if self.least > self.upper or mass < self.flat:
                    self.upper = 0.0
                    break
                if self.grown(replace(self.wrenches, mass=mass), 0.25 * rtol, mass) >= mass:
                    light = LIGHT * mass
                    alone = self.grown(replace(self.wrenches, mass=light), rtol, light) >= light
                    lower = mass if alone else 0.0
                    break
        limit = self.limit if lower > 0.0 else OF_CONTACTS
        return HandPayload(lower, max(self.upper, lower), limit)

    def grown(self, wrenches: HandWrenches, rtol: float, enough: float = math.inf) -> float:
        """Grow the polytope until the load up to which it contains the task is known; return it.

        Args:
            wrenches: Wrenches of the hand; the links' weight is right at its mass, and grows with
                the load.
            rtol: Width of the bounds, relative to them.
            enough: A load for which it suffices to know whether it is held.
        """
        self.most, self.programs, lower = math.inf, 0, 0.0
        try:
            hull = ConvexHull(np.array(self.start(wrenches)), incremental=True)
            while self.programs < MOST_PROGRAMS:
                normals, distances = hull.equations[:, :-1], -hull.equations[:, -1]
                growing, fixed = self.extents(normals)
                left = np.where(distances > self.flat, distances, 0.0) - fixed
                with np.errstate(divide="ignore", invalid="ignore"):
                    idle = np.where(left < 0.0, 0.0, math.inf)
                    loads = np.where(growing > 0.0, left / growing, idle)
                nearest = int(loads.argmin())
                lower = max(float(loads[nearest]), 0.0)
                known = lower >= min(enough, (1.0 - rtol) * self.most)
                if known or self.most < enough < math.inf:
                    break
                at_origin = (distances <= self.flat) & (growing > 0.0)
                middle = at_origin.sum() > 1 and bool(self.programs % 2)
                # While the origin is a corner, the mean normal of its facets cuts most of them off.
                direction = normals[at_origin].mean(axis=0) if middle else normals[nearest]
                point = self.reach(wrenches, direction / np.linalg.norm(direction))
                if (normals @ point - distances).max() <= self.flat and not middle:
                    break  # known but for rounding
                hull.add_points(point[None])
        except QhullError:  # too thin for its precision: what is known so far holds
            pass
        return lower

    def start(self, wrenches: HandWrenches) -> list[Floats]:
        """Wrenches of the hand that span the subspace, if there are such."""
        count = len(wrenches.basis)
        points = [np.zeros(count)]
        while self.programs < 4 * count and self.most > 0.0:
            _, sizes, axes = np.linalg.svd(np.array(points))
            rank = int((sizes > self.flat).sum())
            if rank == count:
                break
            points += [self.reach(wrenches, axes[rank]), self.reach(wrenches, -axes[rank])]
        return points

    def reach(self, wrenches: HandWrenches, direction: Floats) -> Floats:
        """The wrench that reaches farthest along a direction; also updates the bounds."""
        found, search = wrenches.reach(direction), self.search
        self.programs += 1
        growing, fixed = (float(one[0]) for one in self.extents(direction[None]))
        left = max(search.above_rounding(found.upper) - fixed, 0.0)
        if growing > 0.0 and math.isfinite(left):
            self.most = min(self.most, left / growing)
            hardest = search.growing.farthest(self.against(direction)) / search.grasp.scale
            links = -float(wrenches.basis @ hardest @ found.work)
            of_load = growing - links / wrenches.mass
            if of_load > 0.0 and (load := max((left - links) / of_load, 0.0)) < self.upper:
                self.upper, self.limit = load, search.limit(found)
            elif of_load < 0.0:
                self.least = max(self.least, (left - links) / of_load)
        return np.zeros(len(direction)) if found.point is None else found.point

    def against(self, directions: Floats) -> Floats:
        """The opposite of directions of the subspace (..., k), as factors of wrenches (..., 6)."""
        return -(directions @ self.wrenches.basis) / self.search.grasp.scale

    def extents(self, directions: Floats) -> tuple[Floats, Floats]:
        """How far the opposites of both parts of the task reach along directions (r, k)."""
        u, fixed = self.against(directions), self.search.fixed
        constant = np.zeros(len(u)) if fixed is None else fixed.support(u)
        return np.asarray(self.search.growing.support(u)), np.asarray(constant)


def _generators(task: Task) -> Floats:
    """Wrenches that span a task whose border is curved, (g, 6)."""
    corners = [term.corners() for term in task.terms()]
    return np.concatenate([np.eye(6)[:3], *(one for one in corners if one is not None)])
