"""Names of the steps of a long computation, and the time that each takes."""

import time
from collections.abc import Iterator
from contextlib import contextmanager


class StepTimes:
    """The time of each step, in the order in which they began."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        """Time of the finished steps [s], by name."""
        self._running: tuple[str, float] | None = None

    def begin(self, name: str) -> None:
        """Begin a step, and end the one before."""
        self.end()
        self._running = name, time.monotonic()

    def end(self) -> None:
        """End the running step."""
        if self._running is not None:
            name, began = self._running
            self._running = None
            self.seconds[name] = self.seconds.get(name, 0.0) + time.monotonic() - began

    def __str__(self) -> str:
        """List the steps with their times; the last one is the running one."""
        texts = [f"{name} {seconds:.1f} s" for name, seconds in self.seconds.items()]
        if (running := self._running) is not None:
            name, began = running
            texts.append(f"{name} {time.monotonic() - began:.1f} s and not finished")
        return ", ".join(texts) or "no step had begun"


_times: StepTimes | None = None


def begin_step(name: str) -> None:
    """Record that a step of a computation begins, if the times of steps are recorded.

    Args:
        name: The step, as a gerund: `repairing the surface`.
    """
    if _times is not None:
        _times.begin(name)


@contextmanager
def recorded_steps() -> Iterator[StepTimes]:
    """Record the times of the steps that begin in this context."""
    global _times  # noqa: PLW0603
    before, times = _times, StepTimes()
    _times = times
    try:
        yield times
    finally:
        times.end()
        _times = before
