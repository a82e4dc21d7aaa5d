"""Make a hand with joints from its links and joints and from what a description states.

What is not stated is proposed from the geometry, and reported:

* The base is the root; in a MuJoCo model it is the body in the world with most joints below it.
* Fingertips are the last links with collision geometry that joints move.
* The palm is the last link that carries all fingertips.
* The fingertips meet in the posture that brings them closest together: it minimises the sum of
  squares of their distances from their common middle, plus a small term for the distance of the
  joints from 0.
* The approach direction is the axis of the palm's frame along which the palm is thinnest, among
  those within 65 degrees of the direction from the middle of the palm to where the fingertips meet.
* Joints close the hand if they turn about nearly the same axis, within 37 degrees, as the last
  joint of their finger; they turn so that the fingertip comes nearer to where the fingertips meet.
  In the open preshape every joint has the value nearest to 0 within its limits. Exceptions are
  joints that do not close the hand and are more than 34 degrees from that value where the
  fingertips meet, such as the base of a thumb: they keep their value there, unless another finger
  spreads about the same axis.
* Torques are the efforts that the file states, where these are plausible.

Implausible numbers, which are mostly stated in wrong units, are reported.
"""

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from grasp3d.arrays import Bools, Floats, locked, unit_rows
from grasp3d.hand.articulated_hand import BEYOND, ArticulatedHand, Coupling
from grasp3d.hand.link_tree import LinkTree
from grasp3d.system.names import unknown

TORQUE_OF_FINGER, TORQUE_ELSEWHERE = 5.0, 100.0
"""Torques from which on the motor of a finger, or another one, is implausible [N m]; forces [N] are
implausible from 100 times that."""

COARSEST = 1.0
"""Sensor resolution from which on it is implausible [rad]."""

LARGEST_MESH = 2.0
"""Size of a link's mesh beyond which it is implausible [m]."""

TURN = 2.0 * math.pi + 0.01
"""Limit of a turning joint beyond which it is implausible [rad]."""

NO_TRAVEL = 1e-6
"""Travel up to which a joint cannot move [rad or m]."""

LISTED = 4
"""Most joints that a sentence names."""


def largest_torque(hand: ArticulatedHand, joint: str) -> float:
    """Torque, or force, of a joint from which on it is implausible [N m or N]."""
    beyond = {hand.tree.joints[link].name for link in hand.beyond_palm}
    most = TORQUE_OF_FINGER if joint in beyond else TORQUE_ELSEWHERE
    return most * (100.0 if joint in hand.slides else 1.0)


def implausible(hand: ArticulatedHand) -> Iterator[str]:
    """Yield a sentence for each implausible value of a hand."""
    yield from _contradictions(hand)
    for name, shapes in zip(hand.link_names, hand.shapes, strict=True):
        meshes = [one.vertices for one in shapes if one.kind == "mesh"]
        size = max((float(np.ptp(one, axis=0).max()) for one in meshes), default=0.0)
        if size > LARGEST_MESH:
            yield f"the mesh of {name} is {size:.3g} m long: is it in mm (scale 0.001)?"
    yield from too_strong(hand, "torques", dict(zip(hand.joint_names, hand.torques, strict=True)))
    for shape, posture in hand.preshapes.items():
        for name, value in zip(hand.joint_names, posture.tolist(), strict=True):
            if abs(value) > 2.0 * math.pi and name not in hand.slides:
                yield (
                    f"preshape {shape}: {name} is at {value:g} rad, more than a turn: {value:g}° "
                    f"are {math.radians(value):.3g} rad"
                )
    for name, alpha in hand.sensors.items():
        if alpha >= COARSEST:
            yield (
                f"sensors: the resolution of {name} is {math.degrees(alpha):.0f}°: it is stated in "
                f"radians, and {alpha:g}° are {math.radians(alpha):.3g}"
            )


def _contradictions(hand: ArticulatedHand) -> Iterator[str]:
    """Yield a sentence for implausible limits of joints."""
    beyond: dict[tuple[float, float], list[str]] = {}
    for one in hand.ranges:
        low, high = one.limits
        if one.name not in hand.slides and TURN < max(-low, high) < math.inf:
            beyond.setdefault(one.limits, []).append(one.name)
        driver = hand.ranges[one.column]
        if one is not driver and one.factor:
            ends = sorted((end - one.offset) / one.factor for end in one.limits)
            left = min(ends[1], driver.limits[1]) - max(ends[0], driver.limits[0])
            if left <= NO_TRAVEL < driver.limits[1] - driver.limits[0]:
                yield (
                    f"{one.name} follows {driver.name} times {one.factor:g}, and its limits, from "
                    f"{low:g} to {high:g}, leave {driver.name} no "
                    f"{'value' if left < 0.0 else 'travel'}: has the multiplier the wrong sign?"
                )
    for (low, high), names in beyond.items():
        yield (
            f"limits from {low:g} to {high:g} rad of {_listed(names)} are more than a turn: are "
            f"they in degrees? {high:g}° are {math.radians(high):.3g} rad"
        )


def _listed(names: list[str]) -> str:
    return f"{', '.join(names[:LISTED])}{' ...' if len(names) > LISTED else ''}"


def too_strong(hand: ArticulatedHand, what: str, torques: Mapping[str, float]) -> Iterator[str]:
    """Yield a sentence for each implausible torque.

    Args:
        hand: The hand.
        what: What states them, the start of the sentence.
        torques: Torques, or forces, of joints by their names [N m or N].
    """
    joints: dict[tuple[float, float, bool], list[str]] = {}
    for name, torque in torques.items():
        most = largest_torque(hand, name)
        if torque >= most:
            joints.setdefault((float(torque), most, name in hand.slides), []).append(name)
    for (torque, most, slides), names in joints.items():
        unit, small = ("N", "mN") if slides else ("N m", "N mm")
        yield (
            f"{what}: {torque:g} {unit} at {_listed(names)} is more than is "
            f"believed there, from {most:g} {unit} on: is it in {small}, and {torque / 1e3:g} "
            f"{unit} meant?"
        )


FARTHEST_APPROACH = 65.0
"""Largest angle between approach direction and the way to where the fingertips meet [degrees]."""

KEPT = 0.02
"""Weight of a joint's distance from 0 [m/rad] against the distances of fingertips."""

ROUNDED = 1e-9
"""Difference of a length from 1 up to which it is rounding."""

TURNED = 0.6
"""Distance from 0 beyond which a joint that does not close the hand keeps, in the open preshape,
its value where the fingertips meet [rad or m]."""

PARALLEL = 0.8
"""Least cosine of the angle between axes that count as nearly the same."""


def articulated_hand_of(tree: LinkTree, stated: Mapping[str, Any] | None = None) -> ArticulatedHand:
    """Make a hand from its links and joints, and propose what is not stated.

    Args:
        tree: Links and joints.
        stated: What is known of it, as `grasp3d.hand.hand_json.stated_of` returns it. What is
            missing is proposed, and listed in `ArticulatedHand.assumed`.

    Raises:
        SettingError: A stated link or joint does not exist, nothing moves, or the motion has no
            posture (free joints, closed loops).
    """
    known = dict(stated or {})
    assumed, couplings = [*known.get("assumed", ())], known.get("couplings", ())
    base: str = known.get("base") or _base(tree)
    if "base" not in known and base != tree.links[0]:
        assumed.append(f"the base is {base}, with most joints below it")
    whole = _coupled(tree.branch(base), couplings)
    _check(whole)
    # All shapes are read now: a missing mesh is an error here, and other processes get all data.
    shapes = {link: whole.shapes(link) for link in whole.links}
    for link, some in shapes.items():
        if any(shape.kind == "mesh" and not len(shape.vertices) for shape in some):
            raise tree.error(f"a collision mesh of {link} is flat, and has no hull")
    whole = replace(whole, shapes=shapes.__getitem__)
    whole.check_links(known.get("masses", {}))
    hand = ArticulatedHand(
        name=known.get("name") or Path(tree.source).stem,
        tree=whole,
        palm=base,
        couplings=couplings,
        masses=known.get("masses", whole.masses),
        source=known.get("source", ""),
    )
    if not hand.joint_names:
        raise tree.error("no joint moves anything, so it is not a hand")
    return _Proposal(hand, known, assumed).hand()


def _base(tree: LinkTree) -> str:
    """The link that is the base of the hand, if none is stated."""
    roots = [link for link in tree.links if link not in tree.joints]
    if not roots:
        raise tree.error("it has no links")
    below = tree.children(roots[0])
    flies = [link for link in below if tree.joints[link].kind == "free"]
    if len(roots) == 1 and ((len(below) < 2 and not flies) or roots[0] != "world"):
        return roots[0]
    candidates = roots if len(roots) > 1 else below
    base = max(candidates, key=lambda link: len(tree.branch(link).by_name))
    while not tree.shapes(base) and len(below := tree.children(base)) == 1:
        if tree.joints[below[0]].kind == "fixed":
            break
        (base,) = below  # joints that move the whole hand
    return base


def _coupled(tree: LinkTree, couplings: Iterable[Coupling]) -> LinkTree:
    """The tree with joints that follow others as couplings state. Raises SettingError."""
    links = {joint.name: link for link, joint in tree.joints.items() if joint.kind != "fixed"}
    joints = dict(tree.joints)
    for coupling in couplings:
        for name in coupling.joints:
            if name not in links:
                raise tree.error(unknown("joint", name, links))
        first, *others = coupling.joints
        for name, ratio in zip(others, coupling.ratios[1:], strict=True):
            follows = first, ratio / coupling.ratios[0], 0.0
            joints[links[name]] = replace(joints[links[name]], follows=follows)
    return replace(tree, joints=joints)


def _check(tree: LinkTree) -> None:
    """Raise SettingError if a posture cannot describe the tree."""
    for joint in tree.joints.values():
        if joint.kind == "free":
            raise tree.error(
                f"joint {joint.name} neither slides nor turns about an axis, and has no value of "
                "a posture; name a base of the hand below it"
            )
        tree.source_of(joint)
    if tree.closures:
        raise tree.error(f"{tree.closures[0]} closes a loop of links; only trees of links are read")


class _Proposal:
    """The stated values of a hand, with proposals for the rest."""

    def __init__(self, hand: ArticulatedHand, known: Mapping[str, Any], assumed: list[str]) -> None:
        self.known, self.assumed, self.tree, self.bare = known, assumed, hand.tree, hand
        self.names = hand.joint_names
        self.limits = hand.limits_of_joints
        self.zero = np.clip(np.zeros(len(self.names)), *self.limits.T)

    def hand(self) -> ArticulatedHand:
        """Make the hand. Raises SettingError."""
        tree, known = self.tree, self.known
        tips = tuple(known.get("fingertips") or self._fingertips())
        tree.check_links(tips)
        palm = known.get("palm") or self._palm(tips)
        tree.check_links([palm, *known.get("sensors", {})])
        self.bare = replace(self.bare, fingertips=tips, palm=palm)
        closing = self._closing()
        preshapes = self._preshapes(closing)
        approach = self._approach(preshapes["open"])
        if tree.unseen:
            what = "links without collision geometry, which are only seen, touch nothing"
            self.assumed.append(f"{what}: {', '.join(tree.unseen)}")
        if endless := self._named(np.isinf(self.limits).any(axis=1)):
            self.assumed.append(f"joints without limits: {', '.join(endless)}")
        return replace(
            self.bare,
            approach=locked(approach),
            sensors=known.get("sensors", {}),
            torques=locked(self._torques()),
            preshapes=preshapes,
            closing=locked(closing),
            assumed=tuple(self.assumed),
        )

    def _named(self, which: Any) -> list[str]:
        return [name for name, one in zip(self.names, which, strict=True) if one]

    def _fingertips(self) -> tuple[str, ...]:
        # No end: a link that carries a moving one, or is fixed to one that does (a palm's camera).
        carriers = {joint.parent for joint in self.tree.by_name.values()}
        ends = [
            name for name in self.bare.beyond_base
            if self.tree.shapes(name) and carriers.isdisjoint(self.tree.rigid(name))
        ]  # fmt: skip
        inner = {above for name in ends for above in self.tree.chain(name)[1:]}
        found = tuple(name for name in ends if name not in inner)
        if not found:
            seen = f"; only seen are {', '.join(self.tree.unseen)}" if self.tree.unseen else ""
            raise self.tree.error(f"no finger ends with a link that has collision geometry{seen}")
        self.assumed.append(f"fingertips are the last links with geometry: {', '.join(found)}")
        return found

    def _palm(self, tips: Iterable[str]) -> str:
        chains = [self.tree.chain(tip)[1:] for tip in tips]
        common = (link for link in chains[0] if all(link in chain for chain in chains))
        if (palm := next(common, None)) is None:
            raise self.tree.error("no link carries all fingertips; name the palm (palm)")
        self.assumed.append(f"the palm is {palm}, the last link that carries all fingertips")
        return palm

    def _numbers(self, links: Iterable[str]) -> list[int]:
        return [self.tree.links.index(link) for link in links]

    @cached_property
    def _middles(self) -> Floats:
        """Middles of the fingertips' bounding boxes, in the frames of the tips, shape (n, 3)."""
        boxes = [self.tree.geometry(tip).reshape(-1, 3) for tip in self.bare.fingertips]
        return np.array([
            0.5 * (box.min(axis=0) + box.max(axis=0)) if len(box) else np.zeros(3) for box in boxes
        ])  # fmt: skip

    def _tips(self, posture: Floats) -> Floats:
        """Middles of the fingertips in the hand's frame at a posture, shape (n, 3)."""
        poses = self.bare.link_poses(posture)[0, self._numbers(self.bare.fingertips)]
        points: Floats = np.einsum("nij,nj->ni", poses[:, :3, :3], self._middles) + poses[:, :3, 3]
        return points

    @cached_property
    def _meeting(self) -> Floats:
        """Posture in which the fingertips are closest together."""
        low, high = np.clip(self.limits, -np.pi, np.pi).T
        room, found = high - low > 1e-9, np.clip(0.5 * (low + high), low, high)

        def residuals(values: Floats) -> Floats:
            found[room] = values
            points = self._tips(found)
            apart = (points - points.mean(axis=0)).ravel()
            return np.asarray(np.concatenate([apart, KEPT * (values - self.zero[room])]))

        if room.any():
            ends = low[room], high[room]
            found[room] = least_squares(residuals, found[room], bounds=ends).x
        return np.asarray(found)

    @cached_property
    def _target(self) -> Floats:
        """Where the fingertips meet, shape (3,)."""
        return np.asarray(self._tips(self._meeting).mean(axis=0))

    def _closing(self) -> Floats:
        if "closing" in self.known:
            return self._by_name(self.known["closing"], np.zeros(len(self.names)), "closing")
        halfway = 0.5 * (self.zero + self._meeting)
        points, poses = self._tips(halfway), self.bare.link_poses(halfway)
        numbers = np.array(self._numbers(self.bare.fingertips))
        moves = self.bare.jacobians(poses, np.zeros_like(numbers), numbers, points)
        toward = np.einsum("nip,ni->p", moves, self._target - points)
        bends = [
            one is not None
            and self.tree.joints[one[0]].kind == self.tree.joints[one[1]].kind
            and abs(float(one[2][0] @ one[2][1])) >= PARALLEL
            for one in self._in_fingers(halfway)
        ]
        self.assumed.append(
            "the joints that close it turn about nearly the same axis as the last joint of their "
            "finger, in the direction that brings it nearer to where the fingertips meet"
        )
        return np.where(bends, np.sign(toward), 0.0)

    def _in_fingers(self, posture: Floats) -> list[tuple[str, str, Floats] | None]:
        """For each joint: the link that it moves, that of its finger's last joint, and both axes.

        None where it moves several fingers at once, like the joint of a wrist, or no finger.
        """
        poses, joints = self.bare.link_poses(posture)[0], self.tree.joints
        chains = [self.tree.chain(tip) for tip in self.bare.fingertips]
        found = list[tuple[str, str, Floats] | None]()
        link_of = {joint.name: link for link, joint in joints.items()}
        for link in (link_of[name] for name in self.names):
            above = [chain for chain in chains if link in chain]
            if len(above) != 1:
                found.append(None)
                continue
            last = next(one for one in above[0] if joints[one].kind != "fixed")
            turns = poses[self._numbers([link, last]), :3, :3]
            axes = [turn @ joints[one].axis for turn, one in zip(turns, (link, last), strict=True)]
            found.append((link, last, np.array(axes)))
        return found

    def _spreads(self, closing: Floats) -> Bools:
        """Joints that do not close the hand but have a counterpart in another finger, shape (p,).

        Both turn about nearly the same axis, and so do the last joints of their fingers. Fingers
        side by side spread like this, while the base of a thumb has no counterpart.
        """
        found = self._in_fingers(self.zero)
        still = [one if speed == 0.0 else None for one, speed in zip(found, closing, strict=True)]
        return np.array([
            one is not None and any(
                other is not None and other[1] != one[1]
                and (np.abs((one[2] * other[2]).sum(axis=1)) >= PARALLEL).all()
                for other in still
            )
            for one in still
        ])  # fmt: skip

    def _preshapes(self, closing: Floats) -> dict[str, Floats]:
        found = {
            name: locked(self._by_name(values, self.zero, f"preshape {name}"))
            for name, values in self.known.get("preshapes", {}).items()
        }
        for name, posture in found.items():
            self._check_limits(name, posture)
        if "open" not in found:
            turned = (closing == 0.0) & (np.abs(self._meeting - self.zero) > TURNED)
            turned &= ~self._spreads(closing)
            found["open"] = locked(np.where(turned, self._meeting, self.zero))
            others = ", ".join(self._named(turned))
            self.assumed.append(
                "open: joints are at 0, or at the limit nearest to 0"
                + (f", but as they are where the fingertips meet: {others}" if others else "")
            )
        return found

    def _check_limits(self, name: str, posture: Floats) -> None:
        """Raise SettingError if a preshape is beyond the limits of joints."""
        for one, excess in zip(self.bare.ranges, self.bare.excess(posture[None])[0], strict=True):
            if excess > BEYOND:
                (low, high), joint, value = one.limits, self.names[one.column], posture[one.column]
                unit = "m" if joint in self.bare.slides else "rad"
                degrees = f" ({value:g}° are {np.radians(value):.3g} rad)"
                raise self.tree.error(
                    f"preshape {name}: {joint} is at {value:g} {unit}"
                    f"{degrees if unit == 'rad' and excess > 1.0 else ''}, beyond the limits of "
                    f"{one.name}, from {low:.4g} to {high:.4g}"
                )

    def _approach(self, opened: Floats) -> Floats:
        if "approach" in self.known:
            stated = np.array(self.known["approach"], dtype=np.float64)
            return stated if abs(np.linalg.norm(stated) - 1.0) < ROUNDED else unit_rows(stated)
        palm = self.bare.palm
        (number,) = self._numbers([palm])
        corners = self.tree.triangles(self.tree.rigid(palm)).reshape(-1, 3)
        ends = (corners.min(axis=0), corners.max(axis=0)) if len(corners) else np.zeros((2, 3))
        box = np.array(ends)
        inverse = np.linalg.inv(self.bare.link_poses(self._meeting)[0, number])
        way = unit_rows(inverse[:3, :3] @ self._target + inverse[:3, 3] - box.mean(axis=0))
        turn = self.bare.link_poses(opened)[0, number, :3, :3]
        near = np.flatnonzero(np.abs(way) >= np.cos(np.radians(FARTHEST_APPROACH)))
        if not len(near):
            raise self.tree.error("it is not clear where it approaches from; state it (approach)")
        axis = near[np.ptp(box, axis=0)[near].argmin()]
        chosen = np.sign(way[axis]) * np.eye(3)[axis]
        sign = "-" if way[axis] < 0.0 else "+"
        self.assumed.append(
            f"the approach direction is {sign}{'xyz'[axis]} of {palm}: the palm's "
            "thinnest side toward where the fingertips meet"
        )
        return np.asarray(np.round(turn @ chosen, 12) + 0.0)

    def _torques(self) -> Floats:
        found, odd = np.full(len(self.names), np.nan), dict[float, list[str]]()
        if "torques" in self.known:
            return self._by_name(self.known["torques"], found, "torques")
        for number, name in enumerate(self.names):
            effort = self.tree.by_name[name].effort
            if effort is not None and 0.0 < effort < largest_torque(self.bare, name):
                found[number] = effort
            elif effort is not None:
                odd.setdefault(effort, []).append(name)
        for effort, names in odd.items():
            why = f"an effort of {effort:g} is not that of such a motor"
            self.assumed.append(f"{why}: the torque is not stated ({', '.join(names)})")
        if (found > 0.0).any():
            self.assumed.append("torques are the efforts that the file states, which are plausible")
        return found

    def _by_name(self, values: Mapping[str, float], default: Floats, what: str) -> Floats:
        """Values of joints by their names, as an array. Raises SettingError."""
        found = default.copy()
        for name, value in values.items():
            if name not in self.names:
                joint = self.tree.by_name.get(name)
                why = f"{name!r} is no joint of a posture; known: {', '.join(self.names)}"
                if joint is not None and joint.follows is not None:
                    first = joint.follows[0]
                    why = f"{name} follows {first}, and has no value of its own: leave it out"
                raise self.tree.error(f"{what}: {why}")
            found[self.names.index(name)] = value
        return found
