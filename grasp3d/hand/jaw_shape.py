"""Shapes of jaws, as the kernels need them."""

import numpy as np

from grasp3d._kernels.jaws import ROUNDING, Jaw
from grasp3d.arrays import Floats
from grasp3d.hand.finger_faces import Corners
from grasp3d.hand.jaws import Jaws

FOOTPRINT = 1.0 / 3.0
"""Depth, relative to a pad's smaller side, to which the surface opposite it makes the normal.

A turn by the angle of friction of 0.5 brings onto the pad what was deeper by 1/4 to 1/2 of its
side: the first where the contact is in the pad's middle, the second where it is at its edge.
"""

NO_EDGE = (0.0, 0.0, 1.0)
"""Fills the rows of faces with fewer sides."""


def jaw_of(gripper: Jaws, scale: float) -> Jaw:
    """Shape of the jaws of a gripper.

    Args:
        gripper: The gripper.
        scale: Object sizes in one metre.
    """
    faces = [np.array(face) * scale for face in inner_faces(gripper)]
    most = max(map(len, faces))
    edges = np.empty((len(faces), most, 3))
    edges[:] = NO_EDGE
    for row, face in zip(edges, faces, strict=True):
        row[: len(face)] = _edges(face)
    points = np.concatenate(faces)[:, 1:]
    return Jaw(
        planes=np.stack([_plane(face) for face in faces]),
        edges=edges,
        bounds=np.concatenate([points.min(axis=0), points.max(axis=0)]),
        radius=gripper.tip_radius * scale,
        depth=gripper.tip_radius * scale or float(-min(face[:, 0].min() for face in faces)),
        thickness=(gripper.tip_thickness or gripper.finger_thickness) * scale,
        compliance=gripper.compliance * scale,
        footprint=FOOTPRINT * min(gripper.pad_width, gripper.pad_height) * scale,
    )


def inner_faces(gripper: Jaws) -> tuple[Corners, ...]:
    """The faces with which finger 1 touches: those stated, or the pad's rectangle [m].

    Of a round tip it is the square around it, seen along x.
    """
    if gripper.inner_faces:
        return gripper.inner_faces
    tip = gripper.tip_radius
    y, z = (tip, tip) if tip else (0.5 * gripper.pad_width, 0.5 * gripper.pad_height)
    return (((0.0, -y, -z), (0.0, y, -z), (0.0, y, z), (0.0, -y, z)),)


def _plane(face: Floats) -> Floats:
    """Coefficients of x = a + b y + c z through the corners of a face (n, 3), by least squares."""
    columns = np.column_stack([np.ones(len(face)), face[:, 1:]])
    return np.asarray(np.linalg.lstsq(columns, face[:, 0])[0])


def _edges(face: Floats) -> Floats:
    """Sides of a convex face (n, 3), seen along x: outward unit normals and positions (n, 3)."""
    points = face[:, 1:]
    along = np.roll(points, -1, axis=0) - points
    x, y = points.T
    counterclockwise = float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) > 0.0
    outward = np.stack([along[:, 1], -along[:, 0]], axis=1) * (1.0 if counterclockwise else -1.0)
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    # What only grazes a side is not touched.
    return np.column_stack([outward, (outward * points).sum(axis=1) - ROUNDING])
