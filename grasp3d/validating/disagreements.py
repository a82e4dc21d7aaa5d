"""Grasps whose outcome differs most from what their margin predicts."""

import math
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from grasp3d.arrays import Floats, locked, short_repr
from grasp3d.grasps.evaluated_poses import EvaluatedPoses
from grasp3d.hand.closed_jaws import Closing
from grasp3d.hand.metres import metres_per_unit
from grasp3d.hand.parallel_gripper import ParallelGripper
from grasp3d.mesh import ObjectMesh
from grasp3d.validating.hints import failed_hints, held_hints

Kind = Literal["failed", "held", "held_open"]

MEANING: dict[Kind, str] = {
    "failed": "failed, with the largest margins",
    "held": "held, with the smallest margins",
    "held_open": "held, though the jaws do not close on the mesh",
}
"""Each kind in words, as shown to users."""


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
    hand: ParallelGripper
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
    """Of each kind."""
    found: dict[Kind, list[Disagreement]] = field(
        default_factory=lambda: {kind: [] for kind in MEANING}
    )

    def add(self, poses: EvaluatedPoses, scores: dict[str, Floats], first: int) -> None:
        """Add those among some poses.

        Args:
            poses: Evaluated poses with outcomes.
            scores: Their scores.
            first: Row of the first pose in the table of grasps.
        """
        for kind in self.found:
            rows = _extreme(kind, poses, self.most)
            new = [_disagreement(kind, poses, scores, int(row), first) for row in rows]
            merged = [*self.found[kind], *new]
            self.found[kind] = sorted(merged, key=_order)[: self.most]

    def all(self) -> tuple[Disagreement, ...]:
        """All that are kept, the greatest of each kind first."""
        return tuple(one for kind in MEANING for one in self.found[kind])


def _extreme(kind: Kind, poses: EvaluatedPoses, most: int) -> list[int]:
    """Rows of the greatest disagreements of a kind, at most so many."""
    held, closed = poses.outcome == 1.0, poses.jaws.closed
    chosen = {"failed": ~held & closed, "held": held & closed, "held_open": held & ~closed}[kind]
    rows = np.flatnonzero(chosen)
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
