"""How well grasps of closed jaws hold with their whole patches, and where poses are a little wrong.

Points stay the contacts of the label. The score takes what each jaw touches as points of its patch
that share the jaw's force: torsion and rolling then follow from where the patch is and how large,
also where it hangs over the end of a pad. Payloads are those in the worst tilt of the patches that
the sensor allows, exact for hard contacts (Wan & Howe 2018, Sec. III, with the bound on the sum of
the lengths of a jaw's forces).
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from scipy.spatial import ConvexHull
from scipy.special import ndtr

from grasp3d.arrays import Bools, Bytes, Floats, locked, short_repr
from grasp3d.contact.contacts import Contacts, evenly_pressed_radius
from grasp3d.hand.choices import ObjectMotion
from grasp3d.hand.closed_jaws import ClosedJaws
from grasp3d.hand.closing import inner_faces
from grasp3d.hand.jaws import Jaws, metres_per_unit
from grasp3d.hand.scene import Scene
from grasp3d.mesh import ObjectMesh
from grasp3d.mesh.region import allowed_contacts
from grasp3d.quality.critical_angle import critical_friction_angle
from grasp3d.quality.ferrari_canny import epsilon_with
from grasp3d.quality.force_ranges import force_at_worst, payload
from grasp3d.quality.patch_lines import best_line_angles
from grasp3d.quality.tasks import STANDARD_GRAVITY, Weight
from grasp3d.quality.wrenches import EpsilonOptions
from grasp3d.settings import GraspModel
from grasp3d.stability.label import Label
from grasp3d.stability.thresholds import label_angles, margins
from grasp3d.surface.contacts import JawContacts
from grasp3d.surface.grasp_numbers import EPSILON_RTOL, hull_labels, located_angles_of
from grasp3d.surface.load_case import LoadCase
from grasp3d.system.context import unreported

PAYLOAD_RTOL = 1e-2
"""Fraction of a patch payload that may lie between its bounds; the smaller one is given."""

CHUNK = 8192
"""Poses whose errors are tried at a time."""

CUT = 1e-9
"""Distance of a patch from the border [m] that is a rounding error."""

LOST = -1.0
"""Score of a pose at which the jaws do not close on the object."""


@dataclass(frozen=True, eq=False)
class ClosedNumbers:
    """Numbers of grasps where jaws are closed, shape (...) each."""

    closes: Bools
    """Whether the jaws close on the object."""
    clear: Bools
    """Whether they do, and no finger started in it (`ClosedJaws.shift` is 0)."""
    label: Bytes
    """`Label` codes at the contacts; U where the jaws do not close."""
    margin: Floats
    """[rad]; -inf where the jaws do not close."""
    epsilon: Floats
    """At the nominal normals; 0 where the jaws do not close; nan: not computed."""
    payload: Floats
    """What the patches hold at the worst normals [kg], with the force at hand or, where none is
    known, with 1 N of each finger; nan: the task does not depend on the mass."""
    ratio: Floats
    """Force at hand over the force that the patches need at the worst normals to hold what must be
    held; where mass or force are not known, the weight that they hold per newton of each finger."""
    even_ratio: Floats
    """The same of patches that are pressed evenly, and so resist no more torsion than soft pads;
    where mass or force are not known, `ratio`."""
    score: Floats
    """See `Robustness.robust_score`."""
    spare: Floats
    """How far normals may tilt until the patches do not hold what must be held, or do not close,
    where mass or force are not known [rad]; -inf where the jaws do not close."""

    __repr__ = short_repr

    @classmethod
    def of(
        cls,
        mesh: ObjectMesh,
        jaws: ClosedJaws,
        model: GraspModel,
        case: LoadCase | None,
        *,
        with_epsilon: bool,
    ) -> "ClosedNumbers":
        """The numbers of closed jaws, shape (k,) each.

        Args:
            mesh: The object.
            jaws: What the jaws touch.
            model: Friction, sensor resolution and errors, with lengths in the mesh's unit.
            case: What must be held, and with which force; None: nothing is stated.
            with_epsilon: Whether `epsilon` is computed; else it is nan.
        """
        closes = jaws.closed
        shape, contacts = closes.shape, JawContacts.of(mesh, jaws)
        label, found = np.zeros(shape, dtype=np.uint8), contacts.contacts(model)
        margin, spare = np.full((2, *shape), -math.inf)
        epsilon, held, ratio, even, score = np.zeros((5, *shape))
        if not with_epsilon:
            epsilon[:] = math.nan
        score[~closes] = LOST
        if contacts.size:
            allowed = allowed_contacts(mesh, contacts.points)
            angles = np.where(allowed, critical_friction_angle(found), math.inf)
            located, _ = both = located_angles_of(contacts, (angles, angles), model)
            exact = model.method == "exact"
            label[closes] = label_angles(*both, model) if exact else hull_labels(contacts, model)
            margin[closes] = margins(located, model)
            if with_epsilon:
                options = EpsilonOptions.of_model(
                    model, torque_scale=mesh.torque_scale, rtol=EPSILON_RTOL
                )
                epsilon[closes] = epsilon_with(found, options).lower
            forces = _patch_forces(contacts, angles, model, case)
            for values, own in zip((held, ratio, even, score, spare), forces, strict=True):
                values[closes] = own
            outside = np.flatnonzero(closes)[~allowed]
            label[outside], score[outside], spare[outside] = Label.U, LOST, -math.inf
            held[outside] = ratio[outside] = even[outside] = 0.0
        clear = closes & (jaws.shift == 0.0)
        return cls(closes, clear, label, margin, epsilon, held, ratio, even, score, spare)

    def reshaped(self, *shape: int) -> "ClosedNumbers":
        """The same in another shape."""
        return ClosedNumbers(**{name: one.reshape(shape) for name, one in vars(self).items()})

    def take(self, rows: Any) -> "ClosedNumbers":
        """The chosen rows."""
        return ClosedNumbers(**{name: locked(one[rows]) for name, one in vars(self).items()})

    @staticmethod
    def joined(parts: "Sequence[ClosedNumbers]", axis: int = 0) -> "ClosedNumbers":
        """Several as one, along an axis."""
        names = vars(parts[0])
        return ClosedNumbers(
            **{name: np.concatenate([vars(one)[name] for one in parts], axis) for name in names}
        )


def _patch_forces(
    contacts: JawContacts, angles: Floats, model: GraspModel, case: LoadCase | None
) -> tuple[Floats, ...]:
    """What the patches of closed jaws hold, with critical angles of points (b,).

    Payload, ratio, even_ratio, score and spare of `ClosedNumbers`, shape (b,) each.
    """
    jaws = contacts.jaws
    decided = case is not None and case.complete
    held, ratio = _held(jaws.corners, contacts, model, case)
    even = ratio
    if decided:
        middle = jaws.points[:, :, None]
        arms = jaws.corners - middle  # (b, n, m, 3)
        farthest = np.linalg.norm(arms, axis=-1).max(axis=-1)
        radius = evenly_pressed_radius(0.5 * jaws.extents, jaws.area)
        share = np.minimum(radius / np.where(farthest > 0.0, farthest, math.inf), 1.0)
        pressed = middle + share[..., None, None] * arms
        enough = np.flatnonzero(ratio > 0.0)
        even = ratio.copy()
        if len(enough):
            some = contacts.take(enough)
            _, even[enough] = _held(pressed[enough], some, model, case)
        _, nominal = _held(pressed, contacts, model, case, tilted=False)
    least = angles  # of the patches, no larger
    if contacts.count == 2:
        normals = jaws.normals[:, :, None]  # (b, 2, 1, 3)
        y_and_z = np.swapaxes(jaws.poses[:, None, :3, 1:3], 2, 3)  # (b, 1, 2, 3)
        across = y_and_z - (y_and_z * normals).sum(axis=-1, keepdims=True) * normals
        ellipses = 0.5 * jaws.extents[..., None] * across
        least = best_line_angles(jaws.points, jaws.normals, ellipses, angles)
    tilt = model.tilt
    spare = model.effective_friction_angle - least + tilt
    holds = ratio > 0.0
    if decided:
        # With the tilt the payload falls about in proportion, to 0 where they do not close;
        # no more lacks than to 90 degrees of friction.
        with np.errstate(divide="ignore", invalid="ignore"):
            loaded = np.where(spare > 0.0, spare * (1.0 - 1.0 / nominal), -math.inf)
        friction = model.effective_friction_angle + tilt
        lowest = friction - 0.5 * math.pi + np.minimum(spare, 0.0)
        spare, holds = np.clip(loaded, lowest, spare), ratio >= 1.0
    short = np.maximum(np.minimum(spare - tilt, 0.0) / math.pi, LOST)
    score = np.where(holds, ratio / (1.0 + ratio), short)
    return held, ratio, even, score, spare


def _held(
    corners: Floats,
    contacts: JawContacts,
    model: GraspModel,
    case: LoadCase | None,
    *,
    tilted: bool = True,
) -> tuple[Floats, Floats]:
    """Payload [kg] and ratio of patches that are pressed at corners (b, n, m, 3).

    As in `ClosedNumbers`; `tilted`: at the worst normals, or at the nominal ones.
    """
    count = corners.shape[2]
    pressed = Contacts(
        (corners - contacts.mesh.center_mass).reshape(len(corners), -1, 3),
        np.repeat(contacts.jaws.normals, count, axis=1),
        model.friction_interval[0],
    )
    task = Weight() if case is None else case.task
    force = 1.0 if case is None or case.available is None else case.available
    options: dict[str, Any] = {
        "tilt": model.tilt * tilted,
        "bound": "norm", "rtol": PAYLOAD_RTOL, "group": count,
    }  # fmt: skip
    if task.mass is None:
        with np.errstate(divide="ignore"):
            ratio = force / force_at_worst(pressed, task, **options)
        return np.full(len(ratio), math.nan), ratio
    held = payload(pressed, task, force, **options)
    known = case.mass if case is not None and case.complete else None
    mass = known or force / STANDARD_GRAVITY
    return held, held / mass


@dataclass(frozen=True, eq=False)
class Robustness:
    """How far grasps of closed jaws are from failing, at poses that may be a little wrong.

    A row for each of k grasps. With a pose error (`Scene.pose_error`) the jaws are closed at
    `tried` poses around each stated one, the same for all grasps; without one at the stated pose.
    """

    stated: ClosedNumbers
    """Numbers at the stated poses."""
    tried: int
    """Number of poses tried of each grasp, the stated one among them."""
    pad_margin: Floats | None
    """Distance of the contacts from the border of flat pads [m], the smaller one of both jaws,
    below 0 beside them, shape (k,); nan where a jaw touches nothing; None: no flat pads."""
    pad_edge: Floats | None
    """The same of the nearest points of the patches; 0 where the border cuts one off."""
    pressure: Floats | None
    """Force at hand over the smaller patch [Pa], shape (k,); None: the force is not known."""
    closing_share: Floats
    """Share of the poses tried at which the jaws close on the object, shape (k,)."""
    margin_worst: Floats
    """Smallest margin of the poses tried [rad], shape (k,); -inf: at one the jaws do not close."""
    margin_mean: Floats
    """Mean of those at which they close [rad], shape (k,); nan: they close at none."""
    epsilon_worst: Floats
    """Smallest epsilon, shape (k,); 0: at one the jaws do not close; nan: one pose is tried."""
    epsilon_mean: Floats
    """Mean epsilon, shape (k,); nan: one pose is tried."""
    score_worst: Floats
    """Smallest score, shape (k,)."""
    robust_score: Floats
    """Mean score, shape (k,), less what contacts near the border of flat pads may lose.

    It is the mean times the probability that the contacts stay on the pads, and -1 times that of
    the contrary, for normally distributed errors of the position, of which two standard deviations
    are stated.

    The score of a pose is in [-1, 1). Where the patches hold what must be held at the worst normals
    it is r / (1 + r), with r the payload over the mass, at least 1. Where they do not, it is the
    angle by which normals tilt less at most than the sensor's resolution allows, over pi: negative,
    (beta - alpha/2 - beta*) / pi with beta* the angle of friction with which the patches hold it.
    Where mass or force are not known, r is the weight that is held per newton of each finger, any
    above 0, and beta* that with which the patches close. It is -1 where the jaws do not close on
    the object."""
    label_tried: Bytes
    """`Label` codes: the worst of the poses tried, shape (k,).

    S also requires that the patches, pressed evenly, hold the load at the worst normals, where mass
    and force are known, and that contacts stay on the pads wherever the position error shifts
    them. A pose at which a finger starts in the object is M at most. Without errors and without a
    load it is the label."""
    success_probability: Floats
    """Probability that the grasp holds the load (or closes, where mass or force are not known), for
    normally distributed errors, shape (k,).

    Of normals and poses two standard deviations are what is stated of them, pose errors beyond that
    are left out; a tilted normal counts as if tilted the worst way. Nothing is fitted."""
    by_mass: bool
    """Whether scores are relative to the mass of the object."""

    __repr__ = short_repr

    @property
    def even_ratio(self) -> Floats:
        """That of evenly pressed patches at the stated pose, shape (k,); see `ClosedNumbers`."""
        return self.stated.even_ratio

    @property
    def patch_payload(self) -> Floats:
        """What the patches hold at the stated pose [kg], shape (k,); see `ClosedNumbers`."""
        return self.stated.payload

    def take(self, rows: Any) -> "Robustness":
        """The chosen grasps."""
        arrays: dict[str, Any] = {
            name: locked(one[rows])
            for name, one in vars(self).items()
            if isinstance(one, np.ndarray)
        }
        return replace(self, stated=self.stated.take(rows), **arrays)


def robustness_of(
    mesh: ObjectMesh,
    poses: Floats,
    jaws: ClosedJaws,
    scene: Scene,
    model: GraspModel,
    case: LoadCase | None,
    *,
    object_motion: ObjectMotion,
) -> Robustness:
    """Numbers of grasps at closed jaws, and where their poses are a little wrong.

    Args:
        mesh: The object.
        poses: The stated poses, shape (k, 4, 4).
        jaws: What the jaws touch from there.
        scene: The gripper, and the error of its pose.
        model: Friction, sensor resolution and errors, with lengths in the mesh's unit.
        case: What must be held, and with which force; None: nothing is stated.
        object_motion: As in `Hand.close`.
    """
    assert mesh.unit is not None
    offsets = scene.pose_error.offsets(mesh.unit)
    several = len(offsets.poses) > 1 and len(poses) > 0
    stated = ClosedNumbers.of(mesh, jaws, model, case, with_epsilon=several)
    every = stated.reshaped(-1, 1)
    if several:
        close = partial(
            scene.hand.close, mesh, object_motion=object_motion,
            friction=model.nominal_friction,
            **({"give_way": offsets.position} if offsets.position else {}),
        )  # fmt: skip
        others = _tried(mesh, poses, offsets.poses[1:], close, model, case)
        every = ClosedNumbers.joined([every, others], axis=1)
    weights = offsets.weights if several else np.ones(1)
    by_mass = case is not None and case.complete
    # Where a finger started in the object it may hold, but this is not sure.
    codes = np.where(every.clear, every.label, np.minimum(every.label, Label.M))
    if by_mass:
        codes = np.where(every.even_ratio < 1.0, np.minimum(codes, Label.M), codes)
    codes = codes.min(axis=1)
    metres, margin, edge = metres_per_unit(mesh), None, None
    stay = np.ones(len(poses))
    if (pads := scene.jaws) and not pads.round_tips:
        margin, edge = _to_border(jaws, pads, metres)
        if offsets.position:
            # Two standard deviations are the error; a contact that leaves the pad is lost.
            deviation = 0.5 * metres * offsets.position
            stay = np.where(np.isnan(margin), 1.0, ndtr(margin / deviation))
            stays = margin >= metres * offsets.position
            codes = np.where(stays, codes, np.minimum(codes, Label.M))
    with np.errstate(divide="ignore", invalid="ignore"):
        pressure = None
        if case is not None and case.available is not None:
            smaller = jaws.area.min(axis=1) * metres**2
            area = np.where(smaller > 0.0, smaller, math.nan)
            pressure = locked(case.available / area)
        margins_closed = np.where(every.closes, every.margin, 0.0)
        margin_mean = margins_closed.sum(axis=1) / every.closes.sum(axis=1)
    return Robustness(
        stated=stated,
        tried=len(offsets.poses),
        pad_margin=None if margin is None else locked(margin),
        pad_edge=None if edge is None else locked(edge),
        pressure=pressure,
        closing_share=locked(every.closes.mean(axis=1)),
        margin_worst=locked(np.where(every.clear, every.margin, -math.inf).min(axis=1)),
        margin_mean=locked(margin_mean),
        epsilon_worst=locked(np.where(every.clear, every.epsilon, 0.0).min(axis=1)),
        epsilon_mean=locked(every.epsilon.mean(axis=1)),
        score_worst=locked(np.where(every.clear, every.score, LOST).min(axis=1)),
        robust_score=locked((every.score.mean(axis=1) - LOST) * stay + LOST),
        label_tried=locked(codes.astype(np.uint8)),
        success_probability=locked(_probabilities(every.spare, model, jaws) @ weights),
        by_mass=by_mass,
    )


def _tried(
    mesh: ObjectMesh,
    poses: Floats,
    offsets: Floats,
    close: Callable[..., ClosedJaws],
    model: GraspModel,
    case: LoadCase | None,
) -> ClosedNumbers:
    """Numbers at the poses moved by each of t offsets, shape (k, t)."""
    parts, count = [], len(offsets)
    step = max(1, CHUNK // count)
    for first in range(0, len(poses), step):
        moved = np.matmul(poses[first : first + step, None], offsets)  # (r, t, 4, 4)
        with unreported():
            jaws = close(moved.reshape(-1, 4, 4))
            parts.append(
                ClosedNumbers.of(mesh, jaws, model, case, with_epsilon=True).reshaped(-1, count)
            )
    return ClosedNumbers.joined(parts)


def _to_border(closed: ClosedJaws, pads: Jaws, metres: float) -> tuple[Floats, Floats]:
    """Least distances of contacts, and of their patches, from the borders of pads [m].

    Borders are those of all inner faces of a finger together, seen along the closing axis.

    Args:
        closed: Where they touch, k rows.
        pads: The gripper.
        metres: Metres per unit of the mesh.

    Returns:
        Shape (k,) each, the smaller distance of both jaws; nan where a jaw touches nothing.
    """
    corners = np.concatenate([np.array(face) for face in inner_faces(pads)])[:, 1:]
    sides = ConvexHull(corners).equations  # (s, 3): outward normals, and minus their distances

    def distance(points: Floats) -> Floats:
        arms = metres * (points - closed.poses[:, None, None, :3, 3])  # (k, n, m, 3)
        beyond = arms @ closed.poses[:, None, :3, 1:3] @ sides[:, :2].T + sides[:, 2]
        return np.asarray(-beyond.max(axis=(1, 2, 3)))

    edge = distance(closed.corners)
    return distance(closed.points[:, :, None]), np.where(edge < CUT, 0.0, edge)


def _probabilities(spare: Floats, model: GraspModel, jaws: ClosedJaws) -> Floats:
    """Probability that no normal tilts by more than what is to spare, shape (k, t)."""
    deviation = 0.5 * model.tilt  # of the tilt about each of two axes
    if deviation == 0.0:
        return np.asarray(spare > 0.0, dtype=np.float64)
    each = -np.expm1(-0.5 * (np.maximum(spare, 0.0) / deviation) ** 2)
    return np.asarray(each ** jaws.area.shape[1])
