"""Scores and payloads of closed jaws with their whole patches, also at slightly wrong poses.

The label takes contacts as points. The score divides the force of each jaw among points of its
patch: torsion and rolling resistance then follow from the position and size of the patch, also
where it reaches over the end of a pad. Payloads hold for the worst tilt of the patches that the
sensor allows, and are exact for hard contacts (Wan & Howe 2018, Sec. III, with a bound on the sum
of the lengths of a jaw's forces).
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial import ConvexHull
from scipy.special import ndtr

from grasp3d.arrays import Bools, Bytes, Floats, Ints, locked, short_repr
from grasp3d.contact.contacts import Contacts, evenly_pressed_radius
from grasp3d.hand.choices import ObjectMotion
from grasp3d.hand.closing import ClosedJaws, inner_faces
from grasp3d.hand.jaws import Jaws
from grasp3d.hand.scene import Scene
from grasp3d.mesh import ObjectMesh
from grasp3d.mesh.region import allowed_contacts
from grasp3d.quality.critical_angle import critical_friction_angle
from grasp3d.quality.force_ranges import force_within_tilt, payload
from grasp3d.quality.tasks import STANDARD_GRAVITY, Task, Weight
from grasp3d.settings import GraspModel
from grasp3d.stability.label import Label, label_angles
from grasp3d.surface.contacts import JawContacts, critical_angles
from grasp3d.surface.grasp_numbers import hull_labels
from grasp3d.surface.grasp_table import rows_of
from grasp3d.surface.load_case import LoadCase
from grasp3d.system.context import unreported

PAYLOAD_RTOL = 1e-2
"""Relative distance between the bounds of a patch payload; the lower bound is returned."""

CHUNK = 8192
"""Number of poses whose errors are tried at a time."""

LOST = -1.0
"""Score of a pose at which the jaws do not close on the object."""


class ClosedNumbers(NamedTuple):
    """Numbers of grasps with closed jaws, shape (...) each."""

    closes: Bools
    """Whether the jaws close on the object."""
    label: Bytes
    """`Label` codes of the pose; U where the jaws do not close. See `Robustness.label`."""
    margin: Floats
    """Angle by which the grasp is S [rad]; -inf where the jaws do not close."""
    payload: Floats
    """Mass that evenly pressed patches hold at the worst normals [kg], with the available force or,
    where none is known, with 1 N of each finger; nan: the task does not depend on the mass."""
    grip_force: Floats
    """Force that each finger needs at these normals [N] for the mass or, where it is not known, for
    1 kg; inf: no force suffices, or the jaws do not close."""
    score: Floats
    """See `Robustness.score`."""

    @classmethod
    def of(
        cls, mesh: ObjectMesh, jaws: ClosedJaws, model: GraspModel, case: LoadCase | None
    ) -> "ClosedNumbers":
        """Return the numbers of closed jaws, shape (k,) each.

        Args:
            mesh: The object.
            jaws: Contacts and patches of the jaws.
            model: Friction, sensor resolution and errors.
            case: What must be held, and with which force; None: nothing is stated.
        """
        closes = jaws.closed
        shape, contacts = closes.shape, JawContacts.of(mesh, jaws.take(closes))
        label, found = np.zeros(shape, dtype=np.uint8), contacts.contacts(model)
        margin, held = np.full(shape, -math.inf), np.zeros(shape)
        force, score = np.full(shape, math.inf), np.full(shape, LOST)
        if contacts.size:
            allowed = allowed_contacts(mesh, contacts.points)
            nominal = np.where(allowed, critical_friction_angle(found), math.inf)
            angles = critical_angles(contacts, location_error=model.location_error)
            worst, best = (np.where(allowed, one, math.inf) for one in angles)
            exact = model.method == "exact"
            codes = label_angles(worst, best, model) if exact else hull_labels(contacts, model)
            margin[closes] = model.sure_angle - worst
            patches = _Patches.of(contacts, model, case)
            held[closes], force[closes], ratio, score[closes] = patches.numbers(nominal)
            label[closes] = patches.label(codes, ratio)
            outside = np.flatnonzero(closes)[~allowed]
            label[outside], score[outside] = Label.U, LOST
            held[outside], force[outside] = 0.0, math.inf
        clear = closes & (jaws.shift == 0.0)
        # Where a finger started in the object the grasp may hold, but not surely.
        label = np.where(clear, label, np.minimum(label, Label.M))
        return cls(closes, label, margin, held, force, score)

    def reshaped(self, *shape: int) -> "ClosedNumbers":
        """Return the same numbers in another shape."""
        return ClosedNumbers._make(one.reshape(shape) for one in self)

    def take(self, rows: Any) -> "ClosedNumbers":
        """Return the chosen rows."""
        return ClosedNumbers._make(locked(one[rows]) for one in self)

    def tried(self, rows: Ints, others: "ClosedNumbers") -> "ClosedNumbers":
        """Add t other poses to these numbers of one pose each, (k, 1); (k, 1 + t).

        Args:
            rows: Rows that have other poses, shape (r,); all other rows repeat their number.
            others: Numbers of the other poses, shape (r, t).
        """
        every: list[Any] = [np.repeat(one, 1 + others.score.shape[1], axis=1) for one in self]
        for one, added in zip(every, others, strict=True):
            one[rows, 1:] = added
        return ClosedNumbers._make(every)


@dataclass(frozen=True, eq=False)
class _Patches:
    """Patches of closed jaws: points of each patch that share the force of its jaw.

    Scores use the extreme points, at which a jaw may press. Payloads, forces and labels use points
    drawn toward the centre: an evenly pressed patch resists no more torsion than these.
    """

    contacts: JawContacts
    model: GraspModel
    case: LoadCase | None
    points: Floats
    """Extreme points of the patches, relative to the centre of mass, shape (b, n, m, 3)."""
    pressed: Floats
    """The same points drawn toward the centre of each patch."""

    @classmethod
    def of(cls, contacts: JawContacts, model: GraspModel, case: LoadCase | None) -> "_Patches":
        """The patches of closed jaws."""
        jaws = contacts.jaws
        middle = jaws.points[:, :, None]
        arms = jaws.corners - middle  # (b, n, m, 3)
        farthest = np.linalg.norm(arms, axis=-1).max(axis=-1)
        radius = evenly_pressed_radius(0.5 * jaws.extents, jaws.area)
        share = np.minimum(radius / np.where(farthest > 0.0, farthest, math.inf), 1.0)
        middle = middle - contacts.mesh.center_mass
        return cls(contacts, model, case, middle + arms, middle + share[..., None, None] * arms)

    @property
    def decided(self) -> bool:
        """Whether the force is known, and the mass unless the task needs none."""
        return self.case is not None and self.case.complete

    @property
    def task(self) -> Task:
        """Task that must be resisted; the weight in any direction where nothing is stated."""
        return Weight() if self.case is None else self.case.task

    @property
    def force(self) -> float:
        """Available force [N], or 1 if it is not known."""
        return 1.0 if self.case is None or self.case.available is None else self.case.available

    def numbers(self, angles: Floats) -> tuple[Floats, ...]:
        """Payload, grip force, ratio and score of `ClosedNumbers`, shape (b,) each.

        The ratio is the available force over the grip force or, where mass or force are not known,
        the weight that is held per newton of each finger.

        Args:
            angles: Critical angles of the point contacts (b,).
        """
        tilt = self.model.tilt
        held, needed, most = self._held(self.points, tilt)
        ratio, score = most, 1.0 - 1.0 / (1.0 + most)
        if self.case is not None:
            held, needed, ratio = self._held(self.pressed, tilt)
        short = np.flatnonzero(most < 1.0 if self.decided else most <= 0.0)
        if len(short):
            lacks = np.minimum(self._spare(short, angles[short]) - tilt, 0.0)
            score[short] = np.maximum(lacks / math.pi, LOST)
        return held, needed, ratio, score

    def _spare(self, rows: Ints, angles: Floats) -> Floats:
        """Angle by which normals may tilt before the patches do not hold the load, or close [rad].

        Args:
            rows: The chosen grasps (r,).
            angles: Critical angles of their point contacts (r,).
        """
        model = self.model
        patches = critical_friction_angle(self._contacts(self.points[rows], 0.0, rows))
        friction = model.sure_angle + model.tilt
        spare = friction - np.minimum(patches, angles)
        if not self.decided:
            return spare
        _, _, nominal = self._held(self.points[rows], 0.0, rows)
        # With the tilt the payload falls about in proportion, to 0 where the patches do not close.
        # What lacks is limited to a friction angle of 90 degrees.
        with np.errstate(divide="ignore", invalid="ignore"):
            loaded = np.where(spare > 0.0, spare * (1.0 - 1.0 / nominal), -math.inf)
        return np.clip(loaded, friction - 0.5 * math.pi + np.minimum(spare, 0.0), spare)

    def label(self, codes: Bytes, ratio: Floats) -> Bytes:
        """Labels of point contacts (b,) with the load: S only where the patches surely hold it.

        U also where they hold it at no normals that are possible (Wan & Howe 2018, Sec. III, with
        the available force as a bound on what each jaw presses along its normal).

        Args:
            codes: `Label` codes of the point contacts.
            ratio: What `numbers` returned.
        """
        if self.case is None:
            return codes
        codes = np.where(ratio < 1.0 if self.decided else ratio <= 0.0,
                         np.minimum(codes, Label.M), codes)  # fmt: skip
        if self.decided and len(rows := np.flatnonzero((ratio < 1.0) & (codes > Label.U))):
            needed = force_within_tilt(
                self._contacts(self.points[rows], self.model.friction_interval[1], rows), self.task,
                at="best", tilt=self.model.tilt, rtol=PAYLOAD_RTOL,
            )  # fmt: skip
            codes[rows[needed > self.force]] = Label.U
        return codes

    def _contacts(self, points: Floats, friction: float, rows: Any) -> Contacts:
        """Points (b, n, m, 3) as contacts, grouped by jaw."""
        _, jaws, each, _ = points.shape
        normals = np.repeat(self.contacts.jaws.normals[rows], each, axis=1)
        return Contacts(
            points.reshape(len(points), -1, 3), normals, friction,
            groups=np.arange(jaws).repeat(each),
        )  # fmt: skip

    def _held(
        self, points: Floats, tilt: float, rows: Any = slice(None)
    ) -> tuple[Floats, Floats, Floats]:
        """Payload [kg], grip force [N] and ratio of points of rows, at the worst tilt."""
        contacts = self._contacts(points, self.model.friction_interval[0], rows)
        options: dict[str, Any] = {"tilt": tilt, "bound": "norm", "rtol": PAYLOAD_RTOL}
        task, force = self.task, self.force
        with np.errstate(divide="ignore"):
            if task.mass is None:
                needed = force_within_tilt(contacts, task, **options)
                return np.full(len(needed), math.nan), needed, force / needed
            held = payload(contacts, task, force, **options)
            mass = self.case.mass if self.case is not None and self.case.mass else 1.0
            of = mass if self.decided else force / STANDARD_GRAVITY
            grows = all(term.mass is not None for term in task.terms())
            needed = force * mass / held if grows else force_within_tilt(contacts, task, **options)
            return held, needed, held / of


@dataclass(frozen=True, eq=False)
class Robustness:
    """Distance of grasps with closed jaws from failure, also at slightly wrong poses.

    A row for each of k grasps. With a pose error (`Scene.pose_error`) the jaws are closed at
    `tried` poses around each stated one, the same for all grasps; without one, at the stated pose.
    """

    stated: ClosedNumbers
    """Numbers at the stated poses."""
    tried: int
    """Number of poses tried for each grasp, including the stated one."""
    pad_margin: Floats | None
    """Distance of the contacts from the border of flat pads [m], the smaller one of both jaws,
    negative beside the pads, shape (k,); nan: a jaw touches nothing; None: no flat pads."""
    closing_share: Floats
    """Fraction of the poses tried at which the jaws close on the object, shape (k,)."""
    score: Floats
    """Mean score, shape (k,), reduced where contacts are near the border of flat pads.

    With P the probability that the contacts stay on the pads, it is P times the mean score plus (1
    - P) times -1. Errors of the position are normally distributed; the stated error is two standard
    deviations.

    The score of a pose is in [-1, 1). Where the patches hold the load at the worst normals it is r
    / (1 + r), with r the payload over the mass, at least 1. Where they do not, it is negative:
    (beta - alpha/2 - beta*) / pi, with beta* the friction angle with which the patches hold the
    load. This is the angle by which the normals must tilt less than the sensor's resolution allows,
    over pi. Where mass or force are not known, r is the weight held per newton of each finger, any
    value above 0, and beta* is the friction angle with which the patches close. The score is -1
    where the jaws do not close on the object."""
    label: Bytes
    """`Label` codes with everything that is stated, shape (k,): the worst of the poses tried.

    The label of a pose is that of its contacts once the jaws have closed. If mass and force are
    known, S also requires that evenly pressed patches hold the load at the worst normals; where
    they hold it at no normals the label is U. A pose is at most M if a finger starts in the object,
    or if the position error can shift the contacts off the pads. Other poses are tried only where
    the jaws close at the stated pose and its label is not U."""

    __repr__ = short_repr

    def take(self, rows: Any) -> "Robustness":
        """Return the chosen grasps."""
        return Robustness(**{name: rows_of(one, rows) for name, one in vars(self).items()})


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
    """Compute numbers of grasps with closed jaws, also at slightly wrong poses.

    Args:
        mesh: The object.
        poses: The stated poses, shape (k, 4, 4).
        jaws: Contacts and patches of the jaws at these poses.
        scene: The gripper, and the error of its pose.
        model: Friction, sensor resolution and errors.
        case: What must be held, and with which force; None: nothing is stated.
        object_motion: As in `Hand.close`.
    """
    offsets, position = scene.pose_error.offsets(), scene.pose_error.position
    several = len(offsets) > 1 and len(poses) > 0
    stated = ClosedNumbers.of(mesh, jaws, model, case)
    every = stated.reshaped(-1, 1)
    if several:
        close = partial(
            scene.hand.close, mesh, object_motion=object_motion,
            friction=model.nominal_friction,
            **({"give_way": position} if position else {}),
        )  # fmt: skip
        rows = np.flatnonzero(stated.closes & (stated.label > Label.U))
        others = _tried(mesh, poses[rows], offsets[1:], close, model, case)
        every = every.tried(rows, others)
    codes = every.label.min(axis=1)
    margin, stay = None, np.ones(len(poses))
    if (pads := scene.jaws) and not pads.round_tips:
        margin = _to_border(jaws, pads)
        if position:
            # The error is two standard deviations; a contact off the pad is lost.
            deviation = 0.5 * position
            stay = np.where(np.isnan(margin), 1.0, ndtr(margin / deviation))
            stays = margin >= position
            codes = np.where(stays, codes, np.minimum(codes, Label.M))
    return Robustness(
        stated=stated,
        tried=len(offsets),
        pad_margin=None if margin is None else locked(margin),
        closing_share=locked(every.closes.mean(axis=1)),
        score=locked((every.score.mean(axis=1) - LOST) * stay + LOST),
        label=locked(codes.astype(np.uint8)),
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
    for first in range(0, max(len(poses), 1), step):
        moved = np.matmul(poses[first : first + step, None], offsets)  # (r, t, 4, 4)
        with unreported():
            jaws = close(moved.reshape(-1, 4, 4))
            parts.append(ClosedNumbers.of(mesh, jaws, model, case).reshaped(-1, count))
    return ClosedNumbers._make(map(np.concatenate, zip(*parts, strict=True)))


def _to_border(closed: ClosedJaws, pads: Jaws) -> Floats:
    """Smaller distance of both contacts from the borders of their pads [m], (k,).

    The border encloses all inner faces of a finger together, seen along the closing axis.

    Args:
        closed: Contacts of the closed jaws, k rows.
        pads: The gripper.
    """
    corners = np.concatenate([np.array(face) for face in inner_faces(pads)])[:, 1:]
    sides = ConvexHull(corners).equations  # (s, 3): outward normals, and minus their distances
    arms = closed.points - closed.poses[:, None, :3, 3]  # (k, n, 3)
    beyond = arms @ closed.poses[:, :3, 1:3] @ sides[:, :2].T + sides[:, 2]
    return np.asarray(-beyond.max(axis=(1, 2)))
