"""Contacts of grasps that a file contains: their surface points are found when they are needed."""

from functools import cached_property

import numpy as np

from grasp3d.arrays import Bools, Floats, Ints, locked
from grasp3d.errors import MeshError, SettingError
from grasp3d.mesh import ObjectMesh
from grasp3d.mesh.surface_points import SurfacePoints, nearest_surface_points
from grasp3d.surface.contacts import SurfaceContacts, vertex_surface_points

OFF_SURFACE = 1e-3
"""Distance of opposing contacts from the surface, in object sizes, up to which they are on it."""


class ReadContacts(SurfaceContacts):
    """Contacts of grasps that were read: at vertices, and at given positions or unknown places."""

    def __init__(
        self, mesh: ObjectMesh, vertices: Ints, partners: Floats | None, count: int, file: str
    ) -> None:
        """Keep what was read.

        Args:
            mesh: The surface.
            vertices: The first contacts, numbers of vertices, shape (b,).
            partners: Positions of the others, shape (b, n - 1, 3); None: the file has none.
            count: Number of contacts of each grasp, n.
            file: Name of the file, for errors.
        """
        vars(self).update(
            mesh=mesh, _vertices=vertices, _partners=partners, _count=count, _file=file
        )

    def __repr__(self) -> str:
        partners = "contacts" if self.known else "first contacts alone"
        return f"<ReadContacts of {self.size:,} grasps of {self.count} fingers: {partners}>"

    @property
    def known(self) -> bool:
        """Whether all contacts are known."""
        return vars(self)["_partners"] is not None

    @property
    def size(self) -> int:
        """Number of grasps."""
        return len(vars(self)["_vertices"])

    @property
    def count(self) -> int:
        """Number of contacts of each grasp."""
        return int(vars(self)["_count"])

    @cached_property
    def surface_points(self) -> SurfacePoints:
        """Contact points on the faces, shape (b, n): vertices, and points nearest to the others.

        Raises:
            SettingError: The file does not contain the other contacts.
            MeshError: They are not on the surface.
        """
        file, partners = vars(self)["_file"], vars(self)["_partners"]
        if partners is None:
            raise SettingError(
                f"{file}: the file does not contain the opposing contacts of its grasps, which "
                "this needs; label the mesh again, and write NPZ, VTP or Parquet to keep them"
            )
        nearest, _, distances = nearest_surface_points(
            self.mesh, partners.reshape(-1, 3), limit=OFF_SURFACE * self.mesh.size
        )
        if np.isinf(distances).any():
            raise MeshError(f"{file}: opposing contacts are not on its surface; label it again")
        first, shape = vertex_surface_points(self.mesh, vars(self)["_vertices"]), partners.shape[:2]
        faces, weights = nearest.faces.reshape(shape), nearest.weights.reshape(*shape, 3)
        return SurfacePoints(
            locked(np.concatenate([first.faces[:, None], faces], axis=1)),
            locked(np.concatenate([first.weights[:, None], weights], axis=1)),
        )

    def take(self, which: slice | Ints | Bools) -> SurfaceContacts:
        """The chosen grasps."""
        if "surface_points" in vars(self):
            return super().take(which)
        vertices, partners = vars(self)["_vertices"][which], vars(self)["_partners"]
        chosen = None if partners is None else partners[which]
        return ReadContacts(self.mesh, vertices, chosen, self.count, vars(self)["_file"])
