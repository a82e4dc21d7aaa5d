"""A gripper's boxes from the geometry of a robot's hand.

What is read from a description:

* The closing axis is the axis along which both fingers slide. It must be an axis of the frame of
  the link that carries them, the hand's own frame.
* The approach axis is that axis of the hand's frame, at a right angle to the closing axis, which
  points best from the palm to the fingers.
* The stroke follows from the joint limits: the distance between the fingers' inner sides. Fingers
  that overlap when they are closed, by up to 2 mm, touch.
* Fingers and palm are boxes around the collision geometry, placed symmetrically about the TCP: a
  box has the larger size of both fingers, and of both sides of the palm. Faces of the fingers that
  lie beside the palm, when they are open, belong to it.

What is assumed:

* Pads are flat: the parts of the inner sides within 0.5 mm of the contact plane, beyond the palm.
  The TCP is in their middle unless it is given. Pads end where the fingers end, and reach equally
  far behind the TCP.
* Jaws touch with the inner sides of the fingers beyond the palm, of which each closed piece is its
  convex hull (`grasp3d.hand.finger_hull`). Both are those of finger 1. Where they differ by more
  than 1 mm, on more than 5 % of their area, jaws touch with the flat pads alone.
* The palm is at least as thick as the stroke, since something guides the fingers there.
* Compliance, clearance, force and touch are not in such files: they have their default values.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from grasp3d.arrays import Floats
from grasp3d.errors import SettingError
from grasp3d.hand.finger_hull import inner_faces, thickness_at_tcp
from grasp3d.hand.jaws import AXES
from grasp3d.hand.parallel_gripper import ParallelGripper

FLATNESS = 0.0005
"""Distance from the contact plane up to which the inner side of a finger is its pad [m]."""

OVERLAP = 0.002
"""Largest overlap of closed fingers, from inexact geometry [m]."""

ALIGNED = 0.9998
"""Least cosine of the angle between directions that count as the same (about 1 degree)."""

DIGITS = 9
"""Decimals of lengths [m] that are kept: fewer than rounding errors have."""

SAME = 1e-6
"""Largest difference of lengths that count as the same [m]."""

OFF_AXIS = 0.001
"""Largest distance of the TCP from the approach axis of the hand's frame [m]."""


UNIT = {name: np.array(axis) for name, axis in AXES.items()}
"""Unit vectors of the hand's frame by name."""


@dataclass(frozen=True, eq=False)
class SlidingFinger:
    """A finger of a hand, at the value 0 of its joint."""

    link: str
    joint: str
    axis: Floats
    """Movement per unit of the joint's value, in the hand's frame, shape (3,)."""
    limits: tuple[float, float]
    """Smallest and largest value of the joint [m]."""
    triangles: Floats
    """Corners of its collision geometry in the hand's frame [m], shape (n, 3, 3)."""


@dataclass(frozen=True, eq=False)
class SlidingHand:
    """Palm and fingers of a robot's hand; lengths in metres."""

    source: str
    """Name of the file, for messages."""
    link: str
    """The link that carries the fingers; its frame is the hand's own."""
    fingers: tuple[SlidingFinger, SlidingFinger]
    palm: Floats
    """Points of the palm's collision geometry in the hand's frame, shape (n, 3)."""
    coupled: float | None = None
    """Change of finger 2's joint per change of finger 1's, where one follows the other; None: each
    joint has a drive of its own."""


def gripper_of_hand(hand: SlidingHand, *, tcp: float | None = None) -> ParallelGripper:
    """Boxes around the geometry of a hand.

    Args:
        hand: Its palm and fingers.
        tcp: From the origin of the hand's frame to the TCP, along the approach axis [m]; None: the
            middle of the flat pads.

    Raises:
        SettingError: The fingers do not open, move in the same direction, or end behind the palm;
            or their axes are no axes of the hand's frame.

    Example:
        >>> import numpy as np
        >>> import trimesh
        >>> from grasp3d.hand.hand_geometry import SlidingHand, SlidingFinger, gripper_of_hand
        >>> box = trimesh.creation.box(bounds=[[-0.01, 0.0, 0.05], [0.01, 0.01, 0.09]])
        >>> shape, along = box.triangles, np.array([0.0, 1.0, 0.0])
        >>> fingers = tuple(
        ...     SlidingFinger(name, name, sign * along, (0.0, 0.03), shape * [1.0, sign, 1.0])
        ...     for name, sign in (("left", 1.0), ("right", -1.0))
        ... )
        >>> palm = trimesh.creation.box([0.06, 0.1, 0.1]).vertices
        >>> gripper = gripper_of_hand(SlidingHand("hand.urdf", "hand", fingers, palm), tcp=0.08)
        >>> gripper.max_opening, gripper.pad_height, gripper.base_axes
        (0.06, 0.02, ('-y', 'z'))
    """
    closing = _closing_axis(hand)
    return _gripper(_View(hand, closing, _approach_axis(hand, closing)), tcp)


class _View:
    """A hand in coordinates along its closing axis x, y and its approach axis z."""

    def __init__(self, hand: SlidingHand, closing: str, approach: str) -> None:
        self.hand = hand
        self.axes = closing, approach
        x, z = UNIT[closing], UNIT[approach]
        frame = np.stack([x, np.cross(z, x), z])
        one, two = hand.fingers
        self.palm = hand.palm @ frame.T
        # Mirrored, finger 1 is on the side of positive x and opens along it, as finger 2 does.
        mirror = np.array([-1.0, 1.0, 1.0])
        self.whole = one.triangles @ frame.T * mirror, two.triangles @ frame.T
        self.rates = -float(one.axis @ x), float(two.axis @ x)
        self.closed = self._ends(min)
        self.open = self._ends(max)
        self.front = float(self.palm[:, 2].max())
        self.fingers = [self._beyond_palm(finger) for finger in self.whole]
        self.end = max(float(finger[..., 2].max()) for finger in self.fingers)
        sides = np.concatenate([finger[..., 1].ravel() for finger in self.fingers])
        self.middle = 0.5 * float(sides.min() + sides.max())
        self.width = float(np.ptp(sides))

    def _ends(self, end: Callable[..., float]) -> tuple[float, float]:
        """Values of the joints at one end of the stroke."""
        pairs = zip(self.hand.fingers, self.rates, strict=True)
        values = [end(finger.limits, key=lambda v, rate=rate: rate * v) for finger, rate in pairs]
        return values[0], values[1]

    def _beyond_palm(self, finger: Floats) -> Floats:
        """The triangles of a finger that reach beyond the palm. Raises SettingError."""
        beyond: Floats = finger[finger[..., 2].max(axis=1) > self.front]
        if not len(beyond):
            raise SettingError(
                f"{self.hand.source}: the fingers end behind the front of the palm; name the link "
                "of the palm (--palm)"
            )
        return beyond

    def inner_sides(self, values: tuple[float, float]) -> tuple[float, float]:
        """Distances of the inner sides from the origin of the hand's frame, outward."""
        one, two = (
            float(finger[..., 0].min()) + rate * value
            for finger, rate, value in zip(self.fingers, self.rates, values, strict=True)
        )
        return one, two

    def in_gripper_frame(self, centre: float) -> tuple[Floats, Floats]:
        """Triangles of finger 1 and of the mirror image of finger 2, foremost points at x = 0.

        Args:
            centre: Position of the TCP along the approach axis [m].
        """
        one, two = (
            (whole - [float(finger[..., 0].min()), self.middle, centre]) * [-1.0, 1.0, 1.0]
            for whole, finger in zip(self.whole, self.fingers, strict=True)
        )
        return one, two


def _closing_axis(hand: SlidingHand) -> str:
    """Axis from finger 1 to finger 2. Raises SettingError."""
    one, two = hand.fingers
    directions = [finger.axis / np.linalg.norm(finger.axis) for finger in hand.fingers]
    if abs(directions[0] @ directions[1]) < ALIGNED:
        raise SettingError(
            f"{hand.source}: {one.link} and {two.link} must move along one line, in opposite "
            f"directions; their joints {one.joint} and {two.joint} do not"
        )
    if hand.coupled is not None and hand.coupled * (one.axis @ two.axis) > 0.0:
        raise SettingError(
            f"{hand.source}: {one.link} and {two.link} must move in opposite directions; "
            f"{one.joint} and {two.joint} move them in the same direction"
        )
    between = _centre(two, middle=True) - _centre(one, middle=True)
    sign = 1.0 if between @ directions[0] >= 0.0 else -1.0
    for name, axis in UNIT.items():
        if sign * directions[0] @ axis > ALIGNED:
            return name
    raise SettingError(
        f"{hand.source}: the fingers must move along an axis of the frame of {hand.link}, the link "
        "that carries them; turn that frame, or describe the gripper in a JSON file"
    )


def _centre(finger: SlidingFinger, *, middle: bool) -> Floats:
    """Centre of a finger's bounding box, in the middle of its limits or at 0."""
    points = finger.triangles.reshape(-1, 3)
    value = 0.5 * sum(finger.limits) if middle else 0.0
    return np.asarray(0.5 * (points.min(axis=0) + points.max(axis=0)) + value * finger.axis)


def _approach_axis(hand: SlidingHand, closing: str) -> str:
    """Axis from the palm to the fingers' ends."""
    fingers = np.mean([_centre(finger, middle=False) for finger in hand.fingers], axis=0)
    palm = 0.5 * (hand.palm.min(axis=0) + hand.palm.max(axis=0))
    across = [name for name in AXES if name[-1] != closing[-1]]
    return max(across, key=lambda name: float(UNIT[name] @ (fingers - palm)))


def _gripper(view: _View, tcp: float | None) -> ParallelGripper:
    narrow, wide = _openings(view)
    pads = [_pad(finger, view) for finger in view.fingers]
    centre = _centre_of_pads(view, pads, tcp)
    _check_on_axis(view)
    palm_thickness, palm_width = _palm_sizes(view)
    lengths = {
        "min_opening": narrow,
        "max_opening": wide,
        "finger_thickness": max(float(np.ptp(finger[..., 0])) for finger in view.fingers),
        "finger_width": view.width,
        "finger_length": view.end - view.front,
        "pad_width": min(float(np.ptp(pad[:, 0])) for pad in pads),
        "pad_height": 2.0 * (view.end - centre),
        "palm_thickness": max(palm_thickness, wide),
        "palm_width": palm_width,
        "palm_length": view.front - float(view.palm[:, 2].min()),
        "base_to_tcp": centre,
    }
    rounded: dict[str, Any] = {name: round(length, DIGITS) for name, length in lengths.items()}
    return ParallelGripper(
        name=view.hand.link,
        **rounded,
        base_axes=view.axes,
        **_inner_side(view, rounded),
        **_joints(view, narrow, wide),
    )


def _inner_side(view: _View, lengths: dict[str, float]) -> dict[str, Any]:
    """What jaws touch with, and where it is read from."""
    fingers = view.in_gripper_frame(lengths["base_to_tcp"])
    faces = inner_faces(
        fingers,
        front=view.front - lengths["base_to_tcp"],
        pad=(lengths["pad_width"], lengths["pad_height"]),
    )
    thickness, whole = max(map(thickness_at_tcp, fingers)), lengths["finger_thickness"]
    one, two = view.hand.fingers
    file = Path(view.hand.source).name
    differ = "; their inner sides differ: flat pads alone" if faces is None else ""
    return {
        "inner_faces": faces or (),
        "tip_thickness": thickness if 0.0 < thickness < whole - SAME else None,
        "source": f"boxes around {one.link}, {two.link} and the palm of {file}{differ}",
    }


def _openings(view: _View) -> tuple[float, float]:
    """Smallest and largest opening. Raises SettingError."""
    narrow, wide = sum(view.inner_sides(view.closed)), sum(view.inner_sides(view.open))
    one, two = view.hand.fingers
    where = f"{view.hand.source}: {one.link} and {two.link}"
    if narrow < -OVERLAP:
        raise SettingError(
            f"{where} overlap by {-1e3 * narrow:.3g} mm when they are closed; do {one.joint} and "
            f"{two.joint} move in opposite directions, with the right limits?"
        )
    if not wide > max(narrow, 0.0):
        raise SettingError(f"{where} do not open; check the limits of {one.joint} and {two.joint}")
    # Geometry that overlaps a little is thicker than the finger: it touches when it is closed.
    return max(narrow, 0.0), wide - min(narrow, 0.0)


def _joints(view: _View, narrow: float, wide: float) -> dict[str, Any]:
    scales = [
        (opened - closed) / (wide - narrow)
        for opened, closed in zip(view.open, view.closed, strict=True)
    ]
    closed = (value - scale * narrow for value, scale in zip(view.closed, scales, strict=True))
    return {
        "joint_names": tuple(finger.joint for finger in view.hand.fingers),
        "joint_scale": tuple(round(scale, DIGITS) for scale in scales),
        "joint_closed": tuple(round(value, DIGITS) for value in closed),
    }


def _pad(finger: Floats, view: _View) -> Floats:
    """Extent of the flat part of a finger's inner side: least and largest (y, z), shape (2, 2)."""
    near = finger[..., 0].min() + FLATNESS
    flat = finger[(finger[..., 0] <= near).all(axis=1)]
    if not (len(flat) and np.ptp(flat[..., 1]) > 0.0):
        raise SettingError(
            f"{view.hand.source}: the fingers have no flat inner sides beyond the palm; name the "
            "link of the palm (--palm), or describe the gripper in a JSON file"
        )
    points = flat.reshape(-1, 3)[:, 1:]
    low, high = points.min(axis=0), points.max(axis=0)
    return np.stack([np.maximum(low, [-np.inf, view.front]), high])


def _centre_of_pads(view: _View, pads: Sequence[Floats], tcp: float | None) -> float:
    """Position of the TCP along the approach axis. Raises SettingError."""
    centre = max(float(pad[:, 1].mean()) for pad in pads) if tcp is None else tcp
    least = 0.5 * (view.front + view.end)
    if not least <= centre < view.end:
        what = "the pads' middle is at" if tcp is None else "got"
        raise SettingError(
            f"{view.hand.source}: the TCP must be in the outer half of the fingers, from "
            f"{least:.4g} to {view.end:.4g} m along {view.axes[1]} of {view.hand.link}; {what} "
            f"{centre:.4g} (--tcp)"
        )
    return centre


def _check_on_axis(view: _View) -> None:
    """Refuse a hand whose TCP is beside the approach axis of its frame."""
    one, two = view.inner_sides(view.open)
    beside = math.hypot(0.5 * (two - one), view.middle)
    if beside > OFF_AXIS:
        raise SettingError(
            f"{view.hand.source}: the fingers must be symmetric about the axis {view.axes[1]} of "
            f"{view.hand.link}; their middle is {1e3 * beside:.3g} mm beside it: move that frame, "
            "or describe the gripper in a JSON file"
        )


def _palm_sizes(view: _View) -> tuple[float, float]:
    """Sizes of the palm along the closing axis and across, with the fingers' parts beside it."""
    thickness = 2.0 * float(np.abs(view.palm[:, 0]).max())
    width = 2.0 * float(np.abs(view.palm[:, 1] - view.middle).max())
    for finger, rate, value in zip(view.whole, view.rates, view.open, strict=True):
        beside = finger[finger[..., 2].min(axis=1) < view.front].reshape(-1, 3)
        if len(beside):
            thickness = max(thickness, 2.0 * (float(beside[:, 0].max()) + rate * value))
            width = max(width, 2.0 * float(np.abs(beside[:, 1] - view.middle).max()))
    return thickness, width
