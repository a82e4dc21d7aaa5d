"""The number of processors available to this process."""

import os

from grasp3d.errors import SettingError


def available_processors() -> int:
    """Return how many processors this process may use.

    A container or a cluster job may allow fewer than the machine has.
    """
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def thread_count(threads: int | None) -> int:
    """The number of threads to use.

    Args:
        threads: As it was given; None: one per processor.

    Raises:
        SettingError: It is below 1.
    """
    if threads is not None and threads < 1:
        raise SettingError(f"threads must be at least 1; got {threads}")
    return threads or available_processors()
