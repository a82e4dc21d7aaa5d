"""Object meshes: reading, repair, refinement and the contact normals of every surface point."""

from grasp3d.mesh.mesh_sources import MeshSource
from grasp3d.mesh.object_mesh import MeshReport, ObjectMesh
from grasp3d.mesh.preparing import load_mesh

__all__ = ["MeshReport", "MeshSource", "ObjectMesh", "load_mesh"]
