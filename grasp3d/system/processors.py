"""The number of processors available to this process."""

import os


def available_processors() -> int:
    """Return how many processors this process may use.

    A container or a cluster job may allow fewer than the machine has.
    """
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
