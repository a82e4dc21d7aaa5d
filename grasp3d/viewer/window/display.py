"""Check that a window can be opened."""

import os
import sys

from grasp3d.errors import OutputError
from grasp3d.plots.rendering import exits_cleanly

ALTERNATIVES = "use --web for a browser or --screenshot FILE for a picture"
ATTEMPTS = 2
"""An X server that restarts after its last window was closed may refuse one connection."""


def check_display() -> None:
    """Open a window in a child process, as a test.

    On Linux VTK needs an X server, and may abort the process if it does not respond.

    Raises:
        OutputError: No window can be opened.
    """
    if not sys.platform.startswith("linux"):
        return
    name = os.environ.get("DISPLAY")
    if not name:
        raise OutputError(f"no display here: DISPLAY is not set; {ALTERNATIVES}")
    if not any(_child_opens_window() for _ in range(ATTEMPTS)):
        raise OutputError(
            f"no window opens on display {name} (no answer, or no OpenGL); {ALTERNATIVES}"
        )


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
