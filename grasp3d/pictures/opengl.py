"""Rendering with OpenGL: test whether it works, off-screen plotters, and their pixels.

Without OpenGL, VTK ends the whole process instead of raising an error, so a separate process tests
it first.
"""

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from grasp3d.arrays import Bytes
from grasp3d.errors import OutputError

if TYPE_CHECKING:
    import pyvista

WINDOW = "VTK_DEFAULT_OPENGL_WINDOW"
TIMEOUT = 120.0
"""Longest time that the separate process may take to test rendering [s]."""

OVERSAMPLING = 2
"""Rendered pixels per pixel of a picture, in each direction; they are averaged."""

MAX_DRAWN = 8192
"""Largest width or height that every OpenGL can render [pixels]."""

DPI = 72
"""Resolution at which texts have their nominal size [pixels per inch]."""

NO_OPENGL = (
    "pictures need OpenGL, which is not available; install EGL (on Debian: libegl1 libgl1) or run "
    "with a display"
)


@cache
def can_render() -> bool:
    """Return whether pictures can be rendered; tested once, in a separate process."""
    return _ended_cleanly(begin_render_test())


@cache
def begin_render_test() -> subprocess.Popen[bytes] | None:
    """Start the test that `can_render` waits for, so that other work can go on meanwhile."""
    choose_window()
    return _started(
        "from grasp3d.pictures import opengl; raise SystemExit(not opengl.draws_a_triangle())"
    )


def exits_cleanly(code: str) -> bool:
    """Return whether code succeeds in a separate process, as VTK may end the whole process."""
    return _ended_cleanly(_started(code))


def _started(code: str) -> subprocess.Popen[bytes] | None:
    """Start a process that runs code; None if it cannot be started."""
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
        raise OutputError(NO_OPENGL)


def draws_a_triangle() -> bool:
    """Render a triangle and return whether it is visible; without OpenGL this ends the process."""
    # With VTK itself, as PyVista's imports take a second.
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


def new_plotter(width: int, height: int, *, panel: bool = False) -> "pyvista.Plotter":
    """Return a plotter without lights: off screen, or a window with a second renderer as panel.

    Args:
        width: Width [pixels].
        height: Height [pixels].
        panel: Whether to make a window with a panel.
    """
    import pyvista

    plotter = pyvista.Plotter(
        shape=(1, 2 if panel else 1), off_screen=not panel, window_size=[width, height],
        border=False, lighting="none",
    )  # fmt: skip
    plotter.disable_anti_aliasing()
    return plotter


@contextmanager
def off_screen(width: int, height: int) -> Iterator[tuple["pyvista.Plotter", int]]:
    """Open a plotter for a picture; yield it and its oversampling factor in each direction."""
    choose_window()
    factor = OVERSAMPLING if OVERSAMPLING * max(width, height) <= MAX_DRAWN else 1
    plotter = new_plotter(factor * width, factor * height)
    try:
        plotter.renderers[0].GetRenderWindow().SetDPI(factor * DPI)
        yield plotter, factor
    finally:
        plotter.close()


def averaged(rendered: Bytes, factor: int) -> Bytes:
    """Average the pixels of a picture (h, w, 3) over squares of `factor` pixels."""
    height, width = rendered.shape[0] // factor, rendered.shape[1] // factor
    parts = rendered.reshape(height, factor, width, factor, 3)
    return np.asarray(np.rint(parts.mean(axis=(1, 3), dtype=np.float32)), dtype=np.uint8)


def screenshot(plotter: "pyvista.Plotter") -> Bytes:
    """RGB colours of a plotter's window, shape (height, width, 3)."""
    plotter.render()  # otherwise a second screenshot would be equal to the first
    return np.array(plotter.screenshot(return_img=True), dtype=np.uint8)[..., :3]
