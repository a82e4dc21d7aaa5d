"""Undo: earlier choices of the user for the current object."""

from dataclasses import fields
from typing import TYPE_CHECKING

from grasp3d.viewer.session.session import Session

if TYPE_CHECKING:
    from grasp3d.viewer.session.state import ViewState

MAX_STEPS = 100


class History:
    """Records the states of a session for the current object."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._number = session.number
        self._past: list[ViewState] = [session.state]

    def record(self) -> None:
        """Record the current state; not to be called while a slider is being dragged."""
        session = self._session
        if session.number != self._number:
            self._number, self._past = session.number, []
        if not self._past or self._past[-1] != session.state:
            self._past = [*self._past[-MAX_STEPS:], session.state]

    def undo(self) -> None:
        """Restore the previous state."""
        self.record()
        if len(self._past) < 2:
            self._session.show_message("nothing to undo")
            return
        self._past.pop()
        previous = self._past[-1]
        self._session.change(**{one.name: getattr(previous, one.name) for one in fields(previous)})
