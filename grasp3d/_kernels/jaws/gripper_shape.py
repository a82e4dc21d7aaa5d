"""What a grasp is tested against: the gripper's shape, limits of the approach, scratch arrays.

Lengths are in the surface's normalised frame (centred, size 1).
"""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from grasp3d._kernels.surface.face_tree import STACK

TOUCHING = 1e-9
"""Overlap that counts as touching, which is free."""

REACHED, WIDTH, TIP, DIRECTION, TABLE, BLOCKED = range(6)
"""Results of a test: reached, or why not."""

FINGER_1, FINGER_2, PALM, TIP_1, TIP_2 = range(5)
PARTS = 5
"""Parts of a gripper: rows of `ReachWorkspace.parts`."""

LOW, HIGH, HALF_WIDTH, BOTTOM, TOP, AXIS, OUTER_AXIS = range(7)
"""Columns of `ReachWorkspace.parts`; HIGH below LOW: the part is left out."""

NO_GRASP = 6
"""There is no grasp that could be tested."""

MARGIN, OPENING, PREGRASP, DEPTH, RESULTS = 16, 17, 18, 19, 20
"""Entries of a result behind the 4x4 pose, row by row; and their number."""


class GripperShape(NamedTuple):
    """Lengths of a `ParallelGripper`, in object sizes."""

    min_opening: float
    max_opening: float
    finger_thickness: float
    finger_width: float
    finger_length: float
    pad_height: float
    """Size of a flat pad along z; 0: round tips."""
    tip_radius: float
    """Radius of round tips; 0: flat pads."""
    palm_thickness: float
    palm_width: float
    palm_length: float
    compliance: float
    clearance: float


class ApproachLimits(NamedTuple):
    """What else limits the approach: allowed directions, and a table."""

    direction: npt.NDArray[np.float64]
    """Preferred approach direction, zero: none (3,)."""
    least_cosine: float
    """Least cosine of the angle between it and an approach direction; below -1: any."""
    table_normal: npt.NDArray[np.float64]
    """Unit vector out of the table (3,)."""
    table_offset: float
    """Height of the table along it; -inf: there is none."""


class ReachWorkspace(NamedTuple):
    """Scratch arrays of one thread, for a number n of approach angles."""

    cosines: npt.NDArray[np.float64]
    """Of the approach angles (n,)."""
    sines: npt.NDArray[np.float64]
    frame: npt.NDArray[np.float64]
    """Origin midway between the contacts, x, and y and z at angle 0 (4, 3)."""
    y_sizes: npt.NDArray[np.float64]
    """Absolute components of y at each angle (3, n)."""
    z_sizes: npt.NDArray[np.float64]
    """Absolute components of z at each angle (3, n)."""
    parts: npt.NDArray[np.float64]
    """Of each part: from LOW to HIGH along x, from -HALF_WIDTH to HALF_WIDTH along y, from BOTTOM
    to TOP along z; of round tips also the x of their axis at the grasp and before it (PARTS, 7)."""
    clipped: npt.NDArray[np.float64]
    """A face between the planes of a part, as x, y and z at angle 0 (8, 3)."""
    clipped_too: npt.NDArray[np.float64]
    """A second one (8, 3)."""
    corners: npt.NDArray[np.float64]
    """A face as x, y and z at angle 0 (3, 3)."""
    recent: npt.NDArray[np.int64]
    """Node of the tree that blocked each angle last, -1: none, with a part but the palm and with
    the palm (2, n): a workspace belongs to one tree."""
    nodes: npt.NDArray[np.int64]
    masks: npt.NDArray[np.uint64]
    blocked: npt.NDArray[np.uint64]
    """Masks of the angles found to be blocked, at the grasp and farther back (2,)."""


class ReachResults(NamedTuple):
    """Results of tests, a row per grasp; written in place."""

    codes: npt.NDArray[np.uint8]
    """REACHED, why not, or NO_GRASP (n,)."""
    free: npt.NDArray[np.uint64]
    """Mask of the free angles (n,)."""
    found: npt.NDArray[np.float64]
    """Where reached, else nan (n, RESULTS)."""


def no_results(count: int) -> ReachResults:
    """Results before any test."""
    return ReachResults(
        codes=np.full(count, NO_GRASP, dtype=np.uint8),
        free=np.zeros(count, dtype=np.uint64),
        found=np.full((count, RESULTS), math.nan),
    )


def make_workspace(angles: int) -> ReachWorkspace:
    """Allocate the scratch arrays for a number of approach angles, at most 64."""
    turns = 2.0 * math.pi * np.arange(angles) / angles
    return ReachWorkspace(
        cosines=np.cos(turns),
        sines=np.sin(turns),
        frame=np.zeros((4, 3)),
        y_sizes=np.zeros((3, angles)),
        z_sizes=np.zeros((3, angles)),
        parts=np.zeros((PARTS, 7)),
        clipped=np.zeros((8, 3)),
        clipped_too=np.zeros((8, 3)),
        corners=np.zeros((3, 3)),
        recent=np.full((2, angles), -1, dtype=np.int64),
        nodes=np.zeros(STACK, dtype=np.int64),
        masks=np.zeros(STACK, dtype=np.uint64),
        blocked=np.zeros(2, dtype=np.uint64),
    )
