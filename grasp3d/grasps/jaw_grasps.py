"""Poses of a gripper with the grasps that its jaws make there."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import cycle
from typing import Any, Self

import numpy as np

from grasp3d.arrays import Bools, Bytes, Floats, Ints, locked, short_repr
from grasp3d.errors import ContactError
from grasp3d.formats.poses import GraspPoses
from grasp3d.formats.postures import refuse_joints
from grasp3d.grasps.audit import FEWEST
from grasp3d.grasps.evaluated_poses import EvaluatedPoses
from grasp3d.grasps.reasons import GripperReasons
from grasp3d.grasps.robustness import Robustness, robustness_of
from grasp3d.hand.choices import ObjectMotion
from grasp3d.hand.closing import ClosedJaws, Closing, ways
from grasp3d.hand.gripper_pose import GripperPose
from grasp3d.hand.hand import touching
from grasp3d.hand.scene import Scene
from grasp3d.mesh import ObjectMesh
from grasp3d.mesh.region import allowed_contacts
from grasp3d.quality.loads import Load
from grasp3d.settings import GraspModel, with_fingers
from grasp3d.settings.pose_error import poses_of
from grasp3d.stability.label import COLORS, Label
from grasp3d.surface.contacts import JawContacts, critical_angles
from grasp3d.surface.fields import OPENING, REASON, Arrays, Field, given_poses
from grasp3d.surface.grasp_table import GraspRows
from grasp3d.surface.labelled_grasps import written_scores
from grasp3d.surface.load_case import LoadCase
from grasp3d.system.context import unreported, within

JAWS_CLOSED = 0.7
"""Fraction of the work after which the jaws are closed."""

ROUNDING = 1e-9
"""Relative or angular [rad] excess over a limit that rounding explains."""

EXECUTABLE = math.radians(5.0)
"""Angle by which the approach of a grasp must be free to turn either way for a robot to execute it
[rad]; a stated pose error may ask for more."""

TURNS = 4
"""Number of equal steps in which turned approaches are tested."""

NOWHERE = np.zeros((1, 3))
"""A shift of zero."""


@dataclass(frozen=True, eq=False, kw_only=True)
class JawGrasps(GraspRows, EvaluatedPoses):
    """Poses of a gripper with the grasps that its jaws make there, a row for each.

    Contacts are where the jaws touch, at the mean normals of the patches. Where the jaws do not
    close on the object, numbers are nan and the label is U.
    """

    given: GraspPoses
    scene: Scene
    jaws: ClosedJaws
    """Where the jaws touch, and the state of closing where they do not."""
    object_motion: ObjectMotion = "fixed"
    """Whether the object was free to give way to the jaws."""
    collides: Bools
    """Whether the gripper collides with object or table on the way to the pose, shape (k,). It is
    tested as it holds a fixed object and with the clearance before closing; where it holds nothing,
    or the object is free, it is tested wide open."""
    reachable: Bools
    """Whether the jaws close on the object within the stroke with its clearance, without a
    collision and from an allowed direction, shape (k,)."""

    load_result = None
    __repr__ = short_repr

    @classmethod
    def of(
        cls,
        mesh: ObjectMesh,
        start: GraspPoses,
        model: GraspModel | None,
        scene: Scene,
        *,
        object_motion: ObjectMotion = "free",
        load: Load | None = None,
    ) -> Self:
        """Close the jaws of a gripper on an object from given poses; see `evaluate_grasps`.

        Args:
            mesh: The object, of a known unit.
            start: The poses, in metres.
            model: Friction and sensor resolution; None: the defaults, with the resolution that the
                gripper states, if any.
            scene: The gripper, the table and the allowed approach.
            object_motion: As in `evaluate_grasps`.
            load: What each grasp must hold; None: nothing.

        Raises:
            SettingError: A setting is outside its range, or the load needs a mass that is not
                known.
            ContactError: The poses have values of joints, or one is an internal grasp.
        """
        hand = scene.hand
        refuse_joints(start, hand)
        internal = np.flatnonzero(start.pregrasp_opening < start.opening * (1.0 - ROUNDING))
        if len(internal):
            raise ContactError(
                f"{start.names[internal[0]]} is an internal grasp, as are {len(internal)} of "
                f"{start.count}: its fingers push outward; only external grasps are evaluated"
            )
        own_model = touching(hand, GraspModel()) if model is None else model
        own_model = with_fingers(own_model, hand.fingers[-1])
        mesh.check_units(own_model)
        if load is not None:
            LoadCase.of(load, mesh, own_model, hand)  # refuse an unusable load before the work
        return cls.closed_at(mesh, start, own_model, scene, object_motion=object_motion, load=load)

    @classmethod
    def closed_at(
        cls,
        mesh: ObjectMesh,
        start: GraspPoses,
        model: GraspModel,
        scene: Scene,
        *,
        object_motion: ObjectMotion = "free",
        load: Load | None = None,
    ) -> Self:
        """Close the jaws of a gripper at poses that are known to be valid; see `evaluate_grasps`.

        Args:
            mesh: The object, of a known unit.
            start: The poses, in metres.
            model: Friction and sensor resolution, for as many fingers as close.
            scene: The gripper, the table and the allowed approach.
            object_motion: As in `evaluate_grasps`.
            load: What each grasp must hold; None: nothing.
        """
        hand, most = scene.hand, scene.pose_error.position
        with within(0.0, JAWS_CLOSED):
            jaws = hand.close(
                mesh,
                start.poses,
                object_motion=object_motion,
                friction=model.nominal_friction,
                **({"give_way": most} if most else {}),
            )
        held = jaws.closed if object_motion == "fixed" else np.zeros(start.count, dtype=np.bool_)
        colliding, shift = _blocked(mesh, start, jaws, held, scene, most)
        jaws = replace(jaws, shift=locked(shift))
        contacts = JawContacts.of(mesh, jaws.take(jaws.closed))
        angles = np.full((2, start.count), math.nan)
        if contacts.size:
            found = critical_angles(contacts, location_error=model.location_error)
            allowed = allowed_contacts(mesh, contacts.points)
            angles[:, jaws.closed] = np.where(allowed, found, math.inf)
        return cls(
            contacts=JawContacts.of(mesh, jaws),
            model=model,
            critical_angle=locked(angles[0]),
            critical_angle_best=locked(angles[1]),
            scene=scene,
            load=load,
            given=start,
            jaws=jaws,
            object_motion=object_motion,
            collides=locked(colliding),
            reachable=locked(
                jaws.closed & ~colliding & hand.opens_to(jaws) & scene.allows(start.poses)
            ),
        )

    @property
    def first(self) -> Ints:
        """Indices of the rows where the jaws close on the object, else -1, shape (k,)."""
        return np.where(self.jaws.closed, np.arange(self.size), -1)

    @property
    def state(self) -> Bytes:
        """`Closing` codes, shape (k,)."""
        return self.jaws.state

    @property
    def opening(self) -> Floats:
        """Distance of the pads, or of the nearest points of round tips [m], shape (k,)."""
        return self.jaws.opening

    @cached_property
    def robustness(self) -> Robustness:
        """Scores of the touched patches, also at slightly wrong poses; rows (k,).

        Computed when first read.
        """
        return robustness_of(
            self.mesh, self.poses, self.jaws, self.scene, self.model, self.load_case,
            object_motion=self.object_motion,
        )  # fmt: skip

    @cached_property
    def label(self) -> Bytes:
        """`Label` codes with everything that is stated: `Robustness.label`; shape (k,).

        U where the pose is not `reachable`.
        """
        return locked(np.where(self.reachable, self.robustness.label, np.uint8(Label.U)))

    @cached_property
    def reasons(self) -> GripperReasons:
        """Why poses are not S; computed when first read."""
        return GripperReasons(self)

    @cached_property
    def approach_margin(self) -> Floats:
        """Angle by which the approach may turn about the closing axis, either way, collision-free.

        It is tested in `TURNS` steps up to 5 degrees, or up to the angle of the pose error if that
        is larger [rad], shape (k,); nan where the pose is not reachable. A turned gripper may draw
        back by half the height of its pads, which still touch.
        """
        margin = np.where(self.reachable, 0.0, math.nan)
        free = np.flatnonzero(self.reachable)
        for angle in self._most_turn * np.arange(1, TURNS + 1) / TURNS:
            for turn in (angle, -angle):
                turned = self.poses[free] @ poses_of(NOWHERE, np.array([[turn, 0.0, 0.0]]))[1]
                blocked = self._blocked(turned, free)
                back = 0.5 * getattr(self.hand, "pad_height", 0.0)
                turned[:, :3, 3] -= back * turned[:, :3, 2]
                blocked[blocked] = self._blocked(turned[blocked], free[blocked])
                free = free[~blocked]
            margin[free] = angle
        return locked(margin)

    def _blocked(self, poses: Floats, rows: Ints) -> Bools:
        """Whether the open gripper collides at other poses (r, 4, 4) of some rows, shape (r,)."""
        scene, held = self.scene, np.zeros(len(rows), dtype=np.bool_)
        jaws = self.jaws.take(rows)
        return np.array(scene.hand.blocked(self.mesh, poses, jaws, held=held, table=scene.table))

    @property
    def _most_turn(self) -> float:
        return max(EXECUTABLE, self.scene.pose_error.angle)

    @property
    def quality(self) -> Floats:
        """Distance of each grasp from failure, s: `Robustness.score`; shape (k,)."""
        return self.robustness.score

    @cached_property
    def score(self) -> Floats:
        """Score of each pose, from 0 to 1: its label and, within the label, its quality s.

        1 + s is reduced in proportion where `approach_margin` is smaller than the largest angle
        tested, as a grasp without tolerance cannot be executed. See `written_scores`.
        """
        turn = np.nan_to_num(self.approach_margin) / self._most_turn
        return written_scores(self.letter, (1.0 + self.quality) * turn - 1.0)

    @property
    def grip_force(self) -> Floats:
        """Force that each finger needs at the worst normals [N], shape (k,)."""
        return self.robustness.stated.grip_force

    @property
    def payload(self) -> Floats:
        """Mass that the available force holds at the worst normals [kg], shape (k,)."""
        return self.robustness.stated.payload

    def to_poses(self, metrics: Mapping[str, Floats] | None = None) -> GraspPoses:
        """Return the poses with the results as columns; see `EvaluatedPoses.to_poses`."""
        poses = super().to_poses(metrics)
        touched = {"contacts": self.jaws.points, "normals": self.jaws.normals}
        # Where the object yields to the pads, the first touch may be beyond the stroke.
        opening = np.minimum(self.opening, self.hand.max_opening)
        return replace(poses, opening=opening, columns={**poses.columns, **touched})

    def compute(self) -> None:
        """Compute the labels of closed jaws, which take long with method extremes."""
        with within(JAWS_CLOSED, 1.0):
            self.compute_labels()

    def _warnings(self) -> Iterable[str | None]:
        return [None if self.reading else self._starting_inside()]

    def _starting_inside(self) -> str | None:
        """Warn if a finger starts in the object in most poses."""
        inside = int((self.state == Closing.STARTS_INSIDE).sum())
        if self.size < FEWEST or 2 * inside <= self.size:
            return None
        return (
            f"a finger starts in the object in {inside} of {self.size} poses, even wide open: is "
            "the origin of the poses the point between the fingertips, is the unit of mesh and "
            "poses right, and is the object narrower than the stroke there?"
        )

    def _table_columns(self) -> Arrays:
        columns, jaws = super()._table_columns(), self.jaws
        for (jaw, k), axis in zip(np.ndindex(jaws.points.shape[1:]), cycle("xyz"), strict=False):
            columns[f"{axis}{jaw + 1}"] = jaws.points[:, jaw, k]
            columns[f"n{axis}{jaw + 1}"] = 0.0 - jaws.normals[:, jaw, k]
        return columns

    @property
    def fields(self) -> tuple[Field, ...]:
        """Columns of each pose in tables and files."""
        others = given_poses(self.jaws.area.shape[1])
        return (*(one for one in others if one is not REASON), OPENING, REASON)

    def contacts_of(self, row: int) -> tuple[Floats, Floats]:
        """Points and inward normals where the jaws touch, (2, 3) each; (0, 3) if they do not."""
        touching = np.flatnonzero(self.jaws.closed[[row, row]])
        return self.jaws.points[row, touching], self.jaws.normals[row, touching]

    def held_at(self, row: int) -> GripperPose:
        """The gripper at a pose, closed where its jaws touch; see `EvaluatedPoses.held_at`."""
        jaws, closed = self.jaws, self.jaws.closed[row]
        return GripperPose(
            jaws.poses[row] if closed else self.poses[row],
            float(jaws.opening[row]) if closed else self.hand.max_opening,
            float(self.given.pregrasp_opening[row]),
            float(self.approach_margin[row]),
            math.nan,
            colors={0: COLORS[Label(int(self.label[row]))]},
        )

    def using(self, **changed: Any) -> Self:
        """Return the same poses with another model or load; the jaws close again if needed."""
        model, load = changed.get("model", self.model), changed.get("load", self.load)
        model = replace(model, fingers=self.model.fingers)
        if model == self.model:
            return self if load == self.load else replace(self, load=load)
        with unreported():
            return self.closed_at(
                self.mesh, self.given, model, self.scene, object_motion=self.object_motion,
                load=load,
            )  # fmt: skip

    def _settings(self) -> dict[str, Any]:
        """Settings of the evaluation; angles in radians."""
        own = {"gripper": self.hand.name, "object_motion": self.object_motion}
        return self.settings() | own


def _blocked(
    mesh: ObjectMesh, start: GraspPoses, jaws: ClosedJaws, held: Bools, scene: Scene, most: float
) -> tuple[Bools, Floats]:
    """Whether the gripper collides at each pose, and how far it gave way before that [m], (k,).

    It gives way along the closing axis, by no more than the stated pose error.
    """
    shift = np.array(jaws.shift)

    def blocked(rows: Ints, shifts: Floats) -> Bools:
        poses = np.array(start.poses[rows])
        poses[:, :3, 3] += shifts[:, None] * poses[:, :3, 0]
        return scene.hand.blocked(mesh, poses, jaws.take(rows), held=held[rows], table=scene.table)

    colliding = np.array(blocked(np.arange(start.count), shift))
    for move in ways(most) if most else ():
        within_error = np.abs(jaws.shift + move) <= most * (1.0 + ROUNDING)
        rows = np.flatnonzero(colliding & jaws.closed & within_error)
        if len(rows):
            free = rows[~blocked(rows, jaws.shift[rows] + move)]
            colliding[free], shift[free] = False, jaws.shift[free] + move
    return colliding, shift
