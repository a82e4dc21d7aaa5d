"""Options of the commands: their fields and those of settings, and how their words are parsed.

The options of a command are the fields of its dataclass, and those of the settings in it, with the
docstrings as help. Angles without a unit are degrees there.
"""

import math
from collections.abc import Callable, Container, Iterator
from dataclasses import MISSING, Field, dataclass, field, fields, is_dataclass, replace
from functools import cache, partial
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

from grasp3d.errors import GraspError, SettingError
from grasp3d.hand.frames import AUTO, GripperFrame
from grasp3d.hand.hand import Hand
from grasp3d.hand.object_pose import ObjectPose
from grasp3d.hand.reach_settings import ReachSettings
from grasp3d.quality.loads import Load
from grasp3d.quality.task_texts import TaskField, TaskText
from grasp3d.settings import (
    GraspModel,
    MeshOptions,
    Radians,
    Sampling,
)
from grasp3d.settings.friction import Friction as FrictionField
from grasp3d.settings.parsing import IN_PYTHON, Group, Main
from grasp3d.settings.pose_error import PoseError, PoseErrorField
from grasp3d.settings.regions import Region
from grasp3d.settings.units import Length, Lengths, Metres, Quantity, parse_angle, parse_length

NONE = "none"
SMALL = math.radians(1.0)
"""Angle below which a number without a unit is rather meant in radians."""

_METAVARS = {
    "max_memory": "GB", "worker_memory": "GB", "timeout": "SECONDS", "scheduler": "ADDRESS|FILE",
    "mass": "MASS", "density": "DENSITY", "grip_force": "FORCE", "object_mass": "MASS",
}  # fmt: skip
"""Placeholders of the values of some settings; others have a placeholder by their type."""

POSITIONAL, REPEATED = "positional", "repeated"
"""Notes on fields: an argument; an option that may be given several times."""

_GROUPS = {
    "model": "sensor", "sampling": "search", "reach": "hand",
    "mesh": "object", "surface": "object", "grasps": "object", "cluster": "processes",
}  # fmt: skip
"""Groups of settings by the name of their field; others are a group of that name."""

_ALIASES = {"output": ("-o",), "quiet": ("-q",)}
"""Other names of options, by the name of the field."""


@dataclass(frozen=True)
class Stated:
    """A note on a field: what its option has other than its type and docstring say."""

    name: str = ""
    help: str = ""
    metavar: str = ""


@dataclass(frozen=True)
class Parser:
    """How a word of the command line becomes a value."""

    metavar: str = ""
    """Placeholder of the word; empty: there is none, as it is a flag."""
    parse: Callable[[str, str], Any] = lambda _, word: word
    """The value for an option and its word."""
    text: Callable[[Any], str] = str
    """The word for a value, to show a default."""
    optional: bool = False
    """Whether `none` is None."""

    def value(self, option: str, word: str) -> Any:
        """The value for a word; errors name the option."""
        if self.optional and word.lower() == NONE:
            return None
        try:
            return self.parse(option, word)
        except GraspError as error:
            named = str(error).startswith(option)
            raise error if named else SettingError(f"{option}: {error}") from error


@dataclass(frozen=True)
class Option:
    """An option or a positional argument of a command: a field of it, or of settings in it."""

    field: str
    """Name of the field."""
    group: str
    """Name of its group."""
    parsers: tuple[Parser, ...]
    """How each of its words is parsed; of any number of words the parser of each."""
    count: int | Literal["*"]
    """Number of words: 1 is a value, others are tuples."""
    default: Any
    """Its default; `MISSING`: none."""
    repeated: bool
    """Whether it may be given several times, with a word each."""
    names: tuple[str, ...]
    """What it is given with, the main one last; none: it is positional."""
    metavar: str
    """Placeholder of its value; empty: it takes none."""
    text: str
    """Help."""
    brief: str
    """Short help; empty: none, as it is not one of the main options."""

    @property
    def is_required(self) -> bool:
        """Whether a command cannot do without it."""
        return self.default is MISSING

    def parse(self, words: list[str]) -> Any:
        """The value for its words; raises SettingError."""
        name = self.names[-1] if self.names else self.field
        parsers = self.parsers * len(words) if self.count == "*" else self.parsers
        values = tuple(one.value(name, word) for one, word in zip(parsers, words, strict=True))
        return values[0] if self.count == 1 and not self.repeated else values


def options_of(kind: Any, group: str = "output", *, helps: bool = True) -> Iterator[Option]:
    """Yield the options of a command, or of settings.

    Args:
        kind: A dataclass, or a partial of it: then the fields that it gives have no options.
        group: Group of the options that are marked with none.
        helps: Whether they have their helps, which are read from the sources.
    """
    plain, constants = parted(kind)
    hints = get_type_hints(plain, include_extras=True)
    texts = _help_texts(plain) if helps else {}
    for one in sorted(fields(plain), key=lambda one: bool(one.kw_only)):  # as they are given
        hint = hints[one.name]
        if not is_option(one, hint, constants):
            continue
        if settings := settings_in(hint):
            yield from options_of(settings, _GROUPS.get(one.name, one.name), helps=helps)
        else:
            yield _option(one, hint, texts.get(one.name, ""), group)


def is_option(field: "Field[Any]", hint: Any, constants: Container[str]) -> bool:
    """Whether commands have an option for a field, or options for settings that it holds.

    Args:
        field: The field.
        hint: Its type.
        constants: Names of the fields that the command gives itself.
    """
    return field.name not in constants and IN_PYTHON not in _noted(hint)[1]


def parted(kind: Any) -> tuple[Any, dict[str, Any]]:
    """Return a dataclass, and the fields that a partial of it gives."""
    return (kind.func, kind.keywords) if isinstance(kind, partial) else (kind, {})


def settings_in(hint: Any) -> Any:
    """Return the dataclass, or the partial of it, that fields of a type hold; None: no settings."""
    base, notes = _noted(hint)
    kind = next((note for note in notes if isinstance(note, partial)), base)
    return kind if is_dataclass(parted(kind)[0]) else None


def _noted(hint: Any) -> tuple[Any, list[Any]]:
    """Return a type, and what is noted on it."""
    base, *notes = get_args(hint) if get_origin(hint) is Annotated else (hint,)
    return base, notes


def _option(field: "Field[Any]", hint: Any, text: str, group: str) -> Option:
    base, notes = _noted(hint)
    last = dict[type, Any]((type(note), note) for note in notes)
    stated, brief = last.get(Stated, Stated()), str(last.get(Main, ""))
    name = f"--{(stated.name or field.name).replace('_', '-')}"
    is_argument, text = POSITIONAL in notes, stated.help or text
    items = get_args(base) if get_origin(base) is tuple else ()
    if NoneType in get_args(base):
        items = next((get_args(one) for one in get_args(base) if get_origin(one) is tuple), ())
    parsers = tuple(_parser(one) for one in items if one is not ...) or (_parser(hint),)
    count: Any = "*" if ... in items else len(parsers)
    if field.default is not MISSING and parsers[0].metavar:
        values = field.default if count == "*" else [field.default]
        default = NONE
        if field.default not in {None, ()}:
            default = " ".join(map(parsers[0].text, values))
        if default and "(default" not in text:
            text += f" (default: {default})"
            brief += f" (default: {default})" * bool(brief and default not in {NONE, "0", "inf"})
    metavar = _METAVARS.get(field.name) or " ".join(one.metavar for one in parsers)
    metavar += f"|{NONE}" * (parsers[0].optional and not metavar.endswith("]"))
    metavar += " ..." * (count == "*" and REPEATED not in notes)
    return Option(
        field=field.name,
        group="arguments" if is_argument else str(last.get(Group, group)),
        parsers=parsers,
        count=count,
        default=field.default,
        repeated=REPEATED in notes,
        names=() if is_argument else (*_ALIASES.get(field.name, ()), name),
        metavar=stated.metavar or metavar,
        text=text,
        brief=brief,
    )


@cache
def _help_texts(kind: Any) -> dict[str, str]:
    """Return the texts on the fields in the docstrings of a class, by name, in one line each.

    Those of settings that it extends are in the docstrings of these.
    """
    import docstring_parser  # which parsing needs not

    kinds = [base for base in reversed(kind.__mro__) if base.__module__.startswith("grasp3d.")]
    return {
        item.args[-1]: " ".join((item.description or "").split())
        for base in kinds
        for item in docstring_parser.parse_from_object(base).params
    }


def _parser(hint: Any) -> Parser:
    """Return the parser of a type of field."""
    base, notes = _noted(hint)
    if own := [note for note in notes if isinstance(note, Parser)]:
        return own[0]
    if get_args(Radians)[1] in notes:
        return Parser("DEGREES", typed_angle, _degrees)
    inner = get_args(base)
    if get_origin(base) is Literal:
        return Parser("|".join(map(str, inner)), partial(_one_of, {str(one): one for one in inner}))
    if get_origin(base) in {Union, UnionType}:
        kinds = [one for one in inner if one is not NoneType]
        kind = Metres if Metres in kinds else kinds[0]
        optional = NoneType in inner and kind not in {str, Path}
        return replace(_parser(kind), optional=optional)
    parser = _PARSERS[get_origin(base) or base]
    optional = parser.optional or NoneType in get_args(next(iter(inner), None))
    return replace(parser, optional=optional)


def _one_of(words: dict[str, Any], option: str, word: str) -> Any:
    if word not in words:
        raise SettingError(f"{option} must be one of {', '.join(words)}; got {word!r}")
    return words[word]


def _number(kind: type, option: str, word: str) -> Any:
    try:
        return kind(word)
    except ValueError as error:
        whole = "whole " * (kind is int)
        raise SettingError(f"{option} must be a {whole}number; got {word!r}") from error


def typed_angle(option: str, word: str) -> float:
    """Return the angle [rad] of a word; a small number without a unit is asked about."""
    angle = parse_angle(option, word)
    if 0.0 < abs(angle) < SMALL and word[-1].isdecimal():
        raise SettingError(
            f"{option} {word} is {word} degrees: write {word}deg for that, or {word}rad"
        )
    return angle


def _degrees(angle: float) -> str:
    return f"{math.degrees(angle):.6g}"


def _millimetres(length: float) -> str:
    return f"{length:g}" if length in {0.0, math.inf} else f"{1000.0 * length:g}mm"


def _hand(_option: str, word: str) -> Hand:
    """Return the gripper of a preset or a file."""
    from grasp3d.hand.hand_files import read_hand

    return read_hand(word)


def _object_pose(_option: str, word: str) -> ObjectPose:
    """Return the pose of a text or a file; raises ContactError."""
    from grasp3d.grasps.pose_files.frames import read_object_pose

    return read_object_pose(word)


def _frame(_option: str, word: str) -> GripperFrame:
    """Return the frame of a name or a file."""
    from grasp3d.grasps.pose_files.frames import read_frame

    return read_frame(word)


def _any_frame(option: str, word: str) -> GripperFrame | str:
    return word if word == AUTO else _frame(option, word)


_LENGTH = Parser("LENGTH", parse_length, _millimetres)

_PARSERS: dict[Any, Parser] = {
    bool: Parser(),
    str: Parser("FILE"),
    Path: Parser("FILE", lambda _, word: Path(word)),
    int: Parser("INT", partial(_number, int)),
    float: Parser("NUMBER", partial(_number, float), "{:g}".format),
    Hand: Parser("NAME|FILE", _hand, lambda hand: str(hand.name)),
    Metres: _LENGTH,
    Length: _LENGTH,
    Quantity: Parser("NUMBER"),
    FrictionField: Parser("NUMBER|LOW..HIGH"),
    PoseErrorField: Parser("LENGTH,DEGREES", lambda _, word: PoseError.of(word)),
    Lengths: Parser("X,Y,Z", optional=True),
    Region: Parser("BOX|FILE", optional=True),
    TaskField: Parser("TASK", lambda _, word: TaskText.of(word)),
}
"""Parsers by the kind of a field; texts that stay texts are parsed by the settings themselves."""

NumberRanges = Annotated[
    tuple[str, ...], Stated(metavar="NUMBER|FROM:TO:STEP ..."), Group("sensor")
]
"""Words for `parse_frictions`."""

DegreeRanges = Annotated[
    tuple[str, ...], Stated(metavar="DEGREES|FROM:TO:STEP ..."), Group("sensor")
]
"""Words for `parse_angles`."""

LengthOption = float | Metres | None
"""A length: a number, a text with a unit, or none."""

FrameOption = Annotated[
    GripperFrame | None, Parser("NAME|FILE", _frame, optional=True), Group("hand")
]
"""The frame of a gripper's poses, or none."""

AnyFrameOption = Annotated[
    GripperFrame | str | None,
    Parser("NAME|FILE|auto", _any_frame, optional=True),
    Group("hand"),
]
"""The same, or the one that explains the poses."""

ObjectPoseOption = Annotated[
    ObjectPose | None, Parser("POSE|FILE", _object_pose, optional=True), Group("hand")
]
"""The pose of the object in the frame of a robot, or none."""

OutcomeOption = Annotated[str | None, Stated(metavar="NAME"), Group("object")]
"""The name of the values of a file that are the outcomes of its grasps, or none."""

MeshFile = Annotated[
    Path,
    POSITIONAL,
    Stated(help="Mesh file: STL, OBJ, PLY, OFF, GLB, 3MF, ..."),
    Main("mesh: STL, OBJ, PLY, OFF, GLB, 3MF, ..."),
]
"""A mesh to read."""

Inputs = Annotated[
    tuple[str, ...],
    POSITIONAL,
    Stated(
        metavar="PATH ...",
        help="Mesh files, folders, which are searched recursively, globs in quotes such as "
        "'lib/**/*.stl', lists of these (.txt, one per line); also on an object store "
        "(s3://BUCKET/FOLDER).",
    ),
    Main("mesh files, folders, globs or lists (.txt)"),
]
"""Meshes, as `batch.inputs.find_meshes` takes them."""

WholeMesh = partial(MeshOptions, region=None)
"""How commands make options of reading a mesh whose contacts may be anywhere."""


def without(kind: Any, *names: str) -> "partial[Any]":
    """Return how a command makes settings of whose fields it does not take some."""
    return partial(kind, **{name: getattr(kind, name) for name in names})


LoadOfJaws = Annotated[Load, without(Load, "torque_limits")]
"""A load of what has no motors in its joints."""


@dataclass(frozen=True, kw_only=True)
class Forced:
    """The option of commands that refuse lengths which are most likely in another unit."""

    force: bool = False
    """Accept lengths that cannot be meant, such as an opening 500 times the object's size. It
    replaces no files: see --overwrite."""


@dataclass(frozen=True, kw_only=True)
class GivenPoses:
    """The options of commands that read poses of a gripper."""

    object_pose: ObjectPoseOption = None
    """Pose of the object in the frame of the poses, for poses in a robot's frame whose file does
    not state it: x,y,z,yaw in metres and degrees, x,y,z,qx,qy,qz,qw, or a file of it (default: the
    poses are in the mesh's frame, or as their file states)."""

    frame: Annotated[AnyFrameOption, Main("frame of the gripper in the file of poses")] = None
    """Frame of the gripper in which the file has the poses: a name, such as graspgen, isaac,
    panda_hand_tcp or graspnetapi (an unknown one lists all), or a file with the pose of the TCP in
    it, a 4x4 matrix; auto: the one in which by far most poses close on the object (default: the one
    that the file or its format states)."""

    @property
    def of_poses(self) -> dict[str, Any]:
        """What is stated of the file, as `read_grasps` takes it; `auto` is no frame of it."""
        frame = None if self.frame == AUTO else self.frame
        return {"object_pose": self.object_pose, "frame": frame}


@dataclass(frozen=True, kw_only=True)
class Strict:
    """The option of commands that warn."""

    strict: bool = False
    """Take warnings as errors: what they are of is refused, and not written."""


@dataclass(frozen=True, kw_only=True)
class Overwriting:
    """The option of commands that write files."""

    overwrite: bool = False
    """Replace existing files."""


@dataclass(frozen=True, kw_only=True)
class Quiet:
    """The option of commands that print."""

    quiet: bool = False
    """Print nothing but errors."""


@dataclass(frozen=True, kw_only=True)
class Guarded(Quiet, Overwriting, Strict, Forced):
    """The options of what is accepted, replaced and printed."""


@dataclass(frozen=True, kw_only=True)
class Searching(Guarded):
    """The options of commands that search grasps on one mesh or many."""

    model: GraspModel = field(default_factory=GraspModel)
    sampling: Sampling = field(default_factory=Sampling)


@dataclass(frozen=True, kw_only=True)
class Labelling(Searching):
    """The options of commands that label meshes, also for a gripper and a load."""

    reach: ReachSettings = field(default_factory=ReachSettings)
    load: LoadOfJaws = field(default_factory=Load)
    mesh: MeshOptions = field(default_factory=MeshOptions)
