"""Events of a window, heard before VTK's own answers to them."""

from collections.abc import Callable
from typing import Any

FIRST = 10.0
"""VTK asks observers of higher priority first; its own have 0."""


class Events:
    """Calls functions for events; an event that is answered goes no further."""

    def __init__(self, window: Any, fail: Callable[[BaseException], None]) -> None:  # noqa: ANN401
        """Take a window's interactor.

        Args:
            window: VTK's interactor.
            fail: Is told what an answer raised; VTK would print it, or end the process.
        """
        self._window = window
        self._fail = fail

    def on(self, name: str, answer: Callable[[], bool]) -> None:
        """Answer an event.

        Args:
            name: As VTK calls it.
            answer: Tells whether it was answered, so that nobody else has to.
        """

        def called(*_: object) -> None:
            try:
                answered = answer()
            except BaseException as error:  # noqa: BLE001
                self._fail(error)
                return
            if answered:
                self._window.GetCommand(tag).SetAbortFlag(1)

        tag = self._window.AddObserver(name, called, FIRST)
