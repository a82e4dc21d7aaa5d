"""The interactive picture of a page: rendered on the server, controlled from the browser."""

from typing import Any

import pyvista
from trame_rca.rca import VtkRemoteControlledArea

MAX_PIXELS = 4_000_000
"""Largest number of pixels rendered for a browser, which enlarges the picture if it needs more."""


class RemoteView(VtkRemoteControlledArea):  # type: ignore[misc]
    """The render window of a plotter, without VTK's key bindings; the page handles keys."""

    def __init__(self, plotter: pyvista.Plotter) -> None:
        super().__init__(plotter.render_window)

    def process_interaction_event(self, event: dict[str, Any]) -> None:
        """Forward mouse events, but no key events."""
        if not str(event.get("type", "")).startswith("Key"):
            super().process_interaction_event(event)
