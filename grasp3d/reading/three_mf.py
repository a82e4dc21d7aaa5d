"""How many triangles a 3MF declares: trimesh leaves out some parts of it without a word."""

import zipfile
from pathlib import Path
from xml.parsers import expat

_Id = tuple[str, str]
"""File in the archive, and number in it, of an object."""


def triangles_of_3mf(path: Path) -> int:
    """Number of triangles that a 3MF builds, in all copies of its parts.

    Raises:
        ValueError: It uses an object that it does not have.
        RecursionError: An object contains itself.
        Exception: It is no such archive, or its XML is damaged.
    """
    objects = _Objects()
    with zipfile.ZipFile(path) as archive:
        for name in archive.namelist():
            if name.lower().endswith(".model"):
                objects.read(name, archive.read(name))
    return sum(map(objects.count, objects.built))


class _Objects:
    """The objects of all models of an archive."""

    def __init__(self) -> None:
        self.built: list[_Id] = []
        self._triangles: dict[_Id, int] = {}
        self._components: dict[_Id, list[_Id]] = {}
        self._counts: dict[_Id, int] = {}
        self._current: _Id = "", ""

    def read(self, model: str, data: bytes) -> None:
        """Add the objects of a model."""

        def start(name: str, attributes: dict[str, str]) -> None:
            if name == "vertex":  # of which there are very many
                return
            kind = name.rpartition(":")[2]
            if kind == "object":
                self._current = model, attributes["id"]
                self._triangles[self._current], self._components[self._current] = 0, []
            elif kind == "triangle":
                self._triangles[self._current] += 1
            elif kind in {"component", "item"}:
                paths = (v.strip("/") for k, v in attributes.items() if k.endswith("path"))
                part = next(paths, model), attributes["objectid"]
                if kind == "component":
                    self._components[self._current].append(part)
                elif "3d/3dmodel.model" in model.lower():
                    self.built.append(part)

        parser = expat.ParserCreate()
        parser.StartElementHandler = start
        parser.Parse(data, True)  # noqa: FBT003

    def count(self, part: _Id) -> int:
        """Number of triangles of an object with its components."""
        if part not in self._components:
            raise ValueError(f"there is no object {part[1]}")
        if part not in self._counts:
            inner = sum(map(self.count, self._components[part]))
            self._counts[part] = self._triangles[part] + inner
        return self._counts[part]
