"""Cache of one object's search results for other numbers of fingers and limits."""

from grasp3d.settings import AnySampling
from grasp3d.viewer.session.planning import needs_search
from grasp3d.viewer.session.state import ViewState
from grasp3d.viewer.subjects.subject import Subject

MAX_KEPT = 2
"""Cached results besides the displayed one; a large one takes hundreds of megabytes."""


class SearchCache:
    """The last search results of one object."""

    def __init__(self) -> None:
        self._kept: list[Subject] = []

    def add(self, subject: Subject) -> None:
        """Add a result; the oldest is dropped if there are too many."""
        self._kept = [*self._kept, subject][-MAX_KEPT:]

    def take(self, state: ViewState, sampling: AnySampling) -> Subject | None:
        """Remove and return the result for the chosen fingers and limits; None: not cached.

        Args:
            state: The user's choices.
            sampling: Search settings, apart from those in `state`.
        """
        for subject in self._kept:
            if not needs_search(subject, state, sampling):
                self._kept.remove(subject)
                return subject
        return None
