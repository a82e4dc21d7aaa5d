"""Objects that were opened last, kept for whoever opens them again."""

import threading
from collections import OrderedDict
from collections.abc import Callable

from grasp3d.system.progress import Progress
from grasp3d.viewer.subjects.subject import Subject

KEPT = 4
"""How many objects are kept open."""

WAIT = 0.1
"""How often one who waits for another's opening looks whether it is still wanted [s]."""


class Shelf:
    """Keeps the last few objects; several threads may open them, each object one at a time.

    An opening that is abandoned, or fails, leaves nothing behind: the next one begins anew.
    """

    def __init__(self, room: int = KEPT) -> None:
        self._room = room
        self._kept: OrderedDict[int, Subject] = OrderedDict()
        self._guard = threading.Lock()
        self._count = 0

    def keeping(self, read: Callable[[Progress], Subject]) -> Callable[[Progress], Subject]:
        """Give what opens an object the shelf.

        Args:
            read: Opens it.
        """
        number, opening, share = self._count, threading.Lock(), [0.0]
        self._count += 1

        def told(progress: Progress) -> Progress:
            def tell(done: float) -> None:
                share[0] = done
                progress(done)

            return tell

        def kept(progress: Progress) -> Subject:
            while not opening.acquire(timeout=WAIT):
                progress(share[0])  # of the other's work; raises where none wants it any more
            try:
                found = self._take(number)
                return found or self._put(number, read(told(progress)))
            finally:
                opening.release()

        return kept

    def _take(self, number: int) -> Subject | None:
        with self._guard:
            if number in self._kept:
                self._kept.move_to_end(number)
            return self._kept.get(number)

    def _put(self, number: int, subject: Subject) -> Subject:
        with self._guard:
            self._kept[number] = subject
            while len(self._kept) > self._room:
                self._kept.popitem(last=False)
        return subject
