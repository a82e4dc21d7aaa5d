"""Pictures of painted surfaces, drawn by PyVista without a window.

Where there is no OpenGL, VTK ends the whole process instead of raising an error; so a process of
its own tries first.
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
import numpy.typing as npt

from grasp3d.arrays import Bytes, Floats, Ints
from grasp3d.errors import OutputError, SettingError
from grasp3d.settings import DEGREE, Radians

if TYPE_CHECKING:
    import pyvista

WINDOW = "VTK_DEFAULT_OPENGL_WINDOW"
PATIENCE = 120.0
"""Longest wait for the first picture of the trying process [s]."""

LAMP = (-0.35, 0.45, 1.0)
"""From where the light comes: left of the eye and above it."""
AMBIENT = 0.55
"""Share of the light that comes from everywhere."""

MARGIN = 1.05
"""How much larger the picture is than what it shows."""

BALL = 0.022
"""Radius of a finger's mark, as a share of the mean of the surface's two largest extents."""
ARROW = 0.4
"""Length of its arrow, likewise."""
THROUGH = 0.55
"""How dark its hidden parts shine through."""
FINGER_COLOR = "#1A1A1A"


@dataclass(frozen=True)
class View:
    """From where a surface is seen; the z-axis is up."""

    azimuth: Radians = 75.0 * DEGREE
    """Direction of the eye about the z-axis, from the x-axis."""
    elevation: Radians = 35.0 * DEGREE
    """Its angle above the xy-plane."""

    @property
    def axes(self) -> Floats:
        """Unit vectors to the right, up, and toward the eye, shape (3, 3)."""
        sine, cosine = math.sin(self.azimuth), math.cos(self.azimuth)
        up, level = math.sin(self.elevation), math.cos(self.elevation)
        return np.array(
            [
                [-sine, cosine, 0.0],
                [-up * cosine, -up * sine, level],
                [level * cosine, level * sine, up],
            ]
        )


@dataclass(frozen=True, eq=False)
class Finger:
    """A finger to be marked: a ball where it touches and an arrow along its push."""

    place: Floats
    """Contact in the surface's frame, shape (3,)."""
    push: Floats
    """Inward unit normal, shape (3,)."""


@cache
def can_render() -> bool:
    """Tell whether pictures can be drawn here; tried once, in a process of its own."""
    choose_window()
    return holds(
        "from grasp3d import rendering; raise SystemExit(not rendering.draws_a_triangle())"
    )


def holds(code: str) -> bool:
    """Tell whether code ends well in a process of its own, as VTK may end the whole process."""
    try:
        tried = subprocess.run(  # noqa: S603
            [sys.executable, "-c", code], check=False, capture_output=True, timeout=PATIENCE
        )
    except (OSError, subprocess.TimeoutExpired):
        return False
    return tried.returncode == 0


def check_rendering() -> None:
    """Tell before the work whether pictures can be drawn after it.

    Raises:
        OutputError: There is no OpenGL here.
    """
    if not can_render():
        raise OutputError(
            "pictures need OpenGL, which is not here; install EGL (on Debian: libegl1 libgl1) "
            "or run where there is a display"
        )


def draws_a_triangle() -> bool:
    """Draw something and see whether it shows; without OpenGL this ends the process."""
    points = np.array([[0.0, -1.0, -1.0], [0.0, 1.0, -1.0], [0.0, 0.0, 1.0]])
    black = _Surface(points, np.array([[0, 1, 2]]), np.zeros((3, 3), np.uint8), None)
    drawn = _drawn(black, View(0.0, 0.0), (32, 32), ())
    return bool(drawn.min() < drawn.max())


def picture(
    vertices: npt.ArrayLike,
    faces: npt.ArrayLike,
    colors: npt.ArrayLike,
    *,
    normals: npt.ArrayLike | None = None,
    view: View | None = None,
    size: tuple[int, int] = (640, 640),
    fingers: Sequence[Finger] = (),
) -> Bytes:
    """Draw a surface with one colour per vertex on white, filling the picture.

    Fully lit the surface has just the given colours. What is hidden of a finger shines through.

    Args:
        vertices: Positions, shape (V, 3).
        faces: Corners, counter-clockwise from outside, shape (F, 3).
        colors: Red, green, blue from 0 to 255, shape (V, 3).
        normals: Outward normals for the light, shape (V, 3); None: those of the faces, made smooth
            where they meet at less than 30 degrees.
        view: From where it is seen; None: from above and the side.
        size: Width and height [pixels].
        fingers: Contacts to mark.

    Returns:
        Red, green, blue from 0 to 255, shape (height, width, 3).

    Raises:
        OutputError: There is no OpenGL here.
        SettingError: Colours or normals are not one per vertex.
    """
    points, paint = np.asarray(vertices, dtype=np.float64), np.asarray(colors, dtype=np.uint8)
    light = None if normals is None else np.asarray(normals, dtype=np.float64)
    for name, rows in (("colors", paint), ("normals", light)):
        if rows is not None and rows.shape != (len(points), 3):
            raise SettingError(
                f"{name} must be one row of three per vertex, shape ({len(points)}, 3); "
                f"got {rows.shape}"
            )
    check_rendering()
    surface = _Surface(points, np.asarray(faces, np.int64), paint, light)
    return _drawn(surface, view or View(), size, fingers)


def extent_of(points: Floats) -> float:
    """Mean of the two largest extents of a surface, which sizes the fingers' marks."""
    return math.sqrt(float(np.sort(np.ptp(points, axis=0))[1:].prod()))


def choose_window() -> None:
    """Draw by EGL where there is no screen, without VTK's complaint about the missing one."""
    if sys.platform.startswith("linux") and not os.environ.get("DISPLAY"):
        os.environ.setdefault(WINDOW, "vtkEGLRenderWindow")


@dataclass(frozen=True, eq=False)
class _Surface:
    points: Floats
    faces: Ints
    colors: Bytes
    normals: Floats | None

    def made(self) -> "pyvista.PolyData":
        import pyvista

        surface: pyvista.PolyData = pyvista.PolyData.from_regular_faces(
            self.points, self.faces.astype(int)
        )
        surface.point_data["rgb"] = self.colors
        if self.normals is not None:
            surface.point_data.active_normals = self.normals
        return surface


def _drawn(
    surface: _Surface, view: View, size: tuple[int, int], fingers: Sequence[Finger]
) -> Bytes:
    import pyvista

    choose_window()
    plotter = pyvista.Plotter(off_screen=True, window_size=list(size), lighting="none")
    plotter.background_color = pyvista.Color("white")
    try:
        plotter.add_light(pyvista.Light(position=LAMP, light_type="camera light", intensity=1.0))
        painted = plotter.add_mesh(
            surface.made(),
            scalars="rgb",
            rgb=True,
            smooth_shading=True,
            split_sharp_edges=surface.normals is None,
            ambient=AMBIENT,
            diffuse=1.0 - AMBIENT,
        )
        extent = extent_of(surface.points)
        for finger in fingers:
            _mark(plotter, finger, extent)
        tails = [finger.place - ARROW * extent * finger.push for finger in fingers]
        _frame(plotter, np.concatenate([surface.points, *np.reshape(tails, (-1, 1, 3))]), view)
        drawn = _shot(plotter)
        if fingers:
            painted.visibility = False
            drawn = _shining_through(drawn, _shot(plotter))
    finally:
        plotter.close()
    return drawn


def _frame(plotter: "pyvista.Plotter", points: Floats, view: View) -> None:
    """Aim a camera without perspective so that the points fill the picture up to a margin."""
    axes = view.axes
    seen = points @ axes.T
    low, high = seen.min(axis=0), seen.max(axis=0)
    middle = 0.5 * (low + high) @ axes
    width, height = plotter.window_size
    span = MARGIN * np.maximum(high - low, np.finfo(float).tiny)
    camera = plotter.camera
    camera.parallel_projection = True
    camera.focal_point = tuple(middle)
    camera.position = tuple(middle + 2.0 * float(np.linalg.norm(span)) * axes[2])
    camera.up = tuple(axes[1])
    camera.parallel_scale = 0.5 * max(span[1], span[0] * height / width)
    plotter.reset_camera_clipping_range()


def _shot(plotter: "pyvista.Plotter") -> Bytes:
    plotter.render()  # a second picture would otherwise be the first
    return np.array(plotter.screenshot(return_img=True), dtype=np.uint8)[..., :3]


def _shining_through(drawn: Bytes, alone: Bytes) -> Bytes:
    """Darken a picture where the fingers, drawn alone on white, are dark."""
    shade = 1.0 - THROUGH * (1.0 - alone / 255.0)
    return np.asarray(np.rint(drawn * shade), dtype=np.uint8)


def _mark(plotter: "pyvista.Plotter", finger: Finger, extent: float) -> None:
    import pyvista

    length = ARROW * extent
    ball = pyvista.Sphere(radius=BALL * extent, center=tuple(finger.place))
    arrow = pyvista.Arrow(
        start=tuple(finger.place - length * finger.push),
        direction=tuple(finger.push),
        scale=length,
        tip_length=0.3,
        tip_radius=0.085,
        shaft_radius=0.03,
    )
    for part in (ball, arrow):
        plotter.add_mesh(part, color=FINGER_COLOR, smooth_shading=True)
