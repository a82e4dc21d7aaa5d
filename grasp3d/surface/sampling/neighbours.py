"""Adjacent vertices of a surface."""

import numpy as np
from scipy.sparse import coo_array

from grasp3d.arrays import Ints
from grasp3d.mesh import ObjectMesh


def neighbours(mesh: ObjectMesh) -> tuple[Ints, Ints]:
    """(first, index): the adjacent vertices of each vertex, grouped by vertex, for the kernels."""
    one, two = mesh.faces[:, [0, 1, 2]].ravel(), mesh.faces[:, [1, 2, 0]].ravel()
    links = coo_array(
        (
            np.ones(2 * len(one), dtype=np.int8),
            (np.concatenate([one, two]), np.concatenate([two, one])),
        ),
        shape=(len(mesh.vertices),) * 2,
    ).tocsr()
    return links.indptr.astype(np.int64), links.indices.astype(np.int64)
