"""Which files to label, and what the labelled files are called."""

import stat
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from grasp3d.batch.job import Job
from grasp3d.errors import MeshError, OutputError
from grasp3d.mesh.reading import mesh_suffixes

RESULT = "_labeled.ply"


@dataclass(frozen=True)
class MeshFile:
    """A mesh among the inputs."""

    name: str
    """Its path below the folder that was given; of a file that was given, its name."""
    source: Path
    """The file, as it was given."""


def find_meshes(inputs: Iterable[Path], *, results: Path | None = None) -> list[MeshFile]:
    """List the meshes in files and folders, each once.

    Args:
        inputs: Mesh files, and folders that are searched with all below them.
        results: Folder for results, which are no inputs where it is one of its own; labelled files
            that `plan` named are none in any case.

    Returns:
        In alphabetical order of the names.

    Raises:
        MeshError: An input is missing, or there is no mesh among them.
    """
    inputs = list(inputs)
    found: dict[Path, MeshFile] = {}  # by its real place
    for item in inputs:
        try:
            mode = item.stat().st_mode
        except FileNotFoundError as error:
            raise MeshError(f"{item}: there is no such file or folder") from error
        except OSError as error:
            raise MeshError(f"{item}: cannot be opened ({error.strerror})") from error
        if stat.S_ISDIR(mode):
            for path in _meshes_below(item, results):
                found.setdefault(path.resolve(), MeshFile(str(path.relative_to(item)), path))
        else:
            found.setdefault(item.resolve(), MeshFile(item.name, item))
    if not found:
        known = " ".join(sorted(mesh_suffixes()))
        folders = ", ".join(str(item) for item in inputs)
        raise MeshError(f"{folders}: no mesh in it; files named {known} are read")
    return sorted(found.values(), key=lambda mesh: (mesh.name, str(mesh.source)))


def plan(inputs: Iterable[Path], output: Path) -> list[Job]:
    """List the meshes in files and folders, with a name of its own for each result.

    Args:
        inputs: Mesh files, and folders that are searched with all below them.
        output: Folder for the results; what is in it already is not taken for inputs.

    Returns:
        The jobs in alphabetical order; folders below an input folder are kept below `output`.

    Raises:
        MeshError: An input is missing, or there is no mesh among them.
    """
    return _named(find_meshes(inputs, results=output), output)


def _meshes_below(folder: Path, results: Path | None) -> list[Path]:
    suffixes = mesh_suffixes()
    here, own = folder.resolve(), None if results is None else results.resolve()
    if own == here or (own is not None and not own.is_relative_to(here)):
        own = None

    def is_input(path: Path) -> bool:
        if path.suffix.lower() not in suffixes or path.name.startswith(".") or not path.is_file():
            return False
        if own is not None and path.resolve().is_relative_to(own):
            return False
        return not path.name.endswith(RESULT)

    return sorted(path for path in folder.rglob("*") if is_input(path))


def make_folders(jobs: Iterable[Job]) -> None:
    """Make the folders that the results go to.

    Raises:
        OutputError: One cannot be made.
    """
    for folder in sorted({job.target.parent for job in jobs}):
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise OutputError(f"{folder}: cannot be made ({error.strerror})") from error


def _named(found: list[MeshFile], output: Path) -> list[Job]:
    """Name the results: `mug_labeled.ply`, with the suffix where stems meet, with a number else."""
    short = Counter(_key(Path(mesh.name).with_suffix("")) for mesh in found)
    taken: set[str] = set()
    jobs = []
    for mesh in found:
        name = Path(mesh.name)
        stem = name.stem if short[_key(name.with_suffix(""))] == 1 else name.name.replace(".", "_")
        target = name.with_name(f"{stem}{RESULT}")
        number = 2
        while _key(target) in taken:
            target = name.with_name(f"{stem}_{number}{RESULT}")
            number += 1
        taken.add(_key(target))
        jobs.append(Job(name=mesh.name, source=mesh.source, output=output, labeled=str(target)))
    return jobs


def _key(path: Path) -> str:
    """What a file system that ignores case takes for the same name."""
    return str(path).casefold()
