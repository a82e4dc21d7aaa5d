"""Standard output and standard error where they are closed, full, or have no letters for a name."""

import os
import sys
from io import TextIOWrapper
from typing import TextIO

from grasp3d.errors import OutputError


def prepare_streams() -> None:
    """Make standard output and standard error usable, whatever they are connected to.

    A closed one (`>&-`) discards what is printed. Its file descriptor is taken again, so that no
    other file gets it.
    """
    for descriptor, name in enumerate(("stdin", "stdout", "stderr")):
        try:
            os.fstat(descriptor)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # the lowest free descriptor, which is this one
        if getattr(sys, name) is None:
            mode = "w" if descriptor else "r"
            setattr(sys, name, os.fdopen(descriptor, mode, encoding="utf-8", closefd=False))
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):  # a terminal may not support all characters
            stream.reconfigure(errors="backslashreplace")


def discard_output() -> None:
    """Discard what could not be printed, and all that is printed from now on."""
    _discard(sys.stdout)


def print_error(text: str) -> None:
    """Print an error, or discard it if standard error cannot be written.

    Args:
        text: The error, in one line.
    """
    try:
        print(f"grasp3d: {text}", file=sys.stderr, flush=True)  # noqa: T201
    except OSError:
        _discard(sys.stderr)


def check_output(error: OSError) -> None:
    """Raise OutputError if an error is that of standard output, as on a full disk.

    Args:
        error: An error that names no file.
    """
    if isinstance(error, BrokenPipeError) or error.filename is not None:
        return
    try:
        print(flush=True)  # noqa: T201
    except OSError:
        discard_output()
        reason = error.strerror or error
        raise OutputError(f"standard output: cannot be written ({reason})") from error


def _discard(stream: TextIO) -> None:
    """Discard what a stream still holds, and all that is written to it from now on."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
