"""Check that a window can be opened."""

import os
import sys

from grasp3d.errors import OutputError
from grasp3d.pictures.opengl import exits_cleanly

ALTERNATIVES = (
    "grasp3d view shows a page for a browser there, or writes a picture with --screenshot FILE"
)
ATTEMPTS = 2
"""An X server that restarts after its last window was closed may refuse one connection."""


def display_problem() -> str:
    """Why no window can be opened, from one in a child process; empty if one can.

    On Linux VTK needs an X server, and may abort the process if it does not respond.
    """
    if not sys.platform.startswith("linux"):
        return ""
    name = os.environ.get("DISPLAY")
    if not name:
        return "no display here: DISPLAY is not set"
    if not any(_child_opens_window() for _ in range(ATTEMPTS)):
        return f"no window opens on display {name} (no answer, or no OpenGL)"
    return ""


def check_display() -> None:
    """Check that a window can be opened.

    Raises:
        OutputError: It cannot.
    """
    if problem := display_problem():
        raise OutputError(f"{problem}; {ALTERNATIVES}")


def _child_opens_window() -> bool:
    return exits_cleanly(
        "from grasp3d.viewer.window import display; raise SystemExit(not display.opens_a_window())"
    )


def opens_a_window() -> bool:
    """Open a hidden window, and check that VTK has chosen an X window for it."""
    import vtkmodules.vtkRenderingOpenGL2  # noqa: F401
    from vtkmodules.vtkRenderingCore import vtkRenderWindow

    window = vtkRenderWindow()
    window.ShowWindowOff()
    window.SetSize(16, 16)
    window.Render()
    return bool(window.GetClassName() == "vtkXOpenGLRenderWindow")
