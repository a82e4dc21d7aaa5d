"""Reasons why poses are no grasps, or not surely stable ones: one sentence for each."""

import math
from collections.abc import Sequence
from itertools import product
from typing import Any

import numpy as np
import numpy.typing as npt

from grasp3d.arrays import Bools, Floats, Ints, angles_between
from grasp3d.hand.articulated_hand import BEYOND, ArticulatedHand
from grasp3d.hand.closing import MEANING, Closing, close_jaws
from grasp3d.hand.jaws import Jaws
from grasp3d.hand.link_contacts import HandContacts
from grasp3d.hand.reach import collides
from grasp3d.hand.scene import LEVEL, Scene
from grasp3d.mesh.region import allowed_contacts
from grasp3d.mesh.surface_points import contains, nearest_surface_points
from grasp3d.stability.label import Label
from grasp3d.system.context import unreported
from grasp3d.system.names import short_number


class Reasons:
    """Sentences on poses; each pose keeps the first sentence that was added.

    Args:
        count: Number of poses.
    """

    def __init__(self, count: int) -> None:
        self._texts = [""] * count
        self.kinds = [""] * count
        """Topics of the sentences, by which they are counted."""

    @property
    def texts(self) -> npt.NDArray[np.str_]:
        """A sentence for each pose, shape (k,); empty: none."""
        return np.array(self._texts, dtype=np.str_)

    def without(self, chosen: Bools) -> Ints:
        """Rows of chosen poses (k,) that have no sentence yet."""
        return np.flatnonzero(chosen & (self.texts == ""))

    def add(self, kind: str, wrong: Bools | Ints, texts: Sequence[str] = ()) -> None:
        """Add sentences.

        Args:
            kind: Topic of the sentences.
            wrong: The poses they apply to: a mask, shape (k,), or rows.
            texts: A sentence for each of these poses; empty: `kind` for all.
        """
        rows = np.flatnonzero(wrong) if wrong.dtype == np.bool_ else wrong
        for number, row in enumerate(rows.tolist()):
            if not self._texts[row]:
                self._texts[row], self.kinds[row] = texts[number] if texts else kind, kind

    @staticmethod
    def length(length: float) -> str:
        """A length [m] in millimetres, with two digits below 10."""
        millimetres = 1000.0 * float(length)
        return f"{millimetres:.2g} mm" if millimetres < 10.0 else f"{millimetres:.0f} mm"


def _aside(angle: float, limit: float) -> str:
    """Sentence on an approach at an angle [rad] from the best direction, beyond the limit."""
    angle, limit = math.degrees(angle), math.degrees(limit)
    return f"comes {angle:.0f}° from the approach direction, more than {limit:.0f}°"


PARTS = ("finger 1", "finger 2", "palm")
"""Parts of a gripper, by number."""
_KINDS = ("a finger", "a finger", "the palm")

MISSED, OFF_PADS, UNSURE = (
    "may close on nothing within the pose error",
    "contacts may leave the pads",
    "may fail within the pose error",
)
"""Reasons that only a pose error can cause."""

SAMPLES = (3, 5, 9)
"""Number of points along x, y and z of a part at which its depth in the object is measured."""


class GripperReasons(Reasons):
    """Sentences on evaluated poses of a parallel gripper.

    Args:
        poses: The poses, `JawGrasps`; that module imports this one.
    """

    def __init__(self, poses: Any) -> None:
        self._size = len(poses.poses)
        super().__init__(self._size)
        self._poses, jaws = poses, poses.scene.jaws
        # The object yields to the pads, as in the test of the stroke.
        soft = 0.0 if jaws is None else 2.0 * jaws.compliance
        self._widest = poses.scene.hand.limits[1] + soft
        with unreported():
            self._add_direction()
            if jaws is not None:
                self._add_wide(jaws)
                self._add_parts(jaws)
            self._add_states()
            self._add_numbers()

    def _add_direction(self) -> None:
        poses, scene = self._poses, self._poses.scene
        wrong = ~scene.allows(poses.poses)
        angles = scene.approach_angles(poses.poses[wrong])
        texts = [_aside(angle, scene.approach.within) for angle in angles]
        self.add("comes from another direction", wrong, texts)

    def _add_wide(self, hand: Jaws) -> None:
        """Add poses at which fingers start in the object because it is wider than the stroke."""
        poses = self._poses
        rows = self.without(poses.jaws.state == Closing.STARTS_INSIDE)
        if not len(rows):
            return
        wider = hand.opening_to(hand.max_opening + poses.mesh.size)
        closed = close_jaws(poses.mesh, poses.poses[rows], wider)
        excess = closed.opening - self._widest
        wide = excess > 0.0  # nan: not closed there either
        self.add("wider than the stroke", rows[wide], [
            f"wider than the stroke by {self.length(value)}" for value in excess[wide]
        ])  # fmt: skip

    def _add_parts(self, hand: Jaws) -> None:
        """Add which part of the open gripper is in the object or, failing that, in the table."""
        poses, jaws, scene = self._poses, self._poses.jaws, self._poses.scene
        inside = poses.jaws.state == Closing.STARTS_INSIDE
        rows = self.without(inside | (poses.collides & jaws.closed))
        if not len(rows):
            return
        at, wide = poses.poses[rows], hand.limits[1]
        meets = np.stack(
            [collides(poses.mesh, at, wide, hand, only=part) for part in range(len(PARTS))], axis=1
        )
        depths = self._depths(at, hand)  # (r, 3)
        for part, name in enumerate(PARTS):
            kind = _KINDS[part]
            mine = (depths.argmax(axis=1) == part) & (depths[:, part] > 0.0)
            self.add(f"{kind} is inside the object", rows[mine], [
                f"{name} is {self.length(depth)} inside the object" for depth in depths[mine, part]
            ])  # fmt: skip
            kind = f"{kind} meets the object on the way"
            self.add(
                kind, rows[meets[:, part]], [f"{name} meets the object on the way"] * len(rows)
            )
        if scene.table is None:
            return
        heights = np.full((len(rows), len(PARTS)), math.inf)
        for part in range(len(PARTS)):
            corners = np.array(list(product(*np.transpose(_box(hand, part)))))  # (8, 3)
            points = corners @ at[:, :3, :3].swapaxes(1, 2) + at[:, None, :3, 3]
            heights[:, part] = (points @ scene.table.normal - scene.table.offset).min(axis=1)
        for part, name in enumerate(PARTS):
            mine = heights.argmin(axis=1) == part
            self.add(f"{_KINDS[part]} meets the table", rows[mine], [
                f"{name} meets the table" + (f", by {self.length(-height)}" if height < 0.0 else "")
                for height in heights[mine, part]
            ])  # fmt: skip

    def _depths(self, poses: Floats, hand: Jaws) -> Floats:
        """Depth of each part in the object at poses (r, 4, 4), shape (r, 3).

        Measured at the points of a grid; 0 where none is inside, or the mesh is not closed.
        """
        mesh, depths = self._poses.mesh, np.zeros((len(poses), len(PARTS)))
        if not mesh.report.closed:
            return depths
        for part in range(len(PARTS)):
            low, high = _box(hand, part)
            axes = [np.linspace(0.0, 1.0, count) for count in SAMPLES]
            grid = low + np.array(list(product(*axes))) * (high - low)  # (s, 3)
            points = grid @ poses[:, :3, :3].swapaxes(1, 2) + poses[:, None, :3, 3]
            near = np.linalg.norm(points - mesh.center, axis=2) < 0.5 * mesh.size
            row, sample = np.nonzero(near)
            if not len(row):
                continue
            chosen = points[row, sample]
            inside = contains(mesh, chosen)
            _, _, distance = nearest_surface_points(mesh, chosen[inside])
            np.maximum.at(depths[:, part], row[inside], distance)
        return depths

    def _add_states(self) -> None:
        """Add poses at which the jaws do not close on the object."""
        poses = self._poses
        for state, meaning in MEANING.items():
            if state != Closing.CLOSED:
                self.add(meaning, poses.jaws.state == state)
        jaws = poses.jaws
        hand = poses.scene.hand
        shut = jaws.closed & ~hand.opens_to(jaws)
        least, most = hand.limits[0], self._widest
        texts = [
            f"wider than the stroke by {self.length(opening - most)}"
            if opening > most
            else f"narrower than the smallest opening by {self.length(least - opening)}"
            for opening in jaws.opening[shut]
        ]  # fmt: skip
        self.add("outside the stroke", shut, texts)
        self.add("the gripper collides", jaws.closed & poses.collides)

    def _add_numbers(self) -> None:
        """Add why closed jaws do not surely hold the object."""
        poses, jaws, robust = self._poses, self._poses.jaws, self._poses.robustness
        outside = np.zeros(self._size, dtype=np.bool_)
        outside[jaws.closed] = ~allowed_contacts(poses.mesh, jaws.points[jaws.closed])
        self.add("touches outside --region", outside)
        rows = self.without((poses.label < Label.S) & (poses.margin <= 0.0))
        line = jaws.points[rows, 1] - jaws.points[rows, 0]
        normals = jaws.normals[rows]
        off = np.maximum(angles_between(normals[:, 0], line), angles_between(normals[:, 1], -line))
        for label, word in ((Label.U, "slips"), (Label.M, "may slip")):
            mine = poses.label[rows] == label
            self.add(word, rows[mine], [
                f"{word}: contact {math.degrees(angle):.0f}° off the line" for angle in off[mine]
            ])  # fmt: skip
        left = poses.label < Label.S
        self._add_forces(left)
        self.add("gives way, as a finger starts in the object", left & (jaws.shift != 0.0))
        if robust.tried > 1:
            missed = robust.closing_share < 1.0
            self.add(MISSED, left & missed)
            self.add(OFF_PADS, left & self._off_pads())
            self.add(UNSURE, left)

    def _off_pads(self) -> Bools:
        scene, robust = self._poses.scene, self._poses.robustness
        if robust.pad_margin is None:
            return np.zeros(self._size, dtype=np.bool_)
        return np.asarray(robust.pad_margin < scene.pose_error.position)

    def _add_forces(self, left: Bools) -> None:
        case, needed = self._poses.load_case, self._poses.grip_force
        if case is None:
            return
        none = left & np.isinf(needed)
        self.add("no force surely holds the load", none)
        if not case.complete or case.available is None:
            return
        short = left & np.isfinite(needed) & (needed > case.available)
        available = short_number(case.available)
        self.add("needs more force", short, [
            f"needs {short_number(force)} N of {available} N" for force in needed[short]
        ])  # fmt: skip


def _box(hand: Jaws, part: int) -> tuple[Floats, Floats]:
    """Lowest and highest corner of a part of the open gripper, in the gripper's frame."""
    top = 0.0 if hand.round_tips else 0.5 * hand.pad_height
    bottom = top - hand.finger_length
    if part == len(PARTS) - 1:
        half = 0.5 * np.array([hand.palm_thickness, hand.palm_width])
        low, high = [*-half, bottom - hand.palm_length], [*half, bottom]
    else:
        inner = 0.5 * hand.limits[1] + hand.compliance
        outer = 0.5 * hand.limits[1] + hand.finger_thickness
        near, far = (-outer, -inner) if part == 0 else (inner, outer)
        half_width = 0.5 * hand.finger_width
        low, high = [near, -half_width, bottom], [far, half_width, top]
    return np.array(low), np.array(high)


class HandReasons(Reasons):
    """Sentences on poses of a hand with joints.

    Args:
        hand: The hand.
        contacts: Contacts of its links at k poses.
        tolerance: Depth up to which a link may be inside something [m].
    """

    def __init__(self, hand: ArticulatedHand, contacts: HandContacts, tolerance: float) -> None:
        super().__init__(len(contacts.poses))
        self._hand, self._contacts, self._tolerance = hand, contacts, tolerance
        self.impossible: Bools = np.zeros(len(contacts.poses), dtype=np.bool_)
        """Whether the hand cannot be at the pose, shape (k,)."""

    def add_impossible(self, posture: Floats, scene: Scene) -> None:
        """Add why the hand cannot be at poses.

        Args:
            posture: Joint values as they were given, shape (k, p).
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
        closed = self._contacts.rule == "closed"  # the given postures are not evaluated
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
        within, angles = scene.approach.within, scene.approach_angles(self._contacts.poses)
        # The table itself keeps hands from coming from below.
        wrong = np.asarray((angles > within + BEYOND) & (within < LEVEL))
        return wrong, [_aside(angle, within) for angle in angles[wrong]]

    def _name(self, link: str) -> str:
        return "palm" if link == self._hand.palm else link
