"""Rays from the vertices of a surface, and the grasps at their crossings with it."""

from typing import Any

import numpy as np

from grasp3d._kernels.search.antipodal_candidates import BestPairs, PairLimits
from grasp3d._kernels.search.rays import Rays, evaluate_crossings, write_rays
from grasp3d._kernels.surface.surface_contacts import ContactNormals, Surface
from grasp3d.arrays import Ints
from grasp3d.mesh.ray_tracing import FaceRays, Singles

BESIDE = 1e-5
"""Distance from a vertex, in object sizes, within which a face is one of those around it."""


class SurfaceRays(FaceRays):
    """Traces rays away from vertices and evaluates the grasps at the surface that they meet.

    Args:
        surface: The surface.
        sets: The normals of its vertices.
        allowed: Faces where opposing contacts may be.
    """

    def __init__(self, surface: Surface, sets: ContactNormals, allowed: Ints) -> None:
        super().__init__(surface.points, surface.faces)
        self._surface = surface
        self._sets = sets
        self._excluded = np.append(~np.isin(np.arange(len(surface.faces)), allowed), False)

    def evaluate_all(self, rays: Rays, limits: PairLimits, grasps: BestPairs) -> int:
        """Follow every ray to the surface and keep each vertex's best grasps.

        Args:
            rays: The rays; modified.
            limits: Openings in the normalised frame.
            grasps: The best grasps so far; modified.

        Returns:
            Number of rays traced, those continued at their vertex included.
        """
        count = len(rays.owner)
        origins = np.empty((count, 3), dtype=np.float32)
        directions = np.empty((count, 3), dtype=np.float32)
        traced = 0
        while count:
            traced += count
            write_rays(count, rays, self._surface.points, origins, directions)
            faces, far = self._met(origins[:count], directions[:count], rays)
            count = evaluate_crossings(
                count, faces, far, rays, self._surface, self._sets, limits, grasps
            )
        return traced

    def _met(self, origins: Singles, directions: Singles, rays: Rays) -> tuple[Any, Any]:
        """Face that each ray meets first, -1: none, and its distance.

        An excluded face is in the way, unless it is at the vertex.
        """
        faces, far = self.hits(origins, directions)
        excluded, count = self._excluded[faces], len(faces)
        beside = excluded & (rays.along[:count] + far < BESIDE)  # the ray goes on
        rays.last[:count][beside] = faces[beside]
        return np.where(excluded & ~beside, np.int32(-1), faces), far
