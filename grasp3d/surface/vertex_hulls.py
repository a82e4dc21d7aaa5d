"""Labels and epsilon of every vertex's best grasp."""

import math

import numpy as np

from grasp3d.arrays import Bytes, locked
from grasp3d.quality.tilting import EpsilonRange
from grasp3d.settings import GraspModel
from grasp3d.stability.label import Label
from grasp3d.stability.sampled_normals import WorstAndBest
from grasp3d.stability.thresholds import label_angles
from grasp3d.surface.deferred import Deferred
from grasp3d.surface.epsilon import surface_epsilons
from grasp3d.surface.extreme_normals import hull_labels
from grasp3d.surface.vertex_grasps import VertexGrasps, grasps_at, grasps_differ
from grasp3d.system.progress import Progress, ignore


def vertex_angles(
    grasps: VertexGrasps, model: GraspModel, threads: int | None, _progress: Progress
) -> WorstAndBest:
    """Located angles of the vertices' grasps, shape (V,) each."""
    return grasps.located_angles(model, threads=threads)


def vertex_labels(
    grasps: VertexGrasps,
    model: GraspModel,
    located: Deferred[WorstAndBest],
    threads: int | None,
    progress: Progress,
) -> Bytes:
    """Label codes of the vertices by the model's method, shape (V,).

    With method extremes a vertex gets the better label of its two grasps, where they differ.
    """
    if model.method == "exact":
        return locked(label_angles(*located.value, model))
    found = grasps.vertices
    codes = np.full(len(grasps.mesh.vertices), Label.U, dtype=np.uint8)
    differing = found[grasps_differ(grasps.partner_points, found)]  # a few, at creases
    for number, (vertices, report) in enumerate(((found, progress), (differing, ignore))):
        contacts = grasps_at(grasps.mesh, grasps.partner_points, vertices, number)
        labels = hull_labels(contacts, model, threads=threads, progress=report)
        codes[vertices] = np.maximum(codes[vertices], labels)
    return locked(codes[grasps.mesh.canonical])


def vertex_epsilons(
    grasps: VertexGrasps,
    model: GraspModel,
    center_radius: float,
    threads: int | None,
    progress: Progress,
) -> EpsilonRange:
    """Epsilon of every vertex's best grasp over the worst normals, shape (V,) each.

    Args:
        grasps: The grasps.
        model: What is known about the contacts.
        center_radius: Radius of the ball in which the centre of mass lies, in the mesh's unit.
        threads: Threads; None: one per processor.
        progress: Called with the fraction of the work done, from 0 to 1.
    """
    canonical, vertices = grasps.mesh.canonical, grasps.vertices
    contacts = grasps_at(grasps.mesh, grasps.partner_points, vertices, 0)
    values = np.full((3, len(canonical)), math.nan)
    epsilons = surface_epsilons(
        contacts, model, center_radius=center_radius, threads=threads, progress=progress
    )
    values[:, vertices] = epsilons.nominal, epsilons.minimum, epsilons.maximum
    return EpsilonRange(*(locked(row[canonical]) for row in values))
