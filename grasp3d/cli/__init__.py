"""The command line: parses the arguments, runs one command, prints, and returns an exit code.

The modules of options import nothing heavy, so that `grasp3d --help` is fast.
"""

import gc
import logging
import os
import sys
from difflib import get_close_matches
from importlib import import_module
from io import TextIOWrapper
from pathlib import Path
from typing import Any

from grasp3d._kernels import compilations
from grasp3d.cli import commands
from grasp3d.cli.usage import HELP, HELP_ALL, completion_script, help_of, parse
from grasp3d.errors import GraspError, MeshError, SettingError
from grasp3d.system.context import running
from grasp3d.system.documents import package_version, problem_of_file
from grasp3d.system.limited_reading import limited_reading
from grasp3d.system.names import printable

NAMES = (
    "label", "check", "evaluate", "validate", "simulate", "batch", "sweep", "design", "hand",
    "view", "paper",
)  # fmt: skip

KINDS: dict[str, Any] = {name: getattr(commands, name.capitalize()) for name in NAMES}
"""The options of the commands; the module of the same name runs each command."""

BAD_INPUT = 2
INTERRUPTED = 130

PROGRAM_HELP = """usage: grasp3d COMMAND [OPTIONS]

Evaluate grasps on object meshes for fingertips with tactile sensors.

commands:
{}

options:
  -h, --help    Print this help, or, after the name of a command, its main options.
  --help-all    After the name of a command: print all of its options.
  --version     Print the version.
  --completion  Print what completes commands in bash and zsh: source <(grasp3d --completion)
"""


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; return 0 on success, 1 if some meshes failed, 2 for bad input."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):  # a terminal may lack some characters
            stream.reconfigure(errors="backslashreplace")
    try:
        with limited_reading():
            code = _run(sys.argv[1:] if arguments is None else arguments)
        print(end="", flush=True)  # noqa: T201
    except GraspError as error:
        return _failed(printable(str(error)), BAD_INPUT)
    except OSError as error:
        if error.filename is not None:
            raise
        # Output that could not be printed is discarded, as Python would try it again at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if isinstance(error, BrokenPipeError):  # the reader has ended: `grasp3d batch ... | head`
            return 0
        return _failed(f"standard output: cannot be written ({error.strerror})", BAD_INPUT)
    except KeyboardInterrupt as stop:
        return _failed("interrupted" + (f": {stop}" if str(stop) else ""), INTERRUPTED)
    return code


def _failed(text: str, code: int) -> int:
    print(f"grasp3d: {text}", file=sys.stderr, flush=True)  # noqa: T201
    return code


def _run(arguments: list[str]) -> int:
    name, *words = arguments or [""]
    if name == "--version":
        print(f"grasp3d {package_version()}")  # noqa: T201
        return 0
    if name == "--completion":
        print(completion_script(KINDS), end="")  # noqa: T201
        return 0
    if name in {*HELP, HELP_ALL}:
        texts = ((name, (kind.__doc__ or "").partition("\n")[0]) for name, kind in KINDS.items())
        lines = "\n".join(f"  {name:9} {text}" for name, text in texts)
        print(PROGRAM_HELP.format(lines), end="")  # noqa: T201
        return 0
    kind = _kind(name)
    if {*HELP, HELP_ALL} & set(words):
        print(help_of(kind, whole=HELP_ALL in words))  # noqa: T201
        return 0
    command = parse(kind, words)
    level = compilations.level
    if getattr(command, "quiet", False):
        compilations.setLevel(logging.ERROR)
    try:
        _check_file(getattr(command, "file", None))
        module = _module(command)
        from grasp3d.cli.report import Report

        with running(strict=getattr(command, "strict", False)):
            return int(module.run(command, Report(quiet=getattr(command, "quiet", False))))
    finally:
        compilations.setLevel(level)


def _check_file(file: object) -> None:
    """Refuse a missing mesh before the modules that read it are loaded, which takes 2 s.

    Raises:
        MeshError: There is no such file. Whether it is a mesh is checked later.
    """
    if isinstance(file, Path) and (problem := problem_of_file(file)):
        raise MeshError(f"{file}: {problem}")


def _module(command: object) -> Any:
    """Import the module that runs a command.

    Garbage collection leaves out the imported objects, as a scan takes a third of a second. If
    pictures are wanted, the rendering test starts first, as its own imports take a second.
    """
    if getattr(command, "best", None) and getattr(command, "file", None):
        from grasp3d.pictures.opengl import begin_render_test

        begin_render_test()
    gc.disable()
    try:
        return import_module(f"{__name__}.{type(command).__name__.lower()}")
    finally:
        if not gc.get_freeze_count():  # once: later there may be garbage among the objects
            gc.freeze()
        gc.enable()


def _kind(name: str) -> Any:
    """Return the options of a command.

    Raises:
        SettingError: No command has this name.
    """
    if name in KINDS:
        return KINDS[name]
    alike = get_close_matches(name, KINDS, 1)
    known = f"did you mean {alike[0]}?" if alike else f"known: {', '.join(KINDS)}"
    problem = f"no command is called {name!r}" if name else "give a command"
    raise SettingError(f"{problem}; {known}; grasp3d --help explains them")
