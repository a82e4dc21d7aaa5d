"""Rigid motions (3, 4) of points and vectors, from one frame to another and back."""

from grasp3d._kernels.compiling import merged, part
from grasp3d._kernels.surface.vectors import dot


@merged
def turned(matrix, v):
    """A vector of the one frame in the other."""
    return dot(matrix[0], v), dot(matrix[1], v), dot(matrix[2], v)


@merged
def moved(matrix, p):
    """A point of the one frame in the other."""
    x, y, z = dot(matrix[0], p), dot(matrix[1], p), dot(matrix[2], p)
    return x + matrix[0, 3], y + matrix[1, 3], z + matrix[2, 3]


@merged
def turned_back(matrix, v):
    """A vector of the other frame in the one."""
    x = matrix[0, 0] * v[0] + matrix[1, 0] * v[1] + matrix[2, 0] * v[2]
    y = matrix[0, 1] * v[0] + matrix[1, 1] * v[1] + matrix[2, 1] * v[2]
    z = matrix[0, 2] * v[0] + matrix[1, 2] * v[1] + matrix[2, 2] * v[2]
    return x, y, z


@merged
def moved_back(matrix, p):
    """A point of the other frame in the one."""
    return turned_back(matrix, (p[0] - matrix[0, 3], p[1] - matrix[1, 3], p[2] - matrix[2, 3]))


@part
def compose(link, pose, product):
    """Write the product of two rigid motions (3, 4)."""
    for i in range(3):
        for j in range(4):
            product[i, j] = link[i, 3] if j == 3 else 0.0
            for k in range(3):
                product[i, j] += link[i, k] * pose[k, j]
