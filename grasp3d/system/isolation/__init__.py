"""Function calls in child processes, with limits on memory and time."""

from grasp3d.system.isolation.calls import call, call_pickled, end_idle, pickle_call, working_folder
from grasp3d.system.isolation.limits import (
    CallFailedError,
    CallFailure,
    NeedsMemory,
    allowed_memory,
    describe_unexpected,
)

__all__ = [
    "CallFailedError",
    "CallFailure",
    "NeedsMemory",
    "allowed_memory",
    "call",
    "call_pickled",
    "describe_unexpected",
    "end_idle",
    "pickle_call",
    "working_folder",
]
