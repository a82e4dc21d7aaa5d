"""Whether a window can be opened here."""

import os
import sys

from grasp3d.errors import OutputError
from grasp3d.rendering import holds

INSTEAD = "use --web for a browser or --screenshot FILE for a picture"
TRIES = 2
"""A server whose last window was just closed begins anew, and may refuse once."""


def check_display() -> None:
    """Try, in a process of its own, whether a window opens.

    VTK needs an X server on Linux, and where that does not answer it may end the whole process.

    Raises:
        OutputError: It does not.
    """
    if not sys.platform.startswith("linux"):
        return
    name = os.environ.get("DISPLAY")
    if not name:
        raise OutputError(f"no display here: DISPLAY is not set; {INSTEAD}")
    if not any(_tried() for _ in range(TRIES)):
        raise OutputError(f"no window opens on display {name} (no answer, or no OpenGL); {INSTEAD}")


def _tried() -> bool:
    return holds(
        "from grasp3d.viewer.window import display; raise SystemExit(not display.opens_a_window())"
    )


def opens_a_window() -> bool:
    """Open the window that VTK chooses, without showing it, and see whether it belongs to X."""
    import vtkmodules.vtkRenderingOpenGL2  # noqa: F401
    from vtkmodules.vtkRenderingCore import vtkRenderWindow

    window = vtkRenderWindow()
    window.ShowWindowOff()
    window.SetSize(16, 16)
    window.Render()
    return bool(window.GetClassName() == "vtkXOpenGLRenderWindow")
