from .object_mesh import MeshReport as MeshReport
from .object_mesh import ObjectMesh as ObjectMesh
from .preparing import MeshSource as MeshSource
from .preparing import load_mesh as load_mesh
