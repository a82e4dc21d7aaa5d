"""How many processors there are for this process."""

import os


def available_processors() -> int:
    """Processors that this process may use, which a container or a cluster job may limit."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
