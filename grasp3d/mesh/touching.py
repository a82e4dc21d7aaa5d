"""What a finger touches: the normals of a mesh, laid out for the compiled loops."""

import numpy as np

from grasp3d._kernels.faces import Surface
from grasp3d._kernels.normal_sets import Sets
from grasp3d.mesh.normals import crease_twins
from grasp3d.mesh.object_mesh import ObjectMesh


def contact_normals(mesh: ObjectMesh) -> Sets:
    """The vertices' normal sets, as the kernels take them."""
    sets = mesh.normal_sets
    return Sets(sets.start, sets.counts, sets.normals)


def contact_surface(mesh: ObjectMesh) -> Surface:
    """The surface in the normalised frame, as the kernels take it."""
    corners = mesh.corner_normals
    return Surface(
        points=np.ascontiguousarray(mesh.normalized),
        faces=mesh.faces,
        corners=corners.corners,
        normals=corners.normals,
        twins=crease_twins(mesh.faces, corners.corners),
    )
