"""Compiling kernels once before the jobs of a run, outside their limits and times."""

import logging
from contextlib import suppress
from functools import cache

from grasp3d.errors import GraspError
from grasp3d.isolation import call, end_idle
from grasp3d.warming_up import announcement, compile_kernels

logger = logging.getLogger("grasp3d.compiling")


@cache
def compile_first(fingers: int, gripper: bool = False, forces: bool = False) -> None:
    """Compile kernels in a child process, unless they are compiled; its line is logged here.

    This process needs none of them, and otherwise every worker would compile them with its first
    mesh.

    Args:
        fingers: Number of fingers of the grasps; 0: only meshes are prepared.
        gripper: Whether a gripper must reach the grasps.
        forces: Whether grip forces of the grasps are needed, under a load.
    """
    with suppress(GraspError):  # the jobs report the same failure
        line = call(announcement, fingers, gripper, forces)
        if line:
            logger.warning(line)
            call(compile_kernels, fingers, gripper, forces)
            end_idle()  # the child has taken more memory than one that labels
