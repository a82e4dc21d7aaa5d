"""XML of robot descriptions, and the files that they name."""

from pathlib import Path
from xml.etree.ElementTree import Element, ParseError, fromstring

from grasp3d.errors import SettingError
from grasp3d.system.documents import file_bytes, is_file
from grasp3d.system.names import printable


def xml_tree(path: Path) -> Element:
    """The content of an XML file. Raises SettingError."""
    try:
        return fromstring(file_bytes(path))  # noqa: S314, in a process with limits
    except OSError as error:
        reason = f"cannot be read ({error.strerror or error})"
    except (ParseError, LookupError) as error:
        reason = f"is no XML: {error}"
    except (ValueError, RecursionError) as error:
        reason = str(error)
    raise SettingError(printable(f"{path}: {reason}"))


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
