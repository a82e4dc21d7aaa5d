"""A hand with joints: the motions of its links, its fingertips and its motors."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

import numpy as np

from grasp3d._kernels.hands import kinematics
from grasp3d._kernels.hands.link_shapes import LinkShapes
from grasp3d.arrays import ArrayLike, Floats, Ints, locked
from grasp3d.errors import SettingError
from grasp3d.hand.link_bodies import half_widths, link_bodies
from grasp3d.hand.link_tree import Joint, LinkMass, LinkShape, LinkTree
from grasp3d.hand.robot_files import FORMAT, VERSION
from grasp3d.hand.triangles import Part, Triangles, triangles_of
from grasp3d.quality.actuation import Actuation
from grasp3d.system.names import printable

_KINDS = {"fixed": kinematics.FIXED, "slides": kinematics.SLIDES, "turns": kinematics.TURNS}


class Coupling(NamedTuple):
    """Joints with fixed ratios of their values; the structure bears what the motor does not."""

    joints: tuple[str, ...]
    """Names of the joints; a posture contains only the first."""
    ratios: tuple[float, ...]
    """Ratios of their values."""


BEYOND = 1e-3
"""Angle [rad], or length [m], by which a joint may exceed its limit through rounding."""


class JointRange(NamedTuple):
    """Limits of a movable joint, and how its value follows from a joint of a posture."""

    name: str
    column: int
    """Column in a posture of the joint that determines its value: itself, or the one it follows."""
    factor: float
    offset: float
    limits: tuple[float, float] = (-math.inf, math.inf)
    """Its smallest and largest value [m or rad]; infinite: unlimited."""


BASE = Joint("", "fixed", "", np.eye(4), np.zeros(3))
"""Stands for the joint of the base, which has none."""


@dataclass(frozen=True, eq=False, kw_only=True)
class ArticulatedHand:
    """A hand with jointed fingers; lengths in metres, angles in radians.

    It is a `Hand`; its grasps are poses with joint values. It has no opening and does not close
    like sliding jaws: methods that need either raise SettingError.
    """

    name: str
    tree: LinkTree
    """Its links and joints. The hand's frame is that of the first link, the base."""
    palm: str
    """Name of the link that carries the fingers."""
    approach: Floats = field(default_factory=lambda: locked([0.0, 0.0, 1.0]))
    """Unit vector from the palm to the object, in the hand's frame with all joints at the open
    preshape, shape (3,)."""
    fingertips: tuple[str, ...] = ()
    """Names of the last links of the fingers."""
    sensors: Mapping[str, float] = field(default_factory=dict)
    """Sensor resolution alpha [rad] of links that state their own; other links have that of the
    contact model."""
    torques: Floats = field(default_factory=lambda: locked(np.zeros(0)))
    """Greatest torque, or force, of the motor of each joint [N m or N], shape (p,); nan: not
    stated; 0: the joint has no motor and moves freely."""
    couplings: tuple[Coupling, ...] = ()
    masses: Mapping[str, LinkMass] = field(default_factory=dict)
    """Masses of the links, by name."""
    preshapes: Mapping[str, Floats] = field(default_factory=dict)
    """Postures by name, each of shape (p,); the hand closes from "open"."""
    closing: Floats = field(default_factory=lambda: locked(np.zeros(0)))
    """Speeds of the joints when the hand closes, shape (p,); 0: the joint does not move."""
    source: str = ""
    """Where its numbers come from."""
    assumed: tuple[str, ...] = ()
    """Assumptions made where nothing was stated, one sentence each."""

    @cached_property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the p joints of a posture, in file order, without joints that follow others."""
        return tuple(name for name, one in self.tree.by_name.items() if one.follows is None)

    @cached_property
    def slides(self) -> frozenset[str]:
        """Names of the joints that slide."""
        return frozenset(name for name, one in self.tree.by_name.items() if one.kind == "slides")

    @cached_property
    def ranges(self) -> tuple[JointRange, ...]:
        """Limits of all movable joints: first those of a posture, then those that follow."""
        joints = sorted(self.tree.by_name.values(), key=lambda one: one.follows is not None)
        sources = ((joint, *self.tree.source_of(joint)) for joint in joints)
        return tuple(
            JointRange(joint.name, self.joint_names.index(name), factor, offset, joint.limits)
            for joint, name, factor, offset in sources
        )

    def excess(self, postures: Floats) -> Floats:
        """How far postures exceed the limits of the joints of `ranges`, shape (k, r)."""
        columns, factors, offsets, limits = zip(*(one[1:] for one in self.ranges), strict=True)
        values = np.array(factors) * postures[:, list(columns)] + np.array(offsets)
        low, high = np.array(limits).T
        return np.asarray(np.maximum(low - values, values - high))

    @cached_property
    def limits_of_joints(self) -> Floats:
        """Smallest and largest values of the joints of a posture, shape (p, 2); inf: unlimited.

        Joints that follow another also limit its range, unless nothing would be left of it.
        """
        limits = np.full((len(self.joint_names), 2), (-np.inf, np.inf))
        for one in self.ranges:
            if one.factor:
                ends = np.sort((np.array(one.limits) - one.offset) / one.factor)
                low, high = limits[one.column]
                both = max(low, ends[0]), min(high, ends[1])
                if both[0] <= both[1]:
                    limits[one.column] = both
        return locked(limits)

    @property
    def link_names(self) -> tuple[str, ...]:
        """Its L links, parents first."""
        return self.tree.links

    @cached_property
    def shapes(self) -> tuple[tuple[LinkShape, ...], ...]:
        """Collision geometry of each link."""
        return tuple(map(self.tree.shapes, self.link_names))

    @cached_property
    def bodies(self) -> LinkShapes:
        """Collision geometry as the kernels take it."""
        return link_bodies(self.shapes)

    @cached_property
    def half_widths(self) -> Floats:
        """Half the smallest width of each shape of `bodies` [m], shape (m,); slow to compute."""
        return half_widths(self.bodies, [shape for some in self.shapes for shape in some])

    @cached_property
    def chain(self) -> kinematics.Chain:
        """Links and joints as the kernels take them."""
        numbers = {name: number for number, name in enumerate(("", *self.link_names), -1)}
        joints = [self.tree.joints.get(link, BASE) for link in self.link_names]
        ranges, still = {one.name: one for one in self.ranges}, JointRange("", -1, 1.0, 0.0)
        values = [ranges.get(one.name, still) for one in joints]
        return kinematics.Chain(
            parents=locked([numbers[one.parent] for one in joints]),
            kinds=locked([_KINDS[one.kind] for one in joints]),
            origins=locked([one.origin for one in joints]),
            axes=locked([one.axis for one in joints]),
            positions=locked([one.position for one in joints]),
            columns=locked([one.column for one in values]),
            factors=locked([one.factor for one in values]),
            offsets=locked([one.offset for one in values]),
        )

    def _error(self, problem: str) -> SettingError:
        return SettingError(printable(f"{self.name}{problem}"))

    def postures(self, values: ArrayLike) -> Floats:
        """Check values of the joints and return them as an array, shape (k, p).

        Raises:
            SettingError: Their number is not that of `joint_names`, or a value is not finite.
        """
        # Copied, as the kernels are compiled ahead of time for writable arrays.
        postures = np.atleast_2d(np.array(values, dtype=np.float64, order="C"))
        count = len(self.joint_names)
        if postures.ndim != 2 or postures.shape[1] != count:
            raise self._error(
                f" has {count} joints, and a posture has {postures.shape[-1]} values; the joints "
                f"are {', '.join(self.joint_names)}"
            )
        for row, column in np.argwhere(~np.isfinite(postures)):
            raise self._error(
                f": joint {self.joint_names[column]} of posture {row} is "
                f"{postures[row, column]:g}; values of joints must be finite"
            )
        return postures

    def link_poses(self, postures: ArrayLike) -> Floats:
        """Poses of the links in the hand's frame [m], shape (k, L, 4, 4).

        Args:
            postures: Values of the joints `joint_names`, shape (k, p) or (p,).

        Raises:
            SettingError: The number of values is wrong, or a value is not finite.
        """
        poses: Floats = kinematics.link_poses(self.postures(postures), self.chain)
        return poses

    def jacobians(self, link_poses: Floats, row: Ints, link: Ints, points: Floats) -> Floats:
        """Jacobians of points that move with links, shape (c, 3, p).

        Args:
            link_poses: What the method `link_poses` returned, shape (k, L, 4, 4).
            row: Posture of each point, shape (c,).
            link: Number of its link, shape (c,).
            points: Its position in the hand's frame [m], shape (c, 3).

        Returns:
            Velocities in the hand's frame per unit velocity of each joint of a posture; joints that
            follow it move as well.
        """
        found: Floats = kinematics.jacobians(
            np.array(link_poses, order="C"), np.array(row, np.int64), np.array(link, np.int64),
            np.array(points, order="C").reshape(-1, 3), len(self.joint_names), self.chain,
        )  # fmt: skip
        return found

    def link_loads(self, postures: Floats, link_poses: Floats) -> Floats | None:
        """Joint torques that hold the links, per acceleration of gravity [kg m], shape (k, p, 3).

        Args:
            postures: Values of the joints, shape (k, p).
            link_poses: Poses that the method `link_poses` returns for them.

        Returns:
            In the hand's frame; None if no moving link has a known mass.
        """
        moved = [name for name in self.beyond_base if name in self.masses]
        if not moved:
            return None
        count, links = len(postures), [self.link_names.index(name) for name in moved]
        masses = np.array([self.masses[name].mass for name in moved])
        centers = np.array([[*self.masses[name].center, 1.0] for name in moved])
        points = np.einsum("klij,lj->kli", link_poses[:, links], centers)[..., :3].reshape(-1, 3)
        rows, numbers = np.repeat(np.arange(count), len(moved)), np.tile(links, count)
        moves = self.jacobians(link_poses, rows, numbers, points)
        loads = np.einsum("l,klip->kpi", -masses, moves.reshape(count, len(moved), 3, -1))
        return np.asarray(loads)

    def shape(self, opening: float, posture: ArrayLike = ()) -> Triangles:
        """Its links at a posture, by default the open preshape; `opening` is ignored."""
        del opening
        values = np.asarray(posture, dtype=np.float64)
        (poses,) = self.link_poses(values if values.size else self.preshapes["open"])
        corners = [
            self.tree.geometry(link) @ pose[:3, :3].T + pose[:3, 3]
            for link, pose in zip(self.link_names, poses, strict=True)
        ]
        links = np.repeat(np.arange(len(corners)), list(map(len, corners)))
        vertices = np.concatenate(corners).reshape(-1, 3)
        parts = [
            Part.TIP if name in self.fingertips
            else Part.FINGER if name in self.beyond_palm else Part.PALM
            for name in self.link_names
        ]  # fmt: skip
        faces = np.arange(len(vertices)).reshape(-1, 3)
        return triangles_of(vertices, faces, np.array(parts, np.uint8)[links], links)

    @cached_property
    def beyond_palm(self) -> frozenset[str]:
        """Links below the palm that move relative to it."""
        return frozenset(self.tree.branch(self.palm).links) - self.tree.rigid(self.palm).keys()

    @cached_property
    def beyond_base(self) -> tuple[str, ...]:
        """Links that move in the hand's frame, parents first."""
        still = self.tree.rigid(self.link_names[0])
        return tuple(name for name in self.link_names if name not in still)

    # Further members of the protocol `Hand`.
    fingers = ()
    """Contact counts of the grasps for which it finds poses itself: none."""
    limits, max_opening = (0.0, 0.0), 0.0
    """Both are 0, as it has no opening."""
    max_force = None
    """Not stated: how hard its fingers press depends on the posture."""
    sensor_resolution = None
    """Not stated for all fingertips together: see `sensors`."""
    touch_area = 0.0
    """Not stated: 0."""

    @cached_property
    def size(self) -> float:
        """Diagonal of its bounding box at the open preshape [m]."""
        corners = self.shape(0.0).vertices
        return float(np.linalg.norm(np.ptp(corners, axis=0))) if len(corners) else 0.0

    @property
    def finger_length(self) -> float:
        """Approximate reach of its fingers [m]: its size."""
        return self.size

    def torsion_radius(self, friction: float) -> float:
        """Not stated: 0."""
        return 0.0 * friction

    fitting = "at least two links touch the object, and none is deeper than 15 mm in it,"
    """What holds at poses that fit, for a sentence; see `Hand.fitting`."""

    def _refuse(self, *_: Any, **__: Any) -> NoReturn:
        raise self._error(
            " is a hand with joints: poses with values of its joints are evaluated object by "
            "object (grasp3d evaluate MESH GRASPS --hand FILE), and grasps are found for grippers "
            "only"
        )

    check_fingers = distances = reach = close = blocked = opens_to = fits = _refuse

    def description(self) -> Mapping[str, Any]:
        """Its description for files; the key `description` is the path of the robot model."""

        def by_name(values: Floats) -> Mapping[str, float]:
            pairs = zip(self.joint_names, values.tolist(), strict=True)
            return {name: value for name, value in pairs if math.isfinite(value)}

        return {
            "format": FORMAT,
            "version": VERSION,
            "name": self.name,
            "description": Path(self.tree.source).absolute().as_posix(),
            "base": self.link_names[0],
            "palm": self.palm,
            "approach": self.approach.tolist(),
            "fingertips": list(self.fingertips),
            "sensors": dict(self.sensors),
            "torques": by_name(self.torques),
            "couplings": [one._asdict() for one in self.couplings],
            "masses": {name: one._asdict() for name, one in self.masses.items()},
            "preshapes": {name: by_name(posture) for name, posture in self.preshapes.items()},
            "closing": by_name(np.where(self.closing == 0.0, np.nan, self.closing)),
            "source": self.source,
            "assumed": list(self.assumed),
        }


AT_STOP = 1e-3
"""Distance from its limit [rad or m] at which a joint is at its stop."""


def torques_of(hand: ArticulatedHand, torque_limits: float | None = None) -> Floats:
    """Greatest torque of the motor of each joint [N m or N], shape (p,); nan: it has no motor.

    Args:
        hand: The hand.
        torque_limits: Greatest torque of every motor; None: the stated ones.

    Raises:
        SettingError: A torque is not stated, or no joint has a motor that could be limited.
    """
    missing = np.array(hand.joint_names)[np.isnan(hand.torques)].tolist()
    if torque_limits is None and missing:
        raise SettingError(
            f"the description of {hand.name} states no torque of the motor of "
            f"{', '.join(missing)}: state it there, or give that of "
            "every motor (--torque-limits, in Python torque_limits=...)"
        )
    torques = np.where(hand.torques == 0.0, np.nan, torque_limits or hand.torques)
    if torque_limits is not None and np.isnan(torques).all():
        raise SettingError(f"{hand.name} has no motor that torque_limits could limit")
    return torques


def actuation_of(
    hand: ArticulatedHand, posture: Floats, torques: Floats, links: Floats | None = None
) -> Actuation:
    """The drives of a hand in a posture.

    The posture already reflects couplings: a joint that follows another has no torque of its own. A
    joint at its limit is also pushed back by its stop.

    Args:
        hand: The hand.
        posture: Values of its joints (p,).
        torques: Greatest torques of their motors, as `torques_of` returns them, shape (p,).
        links: Torques that hold the links per acceleration of gravity, as in `Actuation`; None:
            their weight is neglected.
    """
    lower, upper = hand.limits_of_joints.T
    stops = (posture <= lower + AT_STOP).astype(float) - (posture >= upper - AT_STOP)
    limits = np.where(np.isnan(torques), 0.0, torques)
    return Actuation(limits, names=hand.joint_names, stops=stops, links=links)
