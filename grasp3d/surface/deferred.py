"""Values that are computed once, when they are first read."""

from collections.abc import Callable
from typing import Generic, TypeVar

from grasp3d.system.progress import Progress, ignore

T = TypeVar("T")


class Deferred(Generic[T]):
    """A value that is computed when it is first read, or earlier by `compute`, with progress."""

    def __init__(self, function: Callable[[Progress], T]) -> None:
        self._function = function
        self._computed: list[T] = []

    @property
    def computed(self) -> T | None:
        """The value if it has been computed, else None."""
        return self._computed[0] if self._computed else None

    @property
    def value(self) -> T:
        """The value; computed now if it has not been."""
        return self.compute(ignore)

    def compute(self, progress: Progress) -> T:
        """Return the value; compute it now if it has not been.

        Args:
            progress: Called with the fraction of the work done, from 0 to 1.
        """
        if not self._computed:
            self._computed.append(self._function(progress))
        return self._computed[0]
