"""Formats of files of grasps: each is registered by its own module, and nothing else names it.

The formats of the package are the modules of `grasp3d.formats.grasps`, each called as its format.
Nothing here imports NumPy, so that the command line starts quickly.
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
    """What is given beside a file to read."""

    hand: Any = None
    """The hand that the grasps are of, of a kind that the format has; None: not given."""
    unit: Unit | None = None
    """Unit of the lengths, if the file states none."""
    outcome: str | None = None
    """Name of the values that say whether a grasp held; None: those of the format."""
    object_scale: float | None = None
    """Scale of the object whose grasps are read, of files of several."""
    object_pose: Any = None
    """Pose of the object in the frame of the poses, see `read_object_pose`; None: not given."""
    frame: Any = None
    """Frame of the gripper in which the poses are, see `read_frame`; None: not given."""


@dataclass(frozen=True, kw_only=True)
class Format:
    """A format of files of grasp poses.

    `read` and `write` have the poses of the gripper's frame that is stated here, as the file has
    them, and lengths in metres unless the files state a unit.
    """

    name: str
    title: str
    """What people call it."""
    suffixes: tuple[str, ...]
    sniff: Callable[[Any], bool]
    """Whether content is in this format: of .json, .yaml and .npy files what they hold, of others
    their path."""
    read: Callable[[Any, Given], "GraspPoses"]
    """Poses of such content. Raises ContactError, ValueError, OSError."""
    write: Callable[[Path, "GraspPoses"], None]
    """Writes poses. Raises OutputError."""
    holds: str
    """What its content looks like, for error messages."""
    frame: str = "tcp"
    """Frame of the gripper in which it has poses, in `FRAMES`."""
    states_frame: bool = False
    """Whether the poses that are read state their frame."""
    unit: Literal["m", "stated"] = "m"
    hands: tuple[Literal["gripper", "articulated"], ...] = ("gripper",)
    """Kinds of hands that it has; none: any hand, which need not be known."""
    alone: bool = False
    """Whether it is read without a hand, though written with one."""
    joints: bool = False
    """Whether it has values of the joints of a gripper."""
    outcomes: bool = False
    """Whether all outcomes must be known."""
    needs: tuple[str, str] | None = None
    """Module of a library that is not always installed, and the name of its package."""
    moves: bool = False
    """Whether its poses may be in the frame of a robot; others have the object's by definition."""
    main: bool = False
    """Whether files of its suffix are written so where no format is named."""
    about: str = ""
    """Its section of the page on formats, Markdown."""


_REGISTERED: dict[str, Format] = {}


def register(kind: Format) -> None:
    """Make a format known; one of the same name is replaced."""
    _REGISTERED[kind.name] = kind


def format_names() -> tuple[str, ...]:
    """Names of all formats; those of the package are not imported."""
    own = (module.name for module in iter_modules(grasps.__path__))
    return tuple(sorted({*own, *_REGISTERED}))


def formats() -> Mapping[str, Format]:
    """All formats by name, those first in which files of their suffix are written."""
    for module in iter_modules(grasps.__path__):
        import_module(f"{grasps.__name__}.{module.name}")
    return dict(sorted(_REGISTERED.items(), key=lambda item: (not item[1].main, item[0])))


def format_called(name: str) -> Format:
    """The format of a name. Raises SettingError if there is none."""
    if name not in format_names():
        raise SettingError(f"no format is called {name!r}; known: {', '.join(format_names())}")
    return formats()[name]


def format_of(path: Path, name: str | None = None) -> Format:
    """The format of a name; None: the main one of files of such a suffix.

    Raises:
        OutputError: No format has that suffix.
        SettingError: No format is called so.
    """
    if name is not None:
        return format_called(name)
    for one in formats().values():
        if path.suffix.lower() in one.suffixes:
            return one
    raise OutputError(unsupported(path, suffixes(), "pose"))


def suffixes() -> tuple[str, ...]:
    """Endings of files of poses."""
    return tuple(dict.fromkeys(suffix for one in formats().values() for suffix in one.suffixes))
