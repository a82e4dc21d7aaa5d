"""Payload of a hand with joints: the largest load that its motors hold, and what limits it.

Hard contacts whose normals are known to within tilts a hold in the worst case exactly what the
cones beta - a hold: whichever motions prove that no more is possible, normals turned away from the
relative velocities that they cause make the same proof for the full friction cones.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from grasp3d.arrays import ArrayLike, Floats, short_repr
from grasp3d.errors import SettingError
from grasp3d.quality.hand_forces.hand_grasp import HandGrasp
from grasp3d.quality.hand_forces.wrench_slice import Reach, WrenchSlice
from grasp3d.quality.tasks import Sum, Task, Term, Wrenches
from grasp3d.quality.wrenches import span

MOST_PROGRAMS = 600
"""Cone programs after which a search for the worst wrench ends with the bounds reached."""

MOST_FACETS = 20000
"""Facets of the polytope after which it ends so."""

FAR = 1e3
"""Force, in the unit of the grasp, that stands for one without limit."""

FLAT = 1e-9
"""Extent of wrenches across a direction, in the unit of force, that is none."""

MOST_MASSES, BESIDE = 12, 0.4
"""Loads that are tried with the weight of the links, and how far beside the expected one, relative
to the tolerance."""

LEAST = 1e-3
"""The least load that is tried so, relative to the largest."""

NOTHING = 1e-6
"""A load [kg] per unit of force [N] that is none: for less of it the links would weigh too much."""

TENTH = 0.1

STILL = 1e-9
"""Velocities of contacts, relative to those of a turn, that are none."""

OF_LINKS = "the weight of the links"
OF_LINE = "the turn about the line of the contacts"
"""What limits where drives do not even carry the links, and where the proof is a turn at which no
contact moves, that about the line of two points."""


@dataclass(frozen=True, eq=False)
class HandPayload:
    """The largest load that a hand holds at all normals within the tilts, with bounds and proof."""

    lower: float
    """It surely holds so much: a mass [kg], or a factor of wrenches that have no mass."""
    upper: float
    """It does not hold more at some of the normals; inf: no limit."""
    limiting: Reach
    """Forces for the wrench that limits the load, and the motions that prove it."""
    slice: WrenchSlice
    """What the proof is about."""
    direction: Floats
    """Direction in the subspace of the slice along which the load is limited, shape (k,)."""
    per_force: float
    """Load per reach of the slice along the direction [kg/N]."""
    programs: int
    """Cone programs solved."""
    is_of_links: bool = False
    """Whether nothing is held for the weight of the links alone."""

    __repr__ = short_repr

    @property
    def value(self) -> float:
        """The load that is surely held."""
        return self.lower

    @property
    def forces(self) -> Floats:
        """Contact forces of the hand on the object at the limit [N], shape (n, 3)."""
        return self.limiting.forces

    @cached_property
    def drive_shares(self) -> Floats:
        """Load that each drive's limits carry, shape (q,).

        A tenth more of them adds at most a tenth of it; about so much where that is little.
        """
        actuation = self.slice.grasp.actuation
        shares = actuation.powers(self.limiting.motion) * self.per_force
        return shares if math.isfinite(self.upper) else np.zeros(len(shares))

    @cached_property
    def friction_gains(self) -> Floats:
        """Load that one tenth more of friction at each contact adds, to first order, (n,)."""
        grasp, angles = self.slice.grasp, self.slice.half_angles
        if not math.isfinite(self.upper):
            return np.zeros(len(angles))
        velocities = grasp.velocities(self.limiting.twist, self.limiting.motion)
        sliding = np.linalg.norm(velocities[:, 1:], axis=1)
        pressing = (self.limiting.forces * grasp.contacts.normals).sum(axis=1)
        friction = grasp.contacts.friction
        wider = np.maximum(angles, 0.0) + np.arctan((1.0 + TENTH) * friction) - np.arctan(friction)
        more = np.tan(wider) - np.tan(np.maximum(angles, 0.0))
        return np.asarray(sliding * np.maximum(pressing, 0.0) * more * self.per_force)

    @property
    def limit(self) -> str:
        """What limits the load: the drive with the largest share, or the friction of a contact."""
        return self.limit_at([f"contact {k}" for k in range(len(self.forces))])

    def limit_at(self, names: Sequence[str]) -> str:
        """The same with names of the n contacts."""
        shares, gains = self.drive_shares, self.friction_gains
        if not math.isfinite(self.upper):
            return "nothing"
        if self.is_of_links:
            return OF_LINKS
        if self.lower == 0.0 and self._turns_freely:
            return OF_LINE
        if self.lower > 0.0 and shares.max(initial=0.0) > 0.0:
            return self.slice.grasp.actuation.names[int(shares.argmax())]
        if math.isfinite(self.slice.grasp.most_force) and self.lower > 0.0:
            return "the largest contact force"
        return (
            f"friction at {names[int(gains.argmax())]}"
            if gains.any()
            else "the place of the contacts"
        )

    @property
    def _turns_freely(self) -> bool:
        """Whether the object alone turns in the proof, and slides and rolls off at no contact."""
        grasp, twist, motion = self.slice.grasp, self.limiting.twist, self.limiting.motion
        turn, moves = float(np.linalg.norm(twist[3:])), grasp.velocities(twist, motion)
        still = np.abs(moves).max() < STILL * turn * grasp.length and len(moves) > 1
        return bool(still and np.abs(motion).max(initial=0.0) < STILL * turn)


def hand_payload(
    grasp: HandGrasp,
    task: Task | ArrayLike,
    *,
    tilt: ArrayLike = 0.0,
    rtol: float = 1e-3,
) -> HandPayload:
    """The largest load that the motors of a hand hold, whichever the normals within tilts are.

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
            one. Those of wrenches agree to about 1e-8.

    Raises:
        SettingError: A setting outside its range.

    Example:
        Two fingers with one motor of 0.2 N m and a link of 50 mm each hold a part between them:

        >>> import grasp3d
        >>> from grasp3d.quality import Actuation, HandGrasp, Weight, hand_payload
        >>> points, normals = [[-0.02, 0, 0], [0.02, 0, 0]], [[1, 0, 0], [-1, 0, 0]]
        >>> contacts = grasp3d.Contacts(points, normals, friction=0.5)
        >>> jacobian = [[[0.05, 0], [0, 0], [0, 0]], [[0, -0.05], [0, 0], [0, 0]]]
        >>> motors = Actuation.of_hand([0.2, 0.2], joints=("left", "right"))
        >>> grasp = HandGrasp(contacts, jacobian, motors)
        >>> found = hand_payload(grasp, Weight(direction=(0, 0, -1)))
        >>> print(f"{found.value:.3f} kg")
        0.408 kg
    """
    if not rtol > 0.0:
        raise SettingError(f"rtol must be above 0; got {rtol}")
    found = _payload(grasp, task, tilt, rtol)
    if found.lower > 0.0 or grasp.actuation.links is None:
        return found
    light = replace(grasp.actuation, links=None)
    without = HandGrasp(grasp.contacts, grasp.jacobian, light, most_force=grasp.most_force)
    alone = _payload(without, task, tilt, rtol)
    return replace(found, is_of_links=alone.lower > 0.0, programs=found.programs + alone.programs)


def _payload(grasp: HandGrasp, task: Task | ArrayLike, tilt: ArrayLike, rtol: float) -> HandPayload:
    """The payload as `hand_payload` has it, but not whether it is nothing for the links alone."""
    growing, constant = _parts(task if isinstance(task, Task) else Wrenches(np.asarray(task)))
    angles = grasp.half_angles(tilt)
    corners = [None if one is None else one.corners_for(None, 1) for one in (growing, constant)]
    assert growing is not None
    weighs = grasp.actuation.links is not None and links_weigh(task)
    if corners[0] is None or (constant is not None and corners[1] is None):
        search = _Search(grasp, angles, growing, constant, rtol)
        return search.with_links() if weighs else search.found()
    fixed = np.zeros((1, 6)) if corners[1] is None else corners[1][0]
    each = [
        _of_wrench(grasp.carrying_links(w[:3]) if weighs else grasp, angles, w, c)
        for w in corners[0][0]
        for c in fixed
    ]
    worst = min(each, key=lambda one: (one.lower, one.upper))
    upper = min(one.upper for one in each)
    return replace(worst, upper=upper, programs=sum(one.programs for one in each))


def links_weigh(task: Task | ArrayLike) -> bool:
    """Whether payloads of a task take the weight of the hand's links, where it is known."""
    growing, constant = _parts(task if isinstance(task, Task) else Wrenches(np.asarray(task)))
    if growing.mass is None or constant is None:
        return growing.mass is not None
    return all(one.corners_for(None, 1) is not None for one in (growing, constant))


def _parts(task: Task) -> tuple[Task, Task | None]:
    """What grows with the mass, for 1 kg, and what does not; all of a task without a mass grows."""
    grows = [term for term in task.scaled_to(1.0).terms() if term.mass is not None]
    others = [term for term in task.terms() if term.mass is None]
    if not grows:
        return task, None
    return Sum(tuple(grows)), Sum(tuple(others)) if others else None


def _of_wrench(grasp: HandGrasp, angles: Floats, wrench: Floats, constant: Floats) -> HandPayload:
    """The largest factor of one wrench that acts on the object besides a constant one."""
    scale = grasp.scale
    size = float(np.linalg.norm(wrench / scale))
    held, along = -constant / scale, np.ones(1)
    if size == 0.0:
        basis, per_force = np.zeros((0, 6)), math.inf
        along = np.zeros(0)
    else:
        basis, per_force = -(wrench / scale / size)[None], 1.0 / size
    part = WrenchSlice(grasp, angles, basis, held)
    found, programs = part.reach(along), 1
    flat = FLAT * grasp.force  # no more than rounding
    lower, upper = (
        (0.0 if abs(one) <= flat else one) * per_force for one in (found.lower, found.upper)
    )
    if size == 0.0:
        lower = upper = math.nan if math.isnan(found.lower) else math.inf
    if constant.any() or not grasp.actuation.holds_links:
        # What it holds without the load: no mass but 0 is a payload otherwise.
        programs += 1
        back = part.reach(-along)
        if not back.lower >= -FLAT * grasp.force:
            lower = upper = 0.0
    lower = 0.0 if math.isnan(lower) else max(lower, 0.0)
    return HandPayload(lower, max(upper, lower), found, part, along, per_force, programs)


@dataclass(frozen=True, eq=False)
class _Search:
    """The search for the wrench of a task with a curved border that is hardest to hold.

    A polytope inside the wrenches that the hand can exert grows where it is nearest, in the ruler
    of the task: its facets bound the load from below, what the hand reaches beyond them from above.
    """

    grasp: HandGrasp
    angles: Floats
    growing: Task
    constant: Task | None
    rtol: float
    mass: float = math.inf
    """Load for which the links have their weight [kg]; of another one as much more or less."""

    def with_links(self) -> HandPayload:
        """The payload with the weight of the links, which does not grow with the load.

        Were it to grow with the load, and be right at a load m, the payload would be some f(m): m
        is held exactly if m <= f(m), as less of the load and of the links is held with both. The
        loads that are held are an interval, of which this is the end. About 1 / f is a straight
        line over 1 / m.
        """
        best = self.found()
        programs, beside = best.programs, BESIDE * self.rtol
        exact = 0.5 * beside
        lower, upper, tried = 0.0, math.inf, [(0.0, 1.0 / _between(best))]
        mass, endless = _between(best), best.lower == math.inf
        mass, small = self.grasp.force if endless else mass, NOTHING * self.grasp.force
        carried = self.holds_links
        if not carried:
            # Nearly the links alone; what is between two loads that are held is held, too.
            light = max(LEAST * min(mass, self.grasp.force), small)
            least = replace(self, mass=light).found()
            programs += least.programs
            if least.upper < light:
                return replace(least, lower=0.0, upper=light, programs=programs)
            carried = least.lower >= light
            lower = light if carried else 0.0
        for _ in range(MOST_MASSES):
            mass = max(mass, small)
            found = replace(self, mass=mass, rtol=exact).found()
            programs += found.programs
            if held := found.lower >= mass:
                lower = max(lower, mass)
            elif found.upper < mass:
                upper, best = (mass, found) if mass < upper else (upper, best)
            if held and endless:  # more of the load alone is held without end
                lower = math.inf
            known = upper < math.inf and upper - lower <= self.rtol * upper
            if known or lower == math.inf or found.upper <= 0.0 or mass == small:
                break
            exact *= 0.5 if not held and found.upper >= mass else 1.0
            tried.append((1.0 / mass, 1.0 / _between(found)))
            root = _crossing(tried[-2:], lower, upper)
            if root - lower > upper - root:  # beside it, to enclose it
                mass = max(root * (1.0 - beside), 0.5 * (root + lower))
            else:
                mass = min(root * (1.0 + beside), 0.5 * (root + upper))
        lower = lower if carried else 0.0
        return replace(best, lower=lower, upper=max(lower, upper), programs=programs)

    @property
    def holds_links(self) -> bool:
        """Whether the drives hold the links without any contact, wherever gravity acts."""
        drives = self.grasp.actuation
        assert drives.links is not None
        rows, rest = drives.inverse @ drives.links, drives.inverse @ drives.offset
        loads = np.concatenate([drives.links, drives.offset[:, None]], axis=1)
        undriven = np.abs(drives.undriven.T @ loads).max(initial=0.0)
        most, least = (self.growing.support(np.pad(one, ((0, 0), (0, 3)))) for one in (rows, -rows))
        within = (most - rest <= drives.upper) & (-least - rest >= drives.lower)
        return bool(within.all() and undriven <= FLAT * np.abs(loads).max(initial=0.0))

    @cached_property
    def slice(self) -> WrenchSlice:
        """The wrenches of the task's span."""
        parts = [self.growing] if self.constant is None else [self.growing, self.constant]
        rows = [_generators(term) for part in parts for term in part.terms()]
        scaled = np.concatenate(rows) / self.grasp.scale
        basis, links = span(scaled), self.grasp.actuation.links
        held = None if links is None else -links @ basis[:, :3].T / self.mass
        return WrenchSlice(self.grasp, self.angles, basis, np.zeros(6), held)

    def _against(self, directions: Floats) -> Floats:
        """The opposite of directions (..., k) of the slice, as factors of wrenches (..., 6)."""
        return -(directions @ self.slice.basis) / self.grasp.scale

    def extents(self, directions: Floats) -> tuple[Floats, Floats]:
        """How far the opposite of both parts reaches along directions (r, k), each (r,)."""
        u = self._against(directions)
        constant = np.zeros(len(u)) if self.constant is None else self.constant.support(u)
        return np.asarray(self.growing.support(u)), np.asarray(constant)

    def first(self) -> Iterator[Floats]:
        """Directions from which the polytope starts: along the axes, and between all of them."""
        count = len(self.slice.basis)
        yield from np.eye(count)
        yield from -np.eye(count)
        yield np.full(count, -1.0 / math.sqrt(count))

    def found(self) -> HandPayload:
        """The payload."""
        part, count = self.slice, len(self.slice.basis)
        polytope = _Polytope(count)
        rest = part.reach(np.zeros(count))
        limit = HandPayload(0.0, math.inf, rest, part, np.zeros(count), 0.0, 1)
        pending, endless = list(self.first()), 0
        while pending and limit.programs < MOST_PROGRAMS:
            direction = pending.pop()
            found = part.reach(direction)
            limit = self.limited(limit, found, direction)
            if not polytope.grows(found):
                break
            endless += found.lower == math.inf
            if pending:
                continue
            if endless == limit.programs - 1:  # every wrench is a sum of some without end
                return replace(limit, lower=math.inf)
            if polytope.flat and limit.programs < 4 * count:
                pending = polytope.across()
                continue
            lower, direction = self.nearest(polytope)
            limit = replace(limit, lower=min(lower, limit.upper))
            near = limit.upper - lower <= self.rtol * limit.upper or lower == math.inf
            if not near and polytope.size < MOST_FACETS:
                pending.append(direction)
        return limit

    def limited(self, limit: HandPayload, found: Reach, direction: Floats) -> HandPayload:
        """With the upper bound that a reach along a direction proves, where it is smaller."""
        growing, constant = (float(one[0]) for one in self.extents(direction[None]))
        programs = limit.programs + 1
        left = max(found.upper - constant, 0.0)
        left = left if left > FLAT * self.grasp.force else 0.0
        if growing > 0.0:
            load, per_force = left / growing, 1.0 / growing
        else:
            load, per_force = 0.0 if found.upper < constant else math.inf, 0.0
        if load >= limit.upper:
            return replace(limit, programs=programs)
        if self.slice.links is not None and math.isfinite(load):
            # The links keep their weight where the load grows: they are not part of its work.
            work = -float(self.growing.farthest(self._against(direction)) @ found.twist)
            per_force = 1.0 / work if work > 0.0 else 0.0
        return HandPayload(limit.lower, load, found, self.slice, direction, per_force, programs)

    def nearest(self, polytope: "_Polytope") -> tuple[float, Floats]:
        """Load up to which the task is inside the polytope, and the facet that limits it."""
        normals, distances = polytope.facets()
        growing, constant = self.extents(normals)
        flat = distances <= FLAT * self.grasp.force
        left = np.where(flat, 0.0, distances) - constant
        with np.errstate(divide="ignore", invalid="ignore"):
            loads = np.where(growing > 0.0, left / growing, np.where(left < 0.0, 0.0, math.inf))
        nearest = int(loads.argmin())
        direction = normals[nearest]
        at_origin = flat & (growing > 0.0)
        if at_origin.sum() > 1 and len(polytope.points) % 2:
            # The origin is a corner still: the middle of its facets cuts most of them off.
            middle = normals[at_origin].mean(axis=0)
            direction = middle if middle.any() else direction
        return max(float(loads[nearest]), 0.0), direction / np.linalg.norm(direction)


def _between(found: HandPayload) -> float:
    """A load near the bounds of a payload, above 0."""
    middle, force = 0.5 * (found.lower + min(found.upper, 2.0 * found.lower)), found.limiting.unit
    return max(middle or min(found.upper, LEAST * force), NOTHING * force)


def _crossing(tried: Sequence[tuple[float, float]], lower: float, upper: float) -> float:
    """The load m at which 1 / f(m) = 1 / m on a line through two points, between two loads."""
    (first, one), (second, two) = tried
    slope = (two - one) / (second - first) if second != first else 0.0
    inverse = (one - slope * first) / (1.0 - slope) if slope < 1.0 else 0.0
    load = 1.0 / inverse if inverse > 0.0 else math.inf
    if lower < load < upper:
        return load
    if upper == math.inf:
        return 4.0 / second
    return math.sqrt(lower * upper) if lower > 0.0 else 0.25 * upper


class _Polytope:
    """A polytope that grows inside the wrenches of a slice, from the origin."""

    def __init__(self, dimension: int) -> None:
        self.points = [np.zeros(dimension)]
        self.hull: ConvexHull | None = None

    def grows(self, found: Reach) -> bool:
        """Add what is reached; False: that is impossible, or it is known up to rounding."""
        if math.isnan(found.lower):
            return False
        point = found.point
        if found.lower == math.inf:
            point = point * (FAR * found.unit / np.linalg.norm(point))
        if self.hull is not None:
            normals, distances = self.facets()
            if (normals @ point - distances).max() <= FLAT * found.unit:
                return False
            try:
                self.hull.add_points(point[None])
            except QhullError:  # too thin for its precision: what is known so far holds
                return False
        self.points.append(point)
        return True

    @property
    def flat(self) -> bool:
        """Whether it has no inside; the hull is made here."""
        if self.hull is None:
            try:
                self.hull = ConvexHull(np.array(self.points), incremental=True)
            except QhullError:
                return True
        return False

    @property
    def size(self) -> int:
        """Number of facets."""
        return 0 if self.hull is None else len(self.hull.equations)

    def across(self) -> list[Floats]:
        """The two directions in which it is thinnest."""
        thin = np.linalg.svd(np.array(self.points))[2][-1]
        return [thin, -thin]

    def facets(self) -> tuple[Floats, Floats]:
        """Normals and distances; of a flat one those of its plane."""
        if self.hull is None:
            return np.array(self.across()), np.zeros(2)
        return self.hull.equations[:, :-1], -self.hull.equations[:, -1]


def _generators(term: Term) -> Floats:
    """Wrenches that span a term of a task, (g, 6)."""
    _, points = term.row()
    return points if len(points) else np.eye(6)[:3]
