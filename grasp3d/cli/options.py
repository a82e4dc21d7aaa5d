"""Options of the commands: their fields and those of settings, as tyro is to parse them.

The options of a command are the fields of its dataclass, and those of the settings in it, with the
docstrings as help. Angles without a unit are degrees there.
"""

import math
from collections.abc import Callable
from dataclasses import MISSING, Field, fields, is_dataclass, replace
from functools import partial
from pathlib import Path
from types import GenericAlias, NoneType, UnionType
from typing import Annotated, Any, Union, get_args, get_origin, get_type_hints

import docstring_parser
import tyro
from tyro.constructors import (
    PrimitiveConstructorSpec,
    StructConstructorSpec,
    StructFieldSpec,
    StructTypeInfo,
)

from grasp3d.errors import GraspError, SettingError
from grasp3d.hand.hand import Hand
from grasp3d.hand.object_pose import ObjectPose
from grasp3d.hand.reach_settings import ReachSettings
from grasp3d.quality.loads import Load
from grasp3d.quality.task_texts import TaskField, TaskText
from grasp3d.settings import (
    AnySampling,
    GraspModel,
    MeshOptions,
    MultifingerSampling,
    Radians,
    Sampling,
)
from grasp3d.settings.checks import parse_angle
from grasp3d.settings.lengths import AnyLength, Length, Measure, Position, parse_length
from grasp3d.settings.parsing import ParsedField
from grasp3d.settings.quantities import Quantity
from grasp3d.settings.uncertainty import Friction as FrictionField
from grasp3d.settings.uncertainty import PerFinger, Uncertainty, parse_fingers

_NONE = "none"
_METAVARS = {
    "max_memory": "GB", "worker_memory": f"GB|{_NONE}", "timeout": f"SECONDS|{_NONE}",
    "width": "PIXELS", "height": "PIXELS", "scheduler": "ADDRESS|FILE",
    "mass": f"MASS|{_NONE}", "density": f"DENSITY|{_NONE}", "grip_force": f"FORCE|{_NONE}",
    "object_mass": "MASS",
}  # fmt: skip
"""Placeholders of the values of some settings; others have a placeholder by their type."""

Parser = PrimitiveConstructorSpec[Any]
"""How words of the command line become a value."""

REGISTRY = tyro.constructors.ConstructorRegistry()
"""Rules for `tyro.cli`."""


@REGISTRY.struct_rule
def options_of(info: StructTypeInfo) -> StructConstructorSpec | None:
    """Return the options of a command, or of settings.

    Args:
        info: A dataclass, or a partial of it: then the fields that it gives have no options.
    """
    hint: Any = info.type
    kind, constants = (hint.func, hint.keywords) if isinstance(hint, partial) else (hint, {})
    if not is_dataclass(kind):
        return None
    hints, helps = get_type_hints(kind, include_extras=True), _help_texts(kind)
    options = tuple(
        StructFieldSpec(
            name=field.name,
            type=_option(field, hints[field.name], helps.get(field.name)),
            default=_default(field),
        )
        for field in fields(kind)
        if field.name not in constants
    )
    return StructConstructorSpec(instantiate=hint, fields=options)


def _option(field: "Field[Any]", hint: Any, text: str | None) -> Any:
    """Return the type of an option: with its help, its placeholder, and the parser of its value."""
    parsed = _parsed(hint, option_name(field.name))
    argument = tyro.conf.arg(
        metavar=_METAVARS.get(field.name),
        # tyro would write `None`.
        help_behavior_hint=f"(default: {_NONE})" if field.default is None else None,
        aliases=["--gripper"] if _HAND in get_args(parsed) else None,
    )
    base, *own = get_args(parsed) if get_origin(parsed) is Annotated else (parsed,)
    base = next((item for item in own if isinstance(item, partial)), base)
    helped = () if text is None else (tyro.conf.arg(help=text),)
    return Annotated[(base, argument, *own, *helped)]


def _default(field: "Field[Any]") -> Any:
    """Return the default of an option; settings have those of their fields."""
    return tyro.MISSING_NONPROP if field.default is MISSING else field.default


def _help_texts(kind: Any) -> dict[str, str]:
    """Return the texts on the fields in the docstrings of a class, by name, in one line each.

    Those of settings that it extends are in the docstrings of these.
    """
    kinds = [base for base in reversed(kind.__mro__) if base.__module__.startswith("grasp3d.")]
    return {
        item.args[-1]: " ".join((item.description or "").split())
        for base in kinds
        for item in docstring_parser.parse_from_object(base).params
    }


def option_name(field: str) -> str:
    """Return the option of a field: `location_error` is given with `--location-error`."""
    return f"--{field.replace('_', '-')}"


def _parsed(hint: Any, option: str) -> Any:
    """Return a type with the parsers of the values that tyro would not parse as needed."""
    parser = _parser(hint, option)
    if parser is not None:
        return Annotated[Any if _is_parsed(hint) else hint, parser]
    if get_origin(hint) is Annotated:
        return Annotated[(_parsed(hint.__origin__, option), *hint.__metadata__)]
    if get_origin(hint) is tuple:
        return GenericAlias(tuple, tuple(_parsed(item, option) for item in get_args(hint)))
    return hint


def _is_parsed(hint: Any) -> bool:
    """Return whether a type is that of a field that parses texts itself."""
    kind = get_origin(hint) or hint
    return isinstance(kind, type) and issubclass(kind, ParsedField)


def _parser(hint: Any, option: str) -> Parser | None:
    """Return the parser of a type of field; None: tyro's own.

    Errors of angles, lengths and fingers are of the settings: one sentence, which names the option,
    where tyro would print a box.
    """
    kinds = get_args(hint) if get_origin(hint) in {Union, UnionType} else (hint,)
    optional = NoneType in kinds
    if Radians in kinds:
        return _angle(option, optional=optional)
    if Measure in kinds:
        return _length(option, optional=optional)
    if Hand in kinds:
        return _HAND
    if get_origin(hint) is Length:
        return _length(option, optional=NoneType in get_args(get_args(hint)[0]))
    if optional and len(kinds) == 2 and kinds[0] in {int, float}:
        return _one_word(f"{kinds[0].__name__.upper()}|{_NONE}", kinds[0])
    return _PARSERS.get(get_origin(hint) or hint)


def _angle(option: str, *, optional: bool) -> Parser:
    """Return the parser of an angle, or of `none` if that is allowed."""

    def degrees(angle: float) -> str:
        return f"{math.degrees(angle):.6g}"

    return _one_word("DEGREES", partial(parse_angle, option), degrees, optional=optional)


def _length(option: str, *, optional: bool) -> Parser:
    """Return the parser of a length, or of `none` if that is allowed."""

    def word(length: AnyLength) -> str:
        return (f"{length:.15g}" if isinstance(length, Measure) else f"{length:g}").replace(" ", "")

    metavar = f"LENGTH|{_NONE}" if optional else "LENGTH"
    return _one_word(metavar, partial(parse_length, option), word, optional=optional)


def _one_word(
    metavar: str,
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

    return PrimitiveConstructorSpec(
        nargs=1,
        metavar=metavar,
        instance_from_str=lambda words: None if is_none(words[0]) else parse(words[0]),
        is_instance=lambda _value: True,
        str_from_instance=lambda value: [_NONE if value is None else text(value)],
    )


def _task(text: str) -> TaskText:
    """Check a task and its files; it keeps their names, which outputs must not have."""
    task = TaskText.of(text)
    task.with_files_read()
    return task


def _fingers(text: str) -> tuple[Uncertainty, ...]:
    """Return the uncertainty of each finger.

    Raises:
        SettingError: It is none.
    """
    try:
        return parse_fingers("" if text.lower() == _NONE else text)
    except SettingError as error:
        raise SettingError(f"--per-finger: {error}") from error


def _hand(word: str) -> Hand:
    """Return the gripper of a preset or a file; raises ValueError."""
    from grasp3d.hand.hand_files import read_hand

    try:
        return read_hand(word)
    except GraspError as error:
        raise ValueError(str(error)) from error


def _object_pose(word: str) -> ObjectPose:
    """Return the pose of a text or a file; raises ContactError."""
    from grasp3d.grasps.pose_files.frames import read_object_pose

    return read_object_pose(word)


_HAND = _one_word(f"NAME|FILE|{_NONE}", _hand, lambda hand: str(hand.name))
"""Parser of a gripper: the name of a preset, or a file."""

_PARSERS: dict[Any, Parser] = {
    FrictionField: _one_word("NUMBER|LOW..HIGH", optional=False),
    PerFinger: _one_word(
        f"NAME=VALUE,...;...|{_NONE}", _fingers, lambda own: str(own) or _NONE, optional=False
    ),
    Position: _one_word(f"X,Y,Z|{_NONE}"),
    Quantity: _one_word(f"NUMBER|{_NONE}"),
    TaskField: _one_word("TASK", _task, optional=False),
}
"""Parsers by the kind of field of settings; the texts are parsed by the settings themselves."""


def model_help(field: str, note: str = "") -> object:
    """Return the help of a field of `GraspModel`, for an option of the same name.

    Args:
        field: Name of the field.
        note: Sentence added to the help.
    """
    return tyro.conf.arg(help=f"{_help_texts(GraspModel)[field]} {note}".strip())


NumberRanges = Annotated[tuple[str, ...], tyro.conf.arg(metavar="NUMBER|FROM:TO:STEP [...]")]
"""Words for `parse_numbers` and `parse_frictions`."""

DegreeRanges = Annotated[tuple[str, ...], tyro.conf.arg(metavar="DEGREES|FROM:TO:STEP [...]")]
"""Words for `parse_angles`."""

LengthRanges = Annotated[tuple[str, ...], tyro.conf.arg(metavar="LENGTH|FROM:TO:STEP [...]")]
"""Words for `parse_lengths`."""

AngleOption = Annotated[Radians | None, tyro.conf.arg(help_behavior_hint="")]
"""An angle [rad], given in degrees or with a unit, or none."""

LengthOption = Annotated[AnyLength | None, tyro.conf.arg(help_behavior_hint="")]
"""A length: a number, a text with a unit, or none."""

ObjectPoseOption = Annotated[
    ObjectPose | None,
    _one_word(f"POSE|FILE|{_NONE}", _object_pose),
    tyro.conf.arg(help_behavior_hint=""),
]
"""The pose of the object in the frame of a robot, or none."""

Flag = Annotated[bool, tyro.conf.FlagCreatePairsOff, tyro.conf.arg(help_behavior_hint="")]
"""An option without a value."""

Quiet = Annotated[Flag, tyro.conf.arg(aliases=["-q"], help="Print nothing but errors.")]
"""Whether a command prints errors only."""

Force = Annotated[
    Flag,
    tyro.conf.arg(
        help="Accept lengths that cannot be meant, such as an opening 500 times the object's size."
    ),
]
"""Whether lengths are accepted that are most likely in another unit."""

Strict = Annotated[
    Flag,
    tyro.conf.arg(help="Take warnings as errors: what they are of is refused, and not written."),
]
"""Whether warnings are errors."""

Overwrite = Annotated[
    Flag,
    tyro.conf.arg(
        help="Replace existing files, also those made with other settings or by other programs."
    ),
]
"""Whether existing files are replaced that this command would not write again just so."""

InputFile = Annotated[Path, tyro.conf.arg(metavar="FILE")]
"""A file to read."""

OutputFile = Annotated[Path | None, tyro.conf.arg(metavar="FILE", help_behavior_hint="")]
"""A file to write; None: the name that the option's help gives."""

Inputs = Annotated[
    tuple[str, ...],
    tyro.conf.Positional,
    tyro.conf.arg(
        metavar="PATH [PATH ...]",
        help_behavior_hint="",
        help="Mesh files, folders, which are searched recursively, globs in quotes such as "
        "'lib/**/*.stl', lists of these (.txt, one per line); also on an object store "
        "(s3://BUCKET/FOLDER).",
    ),
]
"""Meshes, as `batch.inputs.find_meshes` takes them."""


Multifinger = Annotated[
    MultifingerSampling,
    partial(MultifingerSampling, **MultifingerSampling().common),
    tyro.conf.arg(help="How candidate grasps of three fingers and more are searched."),
]
"""The options of a search of three fingers and more that a search of two fingers does not have."""

SearchGroup = Annotated[
    Sampling,
    tyro.conf.arg(
        help="How candidate grasps are searched. A LENGTH is a number in the mesh's unit, or has a "
        "unit: 80mm, 8cm, 0.08m, 3in."
    ),
]
"""The options of a search."""

ReachGroup = Annotated[
    ReachSettings,
    tyro.conf.arg(help="The gripper that must reach each grasp, and what the object stands on."),
]
"""The options of grippers that reach grasps."""

LoadGroup = Annotated[Load, tyro.conf.arg(help="What each grasp must hold, and the force at hand.")]
"""The options of loads."""

MeshGroup = Annotated[
    MeshOptions,
    tyro.conf.arg(
        help="How the mesh is read and prepared. A LENGTH is a number in the mesh's unit, or has a "
        "unit."
    ),
]
"""The options of reading a mesh."""


def given_sampling(sampling: Sampling, multifinger: MultifingerSampling) -> AnySampling:
    """Return the settings of a search whose options were given; `fitted` to a number of fingers.

    Args:
        sampling: The options for two fingers and for any number.
        multifinger: The options for three fingers and more.

    Raises:
        SettingError: Options for both were given.
    """
    pair, several = sampling.own_changes, multifinger.own_changes
    if pair and several:
        raise SettingError(
            f"{option_name(pair[0])} is for two fingers and {option_name(several[0])} for three "
            "and more; leave one of them out"
        )
    if not several:
        return sampling
    return replace(multifinger, **sampling.common)


def without(kind: Any, *names: str) -> "partial[Any]":
    """Return how a command makes settings of whose fields it does not take some."""
    return partial(kind, **{name: getattr(kind, name) for name in names})
