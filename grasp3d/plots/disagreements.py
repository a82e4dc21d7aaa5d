"""Pictures of single grasps: the object, the gripper at its pose, and the contacts."""

import math

import numpy as np

from grasp3d.arrays import Bytes, Floats, Ints, unit_rows
from grasp3d.hand.shapes import COLORS, Part, gripper_triangles
from grasp3d.rendering import Finger, View, picture
from grasp3d.settings.lengths import METRES
from grasp3d.validating.disagreements import Disagreement

PIXELS = (420, 360)

OBJECT = (214, 190, 150)
"""Colour of the object: that of no label and of no part of a gripper."""

OPACITY = 0.6
"""Opacity of the gripper: what it holds remains visible."""

TOWARD_PALM = 0.2
"""How much the camera is turned from the side of the gripper toward its palm."""


def draw_disagreement(one: Disagreement) -> Bytes:
    """Render the object with the translucent gripper, and the contacts where the jaws close.

    Args:
        one: The grasp.

    Returns:
        Red, green, blue from 0 to 255, shape (height, width, 3).

    Raises:
        OutputError: OpenGL is not available.
    """
    mesh = one.mesh
    assert mesh.unit is not None  # evaluated poses have one
    widest = one.hand.max_opening / METRES[mesh.unit]
    opening = one.opening if math.isfinite(one.opening) else widest
    hand = gripper_triangles(one.hand, max(opening, 0.0), pose=one.pose, unit=mesh.unit)
    corners = hand.vertices[hand.faces].reshape(-1, 3)
    table = np.array([COLORS[part] for part in Part], dtype=np.uint8)
    points = np.concatenate([mesh.vertices, corners])
    body = np.tile(np.array(OBJECT, dtype=np.uint8), (len(mesh.vertices), 1))
    colors = np.concatenate([body, np.repeat(table[hand.parts], 3, axis=0)])
    sides = hand.vertices[hand.faces]
    flat = np.cross(sides[:, 1] - sides[:, 0], sides[:, 2] - sides[:, 0])  # (F, 3)
    normals = np.concatenate([-mesh.normals, np.repeat(unit_rows(flat), 3, axis=0)])
    triangles = len(mesh.vertices) + np.arange(len(corners)).reshape(-1, 3)
    both = np.concatenate([mesh.faces, triangles])
    view, fingers = _view(one.pose), _fingers(one)

    def rendered(faces: Ints) -> Bytes:
        """The same points, so that both pictures have the same camera."""
        return picture(
            points, faces, colors, normals=normals, view=view, size=PIXELS, fingers=fingers
        )

    mixed = OPACITY * rendered(both).astype(np.float64) + (1.0 - OPACITY) * rendered(mesh.faces)
    return np.asarray(np.rint(mixed), dtype=np.uint8)


def _fingers(one: Disagreement) -> list[Finger]:
    pairs = zip(one.points, one.normals, strict=True)
    return [Finger(point, normal) for point, normal in pairs if np.isfinite(point).all()]


def _view(pose: Floats) -> View:
    """The view from the side of the gripper, which shows both fingers, and from above."""
    side = pose[:3, 1] * (1.0 if pose[2, 1] >= 0.0 else -1.0)
    toward = side - TOWARD_PALM * pose[:3, 2]
    toward /= np.linalg.norm(toward)
    return View(
        azimuth=math.atan2(toward[1], toward[0]), elevation=math.asin(np.clip(toward[2], -1.0, 1.0))
    )
