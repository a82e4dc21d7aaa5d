"""Rendering with OpenGL: cameras and lights of pictures, and whether they can be rendered.

Without OpenGL VTK ends the whole process instead of raising an error, so a separate process tests
it first.
"""

import math
import os
import subprocess
import sys
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from grasp3d.arrays import Bytes, Floats
from grasp3d.errors import OutputError
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


@cache
def can_render() -> bool:
    """Return whether pictures can be rendered; tested once, in a separate process."""
    return _ended_cleanly(begin_render_test())


@cache
def begin_render_test() -> subprocess.Popen[bytes] | None:
    """Start what `can_render` waits for, so that other work can be done in the meantime."""
    choose_window()
    return _started(
        "from grasp3d.rendering import opengl; raise SystemExit(not opengl.draws_a_triangle())"
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


def choose_window() -> None:
    """Render with EGL if there is no display, which avoids VTK's warning about it."""
    if sys.platform.startswith("linux") and not os.environ.get("DISPLAY"):
        os.environ.setdefault(WINDOW, "vtkEGLRenderWindow")


def screenshot(plotter: "pyvista.Plotter") -> Bytes:
    """RGB colours of a plotter's window, shape (height, width, 3)."""
    plotter.render()  # otherwise a second screenshot would be equal to the first
    return np.array(plotter.screenshot(return_img=True), dtype=np.uint8)[..., :3]
