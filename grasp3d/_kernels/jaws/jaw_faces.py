"""The faces of a surface between the jaws of a gripper, in the frame of the gripper."""

import math

from grasp3d._kernels.compiling.decorators import inlined, kernel

TURNED_AWAY = 0.2
"""Largest x of a face's normal with which it may face a jaw after a small motion."""


@kernel
def gather(surface, tree, pose, jaw, margin, stack, faces):
    """Write the faces within the height and width of the jaws, at any x.

    Args:
        surface: `Surface`.
        tree: Its `FaceTree`.
        pose: Rotation and translation from the gripper's frame (3, 4).
        jaw: `Jaw`.
        margin: Distance beyond the jaws' bounds up to which faces are written, too.
        stack: Memory.
        faces: Written.

    Returns:
        Number of faces.
    """
    size, count, waiting = surface.faces.shape[0], 0, 1
    stack[0, 0], stack[0, 1] = 0, 0
    while waiting:
        waiting -= 1
        level, j = stack[waiting, 0], stack[waiting, 1]
        if not _near(tree.bounds[(1 << level) - 1 + j], pose, jaw, margin):
            continue
        if level < tree.depth:
            for child in range(2):
                stack[waiting, 0], stack[waiting, 1] = level + 1, 2 * j + child
                waiting += 1
            continue
        for i in range(size * j >> level, size * (j + 1) >> level):
            if _write_face(surface, tree.order[i], pose, jaw, margin, count, faces):
                count += 1
    return count


@kernel
def _near(ball, pose, jaw, margin):
    """Whether a ball reaches into the height and width of the jaws."""
    y, z, reach = 0.0, 0.0, ball[3] + margin
    for i in range(3):
        offset = ball[i] - pose[i, 3]
        y += pose[i, 1] * offset
        z += pose[i, 2] * offset
    bounds = jaw.bounds
    return (
        bounds[0] - reach <= y <= bounds[2] + reach and bounds[1] - reach <= z <= bounds[3] + reach
    )


@kernel
def _write_face(surface, face, pose, jaw, margin, row, faces):
    """Write a face in the gripper's frame; returns whether it is within the jaws' bounds."""
    corners, normal = faces.corners[row], faces.normals[row]
    for i in range(3):
        vertex = surface.faces[face, i]
        x = surface.points[vertex, 0] - pose[0, 3]
        y = surface.points[vertex, 1] - pose[1, 3]
        z = surface.points[vertex, 2] - pose[2, 3]
        for k in range(3):
            corners[i, k] = pose[0, k] * x + pose[1, k] * y + pose[2, k] * z
    if not is_between(corners, jaw, margin):
        return False
    a, b, c = corners[0], corners[1], corners[2]
    normal[0] = (b[1] - a[1]) * (c[2] - a[2]) - (b[2] - a[2]) * (c[1] - a[1])
    normal[1] = (b[2] - a[2]) * (c[0] - a[0]) - (b[0] - a[0]) * (c[2] - a[2])
    normal[2] = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    length = math.sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2)
    for k in range(3):
        normal[k] /= length
    faces.numbers[row] = face
    return True


@kernel
def is_between(corners, jaw, margin):
    """Whether a triangle reaches into the height and width of the jaws, up to a margin."""
    for k in range(1, 3):
        low = min(corners[0, k], corners[1, k], corners[2, k])
        high = max(corners[0, k], corners[1, k], corners[2, k])
        if low > jaw.bounds[1 + k] + margin or high < jaw.bounds[k - 1] - margin:
            return False
    return True


@kernel
def move(faces, count, motion, jaw, margin, moved):
    """Write the faces, moved with the object, that are within the height and width of the jaws.

    Args:
        faces: `Faces`.
        count: Number of them.
        motion: Rotation and translation in the gripper's frame (3, 4).
        jaw: `Jaw`.
        margin: Distance beyond the jaws' bounds up to which faces are written, too.
        moved: Written, `Faces`.

    Returns:
        Number of faces.
    """
    kept = 0
    for f in range(count):
        corners, normal = moved.corners[kept], moved.normals[kept]
        move_face(faces.corners[f], faces.normals[f], motion, 0, 3, corners, normal)
        if not is_between(corners, jaw, margin):
            continue
        moved.numbers[kept] = faces.numbers[f]
        kept += 1
    return kept


@inlined
def move_face(corners, normal, motion, first, last, moved, turned):
    """Write coordinates from one axis to another of a face's corners and normal after a motion."""
    for k in range(first, last):
        a, b, c, d = motion[k, 0], motion[k, 1], motion[k, 2], motion[k, 3]
        for i in range(3):
            moved[i, k] = d + a * corners[i, 0] + b * corners[i, 1] + c * corners[i, 2]
        turned[k] = a * normal[0] + b * normal[1] + c * normal[2]


@kernel
def keep_near(faces, count, touches, start, margin, jaw):
    """Keep the faces that a jaw may touch, or start in, after a small motion of the object.

    Args:
        faces: `Faces`; those kept are moved to the front.
        count: Number of them.
        touches: As in `Settling` (2, 7).
        start: Position from which the jaws close, as in `first_touch`.
        margin: Distance by which no point of the faces near the jaws moves more.
        jaw: `Jaw`.

    Returns:
        Number of faces.
    """
    kept = 0
    for f in range(count):
        corners, wanted = faces.corners[f], False
        low = min(corners[0, 0], corners[1, 0], corners[2, 0])
        high = max(corners[0, 0], corners[1, 0], corners[2, 0])
        for finger in range(2):
            side = 1.0 - 2.0 * finger
            first, last = (low, high) if finger == 0 else (-high, -low)
            position = side * touches[finger, 5]
            if last > start - jaw.thickness - margin and first < position + jaw.depth + margin:
                ahead = first >= start - jaw.compliance + margin
                # What is ahead is met only by its front, which a turn may not hide.
                wanted |= not ahead or side * faces.normals[f, 0] < TURNED_AWAY
        if not wanted:
            continue
        if kept < f:
            _copy(faces, f, kept)
        kept += 1
    return kept


@kernel
def _copy(faces, source, target):
    """Copy a face to another row."""
    faces.numbers[target] = faces.numbers[source]
    faces.corners[target] = faces.corners[source]
    faces.normals[target] = faces.normals[source]


@kernel
def put_first(faces, count, numbers):
    """Reorder the faces so that those with the given numbers are the first ones.

    What the jaws have touched last is probably near what they touch next, so that most of the
    others are seen to be farther away.

    Args:
        faces: `Faces`.
        count: Number of them.
        numbers: Faces of the mesh (2,).
    """
    front = 0
    for f in range(count):
        if front < numbers.shape[0] and (faces.numbers[f] == numbers).any():
            swap(faces, f, front)
            front += 1


@kernel
def swap(faces, i, j):
    """Swap two faces."""
    faces.numbers[i], faces.numbers[j] = faces.numbers[j], faces.numbers[i]
    for k in range(3):
        faces.normals[i, k], faces.normals[j, k] = faces.normals[j, k], faces.normals[i, k]
        for c in range(3):
            a, b = faces.corners[i, c, k], faces.corners[j, c, k]
            faces.corners[i, c, k], faces.corners[j, c, k] = b, a
