"""Grasps of the vertices of one surface from two searches: of each vertex the better ones."""

from dataclasses import fields, replace

import numpy as np

from grasp3d.arrays import Bools, Bytes, locked
from grasp3d.hand.reach import Reach
from grasp3d.mesh.surface_points import SurfacePoints
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.surface.vertex_grasps import Reason

TIE = 1e-9
"""Difference of located angles up to which a grasp is kept [rad]."""


def with_more_margin(labels: SurfaceLabels, other: SurfaceLabels) -> SurfaceLabels:
    """Known grasps, or those of a search by margin where they have more of it.

    Over the best normals it is those with the smallest located angle, which alone decides whether
    the vertex is U: so a search by margin makes none U that the known grasps leave M. Known grasps
    stay where the best normals of one search would have a larger angle than the worst ones of the
    other.

    Args:
        labels: Grasps with the smallest critical angles.
        other: Grasps with the largest margins that were found, for the same model.
    """
    worst, best = (
        found < known - TIE
        for found, known in zip(other.located_angles, labels.located_angles, strict=True)
    )
    best |= (labels.reason != Reason.FOUND) & worst
    angles = np.where(worst, other.critical_angle, labels.critical_angle)
    in_order = np.where(best, other.critical_angle_best, labels.critical_angle_best) <= angles
    worst, best = worst & in_order, best & in_order
    return merged(
        labels, other, worst=worst, best=best,
        reason=np.where(worst, other.reason, labels.reason),
    )  # fmt: skip


def merged(
    one: SurfaceLabels, other: SurfaceLabels, *, worst: Bools, best: Bools, reason: Bytes
) -> SurfaceLabels:
    """Labels with the grasps of another search where masks are set.

    Args:
        one: The grasps.
        other: Grasps on the same mesh, whose model, settings and search the result has.
        worst: Vertices whose grasp over the worst normals is from `other` (V,).
        best: Vertices whose grasp over the best normals is from `other` (V,).
        reason: `Reason` codes of the result (V,).
    """
    from_other = np.stack([worst, best], axis=1)  # (V, 2): both grasps of a vertex
    points, others = one.partner_points, other.partner_points
    return SurfaceLabels.of_vertices(
        other.mesh,
        other.model,
        angles=(
            np.where(worst, other.critical_angle, one.critical_angle),
            np.where(best, other.critical_angle_best, one.critical_angle_best),
        ),
        partners=np.where(worst[:, None, None], other.partners, one.partners),
        partner_points=SurfacePoints(
            np.where(from_other[..., None], others.faces, points.faces),
            np.where(from_other[..., None, None], others.weights, points.weights),
        ),
        grip=np.where(worst, other.grip, one.grip),
        reason=reason,
        reach=_chosen_reach(worst, other.reach, one.reach),
        sampling=other.sampling,
        mode=other.mode,
        search=other.search,
        scene=other.scene,
        load=other.load,
    )


def _chosen_reach(which: Bools, other: Reach | None, one: Reach | None) -> Reach | None:
    """Rows of the other poses where `which`, else of the first ones."""
    if other is None or one is None:
        return other
    rows = {}
    for field in fields(Reach):
        first, second = getattr(other, field.name), getattr(one, field.name)
        rows[field.name] = locked(
            np.where(which.reshape(-1, *[1] * (first.ndim - 1)), first, second)
        )
    return replace(other, **rows)
