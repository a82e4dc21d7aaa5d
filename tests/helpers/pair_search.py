"""Arguments for the kernels that search for opposing contacts."""

import math

import numpy as np

from grasp3d._kernels.search.antipodal_candidates import PairLimits
from grasp3d._kernels.search.face_contacts import PairDomain, read_face
from grasp3d._kernels.surface.face_tree import face_tree
from grasp3d.arrays import Floats
from grasp3d.mesh import ObjectMesh


def domain_of(mesh: ObjectMesh, largest: float = math.inf, smallest: float = 1e-6) -> PairDomain:
    """The whole surface, with limits of openings."""
    surface = mesh.contact_surface
    centres, limits = mesh.normal_centres, PairLimits(smallest, largest)
    return PairDomain(surface, mesh.contact_normals, centres, face_tree(surface), limits)


def own_normals(mesh: ObjectMesh, vertex: int) -> Floats:
    """The normals of a vertex (k, 3)."""
    sets = mesh.contact_normals
    return sets.normals[sets.start[vertex] :][: sets.counts[vertex]]


def read(mesh: ObjectMesh, face: int, vertex: int) -> tuple[Floats, Floats]:
    """Lines from a vertex to the corners of a face, and their normals."""
    lines, normals = np.empty((3, 3)), np.empty((3, 3))
    read_face(face, vertex, mesh.contact_surface, lines, normals)
    return lines, normals
