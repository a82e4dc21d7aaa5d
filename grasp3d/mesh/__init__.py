"""Object meshes: reading, repair, refinement and the contact normals of every surface point."""

from grasp3d.mesh.object_mesh import MeshReport, ObjectMesh
from grasp3d.mesh.preparing import load_mesh, mesh_from_arrays, prepare_file

__all__ = ["MeshReport", "ObjectMesh", "load_mesh", "mesh_from_arrays", "prepare_file"]
