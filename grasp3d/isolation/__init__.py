"""Work in child processes of this one, watched and ended when it takes too much."""

from grasp3d.isolation.calls import call, end_idle, working_folder
from grasp3d.isolation.limits import NeedsMemory, allowed_memory
from grasp3d.isolation.losses import Loss, Lost, unexpected

__all__ = [
    "Loss",
    "Lost",
    "NeedsMemory",
    "allowed_memory",
    "call",
    "end_idle",
    "unexpected",
    "working_folder",
]
