"""Grasps of the vertices of a surface: why some have none, and how far they were searched for."""

from dataclasses import dataclass
from enum import IntEnum

from grasp3d._kernels.search import antipodal_candidates


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
