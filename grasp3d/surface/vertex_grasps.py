"""What the wrench hulls say of every vertex's best grasp.

They make the labels of the paper's method, and epsilon.
"""

import math
from dataclasses import dataclass

import numpy as np

from grasp3d.arrays import Bools, Bytes, Floats, Ints, locked
from grasp3d.mesh import ObjectMesh
from grasp3d.mesh.surface_points import SurfacePoints
from grasp3d.quality.tilting import EpsilonRange
from grasp3d.settings import GraspModel
from grasp3d.stability.label import Label
from grasp3d.surface.contacts import SurfaceContacts, vertex_surface_points
from grasp3d.surface.epsilon import surface_epsilons
from grasp3d.surface.extreme_normals import hull_labels
from grasp3d.system.progress import Progress


@dataclass(frozen=True, eq=False)
class VertexGrasps:
    """The grasps of the vertices of a surface: one finger at the vertex, the others elsewhere."""

    mesh: ObjectMesh
    partner_points: SurfacePoints
    """The other contacts of the best grasp over the worst normals, and of the best over the best,
    shape (V, 2, n - 1)."""
    found: Bools
    """Where there is a grasp, shape (V,)."""
    threads: int | None

    def hull_labels(self, model: GraspModel, progress: Progress | None) -> Bytes:
        """Labels of method extremes, shape (V,): the better of two grasps, where they differ."""
        held = np.unique(self.mesh.canonical[self.found])
        codes = np.full(len(self.mesh.vertices), Label.U, dtype=np.uint8)
        differ = held[grasps_differ(self.partner_points, held)]  # a few, at creases
        for number, (vertices, told) in enumerate(((held, progress), (differ, None))):
            labels = hull_labels(
                grasps_at(self.mesh, self.partner_points, vertices, number),
                model,
                threads=self.threads,
                progress=told,
            )
            codes[vertices] = np.maximum(codes[vertices], labels)
        return locked(codes[self.mesh.canonical])

    def epsilon_range(self, model: GraspModel, progress: Progress | None) -> EpsilonRange:
        """Epsilons of every vertex's best grasp over the worst normals, shape (V,) each."""
        canonical = self.mesh.canonical
        held = np.unique(canonical[self.found])
        grasps = grasps_at(self.mesh, self.partner_points, held, 0)
        values = np.full((3, len(canonical)), math.nan)
        found = surface_epsilons(grasps, model, threads=self.threads, progress=progress)
        values[:, held] = found.nominal, found.minimum, found.maximum
        return EpsilonRange(*(locked(row[canonical]) for row in values))


def grasps_at(
    mesh: ObjectMesh, partner_points: SurfacePoints, vertices: Ints, number: int
) -> SurfaceContacts:
    """Take the grasps of some vertices.

    Args:
        mesh: The surface.
        partner_points: The other contacts of every vertex's two grasps, shape (V, 2, n - 1).
        vertices: Which, shape (b,); each has both grasps.
        number: 0: the best grasp over the worst normals; 1: over the best.

    Returns:
        The grasps (b, n), the vertices' own contacts first.
    """
    first = vertex_surface_points(mesh, vertices)
    faces, weights = (
        partner_points.faces[vertices, number],
        partner_points.weights[vertices, number],
    )
    return SurfaceContacts(
        mesh,
        SurfacePoints(
            np.concatenate([first.faces[:, None], faces], axis=1),
            np.concatenate([first.weights[:, None], weights], axis=1),
        ),
    )


def grasps_differ(partner_points: SurfacePoints, vertices: Ints) -> Bools:
    """Where the grasp of the best normals is not that of the worst, shape (b,)."""
    faces, weights = partner_points.faces[vertices], partner_points.weights[vertices]
    same = (faces[:, 0] == faces[:, 1]) & (weights[:, 0] == weights[:, 1]).all(axis=-1)
    return np.asarray(~same.all(axis=-1))


def largest_distance(vertices: Floats, partners: Floats) -> Floats:
    """Largest distance between any two contacts of vertices' grasps.

    Args:
        vertices: The first contacts, shape (V, 3).
        partners: The others, shape (V, n - 1, 3); nan where there is no grasp.

    Returns:
        Shape (V,), in the unit of the positions.
    """
    points = np.concatenate([vertices[:, None], partners], axis=1)
    one, two = np.triu_indices(points.shape[1], 1)
    return np.asarray(np.linalg.norm(points[:, two] - points[:, one], axis=2).max(axis=1))
