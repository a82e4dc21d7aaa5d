"""A gripper as bodies that collide: pads of balls that give way, rigid fingers behind, and a palm.

A pad of rubber gives way where something presses on it, and there alone. So a pad is a bed of balls
that are tangent to its face, each with its share of the pad's stiffness (a Winkler foundation): the
patch grows with the force and with the curvature of what is touched, and torsion and rolling follow
from where the balls press. Balls at the border are smaller, so that the pad ends where it ends,
with an edge as round as that of moulded rubber.

Lengths are in metres, in the gripper's frame: finger 1 closes along +x, finger 2 mirrors it.
"""

import math
from dataclasses import dataclass

import numpy as np

from grasp3d.arrays import Floats, locked, short_repr
from grasp3d.hand.closing import inner_faces
from grasp3d.hand.jaws import FLATNESS, Corners, Jaws
from grasp3d.hand.triangles import PAD_DEPTH

SPACING = 3e-3
"""Largest distance of neighbouring balls [m]."""

ROUNDEST = 6e-3
"""Largest radius of a ball [m]: the pad's face is bumpy by SPACING^2 / (8 radius), 0.2 mm."""

INSET = 1.5e-3
"""Distance of the outermost balls from the border [m]."""

PROTRUDING = 5e-4
"""How far a ball reaches past the border, behind the face [m]: pressed in by a few tenths of a
millimetre it touches up to the border."""


@dataclass(frozen=True, eq=False)
class Fingers:
    """What touches of a gripper."""

    centres: Floats
    """Centres of the balls of finger 1, with the pad's plane at x = 0, shape (k, 3)."""
    radii: Floats
    """Their radii, shape (k,)."""
    stiffness: float
    """Of each ball [N/m]."""
    torsion_radius: float
    """Largest torsional moment per normal force of a ball [m]; 0: hard."""
    solids: tuple[Floats, ...]
    """Corners of the convex rigid parts of finger 1, shape (n, 3) each."""
    palm: Floats
    """Corners of the palm, shape (8, 3)."""

    __repr__ = short_repr

    @property
    def soft(self) -> bool:
        """Whether they resist torsion about the line through their contacts."""
        return self.torsion_radius > 0.0 or len(self.radii) > 1

    @classmethod
    def of(cls, jaws: Jaws, stiffness: float, torsion_radius: float = 0.0) -> "Fingers":
        """The fingers of a gripper.

        Args:
            jaws: The gripper.
            stiffness: Of a pad, or a round tip [N/m].
            torsion_radius: Of a round tip [m]; torsion on pads follows from where they are touched.
        """
        front = jaws.end - jaws.finger_length
        palm = _box(
            (-0.5 * jaws.palm_thickness, 0.5 * jaws.palm_thickness),
            (-0.5 * jaws.palm_width, 0.5 * jaws.palm_width),
            (front - jaws.palm_length, front),
        )
        finger = (-0.5 * jaws.finger_width, 0.5 * jaws.finger_width), (front, jaws.end)
        if jaws.round_tips:
            middle, half = -jaws.tip_radius, 0.5 * jaws.finger_thickness
            solid = _box((middle - half, middle + half), *finger)
            return cls(
                locked(np.array([[middle, 0.0, 0.0]])), locked(np.array([jaws.tip_radius])),
                stiffness, torsion_radius, (locked(solid),), locked(palm),
            )  # fmt: skip
        thickness = jaws.tip_thickness or jaws.finger_thickness
        depth = PAD_DEPTH * thickness
        beds = [_bed(face, 0.5 * thickness) for face in inner_faces(jaws)]
        y, z = (_spread(-0.5 * side, 0.5 * side) for side in (jaws.pad_width, jaws.pad_height))
        if jaws.inner_faces:
            solids = tuple(_behind(face, depth, jaws) for face in jaws.inner_faces)
        else:
            solids = (_box((-jaws.finger_thickness, -depth), *finger),)
        return cls(
            locked(np.concatenate([centres for centres, _ in beds])),
            locked(np.concatenate([radii for _, radii in beds])),
            stiffness / (len(y) * len(z)),
            0.0,
            tuple(map(locked, solids)),
            locked(palm),
        )


def _box(*bounds: tuple[float, float]) -> Floats:
    """Corners of a box (8, 3)."""
    return np.stack(np.meshgrid(*bounds), axis=-1).reshape(-1, 3)


def _bed(face: Corners, largest: float) -> tuple[Floats, Floats]:
    """Centres (k, 3) and radii (k,) of balls that are tangent to a face from behind."""
    corners = np.array(face)
    plane, inward = corners[:, 1:], _inward(corners[:, 1:])
    low, high = plane.min(axis=0), plane.max(axis=0)
    axes = [_spread(one, two) for one, two in zip(low, high, strict=True)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    sides = zip(plane, inward, strict=True)
    inside = np.min([(grid - corner) @ normal for corner, normal in sides], axis=0)
    kept = inside > 0.5 * INSET
    grid, inside = grid[kept], inside[kept]
    columns = np.column_stack([np.ones(len(corners)), plane])
    slope = np.linalg.lstsq(columns, corners[:, 0])[0]  # x = a + b y + c z
    normal = np.array([1.0, -slope[1], -slope[2]]) / math.hypot(1.0, *slope[1:])
    points = np.column_stack([slope[0] + grid @ slope[1:], grid])
    radii = np.minimum(inside + PROTRUDING, min(ROUNDEST, largest))
    return points - radii[:, None] * normal, radii


def _spread(low: float, high: float) -> Floats:
    """Positions between two borders, evenly, with an inset."""
    inset = min(INSET, 0.25 * (high - low))
    return np.linspace(
        low + inset, high - inset, 1 + math.ceil((high - low - 2.0 * inset) / SPACING)
    )


def _inward(outline: Floats) -> Floats:
    """Inward unit normals (n, 2) of the sides, which begin at the corners, of a convex outline."""
    along = np.roll(outline, -1, axis=0) - outline
    x, y = outline.T
    turn = 1.0 if x @ np.roll(y, -1) > y @ np.roll(x, -1) else -1.0
    normals = turn * np.stack([-along[:, 1], along[:, 0]], axis=1)
    return np.asarray(normals / np.linalg.norm(normals, axis=1, keepdims=True))


def _behind(face: Corners, depth: float, jaws: Jaws) -> Floats:
    """Corners (2 n, 3) of the rigid part of a finger behind a face."""
    near = np.array(face) - [depth, 0.0, 0.0]
    at_pad = near[:, 0].min() > -depth - FLATNESS
    thickness = (jaws.tip_thickness if at_pad else None) or jaws.finger_thickness
    far = near.copy()
    far[:, 0] = np.minimum(-thickness, near[:, 0] - depth)
    return np.concatenate([near, far])
