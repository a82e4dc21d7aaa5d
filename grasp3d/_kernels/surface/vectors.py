"""Operations on small vectors in scratch arrays."""

import math

from grasp3d._kernels.compiling import merged


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
def norm(a):
    """Length of a vector of three numbers."""
    return math.sqrt(dot(a, a))


@merged
def triple(row, k):
    """Three numbers of a row, from column k on."""
    return row[k], row[k + 1], row[k + 2]


@merged
def scaled(s, a):
    """The vector s times a, a triple."""
    return s * a[0], s * a[1], s * a[2]


@merged
def divided(a, s):
    """The vector a divided by s, a triple."""
    return a[0] / s, a[1] / s, a[2] / s


@merged
def weighted_sum(weights, a, b, c):
    """Sum of three vectors with three weights, a triple."""
    return (
        weights[0] * a[0] + weights[1] * b[0] + weights[2] * c[0],
        weights[0] * a[1] + weights[1] * b[1] + weights[2] * c[1],
        weights[0] * a[2] + weights[1] * b[2] + weights[2] * c[2],
    )


@merged
def in_triangle(r, u, w, n):
    """Weights of the ends of u and w at a point r of their plane, times the square of n = u x w."""
    return dot(cross(r, w), n), dot(cross(u, r), n)


@merged
def copy(source, target):
    """Copy a vector of three numbers; an assignment of arrays takes Numba far longer to compile."""
    for k in range(3):
        target[k] = source[k]


@merged
def copy_rows(source, target):
    """Copy an array of rows."""
    for i in range(source.shape[0]):
        for k in range(source.shape[1]):
            target[i, k] = source[i, k]


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
def squared_distance(a, b):
    """Square of the distance between two points."""
    d = difference(a, b)
    return dot(d, d)


@merged
def combined(s, a, t, b):
    """Sum of s times a and t times b."""
    return s * a[0] + t * b[0], s * a[1] + t * b[1], s * a[2] + t * b[2]


@merged
def angle_between(a, b):
    """Angle between two vectors by atan2, accurate also near 0 and pi."""
    c = cross(a, b)
    return math.atan2(math.sqrt(dot(c, c)), dot(a, b))


@merged
def remove_components(basis, size, vector, components):
    """Subtract a vector's components along the first rows of a basis, and write `components`."""
    for j in range(size):
        components[j] = dot6(basis[j], vector)
    for j in range(size):
        add6(vector, -components[j], basis[j])
