"""The picture of one visitor: drawn here, moved by the mouse in their browser."""

from typing import Any

import pyvista
from trame_rca.rca import VtkRemoteControlledArea

MOST_PIXELS = 4_000_000
"""Screens with more, as some dense ones have, get a smaller picture made larger."""


class Area(VtkRemoteControlledArea):  # type: ignore[misc]
    """A plotter's window without its keys, which the page answers by itself."""

    def __init__(self, plotter: pyvista.Plotter) -> None:
        super().__init__(plotter.render_window)

    def process_interaction_event(self, event: dict[str, Any]) -> None:
        """Let the mouse turn, shift and zoom."""
        if not str(event.get("type", "")).startswith("Key"):
            super().process_interaction_event(event)
