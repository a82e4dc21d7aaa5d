"""Poses of a hand with joints: the grasps that its links make, and what its motors hold."""

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NoReturn, Self

import numpy as np
import numpy.typing as npt

from grasp3d.arrays import RIGHT_ANGLE, Bools, Bytes, Floats, Ints, locked, short_repr
from grasp3d.contact.contacts import Contacts
from grasp3d.errors import SettingError
from grasp3d.formats.poses import GAP, GraspPoses
from grasp3d.formats.postures import ORDER, matched
from grasp3d.grasps.evaluated_poses import EvaluatedPoses
from grasp3d.grasps.reasons import HandReasons
from grasp3d.hand.articulated_hand import BEYOND, ArticulatedHand, actuation_of, torques_of
from grasp3d.hand.choices import ContactRule
from grasp3d.hand.closing import Closing
from grasp3d.hand.gripper_pose import GripperPose
from grasp3d.hand.link_contacts import CONTACT_DISTANCE, HandContacts, hand_contacts
from grasp3d.hand.proposal import implausible, too_strong
from grasp3d.hand.scene import Scene
from grasp3d.mesh import ObjectMesh
from grasp3d.mesh.region import allowed_contacts
from grasp3d.mesh.turns import turns_beside
from grasp3d.quality.hand_forces import (
    OF_LINE,
    OF_LINKS,
    HandGrasp,
    HandPayload,
    hand_payload,
    links_weigh,
)
from grasp3d.quality.loads import Load, load_settings
from grasp3d.quality.wrenches import EpsilonOptions
from grasp3d.settings import GraspModel
from grasp3d.settings.units import GivenLength, small_length
from grasp3d.stability.classification import ContactSets, SetLabels, label_sets
from grasp3d.stability.label import COLORS, Label, max_resolution
from grasp3d.surface.fields import HAND_GRASPS, Arrays, Field
from grasp3d.surface.grasp_numbers import EPSILON_RTOL
from grasp3d.surface.grasp_table import settings_of
from grasp3d.surface.labelled_grasps import quality_of_contacts
from grasp3d.surface.load_case import LoadCase
from grasp3d.system.context import report_progress, within
from grasp3d.system.names import counted, short_number

FORCE_RTOL = 1e-2
"""Relative width of the brackets of payloads."""

WHY = {
    OF_LINKS: "the weight of the links alone is too much for the motors",
    OF_LINE: "point contacts on one line resist no torque about it",
}
"""Limits at which nothing is held, as sentences."""

UNKNOWN = HandPayload(math.nan, math.nan, "")
"""Payload of a pose that is no grasp."""

FLAT = 1e-3
"""Angle by which cones must be narrower than a half-space [rad]."""


@dataclass(frozen=True, eq=False, kw_only=True)
class MotorLoads:
    """Loads that the motors of a hand hold at k poses: masses [kg] or factors of wrenches."""

    case: LoadCase
    hand: ArticulatedHand
    torques: Floats
    """As `torques_of` returns them, shape (p,)."""
    friction: tuple[float, float]
    """Smallest coefficient, which counts for sure results, and largest one."""
    sets: ContactSets
    jacobians: Floats
    """Jacobians of the contacts, in the mesh's frame [m], shape (c, 3, p)."""
    tilts: Floats
    """Largest angle between true and perceived normals [rad], shape (c,)."""
    postures: Floats
    """Joint values, shape (k, p)."""
    link_loads: Floats | None = None
    """Joint torques that hold the links, per acceleration of gravity in the mesh's frame [kg m],
    shape (k, p, 3); None: no link has a known mass."""

    __repr__ = short_repr

    def held(self, chosen: Bools, angles: Floats, tilts: Floats | None = None) -> list[HandPayload]:
        """Payload at each pose, `UNKNOWN` at those that are not chosen.

        Args:
            chosen: Whether each pose is chosen, shape (k,).
            angles: Half-angles of the friction cones of the contacts [rad], shape (c,).
            tilts: Largest angles between true and given normals [rad], shape (c,); None: 0.
        """
        sets, found = self.sets, [UNKNOWN] * self.sets.size
        for row in np.flatnonzero(chosen).tolist():
            own = slice(*np.searchsorted(sets.row, [row, row + 1]))
            contacts = Contacts(sets.points[own], sets.normals[own], np.tan(angles[own]))
            links = None if self.link_loads is None else self.link_loads[row]
            actuation = actuation_of(self.hand, self.postures[row], self.torques, links)
            grasp = HandGrasp(contacts, self.jacobians[own], actuation)
            tilt = 0.0 if tilts is None else tilts[own]
            found[row] = hand_payload(grasp, self.case.task, tilt=tilt, rtol=FORCE_RTOL)
            report_progress((row + 1) / sets.size)
        return found

    def _angles(self, friction: float) -> Floats:
        """Half-angles of the friction cones [rad], shape (c,)."""
        return np.full(len(self.tilts), math.atan(friction))

    @cached_property
    def _sure(self) -> list[HandPayload]:
        return self.held(self.sets.evaluated, self._angles(self.friction[0]), self.tilts)

    @cached_property
    def payload(self) -> Floats:
        """Largest masses surely held, at the worst normals, shape (k,); nan: no grasp."""
        return locked([one.lower for one in self._sure])

    @cached_property
    def limit(self) -> npt.NDArray[np.str_]:
        """What limits each payload, such as a joint, shape (k,)."""
        return np.array([one.limit for one in self._sure], dtype=np.str_)

    @cached_property
    def payload_most(self) -> Floats:
        """Masses above which the hand cannot hold, whichever normals are true, (k,).

        Upper bounds: cones of half-angle beta + a contain those of all possible normals, so perhaps
        no one choice of normals holds as much. nan where unknown, or where the mass is surely held.
        """
        angles = self._angles(self.friction[1]) + self.tilts
        chosen = self.payload < self._mass
        chosen[self.sets.row[angles >= RIGHT_ANGLE - FLAT]] = False
        return locked([one.upper for one in self.held(chosen, angles)])

    @property
    def doubts(self) -> Iterator[str]:
        """Doubtful torques of the load, one sentence each."""
        hand, stated = self.hand, self.case.load.torque_limits or 0.0
        driven = np.array(hand.joint_names)[~np.isnan(self.torques)].tolist()
        yield from too_strong(hand, "torque_limits", dict.fromkeys(driven, stated))

    @property
    def link_weights(self) -> str:
        """Whether the weight of the hand's links counts, in one sentence."""
        hand = self.hand
        moving = [name for name in hand.beyond_base if hand.shapes[hand.link_names.index(name)]]
        known = [name for name in hand.beyond_base if name in hand.masses]
        if self.link_loads is None:
            return "the weight of the links is neglected: no masses of links are stated"
        if not links_weigh(self.case.task):
            return "the weight of the links is neglected: the task does not say where gravity acts"
        total = short_number(sum(hand.masses[name].mass for name in known))
        missing = sorted({*moving} - {*known})
        but = f", but not of {', '.join(missing[:5])}, which state no mass" if missing else ""
        return f"the weight of the links that move, {total} kg, counts{but}"

    @property
    def _mass(self) -> float:
        """What must be held; nan if it is not known."""
        mass = self.case.mass if self.case.by_mass else 1.0
        return math.nan if mass is None else mass

    @cached_property
    def load_fraction(self) -> Floats:
        """Mass over the mass surely held, shape (k,); above 1: not held; nan: no mass known."""
        with np.errstate(divide="ignore"):
            return locked(self._mass / self.payload)

    def label(self, codes: Bytes) -> Bytes:
        """Labels that take the load into account, shape (k,), if its mass is known.

        A grasp is S if the motors hold the mass at the worst normals, too, and U if they hold it at
        no normals that may be true.

        Args:
            codes: Labels without a load, shape (k,).
        """
        if math.isnan(self._mass):
            return codes
        most = np.where(self.payload >= self._mass, Label.S, Label.M)
        most[self.payload_most < self._mass] = Label.U
        return locked(np.minimum(codes, most), np.uint8)

    @property
    def unit(self) -> str:
        """Unit of the masses after a space; for wrenches alone, what their factors are."""
        return " kg" if self.case.by_mass else " times the wrenches"

    def shortfall(self, row: int) -> str:
        """Say in one sentence why the mass is not surely held at a pose."""
        most, sure = self.payload_most[row], self.payload[row]
        why = f": {WHY[cause]}" if (cause := str(self.limit[row])) in WHY else ""
        if most < self._mass:
            return f"holds {short_number(most)}{self.unit} at most{why}"
        return f"surely holds {short_number(sure)}{self.unit} only{why}"


TOUCHED = 0.5
"""Fraction of the work after which the contacts are known."""

FEW_BEYOND = 0.1
"""Fraction of poses beyond limits up to which an assumed order of joints is not doubted."""


@dataclass(frozen=True, eq=False, kw_only=True)
class LinkGrasps(EvaluatedPoses):
    """Poses of a hand with joints, with the grasps that its links make there, a row for each.

    Each link that touches makes one contact, whose normal it knows within its own sensor
    resolution, or else that of the model. The labels assume that the posture does not give way.
    Where fewer than two links touch, numbers are nan and the label is U.
    """

    mesh: ObjectMesh
    """The object."""
    model: GraspModel
    """Friction and sensor resolution."""
    scene: Scene
    """The hand, and the table that it must not touch."""
    given: GraspPoses
    """The poses as they were given, with their outcomes [m]; the joint values are in the order of
    the hand's joints."""
    contacts: HandContacts
    """Contacts of the links, the rule that makes them, gaps and collisions."""
    contact_distance: float
    """Distance from the surface up to which a link touches [m]."""
    load: Load | None = None
    """What each grasp must hold; None: nothing is stated."""

    __repr__ = short_repr

    @classmethod
    def of(
        cls,
        mesh: ObjectMesh,
        start: GraspPoses,
        model: GraspModel | None,
        scene: Scene,
        *,
        contact_rule: ContactRule = "given",
        contact_distance: GivenLength = CONTACT_DISTANCE,
        load: Load | None = None,
    ) -> Self:
        """Find the contacts of the links at given poses; see `evaluate_grasps`.

        Args:
            mesh: The object, of a known unit.
            start: The poses, in metres, with values of the joints.
            model: Friction and sensor resolution; None: the defaults.
            scene: The hand and the table.
            contact_rule: given or closed.
            contact_distance: Distance from the surface up to which a link touches.
            load: What each grasp must hold; None: nothing.

        Raises:
            SettingError: A setting does not apply to hands with joints, or the mass or the torques
                of the load are not known.
            ContactError: The poses have values of other joints, or none.
        """
        hand, own_model = scene.hand, model or GraspModel()
        assert isinstance(hand, ArticulatedHand)
        _refuse(hand, scene, own_model, load)
        mesh.check_units(own_model)
        if load is not None:
            torques_of(hand, load.torque_limits)  # refuse an unusable load before the work
            LoadCase.of(load, mesh, own_model, hand)
        distance = mesh.length("contact_distance", contact_distance)
        poses = replace(matched(start, hand), joint_names=hand.joint_names)
        with within(0.0, TOUCHED):
            contacts = hand_contacts(
                mesh, hand, poses.poses, poses.posture, rule=contact_rule,
                contact_distance=distance, table=scene.table,
            )  # fmt: skip
        return cls(
            mesh=mesh, model=own_model, scene=scene, given=poses, contacts=contacts,
            contact_distance=distance, load=load,
        )  # fmt: skip

    def compute(self) -> None:
        """Compute labels and payloads of the motors, which take long."""
        with within(TOUCHED, 1.0):
            _ = self.label

    @property
    def hand(self) -> ArticulatedHand:
        """The hand."""
        assert isinstance(self.scene.hand, ArticulatedHand)
        return self.scene.hand

    @cached_property
    def load_case(self) -> LoadCase | None:
        """The load on this object; None: no load is stated."""
        load = self.load
        return None if load is None else LoadCase.of(load, self.mesh, self.model, self.hand)

    @property
    def touching(self) -> Bools:
        """Whether each link touches, shape (k, L)."""
        return self.contacts.touching

    @property
    def state(self) -> Bytes:
        """`Closing` codes, shape (k,); closed means that at least two links touch."""
        codes = np.array([Closing.NOTHING, Closing.ONE_SIDE, Closing.CLOSED], dtype=np.uint8)
        return np.asarray(codes[np.minimum(self.touching.sum(axis=1), 2)])

    @cached_property
    def outside(self) -> Bools:
        """Whether a pose has a contact outside the region of the mesh, shape (k,)."""
        touching, outside = self.touching, np.zeros(self.touching.shape, dtype=np.bool_)
        outside[touching] = ~allowed_contacts(self.mesh, self.contacts.points[touching][:, None])
        return np.asarray(outside.any(axis=1))

    @cached_property
    def _counted(self) -> tuple[Ints, Ints]:
        """Poses and links of the contacts, where two or more touch, all in the region, (c,)."""
        grasped = (self.touching.sum(axis=1) >= 2) & ~self.outside
        row, link = np.nonzero(self.touching & grasped[:, None])
        return row, link

    @cached_property
    def sets(self) -> ContactSets:
        """Contacts relative to the centre of mass, of poses at which at least two links touch."""
        points, normals = self.contacts.points[self._counted], self.contacts.normals[self._counted]
        error = self.model.location_error
        return ContactSets(
            size=self.size,
            row=self._counted[0],
            points=points - self.mesh.center_mass,
            normals=normals,
            location_error=error,
            turns=turns_beside(self.mesh, points, normals, error) if error > 0.0 else None,
        )

    @cached_property
    def tilts_of_links(self) -> Floats:
        """Largest angle between true and perceived normals of each link [rad], shape (L,)."""
        stated, own = self.hand.sensors, self.model.sensor_resolution
        resolutions = [stated.get(name, own) for name in self.hand.link_names]
        return locked(np.array(resolutions, dtype=np.float64) / 2.0)

    @cached_property
    def _labels(self) -> SetLabels:
        low, high = (math.atan(friction) for friction in self.model.friction_interval)
        return label_sets(self.sets, self.tilts_of_links[self._counted[1]], (low, high))

    @cached_property
    def motors(self) -> MotorLoads | None:
        """Loads that the motors hold at each pose; None: no load is stated."""
        if self.load is None or self.load_case is None:
            return None
        hand, posture = self.hand, self.contacts.posture
        weights = hand.link_loads(posture, hand.link_poses(posture))
        turned = self.contacts.poses[:, :3, :3].swapaxes(1, 2)
        return MotorLoads(
            case=self.load_case, hand=hand, torques=torques_of(hand, self.load.torque_limits),
            friction=self.model.friction_interval, sets=self.sets, jacobians=self.jacobians,
            tilts=self.sets.tilts(self.tilts_of_links[self._counted[1]]), postures=posture,
            link_loads=None if weights is None else weights @ turned,
        )  # fmt: skip

    @cached_property
    def label(self) -> Bytes:
        """`Label` codes with everything that is stated: 0 U, 1 M, 2 S; shape (k,).

        With a load whose mass is known, S also means that the motors surely hold it. A pose that
        the hand cannot reach without a collision is U.
        """
        codes, motors = self._labels.label, self.motors
        held = codes if motors is None else motors.label(codes)
        return locked(np.where(self.reachable, held, np.uint8(Label.U)))

    @cached_property
    def quality(self) -> Floats:
        """Distance of each grasp from failure, shape (k,); see `quality_of_contacts`.

        -1 where the hand cannot be without a collision.
        """
        held, motors = self.epsilon, self.motors
        if motors is not None and motors.case.decided:
            held = 1.0 / motors.load_fraction
        quality = quality_of_contacts(np.nan_to_num(self.margin, nan=-math.inf), held)
        return locked(np.where(self.reachable, quality, -1.0))

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

    @cached_property
    def max_resolution(self) -> Floats:
        """Resolution, the same for all sensors, below which a grasp is S [rad], (k,); 0: none."""
        return max_resolution(np.nan_to_num(self.critical_angle, nan=math.inf), self.model)

    @cached_property
    def epsilon(self) -> Floats:
        """Epsilon of all contacts at the perceived normals, certified from below, shape (k,)."""
        options = EpsilonOptions(torque_scale=self.mesh.torque_scale, rtol=EPSILON_RTOL)
        torsion, friction = self.model.torsion_radius, self.model.nominal_friction
        assert isinstance(torsion, float)
        return self.sets.epsilon(options, friction=friction, torsion_radius=torsion)

    @property
    def rank(self) -> Ints:
        """Dimension of the span of the wrenches, shape (k,); 0: no grasp."""
        return self.sets.rank

    @property
    def payload(self) -> Floats | None:
        """Mass that the motors surely hold [kg], shape (k,); None: there is no load."""
        return None if self.motors is None else self.motors.payload

    @cached_property
    def jacobians(self) -> Floats:
        """Jacobians of the contacts of `sets` with respect to the joints, in the mesh's frame [m].

        Shape (c, 3, p).
        """
        row, link = self._counted
        rotation, offset = self.contacts.poses[:, :3, :3], self.contacts.poses[:, :3, 3]
        points = self.sets.points + self.mesh.center_mass - offset[row]
        in_hand = (points[:, None] @ rotation[row])[:, 0]
        links = self.hand.link_poses(self.contacts.posture)
        return locked(rotation[row] @ self.hand.jacobians(links, row, link, in_hand))

    @cached_property
    def links(self) -> npt.NDArray[np.str_]:
        """Names of the links that touch, separated by spaces, shape (k,)."""
        names = np.array(self.hand.link_names)
        return np.array([" ".join(names[row]) for row in self.touching], dtype=np.str_)

    @cached_property
    def gap(self) -> Floats:
        """Largest gap between the surface and a touching link [m], shape (k,).

        0: all touching links are inside; nan: no link touches.
        """
        gaps = np.where(self.touching, np.maximum(self.contacts.gaps, 0.0), math.nan)
        return locked(np.fmax.reduce(gaps, axis=1))

    @property
    def penetration(self) -> Floats:
        """Depth of the deepest link inside the object [m], shape (k,)."""
        return np.asarray(np.maximum(0.0, -self.contacts.gaps.min(axis=1, initial=math.inf)))

    @property
    def overlap(self) -> Floats:
        """Depth of the deepest collision of two links [m], shape (k,)."""
        return np.maximum(0.0, self.contacts.self_depth)

    @property
    def below_table(self) -> Floats:
        """Depth of the hand below the table [m], shape (k,); nan: no table."""
        return np.maximum(0.0, self.contacts.table_depth)

    @cached_property
    def _collisions(self) -> HandReasons:
        reasons = HandReasons(self.hand, self.contacts, self.contact_distance)
        reasons.add_impossible(self.given.posture, self.scene)
        return reasons

    @property
    def reachable(self) -> Bools:
        """Whether the hand can be at the pose without a collision, shape (k,)."""
        return locked(~self._collisions.impossible)

    @cached_property
    def reasons(self) -> HandReasons:
        """Why grasps fail or may fail."""
        reasons, motors = self._collisions, self.motors
        reasons.add_contacts(self.touching)
        reasons.add("touches outside --region", self.outside)
        if motors is not None:
            short = (self.label < self._labels.label) | (motors.load_fraction > 1.0)
            texts = [motors.shortfall(row) for row in np.flatnonzero(short).tolist()]
            reasons.add("the motors do not surely hold it", short, texts)
        return reasons

    @property
    def remarks(self) -> Iterable[str]:
        """Say which contacts count, and whether the weight of the links does."""
        distance = small_length(self.contact_distance, metres=True)
        yield f"contacts {self.contacts.rule}, within {distance}"
        if self.motors is not None:
            yield self.motors.link_weights

    def _warnings(self) -> Iterable[str | None]:
        if order := self.given.settings.get(ORDER):
            beyond = int((self.hand.excess(self.given.posture) > BEYOND).any(axis=1).sum())
            many = f"joints are beyond their limits in {beyond} of {counted(self.size, 'poses')}"
            asked = f"; {many}: are these of another hand, or in another order?"
            asked = asked if beyond > FEW_BEYOND * self.size else ""
            yield f"the order of the joints is {order}{asked}"
        yield from implausible(self.hand)
        if self.motors is not None:
            yield from self.motors.doubts

    def metrics(self, names: str) -> NoReturn:
        """Raise SettingError: measures need grasps of equal numbers of contacts."""
        raise SettingError(f"{self.hand.name} is a hand with joints, and takes no metrics {names}")

    def contacts_of(self, row: int) -> tuple[Floats, Floats]:
        """Points of a pose's contacts and inward normals there, shape (n, 3) each."""
        mine = self.touching[row]
        return self.contacts.points[row, mine], self.contacts.normals[row, mine]

    def held_at(self, row: int) -> GripperPose:
        """The hand at a pose; links that touch have the colour of the label."""
        color = COLORS[Label(int(self.letter[row]))]
        return GripperPose(
            self.contacts.poses[row], 0.0, math.nan, math.nan, math.nan,
            posture=self.contacts.posture[row],
            toward=self.hand.approach,
            colors=dict.fromkeys(np.flatnonzero(self.touching[row]).tolist(), color),
        )  # fmt: skip

    def take(self, rows: Ints) -> Self:
        """Return the chosen poses, in that order.

        Args:
            rows: Their indices, shape (c,).
        """
        return replace(self, given=self.given.take(rows), contacts=self.contacts.take(rows))

    def using(self, **changed: Any) -> Self:
        """Return the same contacts with another model or load."""
        return replace(self, **changed)

    def to_poses(self, metrics: Mapping[str, Floats] | None = None) -> GraspPoses:
        """Return poses and joint values at which the contacts are; see `EvaluatedPoses`.

        Those of a hand that has closed differ from the given ones.
        """
        poses = super().to_poses(metrics)
        return replace(poses, poses=self.contacts.poses, posture=self.contacts.posture)

    @property
    def fields(self) -> tuple[Field, ...]:
        """Columns of each pose in tables and files."""
        return HAND_GRASPS

    def _columns(self) -> Arrays:
        """Results of shape (k,), with the gaps of the links that come near."""
        gaps = np.where(np.isfinite(self.contacts.gaps), self.contacts.gaps, math.nan)
        near = {
            f"{GAP}{name}": column
            for name, column in zip(self.hand.link_names, gaps.T, strict=True)
            if not np.isnan(column).all()
        }
        return {**super()._columns(), **near}

    def _settings(self) -> dict[str, Any]:
        """Settings of the evaluation; angles in radians."""
        felt = dict(zip(self.hand.link_names, (2.0 * self.tilts_of_links).tolist(), strict=True))
        return settings_of(self.mesh, self.model, self.scene) | {
            "hand": self.hand.name,
            "contact_rule": self.contacts.rule,
            "contact_distance": self.contact_distance,
            **load_settings(self.load),
            "link_weights": None if self.motors is None else self.motors.link_weights,
            "sensor_resolutions": felt,
        }


def _refuse(hand: ArticulatedHand, scene: Scene, model: GraspModel, load: Load | None) -> None:
    """Raise SettingError for settings that do not apply to hands with joints."""
    refused = {
        "fingers: a hand touches with as many links as it happens to": model.fingers != 2,
        "method extremes: its labels are exact": model.method != "exact",
        "pose_error: that is for parallel grippers": bool(scene.pose_error),
        "torsion_radius with a load: what motors hold is that of points": load is not None
        and model.torsion_radius != 0.0,
        "grip_force: it follows from torque_limits": load is not None
        and load.grip_force is not None,
    }
    for text, applies in refused.items():
        if applies:
            raise SettingError(f"{hand.name} is a hand with joints, and takes no {text}")
