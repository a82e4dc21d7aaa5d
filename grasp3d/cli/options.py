"""Options of the commands: their fields and those of settings, and how their words are parsed.

The options of a command are the fields of its dataclass, and those of the settings in it, with the
docstrings as help. Angles without a unit are degrees there.
"""

import math
from collections.abc import Callable, Container, Iterator, Sequence
from dataclasses import MISSING, Field, dataclass, field, fields, is_dataclass
from functools import cache, partial
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

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

_NONE = "none"
SMALL = math.radians(1.0)
"""Angle below which a number without a unit is rather meant in radians."""

_METAVARS = {
    "max_memory": "GB", "worker_memory": f"GB|{_NONE}", "timeout": f"SECONDS|{_NONE}",
    "width": "PIXELS", "height": "PIXELS", "scheduler": "ADDRESS|FILE",
    "mass": f"MASS|{_NONE}", "density": f"DENSITY|{_NONE}", "grip_force": f"FORCE|{_NONE}",
    "object_mass": "MASS",
}  # fmt: skip
"""Placeholders of the values of some settings; others have a placeholder by their type."""

ValueT = TypeVar("ValueT")

POSITIONAL, REPEATED = "positional", "repeated"
"""Notes on fields: an argument; an option that may be given several times."""


@dataclass(frozen=True)
class Stated:
    """A note on a field: what its option has other than its type and docstring say."""

    name: str = ""
    help: str | Callable[[], str] = ""
    """A text, or what makes it when the help is printed."""
    metavar: str = ""


@dataclass(frozen=True)
class Parser:
    """How words of the command line become a value."""

    metavar: str
    """Placeholder of the words; empty: there are none, as it is a flag."""
    parse: Callable[[Sequence[str]], Any]
    """The value for the words."""
    text: Callable[[Any], str]
    """The words for a value, to show a default."""
    count: int | str = 1
    """Number of words; *: any."""


_GROUPS = {
    "model": "sensor", "sampling": "search", "reach": "hand",
    "mesh": "object", "surface": "object", "grasps": "object", "cluster": "processes",
}  # fmt: skip
"""Groups of settings by the name of their field; others are a group of that name."""

_ALIASES = {"output": ("-o",), "quiet": ("-q",)}
"""Other names of options, by the name of the field."""


@dataclass(frozen=True)
class Option:
    """An option or a positional argument of a command: a field of it, or of settings in it."""

    field: str
    """Name of the field."""
    group: str
    """Name of its group."""
    parser: Parser
    """How its words are parsed."""
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
            yield _option(one, hint, texts.get(one.name, "") if helps else None, group)


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


def _option(field: "Field[Any]", hint: Any, text: str | None, group: str) -> Option:
    """Return an option; without help where `text` is None."""
    _, notes = _noted(hint)
    stated: dict[str, Any] = {"name": field.name, "help": text}
    for note in notes:
        if isinstance(note, Stated):
            stated |= {key: value for key, value in vars(note).items() if value}
    positional = POSITIONAL in notes
    aliases = () if positional else _ALIASES.get(field.name, ())
    names = *aliases, option_name(stated["name"])
    parser = _parser(hint, names[-1])
    default = "" if field.default is MISSING else parser.text(field.default)
    brief = next((str(note) for note in reversed(notes) if isinstance(note, Main)), "")
    if text is None:
        stated["help"] = ""
    elif callable(stated["help"]):
        stated["help"] = stated["help"]()
    group = next((str(note) for note in notes if isinstance(note, Group)), group)
    if default and "(default" not in stated["help"]:
        stated["help"] += f" (default: {default})"
        brief += f" (default: {default})" if brief and default not in {_NONE, "0", "inf"} else ""
    return Option(
        field=field.name,
        group="arguments" if positional else group,
        parser=parser,
        default=field.default,
        repeated=REPEATED in notes,
        names=() if positional else names,
        metavar=_METAVARS.get(field.name) or stated.get("metavar", parser.metavar),
        text=stated["help"],
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


def option_name(field: str) -> str:
    """Return the option of a field: `location_error` is given with `--location-error`."""
    return f"--{field.replace('_', '-')}"


def _parser(hint: Any, option: str) -> Parser:
    """Return the parser of a type of field.

    Errors are of the settings: one sentence, which names the option.
    """
    base, notes = _noted(hint)
    own = next((note for note in notes if isinstance(note, Parser)), None)
    if known := own or _PARSERS.get(get_origin(base) or base):
        return known
    kinds = get_args(base) if get_origin(base) in {Union, UnionType} else (base,)
    optional, kind = NoneType in kinds, next(one for one in kinds if one is not NoneType)
    if Radians in kinds or get_args(Radians)[1] in notes:
        return _angle(option, optional=optional)
    if Metres in kinds or get_origin(base) is Length:
        kinds = kinds if Metres in kinds else get_args(get_args(base)[0])
        return _length(option, optional=NoneType in kinds)
    if get_origin(kind) is tuple:
        return _of_tuple(kind, option)
    if kind in {int, float} or get_origin(kind) is Literal:
        return _plain(option, kind, optional=optional)
    of_hand = one_word(f"NAME|FILE|{_NONE}", partial(_hand, option), lambda hand: str(hand.name))
    return of_hand if Hand in kinds else one_word("FILE", kind, optional=False)


def _of_tuple(kind: Any, option: str) -> Parser:
    """Return the parser of a type of tuples."""
    items = get_args(kind)
    parsers = [_parser(item, option) for item in items if item is not ...]
    return _several(parsers[0]) if ... in items else _words(parsers)


def _plain(option: str, kind: Any, *, optional: bool) -> Parser:
    """Return the parser of a number, or of one of some words, or of `none` if that is allowed."""
    words = {str(word): word for word in get_args(kind)}
    right = f"one of {', '.join(words)}" if words else f"a {'whole ' * (kind is int)}number"
    metavar = "|".join(words) or ("INT" if kind is int else "NUMBER")

    def parse(word: str) -> Any:
        try:
            return words[word] if words else kind(word)
        except (KeyError, ValueError) as error:
            none = f", or {_NONE}" * optional
            raise SettingError(f"{option} must be {right}{none}; got {word!r}") from error

    metavar += f"|{_NONE}" * optional
    return one_word(metavar, parse, "{:g}".format if kind is float else str, optional=optional)


def _words(parsers: list[Parser]) -> Parser:
    """Return the parser of some words, each with its own."""
    return Parser(
        " ".join(one.metavar for one in parsers),
        lambda words: tuple(one.parse([word]) for one, word in zip(parsers, words, strict=True)),
        lambda value: _NONE if value is None else str(value),
        len(parsers),
    )


def _several(one: Parser) -> Parser:
    """Return the parser of any number of words, all with the same one."""
    return Parser(
        f"{one.metavar} ...",
        lambda words: tuple(one.parse([word]) for word in words),
        lambda values: " ".join(map(one.text, values)) or _NONE,
        "*",
    )


def _angle(option: str, *, optional: bool) -> Parser:
    """Return the parser of an angle, or of `none` if that is allowed."""

    def degrees(angle: float) -> str:
        return f"{math.degrees(angle):.6g}"

    def parse(text: str) -> float:
        angle = parse_angle(option, text)
        if 0.0 < abs(angle) < SMALL and text[-1].isdecimal():
            raise SettingError(
                f"{option} {text} is {text} degrees: write {text}deg for that, or {text}rad"
            )
        return angle

    return one_word("DEGREES", parse, degrees, optional=optional)


def _length(option: str, *, optional: bool) -> Parser:
    """Return the parser of a length, or of `none` if that is allowed."""

    def word(length: float) -> str:
        return f"{length:g}" if length in {0.0, math.inf} else f"{1000.0 * length:g}mm"

    metavar = f"LENGTH|{_NONE}" if optional else "LENGTH"
    return one_word(metavar, partial(parse_length, option), word, optional=optional)


def one_word(
    metavar: str = "",
    parse: Callable[[str], Any] = str,
    text: Callable[[Any], str] = str,
    *,
    optional: bool = True,
) -> Parser:
    """Return the parser of one word, or of `none` if that is allowed.

    Args:
        metavar: Placeholder of the value.
        parse: The value for a word.
        text: The word for a value, to show a default.
        optional: Whether `none` is None.
    """

    def is_none(word: str) -> bool:
        return optional and word.lower() == _NONE

    return Parser(
        metavar,
        lambda words: None if is_none(words[0]) else parse(words[0]),
        lambda value: _NONE if value is None else text(value),
    )


def _hand(option: str, word: str) -> Hand:
    """Return the gripper of a preset or a file."""
    from grasp3d.hand.hand_files import read_hand

    return _named(option, read_hand, word)


def _named(option: str, parse: Callable[[str], ValueT], word: str) -> ValueT:
    """Parse a word; errors name the option."""
    try:
        return parse(word)
    except GraspError as error:
        raise SettingError(f"{option}: {error}") from error


def _object_pose(word: str) -> ObjectPose:
    """Return the pose of a text or a file; raises ContactError."""
    from grasp3d.grasps.pose_files.frames import read_object_pose

    return read_object_pose(word)


_PARSERS: dict[Any, Parser] = {
    bool: Parser("", bool, lambda _: ""),
    FrictionField: one_word("NUMBER|LOW..HIGH", optional=False),
    PoseErrorField: one_word("LENGTH,DEGREES", PoseError.of, optional=False),
    Lengths: one_word(f"X,Y,Z|{_NONE}"),
    Quantity: one_word(f"NUMBER|{_NONE}"),
    Region: one_word(f"BOX|FILE|{_NONE}"),
    TaskField: one_word("TASK", TaskText.of, optional=False),
}
"""Parsers by the kind of field of settings; the texts are parsed by the settings themselves."""


def model_help(field: str, note: str = "") -> Stated:
    """Return the help of a field of `GraspModel`, for an option of the same name.

    Args:
        field: Name of the field.
        note: Sentence added to the help.
    """

    def text() -> str:
        return f"{_help_texts(GraspModel)[field]} {note}".strip()

    return Stated(help=text)


NumberRanges = Annotated[
    tuple[str, ...], Stated(metavar="NUMBER|FROM:TO:STEP ..."), Group("sensor")
]
"""Words for `parse_numbers`."""

DegreeRanges = Annotated[
    tuple[str, ...], Stated(metavar="DEGREES|FROM:TO:STEP ..."), Group("sensor")
]
"""Words for `parse_angles`."""

LengthOption = float | Metres | None
"""A length: a number, a text with a unit, or none."""


def _frame(word: str) -> GripperFrame:
    """Return the frame of a name or a file."""
    from grasp3d.grasps.pose_files.frames import read_frame

    return _named("--frame", read_frame, word)


FrameOption = Annotated[GripperFrame | None, one_word(f"NAME|FILE|{_NONE}", _frame), Group("hand")]
"""The frame of a gripper's poses, or none."""

AnyFrameOption = Annotated[
    GripperFrame | str | None,
    one_word(f"NAME|FILE|{AUTO}|{_NONE}", lambda word: word if word == AUTO else _frame(word)),
    Group("hand"),
]
"""The same, or the one that explains the poses."""

ObjectPoseOption = Annotated[
    ObjectPose | None, one_word(f"POSE|FILE|{_NONE}", _object_pose), Group("hand")
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
    load: Load = field(default_factory=Load)
    mesh: MeshOptions = field(default_factory=MeshOptions)
