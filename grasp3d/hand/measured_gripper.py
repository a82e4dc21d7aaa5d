"""Measure a parallel gripper in a robot's description: boxes around sliding fingers and palm.

Both fingers must slide along one axis of the frame of the link that carries them, which is the
hand's own frame. The approach axis is the axis of this frame, perpendicular to the sliding axis,
that points best from the palm to the fingers. The stroke is the distance between the inner sides at
the limits of the joints; closed fingers that overlap by up to 2 mm count as touching. Boxes are
placed symmetrically about the TCP and have the larger size of the two sides. Parts of the open
fingers that lie beside the palm belong to the palm.

The gripper's `source` lists what is assumed.
"""

import math
from itertools import combinations
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from grasp3d.arrays import Floats
from grasp3d.hand.choices import AXES
from grasp3d.hand.link_tree import Joint, LinkTree
from grasp3d.hand.parallel_gripper import PRESETS, ParallelGripper

FLATNESS = 0.0005
"""Distance from the contact plane up to which the inner side of a finger is its pad [m]."""

OVERLAP = 0.002
"""Largest overlap of closed fingers, from inexact geometry [m]."""

ALIGNED = 0.9998
"""Least cosine of the angle between directions that count as the same (about 1 degree)."""

OFF_AXIS = 0.001
"""Largest distance of the TCP from the approach axis of the hand's frame [m]."""

DIGITS = 9
"""Decimals of lengths [m] that are kept, few enough to remove rounding errors."""

ALIKE = 0.05
"""Relative difference in travel up to which a joint counts as that of a preset."""

NAME_PALM, DESCRIBE = "name the link of the palm (--palm)", "describe the gripper in a JSON file"

UNIT = {name: np.array(axis) for name, axis in AXES.items()}


class _Finger(NamedTuple):
    link: str
    joint: Joint
    axis: Floats
    """Movement per unit of the joint's value, in the hand's frame, shape (3,)."""
    limits: tuple[float, float]
    triangles: Floats
    """Corners of its geometry in the hand's frame where the joint is at 0 [m], shape (n, 3, 3)."""


def sliding_fingers(tree: LinkTree) -> tuple[str, str] | None:
    """The only two links that slide on one rigid body; None unless there is one such pair."""
    sliding = [(link, one.parent) for link, one in tree.joints.items() if one.kind == "slides"]
    pairs = [
        (one, two)
        for (one, carrier), (two, other) in combinations(sliding, 2)
        if other in tree.rigid(carrier)
    ]
    return pairs[0] if len(pairs) == 1 else None


def turning_preset(tree: LinkTree) -> ParallelGripper | None:
    """The preset with turning fingers whose joint a description has; None if there is none."""
    turning = [joint for joint in tree.joints.values() if joint.kind == "turns"]
    for gripper in PRESETS.values():
        for name, scale in zip(gripper.joint_names, gripper.joint_scale, strict=True):
            travel = abs(scale) * (gripper.max_opening - gripper.min_opening)
            for joint in turning:
                off = abs(joint.limits[1] - joint.limits[0] - travel)
                if joint.name.endswith(name) and off <= ALIKE * travel:
                    return gripper
    return None


def measured_gripper(
    tree: LinkTree, fingers: tuple[str, str], palm: str | None = None, tcp: float | None = None
) -> ParallelGripper:
    """Measure a gripper.

    Args:
        tree: Links and joints.
        fingers: Names of the fingers' links.
        palm: Name of the palm's link; None: the link that carries the fingers.
        tcp: Distance from the origin of the hand's frame to the TCP, along the approach axis [m];
            None: that of a link whose name ends with tcp, or else of the middle of the flat pads.

    Raises:
        SettingError: A link does not exist; the fingers do not slide, do not open, or end behind
            the front of the palm; or they do not slide along an axis of the hand's frame.
    """
    tree.check_links([*fingers, *([] if palm is None else [palm])])
    movers = [_mover(tree, link) for link in fingers]
    carrier = tree.joints[movers[0]].parent
    around = tree.rigid(carrier)
    if movers[0] == movers[1] or tree.joints[movers[1]].parent not in around:
        raise tree.error(f"the joints of {' and '.join(fingers)} must be two on one link")
    if palm is not None and palm not in around:
        raise tree.error(f"{palm} is not fixed to {carrier}, which carries the fingers")
    # Without `palm`, only links below the carrier count: the robot's arm may be above it.
    body = tree.triangles({link: around[link] for link in tree.below(palm or carrier)})
    if not len(body):
        what = palm or f"{carrier}, which carries the fingers,"
        raise tree.error(f"{what} has no collision geometry; {NAME_PALM}")
    parts = [_finger(tree, *one, around) for one in zip(fingers, movers, strict=True)]
    closing = _closing_axis(tree, carrier, *parts)
    middle = np.mean([_centre(part.triangles) for part in parts], axis=0) - _centre(body)
    across = [name for name in AXES if name[-1] != closing[-1]]
    approach = max(across, key=lambda name: float(UNIT[name] @ middle))
    tcps = {"": tcp} if tcp is not None else {
        link: float(pose[:3, 3] @ UNIT[approach])
        for link, pose in around.items() if link.lower().endswith("tcp")
    }  # fmt: skip
    numbers, at = _sizes(tree, parts, body, (closing, approach), tcps)
    assumed = [
        "the inner sides are flat, and nothing else of a finger touches",
        *([f"the TCP is {at}"] if at else []),
        "the palm is at least as wide as the stroke",
        "compliance and clearance are the defaults, the force is not known",
    ]
    where = f"boxes around {fingers[0]}, {fingers[1]} and the palm of {Path(tree.source).name}"
    source = f"{where}; assumed: {'; '.join(assumed)}"
    return ParallelGripper(name=carrier, base_axes=(closing, approach), **numbers, source=source)


def _mover(tree: LinkTree, link: str) -> str:
    """The link, a finger's or one above it, that a sliding joint moves. Raises SettingError."""
    for name in tree.chain(link)[:-1]:
        joint = tree.joints[name]
        if joint.kind in {"turns", "free"}:
            raise tree.error(
                f"joint {joint.name} turns {link}; only fingers that slide can be measured: take a "
                f"preset, or {DESCRIBE}"
            )
        if joint.kind == "slides":
            return name
    raise tree.error(f"no joint moves {link}; name the links of the fingers")


def _finger(tree: LinkTree, link: str, mover: str, around: dict[str, Floats]) -> _Finger:
    joint = tree.joints[mover]
    name, factor, offset = tree.source_of(joint)
    low, high = sorted(factor * limit + offset for limit in tree.by_name[name].limits)
    if not 0.0 < high - low < math.inf:
        raise tree.error(f"joint {joint.name} has no limits, from which the stroke follows")
    pose = around[joint.parent] @ joint.origin
    triangles = tree.triangles({one: pose @ to for one, to in tree.below(mover).items()})
    if not len(triangles):
        raise tree.error(f"{link} has no collision geometry")
    return _Finger(link, joint, pose[:3, :3] @ joint.axis, (low, high), triangles)


def _centre(triangles: Floats) -> Floats:
    points = triangles.reshape(-1, 3)
    return np.asarray(0.5 * (points.min(axis=0) + points.max(axis=0)))


def _closing_axis(tree: LinkTree, carrier: str, one: _Finger, two: _Finger) -> str:
    """Axis from finger 1 to finger 2. Raises SettingError."""
    along, names = one.axis @ two.axis, f"{one.joint.name} and {two.joint.name}"
    sources = [tree.source_of(finger.joint) for finger in (one, two)]
    together = sources[0][0] == sources[1][0] and sources[0][1] * sources[1][1] * along > 0.0
    if abs(along) < ALIGNED or together:
        raise tree.error(
            f"{one.link} and {two.link} must move along one line, in opposite directions; {names} "
            f"move them {'in the same direction' if together else 'otherwise'}"
        )
    ends = [_centre(part.triangles) + 0.5 * sum(part.limits) * part.axis for part in (one, two)]
    direction = one.axis if (ends[1] - ends[0]) @ one.axis >= 0.0 else -one.axis
    name = max(UNIT, key=lambda axis: float(direction @ UNIT[axis]))
    if direction @ UNIT[name] <= ALIGNED:
        raise tree.error(
            f"the fingers must move along an axis of the frame of {carrier}, the link that carries "
            f"them; turn that frame, or {DESCRIBE}"
        )
    return name


def _sizes(
    tree: LinkTree, parts: list[_Finger], body: Floats, axes: tuple[str, str], tcp: dict[str, float]
) -> tuple[dict[str, Any], str]:
    """Fields of a gripper for lengths [m] and joints, and where its TCP is. Raises SettingError.

    Args:
        tree: Links and joints.
        parts: The fingers.
        body: Corners of the palm in the hand's frame [m], shape (n, 3, 3).
        axes: Closing and approach axis.
        tcp: Candidates for its position along the approach axis [m], by link; "" for a stated one.
    """
    x, z = UNIT[axes[0]], UNIT[axes[1]]
    frame = np.stack([x, np.cross(z, x), z])
    palm = body.reshape(-1, 3) @ frame.T
    front = float(palm[:, 2].max())
    # Finger 1 is mirrored, so that both fingers are at positive x and open along x.
    sides = np.array([-1.0, 1.0])
    whole = [parts[k].triangles @ frame.T * [sides[k], 1.0, 1.0] for k in (0, 1)]
    rates = sides * [part.axis @ x for part in parts]
    ends = np.array([part.limits for part in parts])  # a row per finger: closed, open
    ends[rates < 0.0] = ends[rates < 0.0, ::-1]
    fingers = [one[one[..., 2].max(axis=1) > front] for one in whole]
    if not all(map(len, fingers)):
        raise tree.error(f"the fingers end behind the front of the palm; {NAME_PALM}")
    inner = np.array([one[..., 0].min() for one in fingers])
    closed, opened = (inner + rates * ends[:, k] for k in (0, 1))
    narrow, wide = float(closed.sum()), float(opened.sum())
    names, where = [part.joint.name for part in parts], " and ".join(part.link for part in parts)
    if narrow < -OVERLAP or wide <= max(narrow, 0.0):
        raise tree.error(
            f"{where} are {1e3 * narrow:.3g} mm apart when they are closed, {1e3 * wide:.3g} mm "
            f"when open; do {' and '.join(names)} move apart, within the right limits?"
        )
    # A small overlap comes from geometry thicker than the finger: closed fingers touch.
    narrow, wide = max(narrow, 0.0), wide - min(narrow, 0.0)
    points = np.concatenate(fingers).reshape(-1, 3)
    middle, end = 0.5 * float(points[:, 1].min() + points[:, 1].max()), float(points[:, 2].max())
    if (away := math.hypot(0.5 * (opened[1] - opened[0]), middle)) > OFF_AXIS:
        raise tree.error(
            f"the fingers must be symmetric about the axis {axes[1]} of the link that carries them;"
            f" their middle is {1e3 * away:.3g} mm beside it: move that frame, or {DESCRIBE}"
        )
    pads = [_pad(tree, one, front) for one in fingers]
    least = 0.5 * (front + end)
    at, centre = "in the middle of their flat parts", max(float(pad[:, 1].mean()) for pad in pads)
    for link, one in tcp.items():
        if not link or least <= one < end:
            at, centre = f"the link {link}" if link else "", one
            break
    if not least <= centre < end:
        what = "the pads' middle is at" if at else "got"
        raise tree.error(
            f"the TCP must be in the outer half of the fingers, from {least:.4g} to "
            f"{end:.4g} m along {axes[1]}; {what} {centre:.4g} (--tcp)"
        )
    moved = [whole[k] + [rates[k] * ends[k, 1], 0.0, 0.0] for k in (0, 1)]
    beside = [one[one[..., 2].min(axis=1) < front].reshape(-1, 3) for one in moved]
    around = np.abs(np.concatenate([palm, *beside]) - [0.0, middle, 0.0])
    scales = (ends[:, 1] - ends[:, 0]) / (wide - narrow)
    half, top = 0.5 * min(float(np.ptp(pad[:, 0])) for pad in pads), end - centre
    low = max(float(pad[0, 1]) for pad in pads) - centre
    low, high = round(low, DIGITS), round(top, DIGITS)
    face = (0.0, -half, low), (0.0, half, low), (0.0, half, high), (0.0, -half, high)
    lengths = {
        "min_opening": narrow,
        "max_opening": wide,
        "finger_thickness": max(float(np.ptp(one[..., 0])) for one in fingers),
        "finger_width": float(np.ptp(points[:, 1])),
        "finger_length": end - front,
        "pad_width": 2.0 * half,
        "pad_height": 2.0 * top,
        "palm_thickness": max(2.0 * float(around[:, 0].max()), wide),
        "palm_width": 2.0 * float(around[:, 1].max()),
        "palm_length": front - float(palm[:, 2].min()),
        "base_to_tcp": centre,
    }
    numbers = {
        **{name: round(length, DIGITS) for name, length in lengths.items()},
        "inner_faces": (face,) if low < -top - OVERLAP else (),
        "joint_names": tuple(names),
        "joint_scale": tuple(scales.round(DIGITS).tolist()),
        "joint_closed": tuple((ends[:, 0] - scales * narrow).round(DIGITS).tolist()),
    }
    return numbers, at


def _pad(tree: LinkTree, finger: Floats, front: float) -> Floats:
    """Least and largest (y, z) of the flat part of a finger's inner side, shape (2, 2)."""
    flat = finger[(finger[..., 0] <= finger[..., 0].min() + FLATNESS).all(axis=1)]
    if not (len(flat) and np.ptp(flat[..., 1]) > 0.0):
        raise tree.error(
            f"the fingers have no flat inner sides beyond the palm; {NAME_PALM}, or {DESCRIBE}"
        )
    points = flat.reshape(-1, 3)[:, 1:]
    return np.stack([np.maximum(points.min(axis=0), [-np.inf, front]), points.max(axis=0)])
