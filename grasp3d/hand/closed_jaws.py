"""What the jaws of a gripper touch when they have closed on an object."""

import math
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from grasp3d._kernels.jaws.closing import INSIDE, LEFT, TOUCHES, ClosedOn
from grasp3d._kernels.jaws.jaws import ROUNDING, Jaw
from grasp3d.arrays import Bools, Bytes, Floats, Ints, locked, short_repr
from grasp3d.mesh import ObjectMesh


class Closing(IntEnum):
    """What happens when the jaws close."""

    CLOSED = 0
    """Both jaws touch the object."""
    NOTHING = 1
    """The jaws reach their smallest opening before both touch, or neither touches at all."""
    ONE_SIDE = 2
    """Only one jaw touches."""
    STARTS_INSIDE = 3
    """A finger is in the object, or overlaps with it, before the jaws move."""
    SLIPS_OUT = 4
    """A free object slides out of the closing jaws."""


MEANING: dict[Closing, str] = {
    Closing.CLOSED: "both jaws touch the object",
    Closing.NOTHING: "the jaws close on nothing",
    Closing.ONE_SIDE: "only one jaw touches the object",
    Closing.STARTS_INSIDE: "a finger starts in the object",
    Closing.SLIPS_OUT: "the object slides out of the jaws",
}
"""Each state in words, as shown to users."""


class Touch(IntEnum):
    """What a jaw touches, and how."""

    NOTHING = 0
    """No part of the object."""
    FACE = 1
    """A patch that is wide in both directions of the pad."""
    EDGE = 2
    """A strip along the pad: an edge, or the side of a cylinder."""
    POINT = 3
    """A small patch: on a corner, or a strongly curved face."""
    PAD_RIM = 4
    """A small patch or a strip at the rim of the pad, such as a corner of the pad on a face."""


NARROW, RIM = 0.25, 1e-3
"""Fractions of the jaw's size: below the first a patch is narrow, within the second of the jaw's
bounds it is at the rim."""


@dataclass(frozen=True, eq=False)
class ClosedJaws:
    """Where the n fingers of a hand touch an object, a row for each pose.

    A parallel gripper has two, its jaws. One that touches nothing has nan, and an area of 0.
    """

    state: Bytes
    """`Closing` codes, shape (k,)."""
    poses: Floats
    """The gripper in the object's frame when the jaws are closed [m], shape (k, 4, 4): as
    given where the object is fixed; one that is free has moved relative to the gripper, whose TCP
    is then midway between the jaws."""
    points: Floats
    """Contacts, in the mesh's frame, shape (k, n, 3): of a fixed object the centroids of
    the touched patches, of a free one the centres of pressure."""
    normals: Floats
    """Unit normals into the object, means over the patches, shape (k, n, 3)."""
    opening: Floats
    """Distance of the pads, or of the nearest points of round tips, when both touch first
    [m], shape (k,); nan unless CLOSED."""
    positions: Floats
    """Where the jaws stop: x of the pads, or of the foremost points of round tips, in the frame of
    `poses` [m], shape (k, n)."""
    area: Floats
    """Areas of the touched patches [m^2], shape (k, n)."""
    extents: Floats
    """Sizes of the touched patches along y and z of the gripper [m], shape (k, n, 2)."""
    corners: Floats
    """Points of the touched patches that are farthest in eight directions of the pads, in the
    mesh's frame, shape (k, n, 8, 3): their convex hull is within that of the patch."""
    touch: Bytes
    """`Touch` codes, shape (k, n)."""
    apart: Bools
    """Whether the patches do not overlap, seen along the closing axis, as where the jaws touch at
    different heights, shape (k,)."""
    shift: Floats
    """How far the gripper moved along the closing axis, relative to the object, before the jaws
    closed, as they would have started in it [m], shape (k,)."""
    turn: Floats
    """Angle by which the object has turned relative to the gripper [rad], shape (k,); 0 where it is
    fixed or has not moved."""

    __repr__ = short_repr

    @property
    def closed(self) -> Bools:
        """Whether both jaws touch the object, shape (k,)."""
        return locked(self.state == Closing.CLOSED)

    @property
    def offset(self) -> Floats:
        """How far the middle between the jaws is from the TCP, along x [m], shape (k,).

        A rigid hand whose jaws move symmetrically pushes the object by as much, against x.
        """
        return locked(self.positions.mean(axis=1))

    def take(self, which: slice | Ints | Bools) -> "ClosedJaws":
        """The chosen poses."""
        return ClosedJaws(**{name: locked(values[which]) for name, values in vars(self).items()})


def closed_jaws(
    mesh: ObjectMesh,
    result: ClosedOn,
    start: Floats,
    jaw: Jaw,
    *,
    least: float,
    free: bool,
    shift: Floats,
) -> ClosedJaws:
    """States, and everything in the mesh's frame.

    Args:
        mesh: The object.
        result: What the kernels found, in the normalised frame.
        start: The poses before the jaws closed, in that frame, shape (k, 3, 4).
        jaw: The jaws.
        least: Smallest opening [object sizes].
        free: Whether the object is free, and contacts are centres of pressure.
        shift: As in `ClosedJaws` [m], shape (k,).
    """
    touches = result.outcome == TOUCHES
    opening = result.position[:, 1] - result.position[:, 0]
    state = _states(touches, result.outcome, opening, least)
    visible = touches & np.isin(state, (Closing.CLOSED, Closing.ONE_SIDE))[:, None]
    hidden = np.where(visible, 1.0, math.nan)
    low, high = result.bounds[..., :2], result.bounds[..., 2:]
    overlap = high.min(axis=1) - low.max(axis=1)
    points = result.points
    if free:
        points = centres_of_pressure(points, low, high, result.poses)
    return ClosedJaws(
        state=locked(state),
        poses=locked(_matrices(mesh, result.poses)),
        points=locked(mesh.from_normalized(points) * hidden[..., None]),
        normals=locked(result.normals * hidden[..., None]),
        opening=locked(np.where(state == Closing.CLOSED, opening, math.nan) * mesh.size),
        positions=locked(result.position * hidden * mesh.size),
        area=locked(np.where(visible, result.area, 0.0) * mesh.size**2),
        extents=locked(np.where(visible[..., None], high - low, 0.0) * mesh.size),
        corners=locked(mesh.from_normalized(result.corners) * hidden[..., None, None]),
        touch=locked(_touches(visible, low, high, jaw)),
        apart=locked((state == Closing.CLOSED) & (overlap < 0.0).any(axis=1)),
        shift=locked(shift),
        turn=locked(_turns(start, result.poses)),
    )


def centres_of_pressure(points: Floats, low: Floats, high: Floats, poses: Floats) -> Floats:
    """Where the jaws press on an object that is free, and in equilibrium between them.

    The forces of both jaws are opposite and on one line. Somewhere in each patch is the centre of
    its pressure, and the patch's centroid only stands for it: where the patches overlap, seen along
    the closing axis, the jaws press on one line along that axis, the one nearest to both centroids;
    else at the ends that are nearest to each other.

    Args:
        points: Centroids of the patches in the object's frame, shape (k, 2, 3).
        low: Smallest y and z of the patches in the gripper's frame, shape (k, 2, 2).
        high: Largest ones.
        poses: The gripper's frame to the object's, shape (k, 3, 4).
    """
    turned, origin = poses[:, None, :, :3], poses[:, None, :, 3]
    local = ((points - origin)[..., None, :] @ turned)[..., 0, :]
    common = local[..., 1:].mean(axis=1, keepdims=True)
    first, last = low.max(axis=1, keepdims=True), high.min(axis=1, keepdims=True)
    common = np.clip(common, np.minimum(first, last), np.maximum(first, last))
    local[..., 1:] = np.clip(common, low, high)
    return np.asarray((turned @ local[..., None])[..., 0] + origin)


def _matrices(mesh: ObjectMesh, poses: Floats) -> Floats:
    """Poses in the mesh's frame, shape (k, 4, 4)."""
    matrices = np.zeros((len(poses), 4, 4))
    matrices[:, :3, :3] = poses[..., :3]
    matrices[:, :3, 3] = mesh.from_normalized(poses[..., 3])
    matrices[:, 3, 3] = 1.0
    return matrices


def _turns(start: Floats, reached: Floats) -> Floats:
    """Angles between the rotations of poses [rad], shape (k,)."""
    # The chord keeps its digits where the angle is small.
    chords = np.linalg.norm(start[..., :3] - reached[..., :3], axis=(1, 2))
    return np.asarray(2.0 * np.arcsin(np.minimum(chords / math.sqrt(8.0), 1.0)))


def _touches(visible: Bools, low: Floats, high: Floats, jaw: Jaw) -> Bytes:
    """`Touch` codes, shape (k, 2)."""
    size = jaw.bounds[2:] - jaw.bounds[:2]
    narrow = high - low < NARROW * size  # (k, 2, 2)
    at_rim = narrow & ((low <= jaw.bounds[:2] + RIM * size) | (high >= jaw.bounds[2:] - RIM * size))
    codes = np.full(visible.shape, Touch.FACE, dtype=np.uint8)
    codes[narrow.any(axis=2)] = Touch.EDGE
    codes[narrow.all(axis=2)] = Touch.POINT
    codes[at_rim.any(axis=2)] = Touch.PAD_RIM
    codes[~visible] = Touch.NOTHING
    return codes


def _states(touches: Bools, outcome: Ints, opening: Floats, least: float) -> Bytes:
    """`Closing` codes, shape (k,)."""
    state = np.full(len(touches), Closing.NOTHING, dtype=np.uint8)
    both = touches.all(axis=1)
    state[touches.any(axis=1) & ~both] = Closing.ONE_SIDE
    state[both & (opening >= least - ROUNDING)] = Closing.CLOSED
    state[(outcome == INSIDE).any(axis=1)] = Closing.STARTS_INSIDE
    state[(outcome == LEFT).any(axis=1)] = Closing.SLIPS_OUT
    return state
