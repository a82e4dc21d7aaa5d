"""Poses of a hand with joints, with the grasps that its links make there."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, NoReturn, Self

import numpy as np
import numpy.typing as npt

from grasp3d.arrays import Bools, Bytes, Floats, Ints, locked, short_repr
from grasp3d.errors import SettingError
from grasp3d.formats.poses import GAP, GraspPoses
from grasp3d.formats.postures import ORDER, matched
from grasp3d.grasps.evaluated_poses import GivenGrasps
from grasp3d.grasps.hand_load_result import HandLoadResult
from grasp3d.grasps.hand_reasons import HandReasons
from grasp3d.hand.articulated.actuation import torques_of
from grasp3d.hand.articulated.articulated_hand import BEYOND, ArticulatedHand
from grasp3d.hand.articulated.contacts import CONTACT_DISTANCE, HandContacts, hand_contacts
from grasp3d.hand.articulated.plausible_numbers import implausible
from grasp3d.hand.choices import ContactRule
from grasp3d.hand.scene import Scene
from grasp3d.mesh import ObjectMesh
from grasp3d.mesh.region import allowed_contacts
from grasp3d.mesh.turns import turns_beside
from grasp3d.quality.loads import load_settings
from grasp3d.quality.wrenches import EpsilonOptions
from grasp3d.settings import GraspModel
from grasp3d.settings.units import GivenLength
from grasp3d.stability.contact_sets import ContactSets, SetLabels, label_sets
from grasp3d.stability.thresholds import max_resolution
from grasp3d.surface.fields import HAND_GRASPS, Arrays, columns_of
from grasp3d.surface.grasp_numbers import EPSILON_RTOL
from grasp3d.surface.grasp_table import settings_of
from grasp3d.surface.load_case import LoadCase
from grasp3d.surface.scores import quality_of_contacts, written_scores
from grasp3d.system.context import refuse_warnings, report_progress, within
from grasp3d.system.counts import counted

TOUCHED = 0.5
"""Fraction of the work after which contacts are known."""

OF_CONTACTS = ("link", "points", "normals", "gap")
"""What `HandContacts` has of each contact besides its pose."""

FEW_BEYOND = 0.1
"""Fraction of poses beyond limits up to which an order of joints that is assumed is not doubted."""


@dataclass(frozen=True, eq=False, kw_only=True)
class EvaluatedHandGrasps(GivenGrasps):
    """Poses of a hand with joints, with the grasps that its links make there, a row for each.

    What a link touches is a contact, whose normal it knows within its resolution: its own, or that
    of the model. The letters are those of a posture that does not give way. Numbers are nan, and
    the label is U, where fewer than two links touch.
    """

    mesh: ObjectMesh
    """The object."""
    model: GraspModel
    """Friction and sensor resolution."""
    scene: Scene
    """The hand, and what it must not touch."""
    given: GraspPoses
    """The poses as they were given, with their outcomes [m]; the posture in the
    order of the hand's joints."""
    contacts: HandContacts
    """What the links touch, by which rule, with gaps and collisions."""
    contact_distance: float
    """Distance of a link from the surface up to which it touches [m]."""
    to_hold: LoadCase | None = None
    """What each grasp must hold; None: nothing is stated."""

    load = None
    load_result = None

    __repr__ = short_repr

    @property
    def hand(self) -> ArticulatedHand:
        """The hand."""
        assert isinstance(self.scene.hand, ArticulatedHand)
        return self.scene.hand

    @cached_property
    def outside(self) -> Bools:
        """Whether a pose has a contact outside the region of the mesh, shape (k,)."""
        wrong = ~allowed_contacts(self.mesh, self.contacts.points[:, None])
        return np.asarray(np.bincount(self.contacts.row[wrong], minlength=self.size) > 0)

    @cached_property
    def _counted(self) -> Bools:
        """Contacts of poses at which two links touch, all in the region, shape (c,)."""
        grasped = (self.touching.sum(axis=1) >= 2) & ~self.outside
        return np.asarray(grasped[self.contacts.row])

    @cached_property
    def sets(self) -> ContactSets:
        """The contacts relative to the centre of mass, of poses at which two links touch."""
        contacts, chosen = self.contacts, self._counted
        points, normals = contacts.points[chosen], contacts.normals[chosen]
        error = self.model.location_error
        return ContactSets(
            size=self.size,
            row=contacts.row[chosen],
            points=points - self.mesh.center_mass,
            normals=normals,
            location_error=error,
            turns=turns_beside(self.mesh, points, normals, error) if error > 0.0 else None,
        )

    @cached_property
    def touching(self) -> Bools:
        """Whether each link touches, shape (k, L)."""
        touching = np.zeros((self.size, len(self.hand.link_names)), dtype=np.bool_)
        touching[self.contacts.row, self.contacts.link] = True
        return touching

    @cached_property
    def _link(self) -> Ints:
        """Link of each contact of `sets`."""
        return self.contacts.link[self._counted]

    @cached_property
    def tilts_of_links(self) -> Floats:
        """Largest angle between true and perceived normals of each link [rad], shape (L,)."""
        stated, own = self.hand.sensors, self.model.sensor_resolution
        resolutions = [stated.get(name, own) for name in self.hand.link_names]
        return locked(np.array(resolutions, dtype=np.float64) / 2.0)

    @cached_property
    def _labels(self) -> SetLabels:
        low, high = (math.atan(friction) for friction in self.model.friction_interval)
        return label_sets(self.sets, self.tilts_of_links[self._link], (low, high))

    @cached_property
    def _link_loads(self) -> Floats | None:
        """Torques that hold the links per acceleration of gravity, in the mesh's frame."""
        posture = self.contacts.posture
        loads = self.hand.link_loads(posture, self.hand.link_poses(posture))
        return None if loads is None else loads @ self.contacts.poses[:, :3, :3].swapaxes(1, 2)

    @cached_property
    def hand_load_result(self) -> HandLoadResult | None:
        """What the motors hold at each pose; None: no load is stated."""
        if self.to_hold is None:
            return None
        low, high = self.model.friction_interval
        torques = torques_of(self.hand, self.to_hold.load.torque_limits)
        return HandLoadResult(
            load=self.to_hold, hand=self.hand, torques=torques,
            friction=(low, self.model.nominal_friction, high), sets=self.sets,
            jacobians=self.jacobians, tilts=self.sets.tilts(self.tilts_of_links[self._link]),
            postures=self.contacts.posture, link_loads=self._link_loads,
        )  # fmt: skip

    @cached_property
    def label(self) -> Bytes:
        """`Label` codes: 0 U, 1 M, 2 S; shape (k,).

        With a load whose mass is known S is what the motors surely hold.
        """
        load_result, codes = self.hand_load_result, self._labels.label
        return codes if load_result is None else load_result.label(codes)

    @property
    def letter(self) -> Bytes:
        """The same as `label`."""
        return self.label

    @cached_property
    def quality(self) -> Floats:
        """How far each grasp is from failing, shape (k,); see `quality_of_contacts`."""
        held, of = self.epsilon, self.hand_load_result
        if of is not None and of.load.decided:
            held = 1.0 + of.spare
        return locked(quality_of_contacts(np.nan_to_num(self.margin, nan=-math.inf), held))

    @cached_property
    def score(self) -> Floats:
        """As of other grasps; 0 where the hand cannot be there without a collision, shape (k,)."""
        return locked(np.where(self.reachable, written_scores(self.letter, self.quality), 0.0))

    @property
    def critical_angle(self) -> Floats:
        """Critical friction angles at the worst locations of the contacts [rad], shape (k,)."""
        return self.sets.critical_angles[0]

    @property
    def critical_angle_best(self) -> Floats:
        """The same at the best locations, shape (k,)."""
        return self.sets.critical_angles[1]

    @property
    def margin(self) -> Floats:
        """Angle by which the grasp is S [rad], shape (k,)."""
        return self._labels.margin

    def contacts_of(self, row: int) -> tuple[Floats, Floats]:
        """Points of a pose's contacts, and inward normals there, shape (n, 3) each."""
        mine = self.contacts.row == row
        return self.contacts.points[mine], self.contacts.normals[mine]

    def using(self, model: GraspModel) -> "EvaluatedHandGrasps":
        """The same contacts with another friction and sensor resolution."""
        return replace(self, model=model)

    @cached_property
    def max_resolution(self) -> Floats:
        """Resolution of all sensors alike below which a grasp is S [rad], shape (k,); 0: none."""
        return max_resolution(np.nan_to_num(self.critical_angle, nan=math.inf), self.model)

    @cached_property
    def epsilon(self) -> Floats:
        """Epsilon of all contacts at the perceived normals, certified from below, shape (k,)."""
        model, mesh = self.model, self.mesh
        options = EpsilonOptions(torque_scale=mesh.torque_scale, rtol=EPSILON_RTOL)
        assert isinstance(model.torsion_radius, float)
        return self.sets.epsilon(
            options, friction=model.nominal_friction, torsion_radius=model.torsion_radius
        )

    @property
    def rank(self) -> Ints:
        """Dimension of the span of the wrenches, shape (k,); 0: no grasp."""
        return self.sets.rank

    @cached_property
    def jacobians(self) -> Floats:
        """How the links move at the contacts of `sets` with the joints, in the mesh's frame [m].

        Shape (c, 3, p).
        """
        contacts, row = self.contacts, self.sets.row
        rotation, offset = contacts.poses[:, :3, :3], contacts.poses[:, :3, 3]
        points = self.sets.points + self.mesh.center_mass - offset[row]
        in_hand = (points[:, None] @ rotation[row])[:, 0]
        links = self.hand.link_poses(contacts.posture)
        return locked(rotation[row] @ self.hand.jacobians(links, row, self._link, in_hand))

    @cached_property
    def links(self) -> npt.NDArray[np.str_]:
        """Names of the links that touch, separated by spaces, shape (k,)."""
        names = np.array(self.hand.link_names)
        return np.array([" ".join(names[row]) for row in self.touching], dtype=np.str_)

    @cached_property
    def gap(self) -> Floats:
        """Largest gap between the surface and a link that touches [m], shape (k,).

        0: all of them are inside; nan: none touches.
        """
        gaps = np.where(self.touching, np.maximum(self.contacts.gaps, 0.0), -math.inf).max(axis=1)
        return locked(np.where(np.isinf(gaps), math.nan, gaps))

    @property
    def penetration(self) -> Floats:
        """How deep the deepest link is inside the object [m], shape (k,)."""
        return np.asarray(np.maximum(0.0, -self.contacts.gaps.min(axis=1, initial=math.inf)))

    @property
    def overlap(self) -> Floats:
        """Depth of the deepest collision of two links [m], shape (k,)."""
        return np.maximum(0.0, self.contacts.self_depth)

    @property
    def below_table(self) -> Floats:
        """How far the hand reaches below the table [m], shape (k,); nan: no table."""
        return np.maximum(0.0, self.contacts.table_depth)

    @cached_property
    def reasons(self) -> HandReasons:
        """What is wrong with each grasp."""
        reasons = HandReasons(self.hand, self.contacts, self.contact_distance)
        reasons.add_impossible(self.given.posture, self.scene)
        reasons.add_contacts(self.touching)
        reasons.add("touches outside --region", self.outside)
        if (of := self.hand_load_result) is not None:
            short = (self.label < self._labels.label) | (of.load_fraction > 1.0)
            texts = [of.shortfall(row) for row in np.flatnonzero(short).tolist()]
            reasons.add("the motors do not surely hold it", short, texts)
        return reasons

    @property
    def reachable(self) -> Bools:
        """Whether the hand can be there without a collision, shape (k,)."""
        return locked(~self.reasons.impossible)

    @property
    def verdict(self) -> str | None:
        """What the motors hold at the best pose, in one sentence; None: no load is stated."""
        load_result = self.hand_load_result
        return None if load_result is None else load_result.verdict(self.reachable)

    def _warnings(self) -> Iterable[str | None]:
        if order := self.given.settings.get(ORDER):
            beyond = int((self.hand.excess(self.given.posture) > BEYOND).any(axis=1).sum())
            many = f"joints are beyond their limits in {beyond} of {counted(self.size, 'poses')}"
            asked = f"; {many}: are these of another hand, or in another order?"
            asked = asked if beyond > FEW_BEYOND * self.size else ""
            yield f"the order of the joints is {order}{asked}"
        yield from implausible(self.hand)
        if self.hand_load_result is not None:
            yield from self.hand_load_result.doubts

    def metrics(self, names: str) -> NoReturn:
        """Refuse: measures are for grasps of equal numbers of contacts. Raises SettingError."""
        raise SettingError(f"{self.hand.name} is a hand with joints, and takes no metrics {names}")

    def take(self, rows: Ints) -> Self:
        """The chosen poses, in that order.

        Args:
            rows: Their indices, shape (c,).
        """
        own = self.contacts
        start = np.searchsorted(own.row, np.arange(self.size + 1))
        counts = np.diff(start)[rows]
        # The contacts of each chosen pose follow each other.
        index = np.repeat(start[rows] - np.cumsum(counts) + counts, counts) + np.arange(
            counts.sum()
        )
        of_contacts = {name: locked(getattr(own, name)[index]) for name in OF_CONTACTS}
        of_poses = {
            field.name: locked(getattr(own, field.name)[rows])
            for field in fields(own)
            if field.name not in {"rule", "row", *OF_CONTACTS}
        }
        row = locked(np.repeat(np.arange(len(rows)), counts))
        changed: dict[str, Any] = {"row": row, **of_contacts, **of_poses}
        contacts = replace(own, **changed)
        return replace(self, given=self.given.take(rows), contacts=contacts)

    def to_poses(self, metrics: Mapping[str, Floats] | None = None) -> GraspPoses:
        """As in `GivenGrasps`: poses and values of joints are those where the contacts are.

        Closed ones are not those that were given.
        """
        poses = super().to_poses(metrics)
        return replace(poses, poses=self.contacts.poses, posture=self.contacts.posture)

    def _columns(self) -> Arrays:
        """Results of shape (k,)."""
        gaps = np.where(np.isfinite(self.contacts.gaps), self.contacts.gaps, math.nan)
        near = {
            f"{GAP}{name}": column
            for name, column in zip(self.hand.link_names, gaps.T, strict=True)
            if not np.isnan(column).all()
        }
        return {**columns_of(HAND_GRASPS, self), **near}

    def _settings(self) -> dict[str, Any]:
        """Settings of the evaluation; angles in radians."""
        tilts = self.tilts_of_links
        felt = {
            name: 2.0 * tilt
            for name, tilt in zip(self.hand.link_names, tilts.tolist(), strict=True)
        }
        return settings_of(self.mesh, self.model, self.scene) | {
            "hand": self.hand.name,
            "contact_rule": self.contacts.rule,
            "contact_distance": self.contact_distance,
            **load_settings(None if self.to_hold is None else self.to_hold.load),
            "verdict": self.verdict,
            "link_weights": None
            if self.hand_load_result is None
            else self.hand_load_result.link_weights,
            "sensor_resolutions": felt,
        }


def evaluate_hand(
    mesh: ObjectMesh,
    poses: GraspPoses,
    model: GraspModel | None,
    scene: Scene,
    *,
    contact_rule: ContactRule = "given",
    contact_distance: GivenLength = f"{CONTACT_DISTANCE} m",
    load: LoadCase | None = None,
) -> EvaluatedHandGrasps:
    """Evaluate poses of a hand with joints, as `evaluate_grasps` does.

    Args:
        mesh: The object.
        poses: The poses, in metres, with values of the joints.
        model: Friction and sensor resolution [rad]; None: the defaults.
        scene: The hand and the table.
        contact_rule: given or closed.
        contact_distance: Distance of a link from the surface up to which it touches.
        load: What each grasp must hold; None: nothing.

    Raises:
        SettingError: A setting that does not apply to hands with joints.
        ContactError: The poses have values of other joints, or none.
    """
    hand = scene.hand
    assert isinstance(hand, ArticulatedHand)
    _refuse(hand, scene, model or GraspModel(), load)
    own_model = model or GraspModel()
    mesh.check_units(own_model)
    distance = mesh.length("contact_distance", contact_distance)
    poses = replace(matched(poses, hand), joint_names=hand.joint_names)
    with within(0.0, TOUCHED):
        contacts = hand_contacts(
            mesh, hand, poses.poses, poses.posture, rule=contact_rule,
            contact_distance=distance, table=scene.table,
        )  # fmt: skip
    result = EvaluatedHandGrasps(
        mesh=mesh, model=own_model, scene=scene, given=poses, contacts=contacts,
        contact_distance=distance, to_hold=load,
    )  # fmt: skip
    refuse_warnings(result.warnings)
    with within(TOUCHED, 1.0):
        _ = result.label
        if result.hand_load_result is not None:
            result.hand_load_result.compute()
        report_progress(1.0)
    return result


def _refuse(hand: ArticulatedHand, scene: Scene, model: GraspModel, load: LoadCase | None) -> None:
    """Refuse settings that do not apply, and loads without torques. Raises SettingError."""
    if load is not None:
        torques_of(hand, load.load.torque_limits)
    refused = {
        "fingers: a hand touches with as many links as it happens to": model.fingers != 2,
        "method extremes: its labels are exact": model.method != "exact",
        "pose_error: that is for parallel grippers": bool(scene.pose_error),
        "torsion_radius with a load: what motors hold is that of points": load is not None
        and model.torsion_radius != 0.0,
        "grip_force: it follows from torque_limits": load is not None
        and load.available is not None,
    }
    for text, applies in refused.items():
        if applies:
            raise SettingError(f"{hand.name} is a hand with joints, and takes no {text}")
