"""Compiling kernels once before the jobs of a run, outside their limits and times."""

import logging
import threading
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from functools import cache

from grasp3d.batch.warmup import announcement, compile_kernels
from grasp3d.errors import GraspError
from grasp3d.system.isolation import call, end_idle

logger = logging.getLogger("grasp3d.compiling")


@cache
def compile_first(
    fingers: int, gripper: bool = False, forces: bool = False, *, children: int = 1
) -> None:
    """Compile kernels in a child process, unless they are compiled; its line is logged here.

    This process needs none of them, and otherwise every worker would compile them with its first
    mesh.

    Args:
        fingers: Number of fingers of the grasps; 0: only meshes are prepared.
        gripper: Whether a gripper must reach the grasps.
        forces: Whether grip forces of the grasps are needed, under a load.
        children: Child processes that load the kernels at the same time, if they are compiled.
    """
    with suppress(GraspError):  # the jobs report the same failure
        line = _announcements(children, fingers, gripper, forces)[0]
        if line:
            logger.warning(line)
            call(compile_kernels, fingers, gripper, forces)
            end_idle()  # the child has taken more memory than one that labels


def _announcements(children: int, fingers: int, gripper: bool, forces: bool) -> list[str]:
    """The line of each child, which loads the kernels to find out whether they are compiled."""
    interrupted = threading.Event()

    def ask() -> str:
        return call(announcement, fingers, gripper, forces, cancelled=interrupted.is_set)

    with ThreadPoolExecutor(children) as threads:
        try:
            return [line.result() for line in [threads.submit(ask) for _ in range(children)]]
        except BaseException:  # the other children are ended, too
            interrupted.set()
            raise
