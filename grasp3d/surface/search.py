"""Search for the best grasp through every vertex, with labels as the result."""

import math
from functools import partial
from typing import Any

import numpy as np

from grasp3d.arrays import ArrayLike, Bytes, Floats, Ints
from grasp3d.hand.reach import Reach
from grasp3d.hand.scene import Scene
from grasp3d.mesh import ObjectMesh
from grasp3d.mesh.surface_points import SurfacePoints
from grasp3d.settings import GraspModel, MultifingerSampling, Sampling, search_cone
from grasp3d.surface.critical_angles import critical_angles
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.surface.merged_grasps import with_more_margin
from grasp3d.surface.sampling.antipodal import AntipodalGrasps, best_pairs
from grasp3d.surface.sampling.multifinger import search
from grasp3d.surface.sampling.pair_limits import ALIKE, Ranking
from grasp3d.surface.vertex_grasps import Reason, SearchReport, grasps_at, grasps_differ
from grasp3d.system.context import report_progress, unreported, within

BEFORE_MARGINS = 0.35
"""Fraction of the work for two fingers that the search by critical angles is expected to take,
where one by margins follows."""

BEFORE_ANGLES = 0.9
"""Fraction of the work for three fingers and more that the search is expected to take."""


def label_pairs(
    mesh: ObjectMesh,
    model: GraspModel,
    sampling: Sampling,
    scene: Scene | None,
) -> SurfaceLabels:
    """Label a surface by the best grasps with two fingers.

    Args:
        mesh: The object's surface.
        model: Friction and sensor resolution; labels are computed later.
        sampling: How grasps are searched for.
        scene: The gripper that must reach each grasp; None: ideal points.
    """
    cone, ranking = search_cone(model, sampling), Ranking.of(model)
    limited = sampling if scene is None else scene.within_stroke(mesh, sampling)
    jaws = None if scene is None or scene.jaws is None else scene
    find = partial(best_pairs, mesh, limited, cone, scene=jaws)
    other_hand = scene if jaws is None else None
    labels_of = partial(
        SurfaceLabels.of_vertices, mesh, model, sampling=sampling, mode="label", scene=scene,
    )  # fmt: skip
    alike = ranking == ALIKE
    with within(0.0, 1.0 if alike else BEFORE_MARGINS):
        found = find()
    labels = labels_of(**_pairs(mesh, found, other_hand), search=_search_report(cone, [found]))
    if alike:
        return labels
    # With larger openings or other normals, grasps may have more margin.
    with within(BEFORE_MARGINS, 1.0):
        other = find(ranking=ranking)
    with unreported():
        with_margin = labels_of(
            **_pairs(mesh, other, other_hand, are_costs=True),
            search=_search_report(cone, [found, other]),
        )
    return with_more_margin(labels, with_margin)


def _search_report(cone: float, searches: list[AntipodalGrasps]) -> SearchReport:
    return SearchReport(
        cone,
        rays=sum(one.rays for one in searches),
        evaluated=sum(one.evaluated for one in searches),
        rounds=sum(one.rounds for one in searches),
        still_falling=searches[-1].still_falling,
    )


def _pairs(
    mesh: ObjectMesh,
    found: AntipodalGrasps,
    scene: Scene | None,
    *,
    are_costs: bool = False,
) -> dict[str, Any]:
    """What `SurfaceLabels.of_vertices` takes of the grasps that a search has found.

    It may have found costs in place of critical angles. With a scene, those grasps are left out
    that its hand does not reach.
    """
    points = SurfacePoints(
        found.partner_points.faces[..., None], found.partner_points.weights[..., None, :]
    )
    angles = found.worst, found.best
    if are_costs:
        having = (found.reason == Reason.FOUND) & mesh.on_surface
        angles, points = _angles_of_pairs(mesh, points, np.unique(mesh.canonical[having]))
    reasons, reach = found.reason, found.reach
    if scene is not None:
        reasons, reach = _reach_of(mesh, points, reasons, scene, grip=found.grip)
    lost = reasons != found.reason
    return {
        "angles": tuple(np.where(lost, math.inf, angle) for angle in angles),
        "partners": np.where(lost[:, None], math.nan, found.partner)[:, None],
        "partner_points": points,
        "grip": np.where(lost, 0, found.grip),
        "reason": reasons,
        "reach": reach,
    }


def _angles_of_pairs(
    mesh: ObjectMesh, points: SurfacePoints, vertices: Ints
) -> tuple[tuple[Floats, Floats], SurfacePoints]:
    """Critical angles (V,) of the grasps of some vertices, and points of the two that have them.

    A grasp of the smallest cost over the best normals may not have the smallest angle.
    """
    worst, best, other = np.full((3, len(mesh.vertices)), math.inf)
    worst[vertices], best[vertices] = critical_angles(grasps_at(mesh, points, vertices, 0))
    other[vertices] = critical_angles(grasps_at(mesh, points, vertices, 1))[1]
    numbers = np.where(other < best, 1, 0)[mesh.canonical]
    rows = np.arange(len(numbers))
    both = SurfacePoints(
        np.stack([points.faces[:, 0], points.faces[rows, numbers]], axis=1),
        np.stack([points.weights[:, 0], points.weights[rows, numbers]], axis=1),
    )
    best = np.minimum(best, other)
    return (worst[mesh.canonical], best[mesh.canonical]), both


def label_multifinger(
    mesh: ObjectMesh,
    model: GraspModel,
    sampling: MultifingerSampling,
    scene: Scene | None,
) -> SurfaceLabels:
    """Label a surface by the best grasps with three fingers or more.

    Args:
        mesh: The object's surface.
        model: Friction and sensor resolution; labels are computed later.
        sampling: How grasps are searched for.
        scene: The hand that must reach each grasp; None: ideal points.

    Raises:
        SettingError: The mesh has fewer vertices than fingers.
    """
    cone, count = search_cone(model, sampling), len(mesh.vertices)
    with within(0.0, BEFORE_ANGLES):
        found = search(mesh, model.fingers, sampling, cone)
    points = _both_grasps(found.partner_points)
    reasons, reach = found.reason, None
    if scene is not None:
        reasons, reach = _reach_of(mesh, points, reasons, scene)
    vertices = np.unique(mesh.canonical[(reasons == Reason.FOUND) & mesh.on_surface])
    grasps = grasps_at(mesh, points, vertices, 0)
    angles = np.full((2, count), math.inf)
    with within(BEFORE_ANGLES, 1.0):
        angles[:, vertices] = critical_angles(grasps)
    differing = vertices[grasps_differ(points, vertices)]
    with unreported():
        _, best = critical_angles(grasps_at(mesh, points, differing, 1))
    angles[1, differing] = np.minimum(angles[1, differing], best)
    partners = np.full((count, model.fingers - 1, 3), math.nan)
    partners[vertices] = grasps.points[:, 1:]
    report_progress(1.0)
    report = SearchReport(
        cone, evaluated=found.evaluated, rounds=found.rounds, still_falling=found.still_falling
    )
    return SurfaceLabels.of_vertices(
        mesh,
        model,
        angles=(angles[0], angles[1]),
        partners=partners,
        partner_points=points,
        grip=0,
        reason=reasons,
        reach=reach,
        sampling=sampling,
        mode="label",
        search=report,
        scene=scene,
    )


def _reach_of(
    mesh: ObjectMesh,
    points: SurfacePoints,
    reasons: Bytes,
    scene: Scene,
    grip: ArrayLike = 1,
) -> tuple[Bytes, Reach]:
    """The reasons, and how the hand reaches each vertex's grasp."""
    tried = np.flatnonzero((reasons == Reason.FOUND) & mesh.on_surface)
    contacts = grasps_at(mesh, points, tried, 0)
    signs = np.broadcast_to(grip, len(reasons))[tried]
    reach = scene.reach(mesh, contacts.points, contacts.normals, grip=signs)
    reasons = reasons.copy()
    reasons[tried[~reach.reached]] = Reason.NOT_REACHED
    return reasons, reach.among(len(mesh.vertices), tried)


def _both_grasps(points: SurfacePoints) -> SurfacePoints:
    """Surface points (V, 2, n - 1); a vertex with one of the two grasps gets it as both."""
    missing = (points.faces < 0).any(axis=2)  # (V, 2)
    source = np.where(missing, [[1, 0]], [[0, 1]])[..., None]
    return SurfacePoints(
        np.take_along_axis(points.faces, source, axis=1),
        np.take_along_axis(points.weights, source[..., None], axis=1),
    )
