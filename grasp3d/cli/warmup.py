"""The command `grasp3d warmup`: compiles kernels ahead."""

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from grasp3d.cli.options import Flag, Quiet
from grasp3d.system.counts import counted


@dataclass(frozen=True)
class Warmup:
    """Compile the kernels ahead, so that no later command or Python program waits for it.

    They are compiled when they are first needed, once per installation: use it to make the image of
    a container, or on the machines of a cluster.
    """

    fingers: Annotated[int, tyro.conf.arg(metavar="INT")] = 2
    """Largest number of fingers, 2 to 5; the kernels for four serve five as well."""

    gripper: Flag = False
    """Compile the kernels for grippers too."""

    forces: Flag = False
    """Compile the kernels for grip forces too, which a load needs."""

    cache: Annotated[Path | None, tyro.conf.arg(metavar="FOLDER", help_behavior_hint="")] = None
    """Folder for the machine code, such as one of an image; later runs find it, also read-only,
    where the environment variable NUMBA_CACHE_DIR names it (default: that of the user)."""

    quiet: Quiet = False

    def run(self) -> int:
        """Run the command, and return the exit code."""
        from grasp3d.batch.warmup import warmup
        from grasp3d.cli.progress_bars import waiting

        begun = time.perf_counter()
        with waiting("compiling kernels", quiet=self.quiet):
            kernels = warmup(
                self.fingers, gripper=self.gripper, forces=self.forces, cache=self.cache
            )
        if not self.quiet:
            seconds = time.perf_counter() - begun
            text = f"compiled {counted(len(kernels), 'kernels')} in {seconds:.0f} s"
            print(text if kernels else "already compiled")  # noqa: T201
        return 0
