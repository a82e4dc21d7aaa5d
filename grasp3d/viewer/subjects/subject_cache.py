"""Cache of the objects that were opened last."""

import threading
from collections import OrderedDict
from collections.abc import Callable

from grasp3d.system.progress import Progress
from grasp3d.viewer.subjects.subject import Subject

MAX_OPEN = 4
"""Default number of objects that are kept open."""

POLL_INTERVAL = 0.1
"""How often a thread that waits for another one's opening reports progress [s]."""


class SubjectCache:
    """Keeps the objects that were opened last, for several threads.

    Each object is opened by one thread at a time. An opening that fails or is cancelled is not
    cached: the next one starts again.
    """

    def __init__(self, capacity: int = MAX_OPEN) -> None:
        self._capacity = capacity
        self._subjects: OrderedDict[int, Subject] = OrderedDict()
        self._lock = threading.Lock()
        self._count = 0

    def cached(self, read: Callable[[Progress], Subject]) -> Callable[[Progress], Subject]:
        """Add the cache to a function that opens one object.

        Args:
            read: Opens the object.
        """
        number, opening, fraction = self._count, threading.Lock(), [0.0]
        self._count += 1

        def recorded(progress: Progress) -> Progress:
            def report(done: float) -> None:
                fraction[0] = done
                progress(done)

            return report

        def read_cached(progress: Progress) -> Subject:
            while not opening.acquire(timeout=POLL_INTERVAL):
                progress(fraction[0])  # of the other thread; raises if this opening is cancelled
            try:
                found = self._get(number)
                return found or self._store(number, read(recorded(progress)))
            finally:
                opening.release()

        return read_cached

    def _get(self, number: int) -> Subject | None:
        with self._lock:
            if number in self._subjects:
                self._subjects.move_to_end(number)
            return self._subjects.get(number)

    def _store(self, number: int, subject: Subject) -> Subject:
        with self._lock:
            self._subjects[number] = subject
            while len(self._subjects) > self._capacity:
                self._subjects.popitem(last=False)
        return subject
