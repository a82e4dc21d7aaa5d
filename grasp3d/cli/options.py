"""Command-line options of the settings: the same dataclasses, with angles in degrees."""

import dataclasses
import math
from typing import TYPE_CHECKING, Annotated, Any, get_args, get_origin, get_type_hints

import docstring_parser
import tyro

from grasp3d.batch.batch_settings import ClusterSettings
from grasp3d.settings import ANGLE, GraspModel, MeshOptions, Sampling
from grasp3d.viewer.view_settings import ViewSettings

_NONE = "none"


def _radians(words: list[str]) -> float | None:
    return None if words[0].lower() == _NONE else math.radians(float(words[0]))


def _degrees(angle: float | None) -> list[str]:
    return [_NONE if angle is None else f"{math.degrees(angle):.6g}"]


_DEGREES = tyro.constructors.PrimitiveConstructorSpec(
    nargs=1,
    metavar="DEGREES",
    instance_from_str=_radians,
    is_instance=lambda value: value is None or isinstance(value, float),
    str_from_instance=_degrees,
)


def _optional(number: type[int] | type[float]) -> tyro.constructors.PrimitiveConstructorSpec[Any]:
    """Return the parser of a number or `none`."""
    return tyro.constructors.PrimitiveConstructorSpec(
        nargs=1,
        metavar=f"{number.__name__.upper()}|{_NONE}",
        instance_from_str=lambda words: None if words[0].lower() == _NONE else number(words[0]),
        is_instance=lambda value: value is None or isinstance(value, number),
        str_from_instance=lambda value: [_NONE if value is None else str(value)],
    )


def _help_texts(settings: type) -> dict[str, str]:
    """Return the texts on the fields in the docstring of a settings class, by name."""
    return {
        item.args[-1]: " ".join((item.description or "").split())
        for item in docstring_parser.parse(settings.__doc__ or "").params
    }


def _options_of(settings: type) -> Any:
    """Return the command-line options of a settings class, with angles in degrees.

    Args:
        settings: A frozen dataclass whose angles are annotated as `Radians`.
    """
    hints, helps = get_type_hints(settings, include_extras=True), _help_texts(settings)
    fields = [
        (
            field.name,
            Annotated[
                (
                    hints[field.name],
                    tyro.conf.arg(help=helps.get(field.name)),
                    *_parser(hints, field),
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
            "__reduce__": lambda self: (settings, dataclasses.astuple(self)),
        },
    )
    return Annotated[settings, tyro.conf.arg(constructor=options)]


def _parser(hints: dict[str, Any], field: "dataclasses.Field[Any]") -> tuple[Any, ...]:
    """Return the parser of a field, or nothing if tyro parses its type as needed."""
    hint = hints[field.name]
    if _is_angle(hint):
        return (_DEGREES,)
    return tuple(_optional(number) for number in (int, float) if hint == number | None)


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


Friction = Annotated[float, _model_option("friction")]
"""A coefficient of friction."""

Frictions = Annotated[tuple[float, ...], _model_option("friction", "One value or more.")]
"""Coefficients of friction."""

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

Fingers = Annotated[int, _model_option("fingers")]
"""A number of fingers."""

Quiet = Annotated[
    bool,
    tyro.conf.arg(aliases=["-q"], help="Print nothing but errors."),
    tyro.conf.FlagCreatePairsOff,
]
"""Whether a command prints errors only."""

if TYPE_CHECKING:
    ModelOptions = GraspModel
    SamplingOptions = Sampling
    SurfaceOptions = MeshOptions
    ClusterOptions = ClusterSettings
    ViewOptions = ViewSettings
else:
    ModelOptions = _options_of(GraspModel)
    SamplingOptions = _options_of(Sampling)
    SurfaceOptions = _options_of(MeshOptions)
    ClusterOptions = _options_of(ClusterSettings)
    ViewOptions = _options_of(ViewSettings)
