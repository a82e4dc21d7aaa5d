"""Inner sides of both fingers, as faces that a gripper has."""

from collections.abc import Sequence

import numpy as np

from grasp3d.arrays import Floats
from grasp3d.hand.convex_polygons import area, clipped, common, rectangle, without_flat_corners
from grasp3d.hand.finger_faces import MOST_CORNERS, Corners, problem_of_face
from grasp3d.hand.finger_hull import TOLERANCE, Face, finger_faces, points_beyond

ALIKE, ALIKE_WITHIN = 0.95, 1e-3
"""Fraction of their inner sides on which fingers agree that mirror each other, within that distance
[m]: the compliance of a gripper that states none."""

FLAT = 0.99
"""Fraction of a pad and of the inner side on which they agree where the pad is the inner side."""

STANDS_OUT = 5e-5
"""Distance from the line through its neighbours, seen along x, below which a corner is none [m]."""

DIGITS = 9
"""Decimals of coordinates [m]: fewer than rounding errors have."""


def inner_faces(
    fingers: tuple[Floats, Floats], *, front: float, pad: tuple[float, float]
) -> tuple[Corners, ...] | None:
    """Faces of the inner side of finger 1, as `ParallelGripper` has them.

    Args:
        fingers: Corners of the geometry of finger 1 and of the mirror image of finger 2, with the
            foremost points at x = 0 [m], shape (n, 3, 3) each.
        front: Position along z of the front of the palm [m].
        pad: Sizes of the pad along y and z [m].

    Returns:
        The faces; empty where the pad is all of them, or where fingers are too large for a face.
        None: the fingers do not mirror each other.

    Example:
        >>> import trimesh
        >>> from grasp3d.hand.inner_side import inner_faces
        >>> box = trimesh.creation.box(bounds=[[-0.01, -0.01, -0.03], [0.0, 0.01, 0.01]]).triangles
        >>> inner_faces((box, box), front=-0.01, pad=(0.02, 0.02))
        ()
        >>> inner_faces((box, box), front=-0.02, pad=(0.02, 0.02))
        (((0.0, -0.01, -0.02), (0.0, 0.01, -0.02), (0.0, 0.01, 0.01), (0.0, -0.01, 0.01)),)
        >>> inner_faces((box, 0.5 * box), front=-0.02, pad=(0.01, 0.01)) is None
        True
    """
    one, two = (finger_faces(finger, front=front) for finger in fingers)
    if agreement(one, two, ALIKE_WITHIN) < ALIKE:
        return None
    half = 0.5 * np.array(pad)
    if agreement([Face(np.zeros(3), rectangle(-half, half))], one, TOLERANCE) > FLAT:
        return ()
    faces = tuple(corners for face in one for corners in corners_of(face))
    return () if any(map(problem_of_face, faces)) else faces


def agreement(one: Sequence[Face], two: Sequence[Face], within: float) -> float:
    """Area on which inner sides are equally far in front, as a fraction of the larger one.

    Args:
        one: Faces that do not overlap, seen along x.
        two: The same of another finger.
        within: Largest difference along x that counts as none [m].

    Returns:
        0 to 1; 1 if both are empty.
    """
    total = 0.0
    for face in one:
        for other in two:
            part = common(face.outline, other.outline)
            for front, back in ((face, other), (other, face)):
                part = clipped(part, front.x(part) - back.x(part) - within)
            total += area(part)
    largest = max(sum(area(face.outline) for face in faces) for faces in (one, two))
    return total / largest if largest else 1.0


def corners_of(face: Face) -> list[Corners]:
    """A face as one that a gripper may have, in several parts if it has too many corners.

    Example:
        >>> import numpy as np
        >>> from grasp3d.hand.finger_hull import Face
        >>> from grasp3d.hand.inner_side import corners_of
        >>> square = np.array([[0, 0], [0.01, 0], [0.01, 0.01], [0.005, 0.01], [0, 0.01]])
        >>> corners_of(Face(np.zeros(3), square))
        [((0.0, 0.0, 0.0), (0.0, 0.01, 0.0), (0.0, 0.01, 0.01), (0.0, 0.0, 0.01))]
    """
    points = Face(face.plane, without_flat_corners(face.outline, STANDS_OUT)).corners
    points[:, 0] = np.minimum(points[:, 0], 0.0)
    corners = [(float(x), float(y), float(z)) for x, y, z in points.round(DIGITS) + 0.0]
    step = MOST_CORNERS - 2
    starts = range(1, len(corners) - 1, step)
    return [(corners[0], *corners[start : start + step + 1]) for start in starts]


def thickness_at_tcp(finger: Floats) -> float:
    """Size of a finger (n, 3, 3) along x at z = 0, behind x = 0; 0: nothing is there [m]."""
    points = points_beyond(finger, 0.0)
    section = points[points[:, 2] < 10.0**-DIGITS]
    return round(float(-section[:, 0].min()), DIGITS) if len(section) else 0.0
