"""Why a pose of a hand with joints is no grasp: one sentence for each."""

import math

import numpy as np

from grasp3d.arrays import Bools, Floats, angles_between
from grasp3d.grasps.reasons import Reasons
from grasp3d.hand.articulated.articulated_hand import BEYOND, ArticulatedHand
from grasp3d.hand.articulated.contacts import HandContacts
from grasp3d.hand.scene import LEVEL, Scene
from grasp3d.hand.table import best_approach


class HandReasons(Reasons):
    """Sentences on poses of a hand with joints.

    Args:
        hand: The hand.
        contacts: What its links touch at k poses.
        tolerance: Depth up to which links may be inside something [m].
    """

    def __init__(self, hand: ArticulatedHand, contacts: HandContacts, tolerance: float) -> None:
        super().__init__(len(contacts.poses))
        self._hand, self._contacts, self._tolerance = hand, contacts, tolerance
        self.impossible: Bools = np.zeros(len(contacts.poses), dtype=np.bool_)
        """Whether the hand cannot be there, shape (k,)."""

    def add_impossible(self, posture: Floats, scene: Scene) -> None:
        """Add why the hand cannot be there.

        Args:
            posture: Values of its joints as they were given, shape (k, p).
            scene: The table, and the allowed approach.
        """
        for kind, (wrong, texts) in {
            "a joint is beyond its limit": self._joints(posture),
            "a link is inside the object": self._inside(),
            "links overlap each other": self._together(),
            "the hand is below the table": self._table(),
            "the hand comes from another direction": self._approach(scene),
        }.items():
            self.add(kind, wrong, texts)
            self.impossible |= wrong

    def add_contacts(self, touching: Bools) -> None:
        """Add why there is no grasp.

        Args:
            touching: Whether each link touches, shape (k, L).
        """
        counts, names = touching.sum(axis=1), self._hand.link_names
        self.add(f"no link within {self.length(self._tolerance)} of the object", counts == 0)
        single = counts == 1
        one = touching[single].argmax(axis=1) if single.any() else ()
        self.add("touches with one link only", single, [
            f"touches with one link only, {self._name(names[k])}" for k in one
        ])  # fmt: skip

    def _joints(self, posture: Floats) -> tuple[Bools, list[str]]:
        closed = self._contacts.rule == "closed"  # given postures are not those that are evaluated
        values = self._contacts.posture if closed else posture
        ranges = self._hand.ranges
        excess = self._hand.excess(values)
        worst = excess.argmax(axis=1)
        most = excess.max(axis=1)
        wrong = most > BEYOND
        numbered = {name: f"{k} ({name})" for k, name in enumerate(self._hand.joint_names, 1)}
        return wrong, [
            f"joint {numbered.get(ranges[joint].name, ranges[joint].name)} is "
            f"{self._motion(ranges[joint].name, value)} beyond its limit"
            for joint, value in zip(worst[wrong].tolist(), most[wrong].tolist(), strict=True)
        ]

    def _motion(self, joint: str, value: float) -> str:
        if joint in self._hand.slides:
            return f"{1000.0 * value:.3g} mm"
        return f"{math.degrees(value):.2g}°" if value < 0.1 else f"{math.degrees(value):.0f}°"

    def _inside(self) -> tuple[Bools, list[str]]:
        gaps = self._contacts.gaps
        depth, link = -gaps.min(axis=1), gaps.argmin(axis=1)
        wrong = depth > self._tolerance
        names = self._hand.link_names
        return wrong, [
            f"{self._name(names[number])} {self.length(value)} inside the object"
            for number, value in zip(link[wrong].tolist(), depth[wrong].tolist(), strict=True)
        ]

    def _together(self) -> tuple[Bools, list[str]]:
        pairs, depth = self._contacts.self_collision, self._contacts.self_depth
        wrong = depth > self._tolerance
        names = self._hand.link_names
        return wrong, [
            f"{self._name(names[one])} and {self._name(names[other])} overlap by "
            f"{self.length(value)}"
            for (one, other), value in zip(pairs[wrong].tolist(), depth[wrong], strict=True)
        ]

    def _table(self) -> tuple[Bools, list[str]]:
        depth = self._contacts.table_depth
        wrong = depth > self._tolerance  # nan: no table
        return wrong, [f"{self.length(value)} below the table" for value in depth[wrong]]

    def _approach(self, scene: Scene) -> tuple[Bools, list[str]]:
        direction, within = best_approach(scene.table, scene.approach), scene.approach.within
        # The table itself is what keeps hands from coming from below.
        if direction is None or within >= LEVEL:
            return np.zeros_like(self.impossible), []
        angles = angles_between(self._contacts.poses[:, :3, :3] @ self._hand.approach, direction)
        wrong = np.asarray(angles > within + BEYOND)
        return wrong, [
            f"comes {math.degrees(angle):.0f}° from the approach direction, more than "
            f"{math.degrees(within):.0f}°"
            for angle in angles[wrong]
        ]

    def _name(self, link: str) -> str:
        return "palm" if link == self._hand.palm else link
