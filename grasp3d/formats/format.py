"""Registry of grasp file formats: each module registers its format, and no other code names it.

The package's own formats are the modules of `grasp3d.formats.grasps`, each named after its format.
Nothing here imports NumPy, so the command line starts quickly.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from typing import TYPE_CHECKING, Any, Literal

from grasp3d.errors import OutputError, SettingError
from grasp3d.formats import grasps
from grasp3d.settings.units import Unit
from grasp3d.system.names import unsupported

if TYPE_CHECKING:
    from grasp3d.formats.poses import GraspPoses


@dataclass(frozen=True, kw_only=True)
class Given:
    """What the caller states in addition to a file to read."""

    hand: Any = None
    """The hand of the grasps, of a kind that the format supports; None: not given."""
    unit: Unit | None = None
    """Unit of the lengths, if the file states none."""
    outcome: str | None = None
    """Name of the values that say whether a grasp held; None: those of the format."""
    object_scale: float | None = None
    """Object scale whose grasps are read, for files with several scales."""
    object_pose: Any = None
    """Pose of the object in the frame of the poses, see `read_object_pose`; None: not given."""
    frame: Any = None
    """Frame of the gripper that the poses refer to, see `read_frame`; None: not given."""


@dataclass(frozen=True, kw_only=True)
class Format:
    """A format of files of grasp poses.

    `read` returns and `write` takes poses as they are in the file: those of the gripper's frame
    that is stated here, with lengths in metres unless the files state a unit.
    """

    name: str
    title: str
    """Name for people."""
    suffixes: tuple[str, ...]
    sniff: Callable[[Any], bool]
    """Whether content is in this format. The content of .json, .yaml and .npy files is the data in
    them; for other files it is their path."""
    read: Callable[[Any, Given], "GraspPoses"]
    """Reads the poses of such content. Raises ContactError, ValueError, OSError."""
    write: Callable[[Path, "GraspPoses"], None]
    """Writes poses. Raises OutputError."""
    holds: str
    """What its content looks like, for error messages."""
    frame: str = "tcp"
    """Frame of the gripper whose poses it contains, a key of `FRAMES`."""
    states_frame: bool = False
    """Whether the poses that `read` returns state their frame."""
    unit: Literal["m", "stated"] = "m"
    hands: tuple[Literal["gripper", "articulated"], ...] = ("gripper",)
    """Kinds of hands that it supports; empty: any hand, which need not be known."""
    alone: bool = False
    """Whether it can be read without a hand, though writing needs one."""
    joints: bool = False
    """Whether it contains values of the joints of a gripper."""
    outcomes: bool = False
    """Whether all outcomes must be known to write it."""
    needs: tuple[str, str] | None = None
    """Module of a library that is not always installed, and the name of its package."""
    moves: bool = False
    """Whether its poses may be in a robot's frame; else they are in the object's by definition."""
    main: bool = False
    """Whether files of its suffix are written in it by default."""
    about: str = ""
    """Its section of the page on formats, Markdown."""


_REGISTERED: dict[str, Format] = {}


def register(kind: Format) -> None:
    """Register a format; it replaces one of the same name."""
    _REGISTERED[kind.name] = kind


def format_names() -> tuple[str, ...]:
    """Names of all formats, without importing those of the package."""
    own = (module.name for module in iter_modules(grasps.__path__))
    return tuple(sorted({*own, *_REGISTERED}))


def formats() -> Mapping[str, Format]:
    """All formats by name, first those in which files of their suffix are written by default."""
    for module in iter_modules(grasps.__path__):
        import_module(f"{grasps.__name__}.{module.name}")
    return dict(sorted(_REGISTERED.items(), key=lambda item: (not item[1].main, item[0])))


def format_called(name: str) -> Format:
    """The format with a name. Raises SettingError if there is none."""
    if name not in format_names():
        raise SettingError(f"no format is called {name!r}; known: {', '.join(format_names())}")
    return formats()[name]


def format_of(path: Path, name: str | None = None) -> Format:
    """The format with a name; None: the default one for the file's suffix.

    Raises:
        OutputError: No format has that suffix.
        SettingError: No format has that name.
    """
    if name is not None:
        return format_called(name)
    for one in formats().values():
        if path.suffix.lower() in one.suffixes:
            return one
    raise OutputError(unsupported(path, suffixes(), "pose"))


def suffixes() -> tuple[str, ...]:
    """Suffixes of files of poses."""
    return tuple(dict.fromkeys(suffix for one in formats().values() for suffix in one.suffixes))
