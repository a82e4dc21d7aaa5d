"""Cameras of pictures: directions of view, the best view of a grasp, and the frame to show."""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from grasp3d.arrays import Floats
from grasp3d.hand.gripper_pose import GripperPose
from grasp3d.settings import DEGREE, Radians

if TYPE_CHECKING:
    import pyvista

LIGHT = (-0.35, 0.45, 1.0)
"""Direction of the light from the camera: to the left and above."""
AMBIENT = 0.55
"""Ambient fraction of the light."""

UPRIGHT = np.array([0.0, 0.0, 1.0])
"""Direction that is up where no other is stated."""

PARALLEL = 1e-20
"""Squared distance of a unit vector from the z-axis below which both count as parallel."""


@dataclass(frozen=True)
class View:
    """Direction of view; the z-axis is up."""

    azimuth: Radians = 75.0 * DEGREE
    """Angle of the camera about the z-axis, from the x-axis."""
    elevation: Radians = 35.0 * DEGREE
    """Angle of the camera above the xy-plane."""

    @property
    def axes(self) -> Floats:
        """Unit vectors to the right, up, and toward the camera, shape (3, 3)."""
        sine, cosine = math.sin(self.azimuth), math.cos(self.azimuth)
        up, level = math.sin(self.elevation), math.cos(self.elevation)
        return np.array(
            [
                [-sine, cosine, 0.0],
                [-up * cosine, -up * sine, level],
                [level * cosine, level * sine, up],
            ]
        )


def broad_view(points: Floats, up: Floats) -> View:
    """The usual view, from the side of an object's longest level axis; for `up` see `view_axes`.

    Args:
        points: Points of the object, shape (n, 3).
        up: Direction that points up in the picture, shape (3,).
    """
    x, y = ((points - points.mean(axis=0)) @ turn_to(up)).T[:2]
    longest = 0.5 * math.atan2(2.0 * float(x @ y), float(x @ x - y @ y))
    return View(longest + View.azimuth)


def view_axes(view: View, up: Floats) -> Floats:
    """Unit vectors to the right, up and toward the camera, shape (3, 3).

    Args:
        view: Direction of the camera.
        up: Direction that is up in the picture, instead of the z-axis, shape (3,).
    """
    return np.asarray(view.axes @ turn_to(up).T)


def turn_to(up: Floats) -> Floats:
    """Shortest rotation of the z-axis to a unit vector, shape (3, 3)."""
    x, y, z = (float(value) for value in up)
    aside = x * x + y * y
    if z < 0.0 and aside < PARALLEL:
        return np.diag([1.0, -1.0, -1.0])
    cross = np.array([[0.0, 0.0, x], [0.0, 0.0, y], [-x, -y, 0.0]])
    # 1 / (1 + z); near z = -1 the form with squares avoids cancellation.
    factor = 1.0 / (1.0 + z) if z >= 0.0 else (1.0 - z) / aside
    return np.asarray(np.eye(3) + cross + factor * (cross @ cross))


LEVEL = 0.3
"""Smallest level part of an axis across which the camera may look."""

USUAL = 0.2
"""Weight of the usual azimuth relative to the side away from the palm."""


def grasp_view(points: Floats, up: Floats, pose: GripperPose | None = None) -> View:
    """View of a grasp: across its closing axis, from above; for `up` see `view_axes`.

    For hands with joints, and for arrows, the closing axis is the one along which contacts spread.
    If it is upright, the camera looks across the approach, or across the second axis of the spread.
    The camera is on the side where no palm hides the object, or else nearer to the usual view.

    Args:
        points: Contacts, shape (n, 3); if there are none, the view is the usual one.
        up: Direction that points up in the picture, shape (3,).
        pose: Pose of the hand at the contacts; None: arrows are drawn.
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


MARGIN = 1.06
"""Size of the free area relative to the object that it shows."""


MOST_BESIDE = 2.4
"""Largest size of a frame relative to the object alone, if a gripper is beside it."""


@dataclass(frozen=True)
class FreeArea:
    """Part of a pane that is free for the object [pixels]."""

    width: float
    """Width of the pane."""
    height: float
    """Height of the pane."""
    top: float = 0.0
    """Height of the texts above."""
    bottom: float = 0.0
    """Height of the texts below."""
    sides: float = 0.0
    """Margin at the left and the right."""

    @property
    def free(self) -> tuple[float, float]:
        """Width and height of the free part, at least one pixel."""
        return (
            max(1.0, self.width - 2.0 * self.sides),
            max(1.0, self.height - self.top - self.bottom),
        )

    @property
    def shift(self) -> float:
        """Height of the free part's centre above the pane's centre, in half heights of the pane."""
        return (self.bottom - self.top) / max(1.0, self.height)


def extents(points: Floats, middle: Floats, axes: Floats) -> tuple[float, float]:
    """Largest horizontal and vertical distance of points from a centre.

    Args:
        points: Shape (n, 3).
        middle: Centre of the picture, shape (3,).
        axes: Unit vectors to the right, up and toward the camera, shape (3, 3).
    """
    reach = np.abs((points - middle) @ axes[:2].T).max(axis=0)
    return float(reach[0]), float(reach[1])


def middle_of(points: Floats, axes: Floats) -> Floats:
    """Centre of points (n, 3) as seen from one view."""
    projected = points @ axes.T
    return np.asarray(0.5 * (projected.min(axis=0) + projected.max(axis=0)) @ axes)


def parallel_scale(reach: tuple[float, float], area: FreeArea) -> float:
    """Half the pane's height [m] at which given extents fill the free area."""
    width, height = area.free
    per_pixel = max(2.0 * reach[0] / width, 2.0 * reach[1] / height, np.finfo(float).tiny)
    return 0.5 * MARGIN * per_pixel * area.height


@dataclass(frozen=True)
class Frame:
    """Visible part of a picture: its centre, and half its extents."""

    middle: Floats
    """Centre, shape (3,)."""
    reach: tuple[float, float]
    """Largest horizontal and vertical distance from the centre [m]."""


def frame_of(points: Floats, beside: Floats, axes: Floats) -> Frame:
    """Frame of an object and of what is beside it.

    A large gripper beside a small object would make the object tiny. So the object keeps at least 1
    / `MOST_BESIDE` of the size that it would have alone, and stays within the frame.

    Args:
        points: Points of the object, shape (n, 3).
        beside: Points of a gripper, shape (m, 3); m may be 0.
        axes: Unit vectors to the right, up and toward the camera, shape (3, 3).
    """
    alone = middle_of(points, axes)
    own = np.array(extents(points, alone, axes))
    if not len(beside):
        return Frame(alone, (float(own[0]), float(own[1])))
    both = np.concatenate([points, beside])
    middle = middle_of(both, axes)
    across, up = extents(both, middle, axes)
    most = MOST_BESIDE * float(own.max())
    reach = np.minimum((across, up), most)
    shift = axes[:2] @ (middle - alone)
    limited = np.clip(shift, own - reach, reach - own)
    return Frame(middle + (limited - shift) @ axes[:2], (float(reach[0]), float(reach[1])))


def aim(camera: "pyvista.Camera", size: float, axes: Floats, middle: Floats) -> None:
    """Point a camera at a centre.

    Args:
        camera: The camera.
        size: Size of everything that is shown.
        axes: Axes from `view_axes`.
        middle: Centre of the picture, shape (3,).
    """
    camera.parallel_projection = True
    camera.focal_point = tuple(middle)
    camera.position = tuple(middle + 3.0 * size * axes[2])
    camera.up = tuple(axes[1])
    camera.clipping_range = (0.5 * size, 6.0 * size)


def pixel_ratio(renderer: "pyvista.Renderer") -> float:
    """Pixels per 1/72 inch; line widths and text sizes are multiplied by it."""
    return float(renderer.GetRenderWindow().GetDPI()) / 72.0


def axes_of(camera: "pyvista.Camera") -> Floats:
    """Unit vectors to the right, up and toward the camera, shape (3, 3)."""
    matrix = camera.GetViewTransformMatrix()
    return np.array([[matrix.GetElement(i, j) for j in range(3)] for i in range(3)])
