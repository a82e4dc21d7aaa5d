"""The plan of a batch: one job per mesh, with a unique name for its results."""

import itertools
import os
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import PurePosixPath

from grasp3d.batch.inputs import STORED, MeshFile
from grasp3d.batch.storage.files import local_path
from grasp3d.batch.storage.folder import Folder
from grasp3d.system.names import name_key, safe_stem, short_hash

_SUFFIXES = (".ply", ".parquet", ".webp", ".html", ".glb")
"""Suffixes of the results of a mesh."""


_HASH = re.compile(r"(?<=.)-[0-9a-f]{64}$")
_WHOLE = re.compile(r"[0-9a-f]{64}")


@dataclass(frozen=True)
class Job:
    """One mesh to label, and the files for its results."""

    mesh: MeshFile
    stem: str
    """Path of its results without the suffix, below the folders of the store."""
    output: Folder
    known_content: str = ""
    """Hash of the content that the store has valid results of; empty: it has none."""
    threads: int = 1
    """Threads that label the mesh."""
    has_page: bool = True
    """Whether the mesh gets pictures, and a page of its own in the report."""

    @property
    def labels(self) -> str:
        """Path of the labelled mesh below the output folder."""
        return f"labels/{self.stem}.ply"

    @property
    def fields(self) -> str:
        """Path of the table of its vertices."""
        return f"fields/{self.stem}.parquet"

    @property
    def page(self) -> str:
        """Path of its page in the report, without the suffix."""
        return f"report/objects/{self.stem}"


def plan(
    meshes: Sequence[MeshFile], output: Folder, earlier: Mapping[str, str] | None = None
) -> list[Job]:
    """Name the results: `mug`, or longer stems where the names of several meshes collide.

    A stem depends on its own mesh and on those whose names collide with it, not on their order.
    Stems that differ only in case or Unicode composition collide as well, and no result has the
    name of an input or of a folder.

    Args:
        meshes: From `find_meshes`.
        output: Folder for the results.
        earlier: Stems of existing results, by the name of their mesh. They are kept, and no other
            mesh gets them.

    Returns:
        A job for each mesh, in their order; folders below an input folder are kept.
    """
    existing = _ExistingNames(meshes, output, earlier or {})
    choices = [_choices(mesh) for mesh in meshes]
    levels = [0] * len(meshes)
    changed = True
    while changed:
        stems = [
            existing.kept.get(mesh.name) or names[level]
            for mesh, names, level in zip(meshes, choices, levels, strict=True)
        ]
        collides = existing.collisions(stems)
        changed = False
        for number, mesh in enumerate(meshes):
            longer = levels[number] + 1 < len(choices[number])
            if collides[number] and longer and mesh.name not in existing.kept:
                levels[number] += 1
                changed = True
    return [Job(mesh, stem, output) for mesh, stem in zip(meshes, stems, strict=True)]


def use_all_processors(jobs: Sequence[Job], processes: int) -> list[Job]:
    """Give the last jobs of a run several threads, so that no processor waits for their end.

    The threads of a job change none of its results.

    Args:
        jobs: In the order in which they are begun.
        processes: Jobs that run at once.
    """
    count = len(jobs)
    return [
        replace(job, threads=max(1, processes // (count - number)))
        for number, job in enumerate(jobs)
    ]


class _ExistingNames:
    """Existing names, with which new stems must not collide."""

    def __init__(
        self, meshes: Sequence[MeshFile], output: Folder, earlier: Mapping[str, str]
    ) -> None:
        self.inputs = _inputs_in(meshes, output)
        safe = {name: stem for name, stem in earlier.items() if _is_safe(stem)}
        counts = Counter(map(name_key, safe.values()))
        names = {mesh.name for mesh in meshes}
        self.kept = {
            name: stem
            for name, stem in safe.items()
            if name in names
            and counts[name_key(stem)] == 1
            and name_key(f"labels/{stem}.ply") not in self.inputs
        }
        self.others = [stem for name, stem in safe.items() if name not in names]
        self.files = set(_files([*self.others, *self.kept.values()]))

    def collisions(self, stems: Sequence[str]) -> list[bool]:
        """Whether each stem collides with another stem, an input, or a folder."""
        counts = Counter(map(name_key, [*stems, *self.others]))
        folders = {key for stem in [*stems, *self.others] for key in _folders(stem)}
        return [
            counts[name_key(stem)] > 1
            or name_key(f"labels/{stem}.ply") in self.inputs
            or any(key in folders for key in _files([stem]))
            or any(key in self.files for key in _folders(stem))
            for stem in stems
        ]


def _choices(mesh: MeshFile) -> list[str]:
    """Stems for a mesh's results, from the shortest to a surely unique stem."""
    path = PurePosixPath(mesh.name.replace(os.sep, "/"))
    # A mesh without a unique name is named by its source, whose folders may be anywhere.
    outside = path.is_absolute() or ".." in path.parts or "://" in mesh.name
    folders = () if outside else path.parts[:-1]
    parent = "".join(f"{safe_stem(part)}/" for part in folders)
    plain, suffixed = safe_stem(path.stem), safe_stem(path.name.replace(".", "_"))
    short, full = short_hash(mesh.source), short_hash(mesh.source, digits=64)
    stems = (plain, suffixed, f"{suffixed}-{short}", f"{suffixed}-{full}")
    return [*(f"{parent}{stem}" for stem in stems), full]


def _is_safe(stem: str) -> bool:
    """Whether `plan` could have made a stem that was read from a file."""
    parts = [_HASH.sub("", part) for part in stem.split("/")]
    return all(part and safe_stem(part) == part for part in parts) or bool(_WHOLE.fullmatch(stem))


@cache
def _folders(stem: str) -> frozenset[str]:
    """Keys of the folders that contain a stem."""
    return frozenset(name_key(str(folder)) for folder in PurePosixPath(stem).parents if folder.name)


def _files(stems: Iterable[str]) -> Iterator[str]:
    """Keys of the result files of stems, without the store's own folders."""
    return (name_key(f"{stem}{suffix}") for stem in stems for suffix in _SUFFIXES)


def _inputs_in(meshes: Iterable[MeshFile], output: Folder) -> set[str]:
    """Keys of inputs in the output folder, and of links in it that are inputs."""
    base, real = local_path(output.url), cache(os.path.realpath)
    roots = {f"{output.url.rstrip('/')}/": ""}
    if base is not None:
        # Folders of the store may be links to folders with inputs.
        roots = {f"{real(base / folder)}{os.sep}": f"{folder}/" for folder in STORED}
        roots[f"{real(base)}{os.sep}"] = ""
    keys = set()
    for mesh in meshes:
        path = local_path(mesh.source)
        locations = [mesh.source]
        if path is not None:
            named = f"{real(path.parent)}{os.sep}{path.name}"
            locations = [named, os.path.realpath(path)] if path.is_symlink() else [named]
        for location, (root, folder) in itertools.product(locations, roots.items()):
            if location.startswith(root):
                keys.add(name_key(folder + location[len(root) :].replace(os.sep, "/")))
    return keys
