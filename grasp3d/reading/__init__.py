"""Reading of untrusted mesh files into arrays."""

from grasp3d.reading.mesh_files import read_mesh
from grasp3d.reading.sources import RawMesh, check_finite, flattened, mesh_suffixes, stated_unit

__all__ = ["RawMesh", "check_finite", "flattened", "mesh_suffixes", "read_mesh", "stated_unit"]
