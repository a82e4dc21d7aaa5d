"""What is compiled in this process, or for it in others: announced once, and counted.

The line goes to the logger `grasp3d.compiling`; without any logging configured, Python writes it to
standard error.
"""

import logging
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

from grasp3d.system.counts import counted

logger = logging.getLogger("grasp3d.compiling")


class Compilations:
    """The kernels that were compiled for this process."""

    def __init__(self) -> None:
        self.kernels: list[str] = []
        """Those that Python calls, as MODULE.FUNCTION, in the order of their compilation."""
        self.current = ""
        """The kernel that is being compiled, with how many of how many; empty: none."""

    def begin(self, kernel: str, *, stored: bool) -> None:
        """Note that this process is going to compile a kernel; the first one is announced.

        Args:
            kernel: Its name.
            stored: Whether later processes will find its machine code.
        """
        if not self.kernels:
            logger.warning(announcement(f"{kernel} and what else is needed", stored=stored))
        self.kernels.append(kernel)
        self.current = kernel

    def end(self) -> None:
        """Note that the kernel is compiled, or could not be."""
        self.current = ""

    @contextmanager
    def several(self, kernels: Sequence[str], *, stored: bool) -> Iterator[Callable[[str], None]]:
        """Announce that kernels are compiled by other processes; call what it yields with each."""
        logger.warning(announcement(counted(len(kernels), "kernels"), stored=stored))
        before = len(self.kernels)

        def begin(kernel: str) -> None:
            self.kernels.append(kernel)
            self.current = f"{kernel}, {len(self.kernels) - before} of {len(kernels)}"

        try:
            yield begin
        finally:
            self.end()


compilations = Compilations()
"""Those of this process."""


def announcement(kernels: str, *, stored: bool) -> str:
    """Line about compilations that are going to begin.

    Args:
        kernels: What is compiled.
        stored: As in `Compilations.begin`.
    """
    often = (
        "once for this processor and version of Numba"
        if stored
        else "in every process: no folder can be written for them (set NUMBA_CACHE_DIR)"
    )
    return f"grasp3d: compiling {kernels}, {often}"
