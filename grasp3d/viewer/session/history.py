"""What was chosen before, to take back what was done by accident."""

from dataclasses import fields
from typing import TYPE_CHECKING

from grasp3d.viewer.session.session import Session

if TYPE_CHECKING:
    from grasp3d.viewer.session.state import Shown

LONGEST = 100


class History:
    """Remembers what was chosen for the object that is looked at."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._number = session.number
        self._past: list[Shown] = [session.shown]

    def note(self) -> None:
        """Remember what is chosen now; to be called where no slider is being dragged."""
        session = self._session
        if session.number != self._number:
            self._number, self._past = session.number, []
        if not self._past or self._past[-1] != session.shown:
            self._past = [*self._past[-LONGEST:], session.shown]

    def undo(self) -> None:
        """Choose again what was chosen before."""
        self.note()
        if len(self._past) < 2:
            self._session.tell("nothing to undo")
            return
        self._past.pop()
        before = self._past[-1]
        self._session.change(**{one.name: getattr(before, one.name) for one in fields(before)})
