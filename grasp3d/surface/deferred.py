"""Values that are computed once, when they are first read."""

import threading
from collections.abc import Callable
from typing import Any, Generic, TypeVar

from grasp3d.system.progress import Progress, ignore

T = TypeVar("T")


class Deferred(Generic[T]):
    """A value that is computed when it is first read, or earlier by `compute`, with progress.

    Several threads that read it at the same time compute it once.
    """

    def __init__(self, function: Callable[[Progress], T]) -> None:
        self._function: Callable[[Progress], T] | None = function
        self._computed: T | None = None
        self._lock = threading.Lock()

    @property
    def computed(self) -> T | None:
        """The value if it has been computed, else None."""
        return self._computed

    @property
    def value(self) -> T:
        """The value; computed now if it has not been."""
        return self.compute(ignore)

    def compute(self, progress: Progress) -> T:
        """Return the value; compute it now if it has not been.

        Args:
            progress: Called with the fraction of the work done, from 0 to 1.
        """
        with self._lock:
            if self._function is not None:
                self._computed = self._function(progress)
                self._function = None  # and what it refers to
        assert self._computed is not None
        return self._computed

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if name != "_lock"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state, _lock=threading.Lock())
