"""Quality measures of grasps on a surface."""

from collections.abc import Sequence

import numpy as np

from grasp3d.arrays import Floats
from grasp3d.mesh import ObjectMesh
from grasp3d.quality.measures.measuring import MetricValues, metrics
from grasp3d.settings import GraspModel
from grasp3d.surface.contacts import SurfaceContacts

EDGES = 8
"""Edges of polygonal friction cones where the model has circular ones."""

NO_NORMALS = "the normals at a contact cancel out"

LONGEST = 0.01
"""Difference of the object's two largest second moments, relative to the largest, from which one of
its principal axes is the longest."""


def surface_metrics(
    grasps: SurfaceContacts,
    model: GraspModel,
    names: str | Sequence[str] = "all",
    *,
    threads: int | None = None,
) -> MetricValues:
    """Quality measures of grasps about the mesh's centre of mass, torques divided by its scale.

    Args:
        grasps: The grasps, at their nominal normals.
        model: Friction, torsion and edges; for circular cones `EDGES`.
        names: As in `quality.metrics`.
        threads: Threads; None: one per processor.

    Returns:
        Shape (b,) each; nan where the normals at a contact cancel out.

    Raises:
        SettingError: An unknown name.
    """
    chosen = grasps.with_normals
    if not len(chosen):
        return MetricValues.undefined(names, grasps.size, NO_NORMALS)
    found = metrics(
        grasps.take(chosen).contacts(model),
        names,
        torque_scale=grasps.mesh.torque_scale,
        edges=model.edges or EDGES,
        principal_axis=longest_axis(grasps.mesh),
        threads=threads,
    )
    return found.placed(chosen, grasps.size, NO_NORMALS)


def longest_axis(mesh: ObjectMesh) -> Floats:
    """Longest principal axis of an object of uniform density, of an open surface that of its area.

    Args:
        mesh: The object.

    Returns:
        Unit direction, shape (3,); nan where no axis is clearly longest, as of a ball or a disc.
    """
    corners = (mesh.vertices[mesh.faces] - mesh.center) / mesh.size  # (F, 3, 3)
    if np.isfinite(mesh.volume):  # tetrahedra, whose fourth corner is the origin
        weights, number = np.linalg.det(corners), 4
    else:
        sides = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        weights, number = np.linalg.norm(sides, axis=1), 3
    weights = weights / weights.sum()
    sums = corners.sum(axis=1)
    centroid = weights @ sums / number  # a given centre of mass may be elsewhere
    # Second moments of a simplex are sums of products of its corners, and of their sum.
    moments = np.einsum("f,fki,fkj->ij", weights, corners, corners)
    moments += np.einsum("f,fi,fj->ij", weights, sums, sums)
    moments = moments / (number * (number + 1)) - np.outer(centroid, centroid)
    sizes, axes = np.linalg.eigh(moments)
    if sizes[2] - sizes[1] < LONGEST * sizes[2]:
        return np.full(3, np.nan)
    return np.asarray(axes[:, 2])
