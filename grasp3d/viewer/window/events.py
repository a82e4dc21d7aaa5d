"""Event handlers of a window that run before VTK's own."""

from collections.abc import Callable
from typing import Any

PRIORITY = 10.0
"""VTK calls observers of higher priority first; its own have 0."""


class Events:
    """Calls handlers for events; a handled event is not passed on to VTK's own observers."""

    def __init__(self, interactor: Any, on_error: Callable[[BaseException], None]) -> None:
        """Take a window's interactor.

        Args:
            interactor: VTK's interactor.
            on_error: Called with exceptions of handlers; VTK would print them or abort.
        """
        self._interactor = interactor
        self._on_error = on_error

    def on(self, name: str, handler: Callable[[], bool]) -> None:
        """Add a handler.

        Args:
            name: VTK's name of the event.
            handler: Returns whether it has handled the event.
        """

        def called(*_: object) -> None:
            try:
                handled = handler()
            except BaseException as error:  # noqa: BLE001
                self._on_error(error)
                return
            if handled:
                self._interactor.GetCommand(tag).SetAbortFlag(1)

        tag = self._interactor.AddObserver(name, called, PRIORITY)
