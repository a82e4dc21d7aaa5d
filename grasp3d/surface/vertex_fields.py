"""The fields of the vertices of a labelled surface, and the arrays of the surface itself.

Where a vertex has no grasp, a code says why.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import IntEnum
from operator import attrgetter

import numpy as np

from grasp3d._kernels.search import antipodal_candidates
from grasp3d.arrays import Bools, Bytes
from grasp3d.hand.reach import Reachability
from grasp3d.quality.grip_forces import Resistance
from grasp3d.stability.label import COLORS, GREY, Label
from grasp3d.surface.fields import (
    APPROACH_MARGIN,
    AREA,
    DECIDED,
    DEPTH,
    DOUBLE,
    EPSILONS,
    FLOAT,
    FORCES,
    KNOWN_OR_NAN,
    LENGTH,
    NORMAL,
    NORMAL_OR_NAN,
    OPENING,
    XYZ,
    Allowed,
    Array,
    Field,
    names_of,
    of_part,
)  # fmt: skip
from grasp3d.surface.grasp_table import GraspRows


class Reason(IntEnum):
    """Why a vertex has no grasp."""

    FOUND = antipodal_candidates.FOUND
    """It has a grasp."""
    NO_PARTNER = antipodal_candidates.NO_PARTNER
    """No opposing contact was found within the search cone."""
    OPENING = antipodal_candidates.OPENING
    """All opposing contacts were outside the limits of opening or distances."""
    OFF_SURFACE = 3
    """The vertex belongs to no face."""
    SAME_POINT = 4
    """A fixed finger is at the vertex."""
    NOT_REACHED = 5
    """It has grasps, but the gripper reached none of those that were tested."""
    EXCLUDED = 6
    """No contact may be there: it is outside the region."""


@dataclass(frozen=True)
class SearchReport:
    """Extent of the search for grasps."""

    cone: float
    """Largest critical friction angle that was searched for [rad]; for two fingers the half-angle
    of the cones about the inward normals that were searched."""
    rays: int = 0
    """Number of rays traced, for two fingers that expand."""
    evaluated: int = 0
    """Number of candidate grasps evaluated, for three fingers and more; for two fingers that
    squeeze, faces on which the best contact was computed."""


_COLORS = np.array([*(COLORS[label] for label in sorted(Label)), GREY], dtype=np.uint8)


def label_colors(labels: GraspRows) -> Bytes:
    """Colour of each vertex by its label, red, green, blue, shape (V, 3)."""
    region = labels.mesh.region
    codes = labels.label if region is None else np.where(region, labels.label, len(Label))
    return _COLORS[codes]


def packed_bits(bits: Bools) -> Array:
    """Rows of at most 64 bits as numbers, shape (b,), the first bit being the lowest."""
    values = np.uint64(1) << np.arange(bits.shape[1], dtype=np.uint64)
    return np.asarray((bits * values).sum(axis=1, dtype=np.uint64))


def unpacked_bits(numbers: Array, count: int) -> Bools:
    """The lowest bits of numbers as rows, shape (b, count); see `packed_bits`."""
    bits = numbers.astype(np.uint64)[:, None] >> np.arange(count, dtype=np.uint64)
    return (bits & np.uint64(1)).astype(np.bool_)


def _pose(column: int) -> Callable[[GraspRows], Array | None]:
    """Make a function that takes an axis of the gripper's poses, or their origin."""
    return lambda labels: None if labels.reach is None else labels.reach.poses[:, :3, column]


def _free_angles(labels: GraspRows) -> Array | None:
    """Free approach angles as bits; None: none were tested."""
    free = None if labels.reach is None else labels.reach.free
    return None if free is None or not free.shape[1] else packed_bits(free)


INDEX = Allowed(0)

PARTNERS = (
    Field("partners", LENGTH, ("n-1", 3), KNOWN_OR_NAN, each="partner_{}", ply=DOUBLE),
    Field("partner_normals", "", ("n-1", 3), NORMAL_OR_NAN, outward=True,
          columns=tuple(f"partner_{{}}_n{axis}" for axis in XYZ), each="partner_{}_normal"),
)  # fmt: skip
POSES = (
    Field("approach", "", (3,), KNOWN_OR_NAN, when="gripper", ply=DOUBLE),
    Field("tcp", LENGTH, (3,), KNOWN_OR_NAN, of=_pose(3), when="gripper", ply=DOUBLE),
    Field("closing", "", (3,), KNOWN_OR_NAN, of=_pose(0), when="gripper", ply=DOUBLE),
    replace(APPROACH_MARGIN, of=None),
    DEPTH,
    replace(DEPTH, name="pregrasp_opening", of=of_part("reach", "pregrasp_opening")),
)


RESTORING = (
    Field("canonical", "", (), INDEX, of=attrgetter("mesh.canonical"), kind="i8"),
    Field("partner_faces", "", ("n-1",), Allowed(-1), of=of_part("partner_points", "faces"),
          kind="i8", each="partner_{}_face"),
    Field("partner_weights", "", ("n-1", 3), KNOWN_OR_NAN, of=of_part("partner_points", "weights"),
          each="partner_{}_weight",
          columns=tuple(f"partner_{{}}_weight_{corner}" for corner in (1, 2, 3))),
    Field("lateral", "", (3,), KNOWN_OR_NAN, of=_pose(1), when="gripper"),
    replace(DEPTH, name="held_opening", ply="", of=of_part("reach", "opening")),
    Field("reach_state", kind="u1", of=of_part("reach", "state"), when="gripper",
          texts=names_of(Reachability)),
    Field("free_angles", of=_free_angles, kind="u8", when="gripper"),
    Field("resistance", of=of_part("load_result", "resistance"), kind="u1", when="load",
          texts=names_of(Resistance)),
)  # fmt: skip
"""Fields that complete the labels when they are read back."""

VERTICES = (
    Field(
        "vertices", "file unit", (3,), of=attrgetter("mesh.file_points"), columns=XYZ, ply=DOUBLE
    ),
    Field("normal", "", (3,), of=attrgetter("mesh.normals"), outward=True,
          columns=("nx", "ny", "nz"), ply=FLOAT),
    Field("color", "", (3,), of=label_colors, kind="u1", columns=("red", "green", "blue"), ply="u1",
          table=False),
    Field("area", AREA, of=attrgetter("mesh.vertex_areas"), array=False),
    *DECIDED,
    *EPSILONS,
    OPENING,
    Field("grip", "", (), NORMAL, kind="i1"),
    Field("reason", kind="u1", ply="u1", texts=names_of(Reason)),
    *PARTNERS,
    *POSES,
    *FORCES,
    *RESTORING,
)  # fmt: skip
"""Every field of a vertex, in the order of files."""

FACES = Field("faces", "", ("F", 3), INDEX, kind="i8")
CORNERS = Field("corners", "", ("F", 3), INDEX, of=attrgetter("corner_normals.corners"), kind="i8")
CORNER_NORMALS = Field(
    "corner_normals", "", ("C", 3), NORMAL, of=attrgetter("corner_normals.normals"), outward=True
)
SURFACE = (FACES, CORNERS, CORNER_NORMALS)
"""The arrays of a surface that do not belong to its vertices."""
