"""The memory that this machine, or the container around this process, has."""

import contextlib
from pathlib import Path

import psutil

_CONTROL_GROUPS = Path("/sys/fs/cgroup")

_LIMITS = ("memory.max", "memory.high", "memory/memory.limit_in_bytes")
"""Files with the limits of a control group: of version 2, and of version 1."""


def machine_memory() -> float:
    """Return the memory of the machine, or the limit of a container, if that is lower [GB]."""
    limits = [float(psutil.virtual_memory().total)]
    for name in _LIMITS:
        with contextlib.suppress(OSError, ValueError):  # none, or the word max
            limits.append(float((_CONTROL_GROUPS / name).read_text(encoding="ascii")))
    return min(limit for limit in limits if limit > 0.0) / 1e9
