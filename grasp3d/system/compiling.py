"""What is compiled in this process: announced once, counted, or refused.

The line goes to the logger `grasp3d.compiling`; without any logging configured, Python writes it to
standard error.
"""

import logging
from collections.abc import Iterator
from contextlib import contextmanager

logger = logging.getLogger("grasp3d.compiling")


class NotCompiledError(Exception):
    """A kernel would have to be compiled, in a run that must not."""


class Compilations:
    """The kernels that this process has compiled."""

    def __init__(self) -> None:
        self.kernels: list[str] = []
        """Those that Python calls, as MODULE.FUNCTION, in the order of their compilation."""
        self.current = ""
        """The kernel that is being compiled; empty: none."""
        self._refusing = False

    def begin(self, kernel: str, *, stored: bool) -> None:
        """Note that a kernel is going to be compiled; the first one is announced.

        Args:
            kernel: Its name.
            stored: Whether later processes will find its machine code.

        Raises:
            NotCompiledError: Compilations are refused.
        """
        if self._refusing:
            raise NotCompiledError(kernel)
        if not self.kernels:
            logger.warning(announcement(stored=stored))
        self.kernels.append(kernel)
        self.current = kernel

    def end(self) -> None:
        """Note that the kernel is compiled, or could not be."""
        self.current = ""

    @contextmanager
    def refused(self) -> Iterator[None]:
        """Refuse compilations for the duration of the context."""
        self._refusing = True
        try:
            yield
        finally:
            self._refusing = False


compilations = Compilations()
"""Those of this process."""


def announcement(*, stored: bool) -> str:
    """Line about compilations that are going to begin; see `Compilations.begin`."""
    often = (
        "once per installation (grasp3d warmup does it ahead)"
        if stored
        else "in every process: no folder can be written for them (set NUMBA_CACHE_DIR)"
    )
    return f"grasp3d: compiling kernels, {often}"
