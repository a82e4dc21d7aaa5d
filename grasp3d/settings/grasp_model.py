"""The grasp model: friction, sensor resolution, fingers, and uncertainty of the contacts.

Friction is a coefficient, or the interval in which it lies. Functions also put a model into words.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, TypeAlias

from grasp3d.errors import SettingError
from grasp3d.settings.checks import check_choice, check_length, check_range
from grasp3d.settings.parsing import ParsedField
from grasp3d.settings.units import DEGREE, Length, LengthSettings, Radians, small_length

LARGEST_TYPED = 10.0
"""Largest coefficient in a text; a larger one, such as 50, is probably a percentage."""

_BETWEEN = ".."
"""Separator of the ends of an interval in a text."""


def friction_interval(value: object) -> tuple[float, float]:
    """Return the smallest and the largest coefficient of friction.

    Args:
        value: A number, two of them, or a text: '0.5' or '0.4..0.6'.

    Raises:
        SettingError: The numbers are not finite, above 0 and in increasing order.

    Example:
        >>> from grasp3d.settings.grasp_model import friction_interval
        >>> friction_interval("0.4..0.6"), friction_interval(0.5)
        ((0.4, 0.6), (0.5, 0.5))
    """
    if type(value) is float and 0.0 < value < math.inf:  # as in most models, which are made often
        return value, value
    parts = value.split(_BETWEEN) if isinstance(value, str) else value
    try:
        ends = [float(one) for one in parts] if isinstance(parts, Sequence) else [float(parts)]  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        ends = []
    if len(ends) == 1:
        ends *= 2
    if isinstance(value, str) and len(ends) == 2 and math.inf > ends[1] > LARGEST_TYPED:
        raise SettingError(
            f"friction must be a coefficient, and even that of rubber is some 2; got {value}: is "
            f"{ends[1] / 100.0:g} meant?"
        )
    if len(ends) != 2 or not all(0.0 < end < math.inf for end in ends) or ends[0] > ends[1]:
        quoted = f"{value:g}" if isinstance(value, float) else repr(value)
        raise SettingError(
            "friction must be a finite number above 0, or an interval of two, the smallest first "
            f"(0.4{_BETWEEN}0.6, in Python (0.4, 0.6)); got {quoted}"
        )
    return ends[0], ends[1]


class Friction(ParsedField[float | tuple[float, float], float | tuple[float, float] | str]):
    """A field of settings that holds a coefficient of friction, or an interval.

    It takes one number, two numbers, the smaller first, or a text: '0.5' or '0.4..0.6'.
    """

    def parse(self, _name: str, value: Any) -> Any:
        """See `ParsedField.parse`."""
        smallest, largest = friction_interval(value)
        return smallest if smallest == largest else (smallest, largest)

    def plain(self, value: Any) -> Any:
        """See `ParsedField.plain`."""
        return _BETWEEN.join(map(repr, value)) if isinstance(value, tuple) else value


Method = Literal["exact", "extremes"]
Tilts = Literal["exact", "sampled_tilts", "bound"]
MAX_FINGERS = 32
MAX_SEARCHED_FINGERS = 5
"""Largest number of fingers in a search; given grasps have at most `MAX_FINGERS`."""


@dataclass(frozen=True)
class GraspModel(LengthSettings):
    """Friction, sensor resolution and fingers, from which a grasp's label follows.

    A length is in metres, or has a unit: '5mm', '0.5cm', '0.2in'; see `Length`.

    Attributes:
        friction: Coulomb friction of fingertip and object: its coefficient, above 0, or the
            interval in which it lies, 0.4..0.6; its smallest value decides S, its largest U.
        sensor_resolution: Resolution alpha of the fingertips' sensors: the angle between the two
            extreme normals that the fingertip cannot distinguish, from 0 to below 180 degrees.
            Further errors of the normals, such as those of joint encoders, count twice:
            alpha + 2 x error.
        fingers: Number of fingers of a grasp, 2 to 5.
        method: How grasps are labelled. exact: by the critical friction angle, which covers every
            normal within the resolution; extremes: by the wrench hulls at every combination of
            extreme normals, as in the paper, which is sampled and slower.
        torsion_radius: Soft fingers: largest torsional moment about the normal per normal force, a
            length; 2/3 x friction x r for an evenly pressed disc of radius r. 0: hard fingers. It
            affects epsilon, and under a load grip force, payload and the label with force, but no
            other labels.
        location_error: Largest distance between the true and the perceived contact point, a length.
            The true point may be anywhere on the connected surface within it, and has the normal
            there. Labels are safe: every S and U is correct.

    Example:
        >>> import math
        >>> import grasp3d
        >>> model = grasp3d.GraspModel(friction=0.5, sensor_resolution=math.radians(20.0))
        >>> print(f"S below {math.degrees(model.sure_angle):.1f} degrees")
        S below 16.6 degrees
    """

    friction: Friction = Friction(0.5)
    sensor_resolution: Radians = 22.6 * DEGREE
    fingers: int = 2
    method: Method = "exact"
    torsion_radius: Length[float] = Length(0.0)
    location_error: Length[float] = Length(0.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        resolution = self.sensor_resolution
        check_range("sensor resolution", resolution, 0.0, math.pi, ends="[)", degrees=True)
        check_length("location error", self.location_error)
        check_range("fingers", self.fingers, 1, MAX_FINGERS)
        check_choice("method", self.method, Method)
        if self.method == "extremes" and self.location_error != 0.0:
            raise SettingError(
                "method extremes tests normals only; location_error needs the method exact"
            )
        check_length("torsion radius", self.torsion_radius)

    @property
    def friction_interval(self) -> tuple[float, float]:
        """Smallest and largest coefficient of friction."""
        return friction_interval(self.friction)

    @property
    def nominal_friction(self) -> float:
        """Coefficient of friction; the middle of its interval if there is one."""
        smallest, largest = self.friction_interval
        # Rounded to 15 digits, so that the middle of 0.4..0.6 is 0.5.
        return smallest if smallest == largest else float(f"{0.5 * (smallest + largest):.15g}")

    @property
    def friction_angle(self) -> float:
        """Half-angle beta of the friction cone at the nominal friction [rad]."""
        return math.atan(self.nominal_friction)

    @property
    def tilt(self) -> float:
        """Largest angle between true and perceived normals [rad]: alpha / 2."""
        return self.sensor_resolution / 2.0

    @property
    def sure_angle(self) -> float:
        """Angle beta - alpha/2 [rad]: a grasp is S where its critical friction angle is smaller.

        Wan & Howe 2018, Sec. III-A: the friction that remains whatever the tilt, here for the
        smallest friction. It is negative where the tilt exceeds the friction angle.
        """
        return math.atan(self.friction_interval[0]) - self.tilt

    @property
    def possible_angle(self) -> float:
        """Angle beta + alpha/2 [rad]: the friction angle that is equivalent to the best tilt.

        It is that of the largest friction.
        """
        return math.atan(self.friction_interval[1]) + self.tilt

    @property
    def unstable_from(self) -> float:
        """Critical friction angle from which a grasp is U [rad]: beta + alpha/2.

        inf for three or more fingers where this reaches 90 degrees: such wide cones are not convex,
        and some tilts may be force-closed whatever the critical angle is.
        """
        widest = self.possible_angle
        return math.inf if self.fingers > 2 and widest >= math.pi / 2.0 else widest

    @property
    def tilts(self) -> Tilts:
        """Method by which the minimum of epsilon over all tilts is found; see `epsilon_range`.

        Method extremes samples the minimum, and the maximum, at the combinations that it tests. For
        soft fingers the minimum is a lower bound, in a model of the points at which they press.
        """
        if self.method == "extremes":
            return "sampled_tilts"
        return "bound" if self.soft else "exact"

    @property
    def epsilon_rank(self) -> int:
        """Dimension of the wrench space in which epsilon is computed.

        Two hard fingers resist no torque about the line through them.
        """
        return 6 if self.soft or self.fingers > 2 else 5

    @property
    def soft(self) -> bool:
        """Whether the fingers are soft, that is, have a torsion radius."""
        return self.torsion_radius != 0.0


GivenModel: TypeAlias = GraspModel | Mapping[str, Any] | None
"""A model as functions take it; a dict of its fields is accepted, too."""


def with_fingers(model: GraspModel, count: int) -> GraspModel:
    """Return a model for given grasps, whose number of fingers is known.

    Raises:
        SettingError: The model has another number of fingers, and not the default.
    """
    if model.fingers not in {GraspModel().fingers, count}:
        raise SettingError(
            f"the grasps have {count} fingers, but the model (--fingers) has {model.fingers}; "
            "fingers need not be set for given grasps"
        )
    return replace(model, fingers=count)


SAFE_LABELS = "every S and U is correct, an M may be one of them"
"""Meaning of labels with a location error."""

EPSILON_MIN = "ε_min"
"""Name of the minimum of epsilon."""

MINIMUM: dict[Tilts, str] = {
    "exact": "smallest over all tilts",
    "sampled_tilts": "smallest over sampled tilts",
    "bound": "lower bound over all tilts",
}
"""Meaning of the minimum of epsilon, by kind of computation, in texts that have named epsilon."""


def epsilon_min_text(model: GraspModel) -> str:
    """Return name and meaning of the minimum of epsilon, for a legend.

    Args:
        model: Model of the labels.

    Example:
        >>> import grasp3d
        >>> from grasp3d.settings.grasp_model import epsilon_min_text
        >>> print(epsilon_min_text(grasp3d.GraspModel()))
        ε_min: smallest over all tilts
    """
    return f"{EPSILON_MIN}: {MINIMUM[model.tilts]}"


def friction_text(model: GraspModel) -> str:
    """Return the friction as text: '0.5', or '0.4 to 0.6' for an interval.

    Args:
        model: The model.

    Example:
        >>> import grasp3d
        >>> from grasp3d.settings.grasp_model import friction_text
        >>> print(friction_text(grasp3d.GraspModel(friction=(0.4, 0.6))))
        0.4 to 0.6
    """
    return " to ".join(dict.fromkeys(f"{end:.4g}" for end in model.friction_interval))


def location_texts(model: GraspModel, *, metres: bool = True) -> list[str]:
    """Return a text on the location error; the list is empty if there is no such error.

    Args:
        model: The model.
        metres: Whether its lengths are in metres; otherwise their unit is not known.

    Example:
        >>> import grasp3d
        >>> from grasp3d.settings.grasp_model import location_texts
        >>> print(*location_texts(grasp3d.GraspModel(location_error="2mm")))
        locations ± 2 mm
    """
    error = model.location_error
    return [f"locations ± {small_length(error, metres=metres)}"] * (error != 0.0)


def model_line(model: GraspModel, *, metres: bool = True) -> str:
    """Return friction, resolution and location error in one line.

    Args:
        model: The model.
        metres: As in `location_texts`.

    Example:
        >>> import grasp3d
        >>> from grasp3d.settings.grasp_model import model_line
        >>> print(model_line(grasp3d.GraspModel(sensor_resolution=0.2, location_error="1mm")))
        μ 0.5, α 11.46°, locations ± 1 mm
    """
    resolution = f"α {math.degrees(model.sensor_resolution):.4g}°"
    locations = location_texts(model, metres=metres)
    return ", ".join([f"μ {friction_text(model)}", resolution, *locations])
