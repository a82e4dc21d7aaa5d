"""Function calls in child processes, with limits on memory and time."""

from grasp3d.system.isolation.calls import call, end_idle, working_folder
from grasp3d.system.isolation.failures import CallFailedError, CallFailure, describe_unexpected
from grasp3d.system.isolation.limits import NeedsMemory, allowed_memory

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
