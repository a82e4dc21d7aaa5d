"""What results are called: a stem of its own for each mesh, that every file system takes."""

import itertools
import os
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import PurePosixPath

from grasp3d.batch.folders import STORED
from grasp3d.batch.inputs import MeshFile
from grasp3d.storage import Folder, local_path
from grasp3d.system.names import name_key, safe_stem, short_hash

_SUFFIXES = (".ply", ".parquet", ".js", ".webp")
"""What stands behind a stem in a name of a result."""


_HASH = re.compile(r"(?<=.)-[0-9a-f]{64}$")
_WHOLE = re.compile(r"[0-9a-f]{64}")


@dataclass(frozen=True)
class Job:
    """One mesh to label, and where its results go."""

    mesh: MeshFile
    stem: str
    """What its results are called, with folders."""
    output: Folder
    known: str = ""
    """Content of the mesh that the store has results of; empty: it has none."""

    @property
    def labels(self) -> str:
        """Labelled mesh, its name below the output folder."""
        return f"labels/{self.stem}.ply"

    @property
    def fields(self) -> str:
        """Table of its vertices."""
        return f"fields/{self.stem}.parquet"

    @property
    def view(self) -> str:
        """What the report shows of it."""
        return f"report/objects/{self.stem}.js"

    @property
    def thumbnail(self) -> str:
        """Its small picture in the report."""
        return f"report/thumbnails/{self.stem}.webp"


def plan(
    meshes: Sequence[MeshFile], output: Folder, taken: Mapping[str, str] | None = None
) -> list[Job]:
    """Name the results: `mug`; where names meet all of them say more of their source.

    So a stem hangs on its own mesh and on those that it meets, but not on their order. Stems that
    differ in case or composition only meet as well, and no result has the name of an input or of a
    folder.

    Args:
        meshes: From `find_meshes`.
        output: Folder for the results.
        taken: Stems of results that are there, by the name of their mesh. They are kept, and no
            other mesh gets them.

    Returns:
        A job for each mesh, in their order; folders below an input folder are kept.
    """
    given = _Given(meshes, output, taken or {})
    choices = [_choices(mesh) for mesh in meshes]
    said = [0] * len(meshes)
    meeting = True
    while meeting:
        stems = [
            given.kept.get(mesh.name) or names[level]
            for mesh, names, level in zip(meshes, choices, said, strict=True)
        ]
        met = given.met(stems)
        meeting = False
        for number, mesh in enumerate(meshes):
            more = said[number] + 1 < len(choices[number])
            if met[number] and more and mesh.name not in given.kept:
                said[number] += 1
                meeting = True
    return [Job(mesh, stem, output) for mesh, stem in zip(meshes, stems, strict=True)]


class _Given:
    """Names that are given, and that new ones must not meet."""

    def __init__(
        self, meshes: Sequence[MeshFile], output: Folder, taken: Mapping[str, str]
    ) -> None:
        self.inputs = _inputs_in(meshes, output)
        safe = {name: stem for name, stem in taken.items() if _is_safe(stem)}
        often = Counter(map(name_key, safe.values()))
        names = {mesh.name for mesh in meshes}
        self.kept = {
            name: stem
            for name, stem in safe.items()
            if name in names
            and often[name_key(stem)] == 1
            and name_key(f"labels/{stem}.ply") not in self.inputs
        }
        self.others = [stem for name, stem in safe.items() if name not in names]
        self.files = set(_files([*self.others, *self.kept.values()]))

    def met(self, stems: Sequence[str]) -> list[bool]:
        """Tell for each stem whether it meets another one, an input, or a folder."""
        often = Counter(map(name_key, [*stems, *self.others]))
        folders = {key for stem in [*stems, *self.others] for key in _folders(stem)}
        return [
            often[name_key(stem)] > 1
            or name_key(f"labels/{stem}.ply") in self.inputs
            or any(key in folders for key in _files([stem]))
            or any(key in self.files for key in _folders(stem))
            for stem in stems
        ]


def _choices(mesh: MeshFile) -> list[str]:
    """Stems for a mesh's results, from the plainest to the surest."""
    path = PurePosixPath(mesh.name.replace(os.sep, "/"))
    # A mesh that shares its name is called by its source, whose folders may be anywhere.
    away = path.is_absolute() or ".." in path.parts or "://" in mesh.name
    folders = () if away else path.parts[:-1]
    home = "".join(f"{safe_stem(part)}/" for part in folders)
    plain, suffixed = safe_stem(path.stem), safe_stem(path.name.replace(".", "_"))
    short, full = short_hash(mesh.source), short_hash(mesh.source, digits=64)
    stems = (plain, suffixed, f"{suffixed}-{short}", f"{suffixed}-{full}")
    return [*(f"{home}{stem}" for stem in stems), full]


def _is_safe(stem: str) -> bool:
    """Whether a stem that was read from a file is one that could have been given."""
    parts = [_HASH.sub("", part) for part in stem.split("/")]
    return all(part and safe_stem(part) == part for part in parts) or bool(_WHOLE.fullmatch(stem))


@cache
def _folders(stem: str) -> frozenset[str]:
    """Keys of the folders that a stem lies in."""
    return frozenset(name_key(str(folder)) for folder in PurePosixPath(stem).parents if folder.name)


def _files(stems: Iterable[str]) -> Iterator[str]:
    """Keys of the files that results become, without the folders that all of them have."""
    return (name_key(f"{stem}{suffix}") for stem in stems for suffix in _SUFFIXES)


def _inputs_in(meshes: Iterable[MeshFile], output: Folder) -> set[str]:
    """Keys of the inputs that lie in the output folder, and of links in it that are inputs."""
    home, real = local_path(output.url), cache(os.path.realpath)
    roots = {f"{output.url.rstrip('/')}/": ""}
    if home is not None:
        # Its own folders may be links to places where inputs are.
        roots = {f"{real(home / folder)}{os.sep}": f"{folder}/" for folder in STORED}
        roots[f"{real(home)}{os.sep}"] = ""
    found = set()
    for mesh in meshes:
        path = local_path(mesh.source)
        places = [mesh.source]
        if path is not None:
            beside = f"{real(path.parent)}{os.sep}{path.name}"
            places = [beside, os.path.realpath(path)] if path.is_symlink() else [beside]
        for place, (root, folder) in itertools.product(places, roots.items()):
            if place.startswith(root):
                found.add(name_key(folder + place[len(root) :].replace(os.sep, "/")))
    return found
