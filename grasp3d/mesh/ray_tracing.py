"""All crossings of rays with a surface: Embree finds the faces, 64 bits the positions."""

from typing import Any

import numpy as np
import numpy.typing as npt
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

from grasp3d._kernels.search.antipodal_candidates import BestPairs, PairLimits
from grasp3d._kernels.search.ray_crossings import evaluate_crossings
from grasp3d._kernels.surface.normal_sets import ContactNormals
from grasp3d._kernels.surface.ray_tracing import Rays, write_rays
from grasp3d._kernels.surface.surface_contacts import Surface
from grasp3d.arrays import Floats, Ints


class FaceRays:
    """Traces rays to the first face that each meets.

    Positions are in the normalised frame (centred, size 1), so that 32 bits of Embree resolve an
    object of any size, anywhere in space. Several threads may use one instance.
    """

    def __init__(self, points: Floats, faces: Ints) -> None:
        self._scene = EmbreeScene(robust=True)
        TriangleMesh(self._scene, points.astype(np.float32), faces.astype(np.int32))
        # The first ray makes Embree build its tree, which must not happen in two threads at once.
        self.hits(np.zeros((1, 3), np.float32), np.ones((1, 3), np.float32))

    def hits(
        self,
        origins: npt.NDArray[np.float32],
        directions: npt.NDArray[np.float32],
        lengths: npt.NDArray[np.float32] | None = None,
    ) -> dict[str, npt.NDArray[Any]]:
        """First face that each ray meets, as Embree's arrays; rays may end after `lengths`."""
        hits: dict[str, npt.NDArray[Any]] = self._scene.run(
            origins, directions, dists=lengths, output=1
        )
        return hits


class SurfaceRays(FaceRays):
    """Traces rays from vertices through a surface and evaluates the grasp at every crossing."""

    def __init__(self, surface: Surface, sets: ContactNormals) -> None:
        super().__init__(surface.points, surface.faces)
        self._surface = surface
        self._sets = sets

    def evaluate_all(self, rays: Rays, limits: PairLimits, grasps: BestPairs) -> int:
        """Follow every ray through all its crossings and keep each vertex's best grasps.

        Args:
            rays: The rays; modified.
            limits: Openings and location error in the normalised frame.
            grasps: The best grasps so far; modified.

        Returns:
            Number of rays traced, those continued behind a crossing included.
        """
        count = len(rays.owner)
        origins = np.empty((count, 3), dtype=np.float32)
        directions = np.empty((count, 3), dtype=np.float32)
        traced = 0
        while count:
            traced += count
            write_rays(count, rays, self._surface.points, origins, directions)
            hits = self.hits(origins[:count], directions[:count])
            count = evaluate_crossings(
                count, hits["primID"], hits["tfar"], rays, self._surface, self._sets, limits,
                grasps,
            )  # fmt: skip
        return traced
