"""What the kernels that search for opposing contacts take."""

import math

import numpy as np

from grasp3d._kernels.search.antipodal_candidates import PairLimits
from grasp3d._kernels.search.face_contacts import OwnNormals, PairDomain, read_face, read_own
from grasp3d._kernels.surface.face_tree import face_tree
from grasp3d.arrays import Floats
from grasp3d.mesh import ObjectMesh


def domain_of(mesh: ObjectMesh, largest: float = math.inf) -> PairDomain:
    """The whole surface, with a largest opening."""
    surface = mesh.contact_surface
    centres, limits = mesh.normal_centres, PairLimits(1e-6, largest)
    return PairDomain(surface, mesh.contact_normals, centres, face_tree(surface), limits)


def own_normals(mesh: ObjectMesh, vertex: int, *, worst: bool) -> OwnNormals:
    """The normals of a vertex."""
    rows = np.empty((mesh.contact_normals.counts.max(), 12))
    return OwnNormals(rows, read_own(vertex, mesh.contact_normals, rows), worst)


def read(mesh: ObjectMesh, face: int, vertex: int) -> tuple[Floats, Floats]:
    """Lines from a vertex to the corners of a face, and their normals."""
    lines, normals = np.empty((3, 3)), np.empty((3, 3))
    read_face(face, vertex, mesh.contact_surface, lines, normals)
    return lines, normals
