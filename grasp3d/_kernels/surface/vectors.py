"""Operations on small vectors in scratch arrays."""

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
def remove_components(basis, size, vector, components):
    """Subtract a vector's components along the first rows of a basis; `components` is written."""
    for j in range(size):
        components[j] = dot6(basis[j], vector)
    for j in range(size):
        for k in range(6):
            vector[k] -= components[j] * basis[j, k]
