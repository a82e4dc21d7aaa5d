"""Which files to label, and what the labelled files are called."""

import stat
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from grasp3d.batch.job import Job
from grasp3d.errors import MeshError, OutputError
from grasp3d.names import name_key, safe_stem, short_hash
from grasp3d.reading import mesh_suffixes

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
        No two results have one name, and none has that of an input.

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
    """Name the results: `mug_labeled.ply`; where names meet all of them say more of their source.

    So a name hangs on its own mesh and on those that it meets, but not on their order. Files that
    differ in case or composition only meet as well, and no name is that of an input or of a folder.
    """
    home = output.resolve()
    inputs = {_key(place) for mesh in found for place in _places(mesh.source)}
    choices = [_choices(mesh) for mesh in found]
    said = [0] * len(found)
    meeting = True
    while meeting:
        targets = [home / names[level] for names, level in zip(choices, said, strict=True)]
        often = Counter(map(_key, targets))
        folders = {_key(folder) for target in targets for folder in target.parents}
        meeting = False
        for number, target in enumerate(targets):
            met = often[_key(target)] > 1 or _key(target) in inputs | folders
            if met and said[number] + 1 < len(choices[number]):
                said[number] += 1
                meeting = True
    return [
        Job(name=mesh.name, source=mesh.source, output=output, labeled=str(names[level]))
        for mesh, names, level in zip(found, choices, said, strict=True)
    ]


def _choices(mesh: MeshFile) -> list[Path]:
    """Names for a mesh's result, below the output folder, from the plainest to the surest."""
    name = Path(mesh.name)
    folder = Path(*map(safe_stem, name.parts[:-1]))
    plain, suffixed = safe_stem(name.stem), safe_stem(name.name.replace(".", "_"))
    source = mesh.source.as_posix()
    hashes = (short_hash(source), short_hash(source, digits=64))
    stems = (plain, suffixed, *(f"{suffixed}-{told}" for told in hashes))
    return [folder / f"{stem}{RESULT}" for stem in stems]


def _places(source: Path) -> tuple[Path, Path]:
    """Where a file really is, and where the link to it is."""
    return source.resolve(), source.parent.resolve() / source.name


def _key(path: Path) -> str:
    return name_key(str(path))
