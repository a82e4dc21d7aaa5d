"""Faces of the inner side of a finger."""

import math

Corners = tuple[tuple[float, float, float], ...]
"""Corners of a face in the gripper's frame [m]."""

MOST_CORNERS = 12
"""Most corners of a face."""

FLATNESS = 1e-4
"""Largest distance of a corner from the plane of its face [m]."""

LARGEST = 1.0
"""Largest coordinate of a corner [m]."""


def problem_of_face(face: Corners) -> str | None:
    """What keeps a face from being one that a jaw touches with; None: nothing does.

    Args:
        face: Its corners in order, as in `ParallelGripper.inner_faces`.

    Example:
        >>> from grasp3d.hand.finger_faces import problem_of_face
        >>> print(problem_of_face(((0.0, 0.0, 0.0), (0.0, 0.01, 0.0), (0.001, 0.0, 0.01))))
        has a corner with x = 0.001; it must be at most 0, behind the plane of the pad
    """
    if not 3 <= len(face) <= MOST_CORNERS:
        return f"must have 3 to {MOST_CORNERS} corners; got {len(face)}"
    if any(len(corner) != 3 for corner in face):
        return "must have corners of three numbers, x, y and z"
    if not all(math.isfinite(value) and abs(value) <= LARGEST for c in face for value in c):
        return f"must have coordinates in metres, at most {LARGEST:g}"
    behind = max(corner[0] for corner in face)
    if behind > 0.0:
        return (
            f"has a corner with x = {behind:g}; it must be at most 0, behind the plane of the pad"
        )
    return _problem_of_outline(face)


def _problem_of_outline(face: Corners) -> str | None:
    """Whether a face is flat, and convex seen along x."""
    turns = [_turn(face, i) for i in range(len(face))]
    if not (min(turns) > 0.0 or max(turns) < 0.0):
        return "must be convex, with its corners in order and none on a side"
    (x0, y0, z0), (x1, y1, z1), (x2, y2, z2) = face[:3]
    area = _turn(face, 1)
    for x, y, z in face[3:]:
        a = ((y - y0) * (z2 - z0) - (z - z0) * (y2 - y0)) / area
        b = ((y1 - y0) * (z - z0) - (z1 - z0) * (y - y0)) / area
        off = x - x0 - a * (x1 - x0) - b * (x2 - x0)
        if abs(off) > FLATNESS:
            return f"must be flat; a corner is {1e3 * abs(off):.3g} mm off the plane of the others"
    return None


def _turn(face: Corners, i: int) -> float:
    """Twice the signed area of the triangle of a corner and its neighbours, seen along x."""
    (_, ay, az), (_, by, bz), (_, cy, cz) = face[i - 1], face[i], face[(i + 1) % len(face)]
    return (by - ay) * (cz - bz) - (bz - az) * (cy - by)
