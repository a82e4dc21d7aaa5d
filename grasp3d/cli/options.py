"""Options of the commands: their fields and those of settings, and the parsing of their words.

The options of a command are the fields of its dataclass and of the settings in it. The docstrings
of the fields are the helps. Angles without a unit are in degrees on the command line.
"""

import math
from collections.abc import Callable, Collection, Iterable, Iterator
from dataclasses import MISSING, Field, dataclass, field, fields, is_dataclass
from functools import cache, partial
from importlib import import_module
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

from grasp3d.errors import GraspError, OutputError, SettingError
from grasp3d.formats.format import format_called, format_names
from grasp3d.hand.frames import AUTO, GripperFrame, ObjectPose
from grasp3d.hand.hand import Hand
from grasp3d.hand.reach_settings import ReachSettings
from grasp3d.quality.loads import Load, TaskField, TaskText
from grasp3d.settings import GraspModel, MeshOptions, Radians, Sampling
from grasp3d.settings.grasp_model import Friction
from grasp3d.settings.mesh_options import Region
from grasp3d.settings.parsing import IN_PYTHON
from grasp3d.settings.pose_error import PoseError, PoseErrorField
from grasp3d.settings.units import Length, Lengths, Metres, Quantity, parse_angle, parse_length
from grasp3d.system.files import check_suffix, check_writable
from grasp3d.system.limited_reading import files_read

NONE = "none"
SMALL = math.radians(1.0)
"""Angle below which a number without a unit was probably meant in radians [rad]."""

FORMATS = "FORMATS"
"""Placeholder in helps for the names of all formats of poses."""

ARGUMENT = "argument"
"""Note on a field: it is a positional argument."""

_METAVARS = {
    "scheduler": "ADDRESS|FILE", "palm": "LINK", "outcome": "NAME", "paint": "QUANTITY",
    "metrics": "all|NAME,NAME", "contacts": "CONTACTS",
}  # fmt: skip
"""Placeholders for the values of some fields; for others the type has one."""

_ALIASES = {"output": ("-o",), "quiet": ("-q",)}
"""Short names of options, by name of the field."""


class Without(tuple[str, ...]):
    """Note on settings: names of the fields for which a command has no options."""

    __slots__ = ()


@dataclass(frozen=True)
class Parser:
    """Parser of a word on the command line; a note on a field, or chosen by the field's type."""

    metavar: str = ""
    """Placeholder of the word; empty for a flag, which takes no word."""
    parse: Callable[[str, str], Any] = lambda _, word: word
    """Function that returns the value for an option and its word."""
    text: Callable[[Any], str] = str
    """Function that returns the word for a value, to show a default."""
    names: Callable[[], tuple[str, ...]] = tuple
    """Function that returns the known words, to which others may be added; empty: any word."""

    @property
    def placeholder(self) -> str:
        """Text that stands for the word in helps."""
        return "|".join(self.names()) or self.metavar


@dataclass(frozen=True)
class Option:
    """An option or argument of a command: a field of the command or of settings in it."""

    field: str
    """Name of the field."""
    group: str
    """Name of its group: the class of the settings."""
    parser: Parser
    """Parser of each of its words."""
    many: bool
    """Whether it takes any number of words, which become a tuple."""
    default: Any
    """Default value; `MISSING`: there is no default."""
    optional: bool
    """Whether the word `none` means None."""
    names: tuple[str, ...]
    """Names on the command line, the main one last; none: it is an argument."""
    metavar: str
    """Placeholder of its value; empty: it takes none."""
    text: str
    """Help text."""

    @property
    def name(self) -> str:
        """Name in error messages."""
        return self.names[-1] if self.names else self.field

    def parse(self, words: list[str]) -> Any:
        """Return the value for its words; raises SettingError."""
        values = tuple(map(self._value, words))
        return values if self.many else values[0]

    def _value(self, word: str) -> Any:
        if self.optional and word.lower() == NONE:
            return None
        try:
            return self.parser.parse(self.name, word)
        except GraspError as error:
            named = str(error).startswith(self.name)
            raise error if named else SettingError(f"{self.name}: {error}") from error


def members(
    kind: Any, without: Collection[str] = ()
) -> Iterator[tuple["Field[Any]", Any, list[Any]]]:
    """Yield the fields of a dataclass for which commands have options, in the order given.

    Args:
        kind: The options of a command, or settings.
        without: Names of fields to leave out.

    Yields:
        The field, its type, and the notes on the type.
    """
    hints = get_type_hints(kind, include_extras=True)
    for one in sorted(fields(kind), key=lambda one: bool(one.kw_only)):
        hint = hints[one.name]
        base, *notes = get_args(hint) if get_origin(hint) is Annotated else (hint,)
        if one.name not in without and IN_PYTHON not in notes:
            yield one, base, notes


def options_of(
    kind: Any, without: Collection[str] = (), group: str = "options", *, helps: bool = True
) -> Iterator[Option]:
    """Yield the options of a command, or of settings.

    Args:
        kind: A dataclass.
        without: Names of fields that have no options.
        group: Group of the options that are not in settings.
        helps: Whether the options have helps, which are read from the sources.
    """
    texts = _help_texts(kind) if helps else {}
    for one, base, notes in members(kind, without):
        if is_dataclass(base):
            yield from options_of(base, left_out(notes), base.__name__, helps=helps)  # type: ignore[union-attr]
        else:
            yield _option(one, base, notes, texts.get(one.name, ""), group)


def left_out(notes: Collection[Any]) -> Collection[str]:
    """Names of the settings fields that notes leave out."""
    return next((note for note in notes if isinstance(note, Without)), ())


def _option(field: "Field[Any]", base: Any, notes: list[Any], text: str, group: str) -> Option:
    is_argument, many = ARGUMENT in notes, get_origin(base) is tuple
    parser, default = _parser(base, notes), field.default
    optional = default is None or NoneType in get_args(base)
    if default is not MISSING and parser.metavar and "(default" not in text:
        values = (default if many else (default,)) or ()
        words = NONE if default in {None, ()} else " ".join(map(parser.text, values))
        text += f" (default: {words})" * bool(words)
    metavar = _METAVARS.get(field.name, parser.placeholder) + " ..." * many
    return Option(
        field=field.name,
        group="arguments" if is_argument else group,
        parser=parser,
        many=many,
        default=default,
        optional=optional,
        names=() if is_argument else (
            *_ALIASES.get(field.name, ()), f"--{field.name.replace('_', '-')}"
        ),
        metavar=metavar,
        text=text.replace(FORMATS, ", ".join(format_names())),
    )  # fmt: skip


@cache
def _help_texts(kind: Any) -> dict[str, str]:
    """Return the help texts of a class's fields by name, each in one line.

    The texts of inherited fields are in the docstrings of the base classes.
    """
    import docstring_parser  # parsing does not need it

    kinds = [base for base in reversed(kind.__mro__) if base.__module__.startswith("grasp3d.")]
    return {
        item.args[-1]: " ".join((item.description or "").split())
        for base in kinds
        for item in docstring_parser.parse_from_object(base).params
    }


def _parser(base: Any, notes: Collection[Any] = ()) -> Parser:
    """Return the parser for the type of a field, or for the words of a tuple."""
    if own := [note for note in notes if isinstance(note, Parser)]:
        return own[0]
    kinds, origin = [one for one in get_args(base) if one is not NoneType], get_origin(base)
    if base == Radians or get_args(Radians)[1] in notes:
        return Parser("DEGREES", typed_angle, lambda angle: f"{math.degrees(angle):.6g}")
    if origin is Annotated:
        return _parser(kinds[0], kinds[1:])
    if origin is Literal:
        return Parser("|".join(kinds), partial(_one_of, kinds))
    if origin in {Union, UnionType, tuple}:
        return _parser(kinds[0])
    return _PARSERS[origin or base]


def _one_of(words: list[str], option: str, word: str) -> str:
    if word not in words:
        raise SettingError(f"{option} must be one of {', '.join(words)}; got {word!r}")
    return word


def number(kind: type, option: str, word: str) -> Any:
    """Return a word as a number; raises SettingError."""
    try:
        return kind(word)
    except ValueError as error:
        whole = "whole " * (kind is int)
        raise SettingError(f"{option} must be a {whole}number; got {word!r}") from error


def typed_angle(option: str, word: str) -> float:
    """Return a word as an angle [rad]; refuse a small number without a unit as ambiguous."""
    angle = parse_angle(option, word)
    if 0.0 < abs(angle) < SMALL and word[-1].isdecimal():
        raise SettingError(
            f"{option} {word} is {word} degrees: write {word}deg for that, or {word}rad"
        )
    return angle


def _millimetres(length: float) -> str:
    return f"{length:g}" if length in {0.0, math.inf} else f"{1000.0 * length:g}mm"


def _read(module: str, function: str) -> Callable[[str, str], Any]:
    """Return a function that reads the value of a word, and only then imports its module."""
    return lambda _, word: getattr(import_module(f"grasp3d.{module}"), function)(word)


_FRAMES = "formats.frames"
_LENGTH = Parser("LENGTH", parse_length, _millimetres)
FOLDER = Parser("FOLDER", lambda _, word: Path(word))

_PARSERS: dict[Any, Parser] = {
    bool: Parser(),
    str: Parser("FILE"),
    Path: Parser("FILE", lambda _, word: Path(word)),
    int: Parser("INT", partial(number, int)),
    float: Parser("NUMBER", partial(number, float), "{:g}".format),
    Hand: Parser("NAME|FILE", _read("hand.hand_files", "read_hand")),
    GripperFrame: Parser("NAME|FILE", _read(_FRAMES, "read_frame")),
    ObjectPose: Parser("POSE|FILE", _read(_FRAMES, "read_object_pose")),
    Metres: _LENGTH,
    Length: _LENGTH,
    Quantity: Parser("QUANTITY"),
    Friction: Parser("NUMBER|LOW..HIGH"),
    PoseErrorField: Parser("LENGTH,DEGREES", lambda _, word: PoseError.of(word)),
    Lengths: Parser("X,Y,Z"),
    Region: Parser("BOX|FILE"),
    TaskField: Parser("TASK", lambda _, word: TaskText.of(word)),
}
"""Parsers by kind of field; the settings themselves parse those that remain texts."""

LengthOption = Metres | float | None
"""Length as a number, a text with a unit, or None."""

WholeMesh = Annotated[MeshOptions, Without(["region"])]
"""Mesh options for commands that allow contacts anywhere on the mesh."""

LoadOfJaws = Annotated[Load, Without(["torque_limits"])]
"""Load of hands without motors in their joints."""

PoseFormat = Parser("FORMAT", lambda _, word: format_called(word).name, names=format_names)
"""Parser of the name of a format of poses."""

_AnyFrame = Parser(
    "NAME|FILE|auto",
    lambda option, word: word if word == AUTO else _PARSERS[GripperFrame].parse(option, word),
)


@dataclass(frozen=True, kw_only=True)
class GivenPoses:
    """Options of commands that read poses of a gripper."""

    object_pose: ObjectPose | None = None
    """Pose of the object in the frame of the poses, for poses in a robot's frame whose file does
    not state it: x,y,z,yaw in metres and degrees, x,y,z,qx,qy,qz,qw, or a file of it (default: the
    poses are in the mesh's frame, or as their file states)."""

    frame: Annotated[GripperFrame | str | None, _AnyFrame] = None
    """Frame of the gripper in the file of poses: a name, such as graspgen, isaac, panda_hand_tcp or
    graspnetapi (any other lists them), or a file with the pose of the TCP in it, a 4x4 matrix;
    auto: the one in which by far most poses close on the object (default: the one that the file or
    its format states)."""

    @property
    def of_poses(self) -> dict[str, Any]:
        """What is known of the file, as `read_grasps` takes it; without the frame `auto`."""
        frame = None if self.frame == AUTO else self.frame
        return {"object_pose": self.object_pose, "frame": frame}


@dataclass(frozen=True, kw_only=True)
class Strict:
    """Option of commands that warn."""

    strict: bool = False
    """Treat warnings as errors: refuse the input that causes one, and write no results for it."""


@dataclass(frozen=True, kw_only=True)
class Overwriting:
    """Option of commands that write files."""

    overwrite: bool = False
    """Replace existing files."""

    def check_output(
        self,
        path: Path | None,
        suffixes: Iterable[str] = (),
        what: str = "",
        *,
        inputs: Iterable[Path | None] = (),
    ) -> None:
        """Check, before a long computation, that an output has a known format and can be written.

        Args:
            path: File to create or replace; None: nothing is written.
            suffixes: Known suffixes, in lower case; none: they are checked elsewhere.
            what: Content of the file, for the error: a table, a figure.
            inputs: Files that the command is going to read; None: not a local file. The output must
                not replace these, nor any file that has been read.

        Raises:
            OutputError: The suffix is not known, the file cannot be written, or it exists already.
        """
        if path is None:
            return
        if suffixes:
            check_suffix(path, suffixes, what)
        check_writable(path)
        if not path.exists():
            return
        every = filter(None, (*inputs, *files_read()))
        if any(one.exists() and path.samefile(one) for one in every):
            raise OutputError(f"{path}: is read by this command; name another file")
        if not self.overwrite:
            raise OutputError(f"{path}: exists; name another file, or replace it with --overwrite")


@dataclass(frozen=True, kw_only=True)
class Quiet:
    """Option of commands that print."""

    quiet: bool = False
    """Print nothing but errors."""


@dataclass(frozen=True)
class OneMesh:
    """Argument of commands on one mesh."""

    file: Annotated[Path, ARGUMENT]
    """Mesh (STL, OBJ, PLY, OFF, GLB, 3MF, ...)."""


@dataclass(frozen=True)
class ManyMeshes:
    """Argument of commands on many meshes, as `batch.inputs.find_meshes` takes it."""

    inputs: Annotated[tuple[str, ...], ARGUMENT, Parser("PATH")]
    """Mesh files, folders, globs or tables: folders are searched recursively, globs are in quotes
    ('lib/**/*.stl'), tables (.csv, .parquet) have a row per mesh: path, and name, scale, unit,
    mass, hand, ... of this mesh; also on an object store (s3://BUCKET/FOLDER)."""


@dataclass(frozen=True, kw_only=True)
class Guarded(Quiet, Overwriting, Strict):
    """Options for what is accepted, replaced and printed."""

    force: bool = False
    """Accept implausible lengths, such as an opening 500 times the object's size. It replaces no
    files: see --overwrite."""


@dataclass(frozen=True, kw_only=True)
class Searching(Guarded):
    """Options of commands that search for grasps on one mesh or many."""

    model: GraspModel = field(default_factory=GraspModel)
    sampling: Sampling = field(default_factory=Sampling)


@dataclass(frozen=True, kw_only=True)
class Labelling(Searching):
    """Options of commands that label meshes, also for a gripper and a load."""

    reach: ReachSettings = field(default_factory=ReachSettings)
    load: LoadOfJaws = field(default_factory=Load)
    mesh: MeshOptions = field(default_factory=MeshOptions)
