"""Function calls in child processes, with limits on memory and time."""

from grasp3d.isolation.calls import call, end_idle, working_folder
from grasp3d.isolation.failures import CallFailedError, CallFailure, describe_unexpected
from grasp3d.isolation.limits import NeedsMemory, allowed_memory

__all__ = [
    "CallFailedError",
    "CallFailure",
    "NeedsMemory",
    "allowed_memory",
    "call",
    "describe_unexpected",
    "end_idle",
    "working_folder",
]
