"""Whether a jaw starts in the object."""

from grasp3d._kernels.compiling.decorators import kernel


@kernel
def starts_inside(faces, count, side, start, jaw):
    """Whether the middle of a jaw is in the object before it moves.

    Args:
        faces: `Faces` that contain all those on the axis.
        count: Number of them.
        side: +1 or -1.
        start: Position of the jaw.
        jaw: `Jaw`.
    """
    behind = jaw.radius if jaw.radius > 0.0 else jaw.compliance
    return inside(faces, count, side * (start - behind))


@kernel
def inside(faces, count, start):
    """Whether the point (start, 0, 0) is in the object.

    Rays along x and against it must both leave the object more often than they enter it, so that
    nothing is inside an open surface that only one of them meets.

    Args:
        faces: `Faces` that contain all those on the axis.
        count: Number of them.
        start: Position on the axis.
    """
    return _leaving(faces, count, 1.0, start) > 0 and _leaving(faces, count, -1.0, -start) > 0


@kernel
def _leaving(faces, count, side, start):
    """How many more faces a ray from `start` leaves the object by than it enters.

    Each edge counts for one of its faces only, so that a ray through an edge or a vertex crosses
    the surface once.
    """
    total = 0
    for i in range(count):
        corners, meets = faces.corners[i], False
        for c in range(3):
            meets ^= _crosses(corners[c], corners[(c + 1) % 3])
        if not meets:
            continue
        normal, x = faces.normals[i], 0.0
        for k in range(3):
            x += normal[k] * corners[0, k]
        if normal[0] != 0.0 and side * x / normal[0] > start:
            total += 1 if side * normal[0] > 0.0 else -1
    return total


@kernel
def _crosses(a, b):
    """Whether an edge crosses the half-line y = 0, z > 0, seen along x."""
    if (a[1] > 0.0) == (b[1] > 0.0):
        return False
    if a[1] > 0.0:  # both faces compute with the same order of the edge's ends
        a, b = b, a
    return a[2] - a[1] * (b[2] - a[2]) / (b[1] - a[1]) > 0.0
