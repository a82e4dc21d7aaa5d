"""The lines about compiling kernels, which a command may hide."""

import logging
from collections.abc import Iterator
from contextlib import contextmanager

COMPILING = "grasp3d.compiling"
"""Name of their logger."""


@contextmanager
def compiling_lines(*, hidden: bool) -> Iterator[None]:
    """Show or hide the lines for the duration of the context."""
    logger = logging.getLogger(COMPILING)
    level = logger.level
    if hidden:
        logger.setLevel(logging.ERROR)
    try:
        yield
    finally:
        logger.setLevel(level)
