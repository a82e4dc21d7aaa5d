"""The command line: parses the arguments, runs one command, prints, and returns an exit code.

Heavy modules are imported by the commands when they run, so that `grasp3d --help` is fast.
"""

import logging
import sys
from dataclasses import dataclass
from typing import Annotated

import tyro

from grasp3d.cli.batch import Batch
from grasp3d.cli.check import Check
from grasp3d.cli.design import Design
from grasp3d.cli.evaluate import Evaluate
from grasp3d.cli.examples import print_examples
from grasp3d.cli.hand import Hand
from grasp3d.cli.label import Label
from grasp3d.cli.options import REGISTRY, Flag
from grasp3d.cli.paper import Paper
from grasp3d.cli.perturb import Perturb
from grasp3d.cli.simulate import Simulate
from grasp3d.cli.streams import (
    check_output,
    discard_output,
    errors_are_lost,
    prepare_streams,
    print_error,
)
from grasp3d.cli.sweep import Sweep
from grasp3d.cli.validate import Validate
from grasp3d.cli.view import View
from grasp3d.cli.warmup import Warmup
from grasp3d.errors import GraspError
from grasp3d.system import compiling
from grasp3d.system.names import printable
from grasp3d.system.versions import package_version

Command = (
    Annotated[Label, tyro.conf.subcommand("label")]
    | Annotated[Check, tyro.conf.subcommand("check")]
    | Annotated[Evaluate, tyro.conf.subcommand("evaluate")]
    | Annotated[Validate, tyro.conf.subcommand("validate")]
    | Annotated[Simulate, tyro.conf.subcommand("simulate")]
    | Annotated[Batch, tyro.conf.subcommand("batch")]
    | Annotated[Sweep, tyro.conf.subcommand("sweep")]
    | Annotated[Perturb, tyro.conf.subcommand("perturb")]
    | Annotated[Design, tyro.conf.subcommand("design")]
    | Annotated[Hand, tyro.conf.subcommand("hand")]
    | Annotated[View, tyro.conf.subcommand("view")]
    | Annotated[Paper, tyro.conf.subcommand("paper")]
    | Annotated[Warmup, tyro.conf.subcommand("warmup")]
)


@dataclass(frozen=True)
class Program:
    """The options of the program, and those of one command."""

    command: Command

    version: Flag = False
    """Print the version."""


BAD_INPUT = 2
INTERRUPTED = 130


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
            print_examples(arguments[0])
        raise
    level = compiling.logger.level
    if getattr(program.command, "quiet", False):
        compiling.logger.setLevel(logging.ERROR)
    try:
        return program.command.run()
    finally:
        compiling.logger.setLevel(level)
