"""Finding the mesh of an object that a file of grasps names."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path, PurePosixPath, PureWindowsPath

from grasp3d.errors import MeshError

MOST_NAMED = 5
"""Most files that an error names."""


@dataclass(frozen=True)
class MeshFolder:
    """A folder in which the meshes of grasps are looked up, or none.

    Example:
        >>> from pathlib import Path
        >>> from grasp3d.validating.mesh_lookup import MeshFolder
        >>> MeshFolder(Path("meshes")).find("scans/mug.glb", Path("log.csv")).name
        'mug.glb'
    """

    folder: Path | None = None

    def __post_init__(self) -> None:
        if self.folder is not None and not self.folder.is_dir():
            problem = "is a file" if self.folder.exists() else "there is no such folder"
            raise MeshError(f"{self.folder}: {problem}; name the folder of the meshes")

    def find(self, stated: str | None, grasps: Path) -> Path:
        """The mesh file that a file of grasps names.

        It is looked up beside that file and in the folder: first by the path that is stated, then
        by its base name, in the folder also in subfolders.

        Args:
            stated: What the file of grasps states; None: nothing.
            grasps: The file of grasps.

        Raises:
            MeshError: Nothing is stated, or there is none or more than one such file.
        """
        if stated is None:
            raise MeshError(f"{grasps}: names no mesh file of its object; give it with --mesh FILE")
        relative = _safe(stated)
        for found in (self._by_path(relative, grasps), self._by_name(relative, grasps)):
            if len(found) == 1:
                return found[0]
            if found:
                named = ", ".join(map(str, found[:MOST_NAMED]))
                raise MeshError(
                    f"{grasps}: names the mesh {stated!r}, and {len(found)} files fit: {named}; "
                    "give the one that is meant with --mesh FILE"
                )
        raise MeshError(f"{grasps}: names the mesh {stated!r}, which is not {self._where(grasps)}")

    def _by_path(self, relative: PurePosixPath, grasps: Path) -> list[Path]:
        folders = [grasps.parent, *([] if self.folder is None else [self.folder])]
        return _distinct([one / relative for one in folders])

    def _by_name(self, relative: PurePosixPath, grasps: Path) -> list[Path]:
        name = relative.name
        return _distinct([grasps.parent / name, *self._by_base_name.get(name, [])])

    @cached_property
    def _by_base_name(self) -> dict[str, list[Path]]:
        """All files below the folder by their base names."""
        found: dict[str, list[Path]] = {}
        for path in sorted(self.folder.rglob("*")) if self.folder is not None else ():
            if path.is_file():
                found.setdefault(path.name, []).append(path)
        return found

    def _where(self, grasps: Path) -> str:
        beside = f"beside it in {grasps.parent}"
        if self.folder is None:
            return f"{beside}: give its folder with --meshes FOLDER, or the file with --mesh FILE"
        return f"{beside} nor below {self.folder}: give the file with --mesh FILE"


def _safe(stated: str) -> PurePosixPath:
    """The path that is stated, below some folder: of others only the base name counts."""
    path = PurePosixPath(PureWindowsPath(stated).as_posix())
    inside = not path.is_absolute() and ".." not in path.parts and not PureWindowsPath(stated).drive
    return path if inside else PurePosixPath(path.name)


def _distinct(paths: list[Path]) -> list[Path]:
    """Files that exist, each once."""
    found = {path.resolve(): path for path in reversed(paths) if path.is_file()}
    return list(reversed(found.values()))
