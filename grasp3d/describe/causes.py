"""Why there is no grasp, in words: the one table for verdicts, reports, tables and the viewer."""

import math
from enum import StrEnum

import numpy as np

from grasp3d.arrays import Bools
from grasp3d.hand.reach import Reachability
from grasp3d.stability.label import Label
from grasp3d.surface.area_statistics import vertex_weights
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.surface.vertex_grasps import Reason


class Cause(StrEnum):
    """Why there is no grasp at a point of a surface, or none that counts; the value says it."""

    NO_PARTNER = "no opposing contacts within the search cone"
    LIMITS = "too wide or too narrow for the limits of the search"
    TOO_WIDE = "too wide for the stroke"
    STROKE = "too wide or too narrow for the stroke"
    TIP = "a fingertip would touch the object elsewhere"
    DIRECTION = "no approach is within the allowed directions"
    TABLE = "the table is in the way"
    BLOCKED = "fingers or palm would touch the object"
    NOT_REACHED = "the gripper reaches none of the grasps"
    SAME_POINT = "a fixed finger is at this point"
    OFF_SURFACE = "the vertex belongs to no face"
    EXCLUDED = "outside --region"
    UNSTABLE = "the best grasp needs more friction"
    FORCE = "the force at hand does not hold the load"
    COLLIDES = "at no pose is the object held without a collision"


_STATES = {
    Reachability.TIP: Cause.TIP,
    Reachability.DIRECTION: Cause.DIRECTION,
    Reachability.TABLE: Cause.TABLE,
    Reachability.BLOCKED: Cause.BLOCKED,
}


def cause_masks(labels: SurfaceLabels) -> dict[Cause, Bools]:
    """Masks of the vertices without a grasp by cause, shape (V,) each.

    Where a gripper reaches none of a vertex's grasps, the cause is that of the best one.

    Args:
        labels: The labelled surface.
    """
    reason, reach, outside = labels.reason, labels.reach, _outside(labels)
    missed = reason == Reason.NOT_REACHED
    masks = {
        Cause.NO_PARTNER: reason == Reason.NO_PARTNER,
        outside: reason == Reason.OPENING,
        Cause.SAME_POINT: reason == Reason.SAME_POINT,
        Cause.OFF_SURFACE: reason == Reason.OFF_SURFACE,
        Cause.EXCLUDED: reason == Reason.EXCLUDED,
    }
    if reach is not None:
        masks[outside] = masks[outside] | (missed & (reach.state == Reachability.WIDTH))
        masks |= {cause: missed & (reach.state == state) for state, cause in _STATES.items()}
    others = missed & ~np.any(list(masks.values()), axis=0)
    return {**masks, Cause.NOT_REACHED: others}


def cause_at(labels: SurfaceLabels, vertex: int) -> Cause | None:
    """Why a vertex has no grasp; None: it has one.

    Args:
        labels: The labelled surface.
        vertex: Number of the vertex.
    """
    masks = cause_masks(labels).items()
    return next((cause for cause, mask in masks if mask[vertex]), None)


def cause_fractions(labels: SurfaceLabels) -> dict[Cause, float]:
    """Area fractions of what is U, by cause, the largest first; those of 0 are left out.

    They add to the fraction that is labelled U: with a load whose mass and force are known that of
    the labels with force.

    Args:
        labels: The labelled surface.

    Example:
        >>> import trimesh
        >>> import grasp3d
        >>> from grasp3d.describe import cause_fractions
        >>> box = trimesh.creation.box([0.09, 0.05, 0.03])
        >>> mesh = grasp3d.load_mesh(box, unit="m", max_edge=0.01)
        >>> labels = grasp3d.label_surface(mesh, hand=grasp3d.ParallelGripper.preset("franka"))
        >>> {str(cause): round(part, 2) for cause, part in cause_fractions(labels).items()}
        {'too wide for the stroke': 0.13, 'the best grasp needs more friction': 0.05}
    """
    masks, has_grasp = cause_masks(labels), labels.reason == Reason.FOUND
    unstable = has_grasp & (labels.label == Label.U)
    if labels.load_result is not None and (codes := labels.load_result.label) is not None:
        masks[Cause.FORCE] = has_grasp & (codes == Label.U) & ~unstable
        unstable &= codes == Label.U
    masks[Cause.UNSTABLE] = unstable
    areas = vertex_weights(labels.mesh, "area")
    fractions = {cause: float(areas[mask].sum()) for cause, mask in masks.items()}
    largest = sorted(fractions, key=lambda cause: -fractions[cause])
    return {cause: fractions[cause] for cause in largest if fractions[cause] > 0.0}


def causes_text(labels: SurfaceLabels) -> str:
    """The causes with their area fractions as one line; empty where nothing is U.

    Args:
        labels: The labelled surface.
    """
    return ", ".join(
        f"{cause} ({100.0 * part:.1f} %)" for cause, part in cause_fractions(labels).items()
    )


def _outside(labels: SurfaceLabels) -> Cause:
    """What it means that all contacts are outside the limits of the opening."""
    sampling, scene = labels.sampling, labels.scene
    lengths = () if sampling is None else sampling.lengths().values()
    if scene is None or any(0.0 < (length or 0.0) < math.inf for length in lengths):
        return Cause.LIMITS
    least, _ = scene.hand.distances()
    return Cause.STROKE if least > 0.0 else Cause.TOO_WIDE
