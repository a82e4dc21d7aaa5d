"""Command-line options of the settings: the same dataclasses, with angles in degrees."""

import ast
import dataclasses
import inspect
import math
import textwrap
from collections.abc import Callable
from pathlib import Path
from types import GenericAlias, NoneType
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    TypeVar,
    get_args,
    get_origin,
    get_type_hints,
)

import docstring_parser
import tyro

from grasp3d.batch.batch_settings import ClusterSettings
from grasp3d.errors import GraspError, SettingError
from grasp3d.hand.parallel_gripper import ParallelGripper
from grasp3d.hand.reach_settings import ReachSettings
from grasp3d.loads import Load
from grasp3d.physics.simulation_settings import SimulationSettings
from grasp3d.quality.task_texts import TaskField, TaskText
from grasp3d.settings import ANGLE, GraspModel, MeshOptions, Sampling
from grasp3d.settings.lengths import AnyLength, Length, Measure, Position, parse_length
from grasp3d.settings.parsing import Field
from grasp3d.settings.quantities import Quantity
from grasp3d.settings.uncertainty import Friction as FrictionField
from grasp3d.settings.uncertainty import PerFinger, Uncertainty, parse_fingers
from grasp3d.viewer.view_settings import ViewSettings

_NONE = "none"
_METAVARS = {
    "max_memory": "GB", "worker_memory": f"GB|{_NONE}", "timeout": f"SECONDS|{_NONE}",
    "width": "PIXELS", "height": "PIXELS", "scheduler": "ADDRESS|FILE",
    "mass": f"MASS|{_NONE}", "density": f"DENSITY|{_NONE}", "grip_force": f"FORCE|{_NONE}",
    "object_mass": "MASS",
}  # fmt: skip
"""Placeholders of the values of some settings; others have one by their type."""

CommandT = TypeVar("CommandT")


def option_name(field: str) -> str:
    """Return the option of a field: `location_error` is given with `--location-error`."""
    return f"--{field.replace('_', '-')}"


def _degrees(angle: float | None) -> list[str]:
    return [_NONE if angle is None else f"{math.degrees(angle):.6g}"]


def _angle(
    option: str, *, optional: bool = True
) -> tyro.constructors.PrimitiveConstructorSpec[Any]:
    """Return the parser of an angle in degrees, or of `none` if that is allowed.

    Its errors, like those of lengths and of fingers, are of the settings: one sentence, where tyro
    would print a box.
    """

    def parse(words: list[str]) -> float | None:
        if optional and words[0].lower() == _NONE:
            return None
        try:
            return math.radians(float(words[0]))
        except ValueError as error:
            raise SettingError(f"{option} must be a number of degrees; got {words[0]!r}") from error

    return tyro.constructors.PrimitiveConstructorSpec(
        nargs=1,
        metavar="DEGREES",
        instance_from_str=parse,
        is_instance=lambda value: value is None or isinstance(value, float),
        str_from_instance=_degrees,
    )


def _length(
    option: str, *, optional: bool = True
) -> tyro.constructors.PrimitiveConstructorSpec[Any]:
    """Return the parser of a length, or of `none` if that is allowed."""
    none = f"|{_NONE}" if optional else ""

    def parse(words: list[str]) -> AnyLength | None:
        if optional and words[0].lower() == _NONE:
            return None
        return parse_length(option, words[0])  # type: ignore[no-any-return]

    return tyro.constructors.PrimitiveConstructorSpec(
        nargs=1,
        metavar=f"LENGTH{none}",
        instance_from_str=parse,
        is_instance=lambda value: value is None or isinstance(value, float | Measure),
        str_from_instance=lambda value: [_length_word(value)],
    )


def _length_word(value: AnyLength | None) -> str:
    """Return the word with which a length is given."""
    if isinstance(value, Measure):
        return str(value).replace(" ", "")
    return _NONE if value is None else f"{value:g}"


def _text(
    metavar: str, check: Callable[[str], Any] = str, *, optional: bool = True
) -> tyro.constructors.PrimitiveConstructorSpec[Any]:
    """Return the parser of a text that the settings parse themselves, or of `none`."""
    return tyro.constructors.PrimitiveConstructorSpec(
        nargs=1,
        metavar=metavar,
        instance_from_str=lambda words: (
            None if optional and words[0].lower() == _NONE else check(words[0])
        ),
        is_instance=lambda _value: True,
        str_from_instance=lambda value: [_NONE if value is None else str(value)],
    )


_DEGREES, _ANY_LENGTH = _angle("an angle"), _length("a length")
_NAMED = {id(_DEGREES): _angle, id(_ANY_LENGTH): _length}
"""Parsers whose errors get the name of the option in `command`."""

_TEXT_FIELDS = Field
"""Kinds of fields that take texts."""

_POSITION = _text(f"X,Y,Z|{_NONE}")
"""Parser of a point."""

_QUANTITY = _text(f"NUMBER|{_NONE}")
"""Parser of a mass, density or force."""


def _task(text: str) -> TaskText:
    """Check a task and its files; it keeps their names, which outputs must not have."""
    task = TaskText.of(text)
    task.with_files_read()
    return task


_TASK = _text("TASK", _task, optional=False)
"""Parser of a task."""


_FRICTION = _text("NUMBER|LOW..HIGH", optional=False)
"""Parser of a coefficient of friction, or of the interval in which it lies: the settings check it.
"""


def _fingers(text: str) -> tuple[Uncertainty, ...]:
    """Return the uncertainty of each finger.

    Raises:
        SettingError: It is none.
    """
    given = "" if text.lower() == _NONE else text
    try:
        return parse_fingers(given)
    except SettingError as error:
        raise SettingError(f"--per-finger: {error}") from error


_PER_FINGER = tyro.constructors.PrimitiveConstructorSpec[Any](
    nargs=1,
    metavar=f"NAME=VALUE,...;...|{_NONE}",
    instance_from_str=lambda words: _fingers(words[0]),
    is_instance=lambda _value: True,
    str_from_instance=lambda value: [str(value) or _NONE],
)
"""Parser of the uncertainty of each finger."""


def optional_number(
    number: type[int] | type[float],
) -> tyro.constructors.PrimitiveConstructorSpec[Any]:
    """Return the parser of a number or `none`."""
    return tyro.constructors.PrimitiveConstructorSpec(
        nargs=1,
        metavar=f"{number.__name__.upper()}|{_NONE}",
        instance_from_str=lambda words: None if words[0].lower() == _NONE else number(words[0]),
        is_instance=lambda value: value is None or isinstance(value, number),
        str_from_instance=lambda value: [_NONE if value is None else str(value)],
    )


def _gripper_of(words: list[str]) -> ParallelGripper | None:
    """Return the gripper of a preset or a file; raises ValueError."""
    from grasp3d.hand.gripper_files import load_gripper

    try:
        return None if words[0].lower() == _NONE else load_gripper(words[0])
    except GraspError as error:
        raise ValueError(str(error)) from error


_GRIPPER: tyro.constructors.PrimitiveConstructorSpec[Any] = (
    tyro.constructors.PrimitiveConstructorSpec(
        nargs=1,
        metavar=f"NAME|FILE|{_NONE}",
        instance_from_str=_gripper_of,
        is_instance=lambda value: value is None or isinstance(value, ParallelGripper),
        str_from_instance=lambda value: [_NONE if value is None else value.name],
    )
)
"""Parser of a gripper: the name of a preset, or a file."""


_ALIASES = {"hand": ["--gripper"]}
"""Other names of options, by the name of the field."""


def _help_texts(settings: type) -> dict[str, str]:
    """Return the texts on the fields in the docstring of a settings class, by name."""
    return {
        item.args[-1]: " ".join((item.description or "").split())
        for item in docstring_parser.parse(settings.__doc__ or "").params
    }


def _options_of(settings: type, *, hidden: tuple[str, ...] = ()) -> Any:
    """Return the command-line options of a settings class, with angles in degrees.

    Args:
        settings: A frozen dataclass whose angles are annotated as `Radians`.
        hidden: Fields that a command does not take: they have no options, only their defaults.
    """
    hints, helps = get_type_hints(settings, include_extras=True), _help_texts(settings)
    fields = [
        (
            field.name,
            Annotated[
                (
                    _value_type(hints[field.name]),
                    tyro.conf.arg(
                        help=helps.get(field.name),
                        metavar=_METAVARS.get(field.name),
                        help_behavior_hint=_default_text(field.default),
                        aliases=_ALIASES.get(field.name),
                    ),
                    *_parser(hints[field.name], option_name(field.name)),
                    *([tyro.conf.Suppress] if field.name in hidden else []),
                )
            ],
            dataclasses.field(default=field.default),
        )
        for field in dataclasses.fields(settings)
    ]
    options = dataclasses.make_dataclass(
        settings.__name__,
        fields,
        bases=(settings,),
        frozen=True,
        namespace={
            "__doc__": settings.__doc__,
            # Other processes cannot import the generated class: they unpickle the settings class.
            "__reduce__": lambda self: (
                settings,
                tuple(getattr(self, field.name) for field in dataclasses.fields(self)),
            ),
        },
    )
    for name, _, _ in fields:  # the defaults would hide what parses texts
        if isinstance(inspect.getattr_static(settings, name), _TEXT_FIELDS):
            delattr(options, name)
    return Annotated[settings, tyro.conf.arg(constructor=options)]


def _value_type(hint: Any) -> Any:
    """Return the type of a field's values: of those that parse texts any."""
    kind = get_origin(hint) or hint
    return Any if isinstance(kind, type) and issubclass(kind, Field) else hint


def _default_text(default: object) -> str | None:
    """Return the text on a default that tyro would write as `None`; None: tyro's own text."""
    return f"(default: {_NONE})" if default is None else None


def _parser(hint: Any, option: str) -> tuple[Any, ...]:
    """Return the parser of a type of field, or nothing if tyro parses it as needed."""
    if _is_angle(hint):
        return (_angle(option, optional=NoneType in get_args(hint)),)
    if hint == ParallelGripper | None:
        return (_GRIPPER,)
    if get_origin(hint) is Length:
        return (_length(option, optional=NoneType in get_args(get_args(hint)[0])),)
    for kind, parser in _PARSERS.items():
        if kind in {hint, get_origin(hint)}:
            return (parser,)
    return tuple(optional_number(number) for number in (int, float) if hint == number | None)


_PARSERS = {
    FrictionField: _FRICTION,
    PerFinger: _PER_FINGER,
    Position: _POSITION,
    Quantity: _QUANTITY,
    TaskField: _TASK,
}
"""Parsers by the kind of field."""


def _is_angle(hint: Any) -> bool:
    """Return whether a type, or a member of its union, is an angle."""
    if get_origin(hint) is Annotated:
        return ANGLE in get_args(hint)[1:]
    return any(_is_angle(part) for part in get_args(hint))


def _model_option(
    field: str, note: str = "", *, metavar: str | None = None, default: str | None = None
) -> object:
    """Return an option with the help of a field of `GraspModel`.

    Args:
        field: Name of the field.
        note: Sentence added to the help.
        metavar: Placeholder of the value; None: from its type.
        default: Description of the default; None: its value.
    """
    text = f"{_help_texts(GraspModel).get(field, '')} {note}".strip()
    return tyro.conf.arg(help=text, metavar=metavar, help_behavior_hint=default)


Friction = Annotated[
    float,
    tyro.conf.arg(help="Coulomb coefficient of friction between fingertip and object, above 0."),
]
"""A coefficient of friction."""

FrictionRanges = Annotated[
    tuple[str, ...],
    tyro.conf.arg(
        help="Coulomb coefficients of friction between fingertip and object, above 0. For an "
        "interval give its middle here and half its width with --friction-error.",
        metavar="NUMBER|FROM:TO:STEP [...]",
    ),
]
"""Coefficients of friction as words for `parse_frictions`."""

SensorResolution = Annotated[float | None, _model_option("sensor_resolution", default=""), _DEGREES]
"""A sensor resolution [rad], given in degrees; None: not given."""

SensorResolutions = Annotated[
    tuple[Annotated[float, _DEGREES], ...],
    _model_option("sensor_resolution", "One or two values, in degrees."),
]
"""One or two sensor resolutions [rad], given in degrees."""

SensorResolutionRanges = Annotated[
    tuple[str, ...],
    _model_option(
        "sensor_resolution",
        "One value or more, in degrees, and ranges that include both ends.",
        metavar="DEGREES|FROM:TO:STEP [...]",
    ),
]
"""Sensor resolutions in degrees as words for `parse_resolutions`."""

NormalErrorRanges = Annotated[
    tuple[str, ...],
    _model_option("normal_error", "In degrees.", metavar="DEGREES|FROM:TO:STEP [...]"),
]
"""Normal errors in degrees as words for `parse_angles`."""

LocationErrorRanges = Annotated[
    tuple[str, ...], _model_option("location_error", metavar="LENGTH|FROM:TO:STEP [...]")
]
"""Location errors as words for `parse_lengths`."""

FrictionErrorRanges = Annotated[
    tuple[str, ...],
    tyro.conf.arg(
        help="Largest difference between the true friction and the coefficient, to either side; "
        "smaller than the coefficient. --friction 0.5 --friction-error 0.1: from 0.4 to 0.6.",
        metavar="NUMBER|FROM:TO:STEP [...]",
    ),
]
"""Errors of friction as words for `parse_numbers`."""

Fingers = Annotated[int, _model_option("fingers")]
"""A number of fingers."""

LengthOption = Annotated[AnyLength | None, _ANY_LENGTH, tyro.conf.arg(help_behavior_hint="")]
"""A length: a number, a text with a unit, or none."""

HandOption = Annotated[
    ParallelGripper | None,
    _GRIPPER,
    tyro.conf.arg(help_behavior_hint="", aliases=_ALIASES["hand"]),
]
"""A gripper: the name of a preset, or a file; None: not given."""

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


def command(kind: type[CommandT]) -> type[CommandT]:
    """Give a command's options their docstrings as help, without the line breaks of the source.

    Args:
        kind: A dataclass whose fields are options, with docstrings.
    """
    (tree,) = ast.parse(textwrap.dedent(inspect.getsource(kind))).body
    assert isinstance(tree, ast.ClassDef)
    for field, text in zip(tree.body, tree.body[1:], strict=False):
        if not (isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name)):
            continue
        if isinstance(text, ast.Expr) and isinstance(text.value, ast.Constant):
            helped = tyro.conf.arg(help=" ".join(str(text.value.value).split()))
            hints, name = kind.__annotations__, field.target.id
            hints[name] = Annotated[_with_option(hints[name], option_name(name)), helped]
    return kind


def _with_option(hint: Any, option: str) -> Any:
    """Return a type whose parsers of angles and lengths name the option in their errors."""
    if get_origin(hint) is tuple:
        return GenericAlias(tuple, tuple(_with_option(one, option) for one in get_args(hint)))
    if get_origin(hint) is not Annotated:
        return hint
    parsers = (_NAMED.get(id(one)) for one in hint.__metadata__)
    named = [
        one if parser is None else parser(option)
        for one, parser in zip(hint.__metadata__, parsers, strict=True)
    ]
    return Annotated[_with_option(hint.__origin__, option), *named]


NOT_OF_NOISE = ("location_error", "per_finger", "method", "extreme_normals")
"""Fields of `GraspModel` that labels of noisy copies do not take."""

NOT_OF_PHYSICS = ("fingers", "method", "extreme_normals", "edges", "actuation")
"""Fields of `GraspModel` that simulated grasps do not take."""

NOT_OF_OUTCOMES = ("fingers", "per_finger", "method", "extreme_normals")
"""Fields of `GraspModel` that labels held against outcomes do not take."""

if TYPE_CHECKING:
    ModelOptions = GraspModel
    ValidatedModelOptions = GraspModel
    NoisyModelOptions = GraspModel
    SamplingOptions = Sampling
    SurfaceOptions = MeshOptions
    ReachOptions = ReachSettings
    LoadOptions = Load
    SimulatedModelOptions = GraspModel
    SimulationOptions = SimulationSettings
    ClusterOptions = ClusterSettings
    ViewOptions = ViewSettings
else:
    ModelOptions = _options_of(GraspModel)
    NoisyModelOptions = _options_of(GraspModel, hidden=NOT_OF_NOISE)
    ValidatedModelOptions = _options_of(GraspModel, hidden=NOT_OF_OUTCOMES)
    SamplingOptions = _options_of(Sampling)
    SurfaceOptions = _options_of(MeshOptions)
    ReachOptions = _options_of(ReachSettings)
    LoadOptions = _options_of(Load)
    SimulatedModelOptions = _options_of(GraspModel, hidden=NOT_OF_PHYSICS)
    SimulationOptions = _options_of(SimulationSettings)
    ClusterOptions = _options_of(ClusterSettings)
    ViewOptions = _options_of(ViewSettings)
