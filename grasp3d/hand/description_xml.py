"""XML of robot descriptions, and a look at MuJoCo's before anything is made of it."""

import math
import stat
from collections import Counter
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

from grasp3d.errors import SettingError
from grasp3d.system.documents import MEGABYTE, file_bytes, is_file, number_of
from grasp3d.system.names import printable

LARGEST_FILE = 16 * MEGABYTE
"""Largest robot description [bytes], without its meshes."""

MOST_ELEMENTS = 100_000
"""Most elements of a description, with the copies that it asks for."""

DEEPEST = 200
"""Deepest nesting of links."""

MOST_FILES = 100
"""Most models that a description includes."""

_COPIES = dict.fromkeys(("replicate", "composite", "flexcomp"), ("count",))
"""Elements of which MuJoCo makes many, and the attribute with their numbers."""

_SIZES: dict[str, dict[tuple[str, ...], int]] = {
    "hfield": {("nrow", "ncol"): 10_000_000},
    "texture": {("width", "height"): 64_000_000},
    "numeric": {("size",): 1_000_000},
    "user": {("dim",): 1_000_000},
    "size": {
        (name,): 10_000
        for name in (
            "nkey", "nuser_body", "nuser_jnt", "nuser_geom", "nuser_site", "nuser_cam",
            "nuser_tendon", "nuser_actuator", "nuser_sensor",
        )
    },
}  # fmt: skip
"""Largest products of numbers in attributes for which MuJoCo takes memory, by element."""

_FOLDERS = ("meshdir", "texturedir", "assetdir")

_MODELS = {"include", "model"}
"""Elements that name another model."""


def xml_tree(path: Path) -> Element:
    """The content of an XML file of moderate size without a document type or entities.

    Raises:
        SettingError: It is none.
    """
    try:
        return _tree(file_bytes(path, LARGEST_FILE))
    except OSError as error:
        reason = f"cannot be read ({error.strerror or error})"
    except (expat.ExpatError, LookupError) as error:
        reason = f"is no XML: {error}"
    except ValueError as error:
        reason = str(error)
    raise SettingError(printable(f"{path}: {reason}"))


def _tree(data: bytes) -> Element:
    """The content of XML. Raises ExpatError, LookupError, ValueError."""
    builder, parser, counts = TreeBuilder(), expat.ParserCreate(), Counter[str]()

    def reject(*_: object) -> None:
        raise ValueError("declares a document type or entities, which are not supported")

    def start(name: str, attributes: dict[str, str]) -> None:
        counts.update(elements=1, depth=1)
        if counts["elements"] > MOST_ELEMENTS or counts["depth"] > DEEPEST:
            raise ValueError(
                f"has more than {MOST_ELEMENTS:,} elements, or {DEEPEST} within each other"
            )
        builder.start(name, attributes)

    def end(name: str) -> None:
        counts["depth"] -= 1
        builder.end(name)

    parser.StartDoctypeDeclHandler = reject
    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.Parse(data, True)  # noqa: FBT003
    return builder.close()


def mesh_file(name: str, path: Path) -> Path | None:
    """The mesh that a URDF names; None: there is none."""
    scheme, _, rest = name.rpartition("://")
    folders = path.absolute().parents
    if scheme in {"package", "model"}:
        package, _, inside = rest.partition("/")
        candidates = [folder / package / inside for folder in folders]
        candidates += [folder / inside for folder in folders if folder.name == package]
    else:
        candidates = [path.absolute().parent / rest]  # an absolute path stays what it is
    return next(filter(is_file, candidates), None)


def size_of_files(path: Path) -> int:
    """Size of all files of a description [bytes], after a look at what a MuJoCo model asks for.

    Raises:
        SettingError: It asks for too many copies, or too much memory; names what is no file; or
            includes itself.
    """
    if path.suffix.lower() == ".urdf":
        files = [mesh_file(mesh.get("filename", ""), path) for mesh in xml_tree(path).iter("mesh")]
        return sum(file.stat().st_size for file in [path, *files] if file is not None)
    look = _Look(path)
    look.read(path, ())
    if len(look.names) * len(look.folders) > MOST_ELEMENTS:
        raise SettingError(printable(f"{path}: names more than {MOST_ELEMENTS:,} files"))
    for name in sorted(look.names):
        for folder in sorted(look.folders):
            look.add_file(path.parent / folder / name)
    return look.bytes


class _Look:
    """What a MuJoCo model asks for, with all models that it includes."""

    def __init__(self, path: Path) -> None:
        self.bytes, self.names, self.folders = 0, set[str](), {""}
        self._path, self._elements, self._models = path, 0.0, 0

    def read(self, path: Path, above: tuple[Path, ...]) -> None:
        """Add a model, which others include. Raises SettingError."""
        self._models += 1
        if path.resolve() in above:
            raise self._error(f"includes itself, by way of {above[-1].name}")
        if self._models > MOST_FILES:
            raise self._error(f"includes models more than {MOST_FILES} times")
        queue = [(xml_tree(path), 1.0)]
        while queue:
            element, count = queue.pop()
            self._add(element, count)
            if element.tag in _MODELS and element.get("file"):
                for folder in dict.fromkeys((path.parent, self._path.parent)):
                    if self.add_file(folder / element.get("file", "")):
                        self.read(folder / element.get("file", ""), (*above, path.resolve()))
                        break
            count *= _product(element, _COPIES.get(element.tag, ()))
            queue += [(child, count) for child in element]

    def _add(self, element: Element, count: float) -> None:
        self._elements += count * _product(element, _COPIES.get(element.tag, ()))
        if self._elements > MOST_ELEMENTS:
            raise self._error(f"asks for more than {MOST_ELEMENTS:,} elements, with their copies")
        for names, most in _SIZES.get(element.tag, {}).items():
            if _product(element, names) > most:
                raise self._error(
                    f"asks for a size of {_product(element, names):,.0f} in {element.tag} "
                    f"({' x '.join(names)}), and at most {most:,} are read"
                )
        self.folders |= {element.get(name, "") for name in _FOLDERS}
        self.names |= {text for name, text in element.items() if name.startswith("file")}

    def add_file(self, path: Path) -> bool:
        """Add the size of a file, if there is one. Raises SettingError where it is no file."""
        with suppress(OSError, ValueError):
            status = path.stat()
            if not stat.S_ISREG(status.st_mode) and not stat.S_ISDIR(status.st_mode):
                raise self._error(f"names {path.name}, which is a pipe or a device, not a file")
            self.bytes += status.st_size
            return stat.S_ISREG(status.st_mode)
        return False

    def _error(self, problem: str) -> SettingError:
        return SettingError(printable(f"{self._path}: {problem}"))


def _product(element: Element, names: Iterable[str]) -> float:
    """Product of all numbers in attributes of an element, of those above 1."""
    words = [word for name in names for word in element.get(name, "").split()]
    return math.prod(max(1.0, number_of(word)) for word in words)
