"""The command line: parses the arguments, runs one command, prints, and returns an exit code.

Heavy modules are imported by the commands when they run, so that `grasp3d --help` is fast.
"""

import os
import sys
from io import TextIOWrapper
from typing import Annotated

import tyro

from grasp3d.cli.batch import Batch
from grasp3d.cli.check import Check
from grasp3d.cli.design import Design
from grasp3d.cli.evaluate import Evaluate
from grasp3d.cli.label import Label
from grasp3d.cli.paper import Paper
from grasp3d.cli.sweep import Sweep
from grasp3d.cli.view import View
from grasp3d.errors import GraspError
from grasp3d.system.names import printable
from grasp3d.system.versions import package_version

Command = (
    Annotated[Label, tyro.conf.subcommand("label")]
    | Annotated[Check, tyro.conf.subcommand("check")]
    | Annotated[Evaluate, tyro.conf.subcommand("evaluate")]
    | Annotated[Batch, tyro.conf.subcommand("batch")]
    | Annotated[Sweep, tyro.conf.subcommand("sweep")]
    | Annotated[Design, tyro.conf.subcommand("design")]
    | Annotated[View, tyro.conf.subcommand("view")]
    | Annotated[Paper, tyro.conf.subcommand("paper")]
)

BAD_INPUT = 2
INTERRUPTED = 130


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; returns 0 on success, 1 if some meshes failed, 2 for bad input."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):  # a terminal may not support all characters
            stream.reconfigure(errors="backslashreplace")
    try:
        try:
            return _run(sys.argv[1:] if arguments is None else arguments)
        finally:
            sys.stdout.flush()
    except GraspError as error:
        print(f"grasp3d: {printable(str(error))}", file=sys.stderr)  # noqa: T201
        return BAD_INPUT
    except BrokenPipeError:  # the reader of the output has ended, as in `grasp3d batch ... | head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except KeyboardInterrupt as stop:
        details = f": {stop}" if str(stop) else ""
        print(f"grasp3d: interrupted{details}", file=sys.stderr)  # noqa: T201
        return INTERRUPTED


def _run(arguments: list[str]) -> int:
    if arguments == ["--version"]:
        print(f"grasp3d {package_version()}")  # noqa: T201
        return 0
    command = tyro.cli(
        Command,
        prog="grasp3d",
        description="Evaluate grasps on object meshes for fingertips with tactile sensors.",
        args=arguments,
        config=(tyro.conf.OmitArgPrefixes, tyro.conf.OmitSubcommandPrefixes),
    )
    return command.run()
