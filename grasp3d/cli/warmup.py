"""The command `grasp3d warmup`: compiles kernels ahead."""

import time

from grasp3d._kernels.compiling.ahead import warmup
from grasp3d.cli.progress_bars import waiting
from grasp3d.cli.tool_commands import Warmup
from grasp3d.system.counts import counted


def run(command: Warmup) -> int:
    """Run the command, and return the exit code."""
    begun = time.perf_counter()
    with waiting("compiling kernels", quiet=command.quiet):
        kernels = warmup()
    if not command.quiet:
        seconds = time.perf_counter() - begun
        text = f"compiled {counted(len(kernels), 'kernels')} in {seconds:.0f} s"
        print(text if kernels else "already compiled")  # noqa: T201
    return 0
