"""Payload of a hand with joints: the largest load that its motors hold, and what limits it.

Hard contacts whose normals are known to within tilts a hold in the worst case exactly what the
cones beta - a hold: whichever motions prove that no more is possible, normals turned away from the
relative velocities that they cause make the same proof for the full friction cones.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from grasp3d.arrays import ArrayLike, Floats
from grasp3d.contact.contacts import Contacts, tilts_of
from grasp3d.quality.hand_forces.hand_grasp import HandGrasp
from grasp3d.quality.hand_forces.hand_wrenches import OF_FORCE, Farthest, HandWrenches
from grasp3d.quality.tasks import Sum, Task, Wrenches
from grasp3d.quality.wrenches import check_rtol, span

MOST_PROGRAMS = 600
"""Cone programs after which a search for the worst wrench ends with the bounds reached."""

FLAT = 1e-7
"""Reach, in the unit of force, that is none, and size of a wrench outside a span that is none."""

NARROW = 1e-6
"""Half-angle of a cone [rad] up to which it is taken to have this one."""

LINE = 5
"""Rank of contacts whose points are on a line."""

MOST_MASSES = 40
"""Masses that are tried with the weight of the links."""

LIGHT = 1e-2
"""A load with which it is tried whether the links alone are held, relative to the payload."""

OF_LINKS = "the weight of the links"
OF_LINE = "the turn about the line of the contacts"
OF_CONTACTS = "what can be pressed at the contacts"
"""What limits where nothing is held: for the links alone, as points on one line leave the turn
about it free, and otherwise."""


@dataclass(frozen=True)
class HandPayload:
    """The largest load that a hand holds at all normals within the tilts, with bounds."""

    lower: float
    """It surely holds so much: a mass [kg], or a factor of wrenches that have no mass."""
    upper: float
    """It does not hold more at some of the normals; inf: not known."""
    limit: str
    """What limits it: a motor, or the largest contact force; or why nothing is held."""


def hand_payload(
    grasp: HandGrasp,
    task: Task | ArrayLike,
    *,
    tilt: ArrayLike = 0.0,
    rtol: float = 1e-3,
) -> HandPayload:
    """The largest load that the motors of a hand hold, whichever the normals within tilts are.

    Smaller loads are held, too (with the weight of the links down to a hundredth of it). The lower
    bound rests on contact forces that were found, and that keep to all limits but for 1e-7 of the
    largest of them, the upper one on duals that are about as accurate.

    Where `Actuation.links` is known the weight of the links turns with that of the load: exactly,
    also in any direction. It is neglected for tasks that have no mass, and for those with a curved
    border and given wrenches besides.

    Args:
        grasp: Contacts, Jacobian and drives.
        task: What must be resisted: its own mass does not matter, the payload is one [kg]. Tasks
            without a mass, and wrenches of shape (6,) or (k, 6), force [N] and torque about the
            centre of mass [N x unit of the points], are multiplied by a factor instead.
        tilt: Largest angle a between true and given normals [rad], one value or shape (n,). Where
            it exceeds the friction angle no force of the contact is safe.
        rtol: For tasks with a curved border: largest difference of the bounds relative to the upper
            one. Those of wrenches agree to about 1e-7.

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
    """Whether payloads of a task take the weight of the hand's links, where it is known."""
    growing, fixed = _parts(task)
    if growing.mass is None or fixed is None:
        return growing.mass is not None
    return all(one.corners_for(None, 1) is not None for one in (growing, fixed))


def _parts(task: Task | ArrayLike) -> tuple[Task, Task | None]:
    """What grows with the mass, for 1 kg, and what does not; all of a task without a mass grows."""
    task = task if isinstance(task, Task) else Wrenches(np.asarray(task))
    grows = [term for term in task.scaled_to(1.0).terms() if term.mass is not None]
    others = [term for term in task.terms() if term.mass is None]
    if not grows:
        return task, None
    return Sum(tuple(grows)), Sum(tuple(others)) if others else None


@dataclass(frozen=True, eq=False)
class _Search:
    """The search for the load at which the wrench of a task that is hardest to hold is held."""

    grasp: HandGrasp
    growing: Task
    fixed: Task | None
    rtol: float
    links: Floats | None
    """Torques that hold the links, as `Actuation.links`; None: they do not weigh."""

    def payload(self) -> HandPayload:
        """The payload."""
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
        """The largest factor of one wrench that acts on the object besides another one."""
        grasp, scaled = self.grasp, -wrench / self.grasp.scale
        size, joints = float(np.linalg.norm(scaled)), grasp.actuation.joints
        carried = np.zeros(joints) if self.links is None else -self.links @ wrench[:3]
        wrenches = HandWrenches(grasp, scaled[None] / size, -fixed / grasp.scale, carried)
        found = wrenches.reach(np.ones(1))
        point = 0.0 if found.point is None else float(found.point[0])
        lower = max(self.above_rounding(point) / size, 0.0)
        if lower > 0.0 and (fixed.any() or carried.any()):
            # What it holds without the load: no load but 0 is a payload otherwise.
            back = wrenches.reach(-np.ones(1)).point
            lower = lower if back is not None and back[0] <= FLAT * grasp.force else 0.0
        upper = max(self.above_rounding(found.upper) / size, lower)
        return HandPayload(lower, upper, self.limit(found) if lower > 0.0 else OF_CONTACTS)

    def above_rounding(self, reach: float) -> float:
        """A reach, 0 where it is one of rounding."""
        return reach if abs(reach) > FLAT * self.grasp.force else 0.0

    def limit(self, found: Farthest) -> str:
        """What bears most of a reach."""
        names = self.grasp.actuation.names
        largest = int(found.shares.argmax())
        return names[largest] if largest < len(names) else OF_FORCE


class _Growth:
    """The search for the payload of a task with a curved border.

    A polytope inside the wrenches of the hand grows where it is nearest to the task, in its ruler:
    the facets bound the load from below, what the hand reaches beyond them from above.

    The weight of the links does not grow with the load. With links that do, and weigh what they do
    where it is m, the payload would be some f(m): m is held exactly if m <= f(m). As 1 / f is a
    convex function of 1 / m, and every proof that wrenches reach no farther bounds it from below by
    a line, loads that fall from bound to bound end at the payload.
    """

    def __init__(self, search: _Search, basis: Floats) -> None:
        carried = np.zeros(search.grasp.actuation.joints)
        self.search, self.flat = search, FLAT * search.grasp.force
        self.wrenches = HandWrenches(search.grasp, basis, np.zeros(6), carried, search.links)
        self.programs = 0
        self.least, self.upper, self.limit = 0.0, math.inf, OF_CONTACTS
        """Loads that may be held, and what limits them."""
        self.most = math.inf
        """Bound of f from above."""

    def payload(self) -> HandPayload:
        """The payload."""
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
        """Load up to which the task is inside the polytope, when it has grown until that is known.

        Args:
            wrenches: What the hand reaches; links weigh what they do with its mass, and grow with
                the load.
            rtol: Width of the bounds, relative to them.
            enough: A load of which it suffices to know whether it is held.
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
                # Where the origin is a corner still the middle of its facets cuts most of them off.
                direction = normals[at_origin].mean(axis=0) if middle else normals[nearest]
                point = self.reach(wrenches, direction / np.linalg.norm(direction))
                if (normals @ point - distances).max() <= self.flat and not middle:
                    break  # it is known but for rounding
                hull.add_points(point[None])
        except QhullError:  # too thin for its precision: what is known so far holds
            pass
        return lower

    def start(self, wrenches: HandWrenches) -> list[Floats]:
        """Wrenches that span the subspace, where the hand can exert such."""
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
        """The wrench that reaches farthest along a direction; the bounds that follow are kept."""
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
        """How far the opposite of both parts of the task reaches along directions (r, k)."""
        u, fixed = self.against(directions), self.search.fixed
        constant = np.zeros(len(u)) if fixed is None else fixed.support(u)
        return np.asarray(self.search.growing.support(u)), np.asarray(constant)


def _generators(task: Task) -> Floats:
    """Wrenches that span a task whose border is curved, (g, 6)."""
    corners = [term.corners() for term in task.terms()]
    return np.concatenate([np.eye(6)[:3], *(one for one in corners if one is not None)])
