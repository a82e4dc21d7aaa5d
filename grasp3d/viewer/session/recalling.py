"""Surfaces that were searched for other fingers and limits, to go back to them at once."""

from grasp3d.settings import Sampling
from grasp3d.viewer.session.planning import is_other
from grasp3d.viewer.session.state import Shown
from grasp3d.viewer.subjects.subject import Subject

MOST = 2
"""How many are kept beside the one that is shown: a large one takes hundreds of megabytes."""


class Recall:
    """The last surfaces of one object, one for each number of fingers and limit."""

    def __init__(self) -> None:
        self._kept: list[Subject] = []

    def keep(self, subject: Subject) -> None:
        """Keep one that is to be replaced; the oldest falls away."""
        self._kept = [*self._kept, subject][-MOST:]

    def take(self, shown: Shown, sampling: Sampling) -> Subject | None:
        """Give back the one that belongs to what is chosen; None: there is none.

        Args:
            shown: What is chosen.
            sampling: How grasps are searched, but for what is chosen.
        """
        for subject in self._kept:
            if not is_other(subject, shown, sampling):
                self._kept.remove(subject)
                return subject
        return None
