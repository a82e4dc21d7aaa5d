"""Pictures of coloured surfaces, rendered by PyVista without a window.

Without OpenGL VTK ends the whole process instead of raising an error, so a separate process tests
it first.
"""

import math
import os
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from grasp3d.arrays import ArrayLike, Bytes, Floats, Ints
from grasp3d.errors import OutputError, SettingError
from grasp3d.settings import DEGREE, Radians

if TYPE_CHECKING:
    import pyvista

WINDOW = "VTK_DEFAULT_OPENGL_WINDOW"
TIMEOUT = 120.0
"""Longest duration of the separate process that tests rendering [s]."""

LIGHT = (-0.35, 0.45, 1.0)
"""Direction of the light from the camera: to the left and above."""
AMBIENT = 0.55
"""Ambient fraction of the light."""

MARGIN = 1.05
"""Size of the picture relative to what it shows."""

BALL, RIM = 0.026, 0.007
"""Radius of a finger's ball and width of its white rim, as fractions of the mean of the surface's
two largest extents."""
ARROW = 0.4
"""Length of its arrow, likewise."""
HIDDEN_OPACITY = 0.55
"""Opacity of its hidden parts."""
FINGER_COLOR = "#1A1A1A"


UPRIGHT = np.array([0.0, 0.0, 1.0])
"""Direction that is up where nothing else is stated."""

PARALLEL = 1e-20
"""Squared distance of a unit vector from the z-axis below which it is parallel to it."""


@dataclass(frozen=True)
class View:
    """Direction of the camera; the z-axis is up."""

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


def view_axes(view: View, up: Floats) -> Floats:
    """Unit vectors to the right, up and toward the camera, shape (3, 3).

    Args:
        view: Direction of the camera.
        up: Direction that points up in the picture, instead of the z-axis, shape (3,).
    """
    return np.asarray(view.axes @ turn_to(up).T)


def turn_to(up: Floats) -> Floats:
    """Shortest rotation of the z-axis to a unit vector, shape (3, 3)."""
    x, y, z = (float(value) for value in up)
    aside = x * x + y * y
    if z < 0.0 and aside < PARALLEL:
        return np.diag([1.0, -1.0, -1.0])
    cross = np.array([[0.0, 0.0, x], [0.0, 0.0, y], [-x, -y, 0.0]])
    # 1 / (1 + z); near z = -1 that of the squares does not cancel.
    factor = 1.0 / (1.0 + z) if z >= 0.0 else (1.0 - z) / aside
    return np.asarray(np.eye(3) + cross + factor * (cross @ cross))


@dataclass(frozen=True, eq=False)
class Finger:
    """A finger to be marked: a ball at the contact point and an arrow along the contact normal."""

    point: Floats
    """Contact point in the surface's frame, shape (3,)."""
    normal: Floats
    """Inward unit normal, shape (3,)."""


@cache
def can_render() -> bool:
    """Return whether pictures can be rendered; tested once, in a separate process."""
    return _ended_cleanly(begin_render_test())


@cache
def begin_render_test() -> subprocess.Popen[bytes] | None:
    """Start what `can_render` waits for, so that other work can be done in the meantime."""
    choose_window()
    return _started(
        "from grasp3d.plots import rendering; raise SystemExit(not rendering.draws_a_triangle())"
    )


def exits_cleanly(code: str) -> bool:
    """Return whether code succeeds in a separate process, as VTK may end the whole process."""
    return _ended_cleanly(_started(code))


def _started(code: str) -> subprocess.Popen[bytes] | None:
    """A process that runs code; None: it cannot be started."""
    silent = subprocess.DEVNULL
    try:
        return subprocess.Popen([sys.executable, "-c", code], stdout=silent, stderr=silent)  # noqa: S603
    except OSError:
        return None


def _ended_cleanly(process: subprocess.Popen[bytes] | None) -> bool:
    """Wait for a process, and return whether it succeeded."""
    if process is None:
        return False
    try:
        return process.wait(TIMEOUT) == 0
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
        return False


def check_rendering() -> None:
    """Check, before long work, that pictures can be rendered after it.

    Raises:
        OutputError: OpenGL is not available.
    """
    if not can_render():
        raise OutputError(
            "pictures need OpenGL, which is not available; install EGL (on Debian: libegl1 libgl1) "
            "or run with a display"
        )


def draws_a_triangle() -> bool:
    """Render a triangle and return whether it is visible; without OpenGL this ends the process."""
    # By VTK itself: what PyVista imports takes a second.
    import vtkmodules.vtkRenderingOpenGL2  # noqa: F401, draws what the others describe
    from vtkmodules.vtkCommonCore import vtkUnsignedCharArray
    from vtkmodules.vtkFiltersSources import vtkRegularPolygonSource
    from vtkmodules.vtkRenderingCore import (
        vtkActor,
        vtkPolyDataMapper,
        vtkRenderer,
        vtkRenderWindow,
    )

    triangle, mapper, actor = vtkRegularPolygonSource(), vtkPolyDataMapper(), vtkActor()
    triangle.SetNumberOfSides(3)
    mapper.SetInputConnection(triangle.GetOutputPort())
    actor.SetMapper(mapper)
    renderer, window, pixels = vtkRenderer(), vtkRenderWindow(), vtkUnsignedCharArray()
    renderer.AddActor(actor)
    window.OffScreenRenderingOn()
    window.SetSize(32, 32)
    window.AddRenderer(renderer)
    window.Render()
    window.GetPixelData(0, 0, 31, 31, 1, pixels, 0)
    least, most = pixels.GetRange(0)
    return bool(least < most)


def picture(
    vertices: ArrayLike,
    faces: ArrayLike,
    colors: ArrayLike,
    *,
    normals: ArrayLike | None = None,
    view: View | None = None,
    size: tuple[int, int] = (640, 640),
    fingers: Sequence[Finger] = (),
) -> Bytes:
    """Render a surface with one colour per vertex on white, filling the picture.

    Fully lit parts have exactly the given colours. Hidden parts of fingers are drawn transparent.

    Args:
        vertices: Positions, shape (V, 3).
        faces: Corners, counter-clockwise from outside, shape (F, 3).
        colors: Red, green, blue from 0 to 255, shape (V, 3).
        normals: Outward normals for shading, shape (V, 3); None: those of the faces, smoothed where
            they meet at less than 30 degrees.
        view: Direction of the camera; None: from above and the side.
        size: Width and height [pixels].
        fingers: Contacts to mark.

    Returns:
        Red, green, blue from 0 to 255, shape (height, width, 3).

    Raises:
        OutputError: OpenGL is not available.
        SettingError: Colours or normals are not one per vertex.
    """
    points, paint = np.asarray(vertices, dtype=np.float64), np.asarray(colors, dtype=np.uint8)
    shading = None if normals is None else np.asarray(normals, dtype=np.float64)
    for name, rows in (("colors", paint), ("normals", shading)):
        if rows is not None and rows.shape != (len(points), 3):
            raise SettingError(
                f"{name} must be one row of three per vertex, shape ({len(points)}, 3); "
                f"got {rows.shape}"
            )
    check_rendering()
    surface = _surface(points, np.asarray(faces, np.int64), paint, shading)
    return _rendered(surface, view or View(), size, fingers)


def choose_window() -> None:
    """Render with EGL if there is no display, which avoids VTK's warning about it."""
    if sys.platform.startswith("linux") and not os.environ.get("DISPLAY"):
        os.environ.setdefault(WINDOW, "vtkEGLRenderWindow")


def _surface(
    points: Floats, faces: Ints, colors: Bytes, normals: Floats | None
) -> "pyvista.PolyData":
    """The surface with the colours `rgb`, and normals if they are given."""
    import pyvista

    surface: pyvista.PolyData = pyvista.PolyData.from_regular_faces(points, faces.astype(int))
    surface.point_data["rgb"] = colors
    if normals is not None:
        surface.point_data.active_normals = normals
    return surface


def _rendered(
    surface: "pyvista.PolyData", view: View, size: tuple[int, int], fingers: Sequence[Finger]
) -> Bytes:
    import pyvista

    choose_window()
    plotter = pyvista.Plotter(off_screen=True, window_size=list(size), lighting="none")
    plotter.background_color = pyvista.Color("white")
    try:
        plotter.add_light(pyvista.Light(position=LIGHT, light_type="camera light", intensity=1.0))
        colored = plotter.add_mesh(
            surface,
            scalars="rgb",
            rgb=True,
            smooth_shading=True,
            split_sharp_edges=surface.point_data.active_normals is None,
            ambient=AMBIENT,
            diffuse=1.0 - AMBIENT,
        )
        points = np.array(surface.points)
        extent = math.sqrt(float(np.sort(np.ptp(points, axis=0))[1:].prod()))
        tails = [finger.point - ARROW * extent * finger.normal for finger in fingers]
        for finger in fingers:
            _mark(plotter, finger, extent)
        _aim_camera(plotter, np.concatenate([points, *np.reshape(tails, (-1, 1, 3))]), view, size)
        image = screenshot(plotter)
        if fingers:
            colored.visibility = False
            image = _with_hidden_fingers(image, screenshot(plotter))
    finally:
        plotter.close()
    return image


def _aim_camera(
    plotter: "pyvista.Plotter", points: Floats, view: View, size: tuple[int, int]
) -> None:
    """Aim an orthographic camera at the middle of the points, so that they fill the picture."""
    axes = view.axes
    projected = points @ axes.T
    low, high = projected.min(axis=0), projected.max(axis=0)
    across, up, _ = (float(extent) for extent in high - low)
    span = MARGIN * max(up, across * size[1] / size[0], np.finfo(float).tiny)
    middle = 0.5 * (low + high) @ axes
    camera = plotter.camera
    camera.parallel_projection = True
    camera.focal_point = tuple(middle)
    camera.position = tuple(middle + 2.0 * (float(np.linalg.norm(high - low)) + span) * axes[2])
    camera.up = tuple(axes[1])
    camera.parallel_scale = 0.5 * span
    plotter.reset_camera_clipping_range()


def screenshot(plotter: "pyvista.Plotter") -> Bytes:
    """RGB colours of a plotter's window, shape (height, width, 3)."""
    plotter.render()  # otherwise a second screenshot would be equal to the first
    return np.array(plotter.screenshot(return_img=True), dtype=np.uint8)[..., :3]


def _with_hidden_fingers(image: Bytes, fingers: Bytes) -> Bytes:
    """Darken a picture where the fingers, rendered alone on white, are dark."""
    shade = 1.0 - HIDDEN_OPACITY * (1.0 - fingers / 255.0)
    return np.asarray(np.rint(image * shade), dtype=np.uint8)


def _mark(plotter: "pyvista.Plotter", finger: Finger, extent: float) -> None:
    """Draw a ball with a white rim at a contact, and an arrow that ends at the ball."""
    import pyvista

    radius, start = BALL * extent, finger.point - ARROW * extent * finger.normal
    arrow = pyvista.Arrow(
        start=tuple(start),
        direction=tuple(finger.normal),
        scale=ARROW * extent - radius,
        tip_length=0.3,
        tip_radius=0.085,
        shaft_radius=0.03,
    )
    ball, rim = (
        pyvista.Sphere(radius=one, center=tuple(finger.point))
        for one in (radius, radius + RIM * extent)
    )
    for part in (ball, arrow):
        plotter.add_mesh(part, color=FINGER_COLOR, smooth_shading=True)
    plotter.add_mesh(rim, color="white", culling="front", lighting=False)
