"""The direction of the camera that shows a grasp."""

import math

import numpy as np

from grasp3d.arrays import Floats
from grasp3d.hand.gripper_pose import GripperPose
from grasp3d.rendering.opengl import View, turn_to

LEVEL = 0.3
"""Least level part of an axis across which the camera may look."""

USUAL = 0.2
"""Weight of the usual azimuth beside that of the palm, behind which the camera should not be."""


def grasp_view(points: Floats, up: Floats, pose: GripperPose | None = None) -> View:
    """The view of a grasp: across its closing axis, from above; about `up`, see `view_axes`.

    The closing axis of hands with joints, and of arrows, is that along which contacts spread. Where
    it is upright, the camera looks across the approach, or the axis along which they spread next.
    Of the two sides, that from which no palm is in front of the object, else that nearer to the
    usual view.

    Args:
        points: Contacts, shape (n, 3); where there are none, the view is the usual one.
        up: Direction that points up in the picture, shape (3,).
        pose: Pose of the hand at them; None: arrows are drawn.
    """
    if not len(points):
        return View()
    if pose is None or pose.has_joints:
        _, sizes, rows = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)
        axes = sizes[:, None] * rows
    else:
        axes = pose.pose[:3, [0, 2]].T
    least = LEVEL * np.linalg.norm(axes[0])
    level = [(x, y) for x, y, _ in (axes @ turn_to(up)).tolist() if math.hypot(x, y) > least]
    if not level:
        return View()
    along, beside = level[0]
    across = math.atan2(along, -beside)
    approach = np.zeros(3) if pose is None else pose.approach @ turn_to(up)

    def preferred(azimuth: float) -> float:
        before_palm = approach[0] * math.cos(azimuth) + approach[1] * math.sin(azimuth)
        return float(before_palm + USUAL * math.cos(azimuth - View.azimuth))

    return View(max((across, across + math.pi), key=preferred))
