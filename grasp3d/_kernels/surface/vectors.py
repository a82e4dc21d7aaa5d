"""Operations on small vectors in scratch arrays."""

import math

from grasp3d._kernels.compiling.decorators import merged


@merged
def dot(a, b):
    """Inner product of two vectors of three numbers, arrays or triples."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@merged
def cross(a, b):
    """Cross product, a triple."""
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )


@merged
def copy(source, target):
    """Copy a vector of three numbers; an assignment of arrays takes Numba far longer to compile."""
    for k in range(3):
        target[k] = source[k]


@merged
def dot6(a, b):
    """Inner product of two vectors of six numbers."""
    return ((a[0] * b[0] + a[1] * b[1]) + (a[2] * b[2] + a[3] * b[3])) + (a[4] * b[4] + a[5] * b[5])


@merged
def copy6(source, target):
    """Copy a vector of six numbers."""
    for k in range(6):
        target[k] = source[k]


@merged
def clear6(vector):
    """Set six numbers to 0."""
    for k in range(6):
        vector[k] = 0.0


@merged
def scale6(vector, factor):
    """Multiply a vector of six numbers."""
    for k in range(6):
        vector[k] *= factor


@merged
def add6(vector, factor, other):
    """Add a multiple of another vector of six numbers."""
    for k in range(6):
        vector[k] += factor * other[k]


@merged
def difference(a, b):
    """The vector a - b of three numbers, a triple."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@merged
def combined(s, a, t, b):
    """Sum of s times a and t times b."""
    return s * a[0] + t * b[0], s * a[1] + t * b[1], s * a[2] + t * b[2]


@merged
def angle_between(a, b):
    """Angle between two vectors, by atan2: accurate near 0 and pi too."""
    c = cross(a, b)
    return math.atan2(math.sqrt(dot(c, c)), dot(a, b))


@merged
def remove_components(basis, size, vector, components):
    """Subtract a vector's components along the first rows of a basis; `components` is written."""
    for j in range(size):
        components[j] = dot6(basis[j], vector)
    for j in range(size):
        add6(vector, -components[j], basis[j])
