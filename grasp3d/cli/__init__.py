"""The command line: parses the arguments, runs one command, prints, and returns an exit code.

The modules of options import nothing heavy, so that `grasp3d --help` is fast.
"""

import logging
import sys
from dataclasses import dataclass
from importlib import import_module
from textwrap import indent
from typing import get_args

import docstring_parser
import tyro

from grasp3d.cli.design_command import Design
from grasp3d.cli.grasp_commands import Evaluate, Simulate, Validate
from grasp3d.cli.library_commands import Batch, Sweep
from grasp3d.cli.mesh_commands import Check, Label, Perturb, View
from grasp3d.cli.options import REGISTRY, Flag
from grasp3d.cli.streams import (
    check_output,
    discard_output,
    errors_are_lost,
    prepare_streams,
    print_error,
)
from grasp3d.cli.tool_commands import Hand, Paper, Warmup
from grasp3d.errors import GraspError
from grasp3d.system import compiling
from grasp3d.system.context import running
from grasp3d.system.names import printable
from grasp3d.system.versions import package_version

Command = (
    Label
    | Check
    | Evaluate
    | Validate
    | Simulate
    | Batch
    | Sweep
    | Perturb
    | Design
    | Hand
    | View
    | Paper
    | Warmup
)
"""The options of a command, which the module of its name runs."""


@dataclass(frozen=True)
class Program:
    """The options of the program, and those of one command.

    Example:
        # Label a mesh, and write it
        grasp3d label meshes/mug.glb --max-opening 60mm
        # The options of a command
        grasp3d label --help
    """

    command: Command

    version: Flag = False
    """Print the version."""


BAD_INPUT = 2
INTERRUPTED = 130

KINDS = {kind.__name__.lower(): kind for kind in get_args(Command)}
"""The options of each command by its name."""


def examples_of(command: str) -> str:
    """Return the examples in the docstring of a command's options, or of the program.

    The folder `meshes` in them is the one that comes with the package, `grasps.csv` a table with
    columns x1 y1 z1 x2 y2 z2, `tried.csv` one of poses with outcomes, `hand.urdf` a robot's hand.

    Args:
        command: Name of the command; another word: the program.
    """
    [examples] = docstring_parser.parse_from_object(KINDS.get(command, Program)).examples
    return indent(examples.description or "", "  ")


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; returns 0 on success, 1 if some meshes failed, 2 for bad input."""
    prepare_streams()
    try:
        return _printed(sys.argv[1:] if arguments is None else arguments)
    except GraspError as error:
        print_error(printable(str(error)))
        return BAD_INPUT
    except BrokenPipeError:  # the reader of the output has ended, as in `grasp3d batch ... | head`
        discard_output()
        return 0
    except KeyboardInterrupt as stop:
        details = f": {stop}" if str(stop) else ""
        print_error(f"interrupted{details}")
        return INTERRUPTED


def _printed(arguments: list[str]) -> int:
    """Run the command line, and write what it prints.

    Raises:
        OutputError: Standard output cannot be written.
    """
    try:
        try:
            return _run(arguments)
        finally:
            sys.stdout.flush()
    except OSError as error:
        check_output(error)
        if errors_are_lost(error):  # those of usage, which the parser prints
            return BAD_INPUT
        raise


def _run(arguments: list[str]) -> int:
    if arguments[:1] == ["gripper"]:  # another name of that command
        arguments = ["hand", *arguments[1:]]
    if arguments == ["--version"]:
        print(f"grasp3d {package_version()}")  # noqa: T201
        return 0
    try:
        program = tyro.cli(
            Program,
            prog="grasp3d",
            description="Evaluate grasps on object meshes for fingertips with tactile sensors.",
            args=arguments,
            registry=REGISTRY,
            config=(
                tyro.conf.OmitArgPrefixes,
                tyro.conf.OmitSubcommandPrefixes,
                tyro.conf.DisallowNone,
            ),
        )
    except SystemExit as end:
        if not end.code and {"-h", "--help"} & set(arguments):
            print(f"examples:\n{examples_of(arguments[0])}")  # noqa: T201
        raise
    level = compiling.logger.level
    if getattr(program.command, "quiet", False):
        compiling.logger.setLevel(logging.ERROR)
    try:
        module = import_module(f"{__name__}.{type(program.command).__name__.lower()}")
        with running(strict=getattr(program.command, "strict", False)):
            return int(module.run(program.command))
    finally:
        compiling.logger.setLevel(level)
