"""Grasps whose outcome differs most from what their margin predicts, and likely causes in words."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from grasp3d.arrays import Floats, locked, short_repr
from grasp3d.grasps.evaluated_poses import EvaluatedPoses
from grasp3d.hand.closed_jaws import MEANING as CLOSINGS
from grasp3d.hand.closed_jaws import Closing
from grasp3d.hand.hand import Hand
from grasp3d.hand.jaws import metres_per_unit
from grasp3d.mesh import ObjectMesh
from grasp3d.settings import GraspModel
from grasp3d.system.counts import short_number

Kind = Literal["failed", "held", "held_open"]

MEANING: dict[Kind, str] = {
    "failed": "failed, with the largest margins",
    "held": "held, with the smallest margins",
    "held_open": "held, though the jaws do not close on the mesh",
}
"""Each kind in words, as shown to users."""

SMALL_AREA = 0.05
"""Fraction of a pad's area below which a contact is small: its patch resists no rolling."""

FAR_ARM = 0.25
"""Distance of the centre of mass from the line of the contacts, in object sizes, that is far."""

TIGHT = 0.003
"""Clearance of each finger below which small errors of the pose push the object [m]."""

ROLLS = "small contact ({area}): the object can roll about it, which two points do not show"
EDGE = "small contact ({area}): an edge or corner, whose mean normal says little"
ARM = "the centre of mass is {arm} off the line of the contacts: the weight twists the object"
FORCE = "the load needs {needed} of each finger, and {available} are at hand"
CLEARANCE = (
    "the open gripper leaves {clearance} on each side: a small error of its pose pushes the object"
)
REACH = "the gripper collides, or the jaws are outside their stroke: it may not have been reached"
RESOLUTION = (
    "M, not U: at the perceived normals friction {friction} is enough; the sensor resolution takes "
    "up the margin"
)
FRICTION = "force-closed from a friction of {needed} on: the true one may be above {friction}"
CLOSING = "{closing}: pose, gripper or mesh differ from those of the attempt, or the object moved"
NONE = "no cause is visible in its numbers: dynamics, deformation, or a mesh that differs"


@dataclass(frozen=True, eq=False)
class Disagreement:
    """A grasp whose outcome differs from what its margin predicts."""

    kind: Kind
    row: int
    """Its row in the table of grasps, from 0."""
    margin: float
    """[rad]; nan: the jaws do not close."""
    hints: tuple[str, ...]
    """Likely causes, judged by its numbers."""
    mesh: ObjectMesh
    hand: Hand
    pose: Floats
    """The gripper's pose in the mesh's frame, between the contacts where the jaws close, shape
    (4, 4)."""
    opening: float
    """[mesh unit]; nan: the jaws do not close."""
    points: Floats
    """Contacts [mesh unit], shape (2, 3); nan: none."""
    normals: Floats
    """Unit normals into the object, shape (2, 3)."""

    __repr__ = short_repr


@dataclass
class Disagreements:
    """The greatest disagreements among the grasps seen so far; only these are kept."""

    most: int
    """Most disagreements of each kind."""
    greatest: dict[Kind, list[Disagreement]] = field(
        default_factory=lambda: {kind: [] for kind in MEANING}
    )

    def add(self, poses: EvaluatedPoses, scores: dict[str, Floats], first: int) -> None:
        """Add the greatest disagreements among some poses.

        Args:
            poses: Evaluated poses with outcomes.
            scores: Their scores.
            first: Row of the first pose in the table of grasps.
        """
        for kind in self.greatest:
            rows = _extreme(kind, poses, self.most)
            new = [_disagreement(kind, poses, scores, int(row), first) for row in rows]
            merged = [*self.greatest[kind], *new]
            self.greatest[kind] = sorted(merged, key=_order)[: self.most]

    def all(self) -> tuple[Disagreement, ...]:
        """All kept disagreements, the greatest of each kind first."""
        return tuple(one for kind in MEANING for one in self.greatest[kind])


def _extreme(kind: Kind, poses: EvaluatedPoses, most: int) -> list[int]:
    """Rows of the greatest disagreements of a kind, at most so many."""
    held, closed = poses.outcome == 1.0, poses.jaws.closed
    mask = {"failed": ~held & closed, "held": held & closed, "held_open": held & ~closed}[kind]
    rows = np.flatnonzero(mask)
    if kind != "held_open":
        margins = poses.margin[rows]
        # A failed grasp without margin, labelled U, is none.
        rows = rows[margins > 0.0] if kind == "failed" else rows[margins <= 0.0]
        keys = poses.margin[rows] * (-1.0 if kind == "failed" else 1.0)
        rows = rows[np.argsort(keys, kind="stable")]
    return [int(row) for row in rows[:most]]


def _order(one: Disagreement) -> tuple[float, int]:
    if one.kind == "held_open":
        return 0.0, one.row
    return (-one.margin if one.kind == "failed" else one.margin), one.row


def _disagreement(
    kind: Kind, poses: EvaluatedPoses, scores: dict[str, Floats], row: int, first: int
) -> Disagreement:
    own = {name: float(values[row]) for name, values in scores.items()}
    state, mesh, hand = Closing(int(poses.state[row])), poses.mesh, poses.hand
    holding = poses.holding
    if kind == "failed":
        available = None if holding is None else holding.available
        hints = failed_hints(own, hand, mesh.size * metres_per_unit(mesh), available)
    else:
        hints = held_hints(own, hand, poses.model, state)
    pose = poses.jaws.poses[row].copy()
    offset = float(poses.jaws.offset[row])
    pose[:3, 3] += (offset if math.isfinite(offset) else 0.0) * pose[:3, 0]
    return Disagreement(
        kind=kind,
        row=first + row,
        margin=own["margin"],
        hints=hints,
        mesh=mesh,
        hand=hand,
        pose=locked(pose),
        opening=float(poses.opening[row]),
        points=locked(poses.jaws.points[row]),
        normals=locked(poses.jaws.normals[row]),
    )


def failed_hints(
    scores: Mapping[str, float], hand: Hand, size: float, available: float | None
) -> tuple[str, ...]:
    """Why a grasp with a large margin may have failed.

    Args:
        scores: Its scores by name.
        hand: The gripper.
        size: Size of the object [m].
        available: Force at hand of each finger [N]; None: not known.
    """
    hints = []
    if is_small(scores["contact_area"], hand):
        hints.append(ROLLS.format(area=_area(scores["contact_area"])))
    if scores["center_of_mass_distance"] > FAR_ARM * size:
        arm = f"{1e3 * scores['center_of_mass_distance']:.3g} mm"
        hints.append(ARM.format(arm=arm))
    clearance = 0.5 * (hand.max_opening - scores["opening"])
    if clearance < TIGHT:
        hints.append(CLEARANCE.format(clearance=f"{1e3 * max(clearance, 0.0):.2g} mm"))
    needed = scores.get("grip_force", math.nan)
    if available is not None and needed > available:
        text = "no finite force" if math.isinf(needed) else f"{short_number(needed)} N"
        hints.append(FORCE.format(needed=text, available=f"{short_number(available)} N"))
    if not scores["reachable"]:
        hints.append(REACH)
    return tuple(hints) or (NONE,)


def held_hints(
    scores: Mapping[str, float], hand: Hand, model: GraspModel, state: Closing
) -> tuple[str, ...]:
    """Why a grasp with a small margin, or whose jaws do not close, may have held.

    Args:
        scores: Its scores by name.
        hand: The gripper.
        model: Friction and sensor resolution of the labels.
        state: What the jaws do.
    """
    if state != Closing.CLOSED:
        return (CLOSING.format(closing=CLOSINGS[state]),)
    hints = []
    if is_small(scores["contact_area"], hand):
        hints.append(EDGE.format(area=_area(scores["contact_area"])))
    angle, friction = scores["critical_angle"], f"{model.friction:.3g}"
    if angle < model.friction_angle:
        hints.append(RESOLUTION.format(friction=friction))
    elif angle < math.pi / 2.0:
        hints.append(FRICTION.format(needed=f"{math.tan(angle):.3g}", friction=friction))
    return tuple(hints) or (NONE,)


def is_small(area: float, hand: Hand) -> bool:
    """Whether a contact is small for the gripper.

    Args:
        area: The smaller touched patch [m^2].
        hand: The gripper.
    """
    return area < SMALL_AREA * hand.touch_area


def _area(area: float) -> str:
    return f"{1e6 * area:.2g} mm²"
