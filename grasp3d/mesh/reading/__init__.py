"""From a mesh file to plain arrays, without trusting the file."""

from grasp3d.mesh.reading.files import RawMesh, check_finite, mesh_suffixes, read_mesh

__all__ = ["RawMesh", "check_finite", "mesh_suffixes", "read_mesh"]
