"""The settings as command-line options: the same dataclasses, with angles in degrees."""

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
    """Read a number, or none."""
    return tyro.constructors.PrimitiveConstructorSpec(
        nargs=1,
        metavar=f"{number.__name__.upper()}|{_NONE}",
        instance_from_str=lambda words: None if words[0].lower() == _NONE else number(words[0]),
        is_instance=lambda value: value is None or isinstance(value, number),
        str_from_instance=lambda value: [_NONE if value is None else str(value)],
    )


def _on_command_line(settings: type) -> Any:  # noqa: ANN401
    """Make a settings class read and show its angles in degrees, its docstrings being the help.

    Args:
        settings: A frozen dataclass whose angles are annotated as `Radians`.
    """
    hints = get_type_hints(settings, include_extras=True)
    helps = {
        item.args[-1]: " ".join((item.description or "").split())
        for item in docstring_parser.parse_from_object(settings).params
    }
    fields = [
        (
            field.name,
            Annotated[
                (hints[field.name], tyro.conf.arg(help=helps[field.name]), *_reading(hints, field))
            ],
            dataclasses.field(default=field.default),
        )
        for field in dataclasses.fields(settings)
    ]
    made = dataclasses.make_dataclass(
        settings.__name__,
        fields,
        bases=(settings,),
        frozen=True,
        namespace={
            "__doc__": settings.__doc__,
            # Other processes know the settings class only.
            "__reduce__": lambda self: (settings, dataclasses.astuple(self)),
        },
    )
    return Annotated[settings, tyro.conf.arg(constructor=made)]


def _reading(hints: dict[str, Any], field: "dataclasses.Field[Any]") -> tuple[Any, ...]:
    """How a field is read from the command line where its type alone does not say it."""
    hint = hints[field.name]
    if _is_angle(hint):
        return (_DEGREES,)
    return tuple(_optional(number) for number in (int, float) if hint == number | None)


def _is_angle(hint: Any) -> bool:  # noqa: ANN401
    """Tell whether a field, or the part of its union that is not None, is an angle."""
    if get_origin(hint) is Annotated:
        return ANGLE in get_args(hint)[1:]
    return any(_is_angle(part) for part in get_args(hint))


if TYPE_CHECKING:
    ModelOptions = GraspModel
    SamplingOptions = Sampling
    SurfaceOptions = MeshOptions
    ClusterOptions = ClusterSettings
    ViewOptions = ViewSettings
else:
    ModelOptions = _on_command_line(GraspModel)
    SamplingOptions = _on_command_line(Sampling)
    SurfaceOptions = _on_command_line(MeshOptions)
    ClusterOptions = _on_command_line(ClusterSettings)
    ViewOptions = _on_command_line(ViewSettings)
