"""Grip force: how hard fingers must press to hold, and what they can then carry, in newtons.

The smallest bound t of the contact forces for which they can balance every wrench of a task T is

    F = max over u of h_T(-u) / h(u),

h and h_T the support functions of the grasp wrench space, with contact forces bounded by 1, and of
the task: epsilon of Ferrari & Canny (ICRA 1992) with another ruler. It is found by the same growing
hull, with facets ranked by h / h_T; for one wrench by the simplex method along its ray.
"""

import math
from dataclasses import dataclass, replace
from enum import IntEnum

import numpy as np

from grasp3d._kernels.forces import grip_force as kernels
from grasp3d._kernels.forces.grip_force import ForceResults
from grasp3d.arrays import ArrayLike, Bools, Bytes, Floats, Ints, shaped, short_repr
from grasp3d.contact.contacts import LARGEST, Contacts, of_shape
from grasp3d.errors import ContactError, SettingError
from grasp3d.quality.force_problem import ForceBound, ForceProblem, LimitSurface
from grasp3d.quality.tasks import Task

ALIGNED = 1e-12
"""Largest sine of the angle between the normals and the line."""

NO_TORQUE = 1e-9
"""Torque about the line, relative to the wrench, that is a rounding error."""


@dataclass(frozen=True, eq=False)
class OpposedForces:
    """The contact forces of two opposed fingers that press as little as possible, in closed form.

    Both normals lie on the line through the contacts. Balance then fixes the tangential forces of
    both fingers, the difference of their normal forces N_1 - N_2 and the sum of their torsional
    moments; the only freedom is how hard they press. With a_i the tangential forces divided by
    friction, e_i the torsion radii and T the torque about the line, the smallest pressure satisfies
    (limit surface of Howe & Cutkosky, IJRR 1996)

        e_1 sqrt(N_1^2 - a_1^2) + e_2 sqrt(N_2^2 - a_2^2) = |T|,    N_i >= a_i,

    and for equal fingers with the weight across the line at its middle, a distance l off it,
    N = 1/2 m g sqrt(1 / friction^2 + (l / e)^2): the makers' m g / (2 friction) where l = 0.
    """

    normal: Floats
    """Normal forces, shape (b, 2); inf where no force suffices."""
    tangential: Floats
    """Tangential forces, shape (b, 2, 3)."""
    torsion: Floats
    """Torsional moments about the contacts' normals, shape (b, 2)."""

    def bounded(self, bound: str) -> Floats:
        """The smallest bound of the contact forces, of the kind that `grip_force` takes, (b,)."""
        if bound == "total":
            return np.asarray(self.normal.sum(axis=-1) + 0.0)
        if bound == "norm":
            sideways = np.linalg.norm(self.tangential, axis=-1)
            return np.asarray(np.hypot(self.normal, sideways).max(axis=-1))
        return np.asarray(self.normal.max(axis=-1) + 0.0)  # never -0

    def proofs(self, contacts: Contacts, bound: str) -> tuple[Floats, Bools]:
        """Directions (b, 6) that prove the bounds, and where both fingers twist, so that they do.

        At each contact the velocity is normal to the limit surface at the contact force. The
        velocity along the line is free; it is such that the forces of the bound alone count.

        Args:
            contacts: The grasps.
            bound: As `bounded` takes it; 'norm' has no directions.
        """
        line, length = _line(contacts)
        twisting = np.isfinite(self.normal) & (self.torsion != 0.0) & (bound != "norm")
        proven = np.asarray(twisting.all(axis=-1))
        normal, torsion = np.where(proven[:, None], (self.normal, self.torsion), 1.0)
        radius = np.where(proven[:, None], contacts.torsion_radius, 1.0)
        spin = np.sign(torsion[:, :1])
        scale = radius**2 / np.abs(torsion)  # of the velocities, for a spin of 1
        sliding = (scale / contacts.friction**2)[..., None] * self.tangential
        pressing = scale * normal  # support functions of the contacts that stay, along the line
        if bound == "total":
            along = 0.5 * (pressing[:, 1] - pressing[:, 0])
        else:
            harder = normal[:, 0] > normal[:, 1]
            along = np.where(harder, pressing[:, 1], -pressing[:, 0])
        turning = spin * line + np.cross(line, sliding[:, 1] - sliding[:, 0]) / length[:, None]
        moving = sliding[:, 0] + along[:, None] * line - np.cross(turning, contacts.points[:, 0])
        return np.concatenate([moving, turning], axis=-1), proven

    def in_contact_frame(self, normals: Floats) -> Floats:
        """Forces along x, y, z and torsional moments, as of `ForceCertificate`, (b, 2, 4)."""
        normal = np.where(np.isfinite(self.normal), self.normal, math.nan)[..., None]
        forces = normal * normals + self.tangential
        return np.concatenate([forces, self.torsion[..., None]], axis=-1)


def are_opposed(contacts: Contacts) -> Bools:
    """Whether grasps of a flat batch are two fingers that push toward each other, (b,)."""
    if contacts.count != 2:
        return np.zeros(len(contacts.points), dtype=np.bool_)
    line, length = _line(contacts)
    first, second = contacts.normals[:, 0], contacts.normals[:, 1]
    aligned = (np.linalg.norm(np.cross(first, line), axis=-1) <= ALIGNED) & (
        np.linalg.norm(np.cross(second, line), axis=-1) <= ALIGNED
    )
    toward = ((first * line).sum(axis=-1) > 0.0) & ((second * line).sum(axis=-1) < 0.0)
    friction = (contacts.friction > 0.0).all(axis=-1)
    return np.asarray(aligned & toward & friction & (length > 0.0))


def opposed_forces(contacts: Contacts, wrenches: Floats) -> OpposedForces:
    """Forces of two opposed fingers that resist wrenches.

    Args:
        contacts: Grasps for which `are_opposed` holds, a flat batch.
        wrenches: Wrenches that act on the object, shape (b, 6).
    """
    line, length = _line(contacts)
    force, torque = -wrenches[:, :3], -wrenches[:, 3:]
    about_first = torque - np.cross(contacts.points[:, 0], force)
    twist = (about_first * line).sum(axis=-1)
    across = about_first - twist[:, None] * line
    along = (force * line).sum(axis=-1)
    second = np.cross(across, line) / length[:, None]
    tangential = np.stack([force - along[:, None] * line - second, second], axis=1)
    least = np.linalg.norm(tangential, axis=-1) / contacts.friction  # (b, 2)
    size = np.linalg.norm(force, axis=-1) * (length + np.linalg.norm(contacts.points[:, 0], axis=1))
    size += np.linalg.norm(torque, axis=-1)
    twist = np.where(np.abs(twist) <= NO_TORQUE * size, 0.0, twist)
    pressing = _pressing(np.abs(twist), least, along, contacts.torsion_radius)
    normal = np.stack([pressing + along, pressing], axis=-1)
    return OpposedForces(normal, tangential, _torsion(normal, least, contacts, twist))


def _line(contacts: Contacts) -> tuple[Floats, Floats]:
    """Directions from the first to the second contacts (b, 3), and distances (b,)."""
    difference = contacts.points[:, 1] - contacts.points[:, 0]
    length = np.linalg.norm(difference, axis=-1)
    return difference / np.where(length > 0.0, length, 1.0)[:, None], length


def _capacity(
    normal: Floats, along: Floats, first: Floats, second: Floats, e1: Floats, e2: Floats
) -> Floats:
    """Torque about the line that both fingers resist when the second finger presses so hard."""
    spare = np.maximum(normal + along - first, 0.0) * (normal + along + first)
    other = np.maximum(normal - second, 0.0) * (normal + second)
    return np.asarray(e1 * np.sqrt(spare) + e2 * np.sqrt(other))


def _pressing(twist: Floats, least: Floats, along: Floats, radius: Floats) -> Floats:
    """Smallest normal force of the second finger, shape (b,)."""
    first, second = least.T
    lowest = np.maximum(np.maximum(second, first - along), np.maximum(0.0, -along))
    e1, e2 = radius.T
    pressing = np.where(twist > 0.0, math.inf, lowest)
    enough = _capacity(lowest, along, first, second, e1, e2) >= twist
    pressing = np.where(enough, lowest, pressing)
    searched = np.flatnonzero(~enough & (np.maximum(e1, e2) > 0.0))
    if searched.size:
        terms = (along, first, second, e1, e2, twist)
        rest = tuple(values[searched] for values in terms)
        # Pressing by this much more, either finger resists the torque by itself.
        more = twist / np.maximum(e1, e2) + np.maximum(first, second) + np.abs(along)
        from scipy.optimize.elementwise import find_root

        root = find_root(
            lambda normal, *values: _capacity(normal, *values[:-1]) - values[-1],
            (lowest[searched], (lowest + more)[searched]),
            args=rest,
            tolerances={"xrtol": 4e-16, "xatol": 0.0, "fatol": 0.0, "frtol": 0.0},
        )
        pressing[searched] = np.where(root.success, root.x, math.inf)
    return pressing


def _torsion(normal: Floats, least: Floats, contacts: Contacts, twist: Floats) -> Floats:
    """Torsional moments about the contacts' own normals that sum up to the torque, (b, 2)."""
    spare = np.maximum(normal - least, 0.0) * (normal + least)
    most = contacts.torsion_radius * np.sqrt(np.where(np.isfinite(spare), spare, 0.0))
    total = most.sum(axis=-1)
    part = np.where(total > 0.0, twist / np.where(total > 0.0, total, 1.0), 0.0)
    return np.asarray(most * part[:, None] * np.array([1.0, -1.0]))


def _hardest(
    problem: ForceProblem, wrenches: Floats, rtol: float, *, certified: bool
) -> tuple[ForceResults, Floats]:
    """Grip force of the hardest of k wrenches (b, k, 6) for each grasp, and that wrench (b, 6)."""
    size, count = wrenches.shape[:2]
    each = [_against(problem, wrenches[:, k], rtol, certified=certified) for k in range(count)]
    columns = ForceResults(*map(np.stack, zip(*each, strict=True)))  # (k, b, ...)
    grasps = np.arange(size)
    worst, best = columns.upper.argmax(axis=0), columns.lower.argmax(axis=0)
    results = ForceResults(*(column[worst, grasps] for column in columns))
    proof = {"lower": columns.lower[best, grasps], "direction": columns.direction[best, grasps]}
    return results._replace(**proof), wrenches[grasps, worst]


def _against(
    problem: ForceProblem, wrenches: Floats, rtol: float, *, certified: bool
) -> ForceResults:
    """Grip force against one wrench for each grasp, shape (b, 6); opposed fingers: closed form.

    Forces are those of `ForceCertificate`.
    """
    results = problem.of_wrenches(wrenches, rtol, certified=certified)
    forces = problem.in_contact_frame(results.forces)
    if problem.plain:
        contacts = problem.contacts.reshape((-1,))
        opposed = np.flatnonzero(are_opposed(contacts))
        if opposed.size:
            pairs = contacts.take(opposed)
            exact = opposed_forces(pairs, wrenches[opposed])
            finite = np.isfinite(exact.normal).all(axis=-1)
            directions, proven = exact.proofs(pairs, problem.bound)
            results.direction[opposed[proven]] = directions[proven]
            opposed, values = opposed[finite], exact.bounded(problem.bound)[finite]
            results.lower[opposed] = results.upper[opposed] = values
            forces[opposed] = exact.in_contact_frame(pairs.normals)[finite]
    return results._replace(forces=forces)


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
    """Proof of a grip force, which linear algebra can verify."""

    direction: Floats
    """Direction u of wrenches, shape (..., 6), against which the task reaches h_T(-u) and the grasp
    wrench space only h(u): `lower` is their ratio; where no force suffices h(u) is 0."""
    wrench: Floats
    """The wrench of the task that needs the most force, or the given one, shape (..., 6)."""
    forces: Floats
    """Contact forces that balance that wrench, each inside its friction cone or limit surface,
    shape (..., n, 4): force along x, y, z [N], and torsional moment about the normal [N x mesh
    unit]; nan where no force suffices."""

    __repr__ = short_repr


@dataclass(frozen=True, eq=False)
class GripForce:
    """The smallest contact forces that resist a wrench or a task, with certified bounds."""

    lower: Floats
    """Lower bound: no smaller force suffices [N], shape (...)."""
    upper: Floats
    """Upper bound: this force suffices [N], shape (...); inf where no force is known to."""
    rank: Ints
    """Dimension of the span of the wrenches, shape (...)."""
    resistance: Bytes
    """`Resistance` codes, shape (...)."""
    bound: ForceBound
    limit_surface: LimitSurface
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
    edges: int | None = None,
    cone_offset: ArrayLike = 0.0,
    rtol: float = 1e-3,
) -> GripForce:
    """Smallest contact forces that resist a wrench, or any wrench of a task.

    The fingers may press differently for each wrench, as far as the bound allows: it is the force
    that the gripper must be capable of.

    Args:
        contacts: The contacts. Soft fingers have the elliptic limit surface of Howe & Cutkosky
            (IJRR 1996), (f_t / friction)^2 + (moment / torsion_radius)^2 <= f_n^2.
        task: A `Task`, the same for all grasps; or wrenches that act on the object, shape (..., 6):
            force [N] and torque about the centre of mass [N m].
        bound: What is limited: 'normal', the normal component of every finger's force, which the
            data sheets of grippers call force per finger; 'norm', the length of every finger's
            force; 'total', the sum of the normal components of all fingers.
        masses: Masses [kg] that replace the task's own, one for all grasps or shape (...).
        edges: Edges of polygonal friction cones; None: circular cones. Soft fingers then resist the
            linear hull that epsilon takes.
        cone_offset: Angle added to the cones' half-angles [rad], one value or shape (..., n).
        rtol: Largest difference of the bounds, as a fraction of the upper one.

    Returns:
        Bounds, proof, and where infinite the reason, of each grasp of the batch.

    Raises:
        ContactError: Wrenches of another shape, or values that are not finite.
        SettingError: A setting outside its range.

    Example:
        Two soft fingers on opposite sides of a part of 0.5 kg, gravity across their line, where
        m g / (2 friction) is known, and in any direction:

        >>> import grasp3d
        >>> from grasp3d.quality import Weight
        >>> points, normals = [[-0.02, 0, 0], [0.02, 0, 0]], [[1, 0, 0], [-1, 0, 0]]
        >>> contacts = grasp3d.Contacts(points, normals, friction=0.5, torsion_radius=0.003)
        >>> print(f"{grasp3d.grip_force(contacts, [0, 0, -4.903, 0, 0, 0]).value:.2f} N")
        4.90 N
        >>> print(f"{grasp3d.grip_force(contacts, Weight(0.5)).value:.2f} N")
        6.94 N
    """
    problem = ForceProblem.of_contacts(contacts, bound=bound, edges=edges, cone_offset=cone_offset)
    return ForceOptions(task, bound, masses, rtol).solve(problem)


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
    masses = np.asarray(values, dtype=np.float64)
    if not ((masses >= 0.0) & np.isfinite(masses)).all():
        raise SettingError(f"masses must be finite and at least 0 [kg]; got {masses}")
    return of_shape("masses", masses, contacts.batch).reshape(-1).copy()


@dataclass(frozen=True, eq=False)
class ForceOptions:
    """What `grip_force` takes besides the contacts, for a batch or some of it."""

    task: Task | ArrayLike
    bound: ForceBound
    masses: ArrayLike | None
    rtol: float
    group: int = 1
    """As in `payload`."""

    def flat(self, contacts: Contacts) -> "ForceOptions":
        """With one wrench and one mass for each grasp of a flat batch."""
        task = self.task if isinstance(self.task, Task) else wrenches_of(self.task, contacts)
        masses = None if self.masses is None else masses_of(self.masses, contacts)
        return replace(self, task=task, masses=masses)

    def take(self, rows: slice | Ints) -> "ForceOptions":
        """Those of chosen grasps."""
        task = self.task if isinstance(self.task, Task) else np.asarray(self.task)[rows]
        masses = None if self.masses is None else np.asarray(self.masses)[rows]
        return replace(self, task=task, masses=masses)

    def solve(self, problem: ForceProblem) -> GripForce:
        """Grip force of contacts whose wrench spaces are known."""
        options = self.flat(problem.contacts)
        results, wrenches = options.found(problem, certified=True)
        if wrenches is None:
            assert isinstance(options.task, Task)
            masses = None if options.masses is None else np.asarray(options.masses)
            wrenches = options.task.farthest_for(masses, -results.direction)
            forces = problem.of_wrenches(wrenches, self.rtol).forces
            results = results._replace(forces=problem.in_contact_frame(forces))
        batch = problem.contacts.batch
        return GripForce(
            lower=shaped(results.lower, batch),
            upper=shaped(results.upper, batch),
            rank=shaped(results.rank, batch),
            resistance=shaped(results.reason, batch),
            bound=self.bound,
            limit_surface=problem.limit_surface,
            certificate=ForceCertificate(
                direction=shaped(results.direction, batch),
                wrench=shaped(wrenches, batch),
                forces=shaped(results.forces, batch),
            ),
        )

    def bounds(self, problem: ForceProblem) -> ForceResults:
        """Bounds for options of a flat batch, without the contact forces that prove them."""
        return self.found(problem, certified=False)[0]

    def found(
        self, problem: ForceProblem, *, certified: bool
    ) -> tuple[ForceResults, Floats | None]:
        """Results of a flat batch, and the hardest wrenches (b, 6), of which the forces are.

        Without these wrenches, and forces, where the task was taken as a whole.
        """
        task = self.task
        if isinstance(task, Task):
            masses = None if self.masses is None else np.asarray(self.masses)
            wrenches = task.corners_for(masses, problem.problem.size)
            if wrenches is None:
                return problem.of_task(task, self.rtol, masses), None
        else:
            wrenches = np.asarray(task)[:, None]
        return _hardest(problem, wrenches, self.rtol, certified=certified)
