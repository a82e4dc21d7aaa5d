"""URDF and MuJoCo models, read in a process of their own."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from grasp3d.errors import SettingError
from grasp3d.hand.description_xml import size_of_files
from grasp3d.hand.link_tree import LinkTree
from grasp3d.system.documents import problem_of_file
from grasp3d.system.isolation import CallFailedError, call
from grasp3d.system.names import printable

MEMORY, SECONDS, BYTES_PER_SECOND = 4.0, 15.0, 1e6
"""Limits of the process that reads a robot's description: memory [GB]; time for one without meshes
[s]; and bytes of all its files for which it has one second more."""

SUFFIXES = (".urdf", ".xml", ".mjcf")

T = TypeVar("T")


def read_links(path: Path) -> LinkTree:
    """All links and joints of a URDF (.urdf) or a MuJoCo model. Raises SettingError."""
    if path.suffix.lower() == ".urdf":
        from grasp3d.hand.urdf import read_urdf

        return read_urdf(path)
    from grasp3d.hand.mjcf import read_mjcf

    return read_mjcf(path)


def watched(make: Callable[..., T], path: Path, *arguments: Any) -> T:
    """What a function makes of a robot's description, in a child process.

    Such files, and those that they name, can ask for any memory and time, and end the process.

    Args:
        make: The function of a `LinkTree` and the other arguments.
        path: The file.
        arguments: The other arguments.

    Raises:
        SettingError: The file cannot be read, or the function refuses it.
    """
    if problem := problem_of_file(path):
        raise SettingError(printable(f"{path}: {problem}"))
    if path.suffix.lower() not in SUFFIXES:
        known = " ".join(SUFFIXES)
        raise SettingError(printable(f"{path} is no URDF or MuJoCo model: supported are {known}"))
    seconds = SECONDS + size_of_files(path) / BYTES_PER_SECOND
    try:
        made: T = call(_make, make, path, *arguments, memory=MEMORY, seconds=seconds)
    except SettingError as error:
        raise SettingError(str(error)) from None  # without the traceback of the child
    except CallFailedError as failure:
        raise SettingError(
            printable(f"{path}: the process that reads it {failure}; describe the gripper in JSON")
        ) from failure
    return made


def _make(make: Callable[..., T], path: Path, *arguments: Any) -> T:
    return make(read_links(path), *arguments)
