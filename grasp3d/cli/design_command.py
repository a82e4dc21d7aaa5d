"""The command `design`: its options on fingertip and sensor, joints, errors and the object."""

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from grasp3d.cli.options import Forced, LengthOption, Overwriting, Stated, Strict, one_word
from grasp3d.contact.sensor import JointEncoders
from grasp3d.errors import SettingError
from grasp3d.settings import Radians
from grasp3d.settings.lengths import Unit, length_in_unit
from grasp3d.settings.parsing import Group, Main
from grasp3d.settings.uncertainty import Interval, friction_interval

_BETWEEN = ".."


def friction_text(friction: Interval) -> str:
    """A friction as it is given on the command line.

    Args:
        friction: Smallest and largest value.
    """
    return _BETWEEN.join(f"{end:.4g}" for end in dict.fromkeys(friction))


_INTERVAL = one_word(f"NUMBER|LOW{_BETWEEN}HIGH", friction_interval, friction_text, optional=False)

FrictionList = Annotated[
    tuple[Annotated[Interval, _INTERVAL], ...],
    Stated(
        help="Coulomb coefficient of friction between fingertip and object, above 0, or the "
        "interval in which it lies, 0.4..0.6. One value or more."
    ),
    Group("sensor"),
    Main("frictions, or intervals: 0.4..0.6"),
]
"""Frictions, each as its smallest and largest value."""


@dataclass(frozen=True)
class JointOptions:
    """The joints of each finger, and their encoders."""

    encoder_counts: Annotated[tuple[float, ...], Main("counts per revolution")] = ()
    """Counts per revolution of the encoders, after quadrature decoding: one number for all joints,
    or one for each. Without them the required counts are printed."""

    joint_lengths: Annotated[tuple[LengthOption, ...], Main("from each joint to the contact")] = ()
    """Distance of each joint's axis from the contact; with --parallel-jaws the travel of a jaw per
    revolution of its encoder."""

    parallel_jaws: bool = False
    """The joints move the jaws of a parallel gripper along the line through both contacts."""

    def __post_init__(self) -> None:
        if self.encoder_counts and not self.joint_lengths:
            raise SettingError(
                "--encoder-counts need the lengths of the joints: give --joint-lengths"
            )
        if self.parallel_jaws and not self.joint_lengths:
            raise SettingError("--parallel-jaws needs --joint-lengths: the travel per revolution")

    def encoders(self, unit: Unit) -> JointEncoders | None:
        """The encoders; None: no joints are given. Without counts they are exact.

        Args:
            unit: Unit of the lengths.

        Raises:
            SettingError: A value is outside its range.
        """
        lengths = tuple(
            length_in_unit("joint_lengths", length, unit) for length in self.joint_lengths
        )
        if not lengths:
            return None
        counts = self.encoder_counts or (float("inf"),)
        return JointEncoders(
            counts[0] if len(counts) == 1 else counts,
            lengths,
            "prismatic" if self.parallel_jaws else "revolute",
        )


@dataclass(frozen=True)
class GraspOptions:
    """What else is uncertain, and the grasps that the design is for."""

    normal_error: Annotated[Radians | None, Group("sensor")] = None
    """Largest angle in degrees between true and perceived normals, beside those that sensor and
    encoders cause."""

    location_error: Annotated[LengthOption, Group("sensor")] = None
    """Largest distance between the true and the perceived contact, beside those of sensor and
    encoders."""

    critical_angle: Radians | None = None
    """Critical friction angle of the grasp in degrees (default: 0, that of the best grasps: the
    contact normals lie on the line through both contacts)."""

    object: Annotated[Path | None, Main("mesh whose best grasps the design is for")] = None
    """Mesh of an object, which is searched for the best grasp at each vertex: their critical angles
    and openings are used instead of those of one grasp."""

    unit: Unit | None = None
    """Unit of the mesh's coordinates (default: the unit that the file states)."""

    max_opening: Annotated[LengthOption, Group("hand")] = None
    """Largest distance between the contacts on the object."""

    def __post_init__(self) -> None:
        if self.object is None:
            for name in ("unit", "max_opening"):
                if getattr(self, name) is not None:
                    option = f"--{name.replace('_', '-')}"
                    raise SettingError(f"{option} is for an object; give its mesh with --object")
        elif self.critical_angle is not None:
            raise SettingError(
                "--critical-angle is that of one grasp, --object has those of its surface; give one"
            )


DEFAULT_RADIUS: dict[Unit, float] = {"m": 0.01, "cm": 1.0, "mm": 10.0, "in": 10.0 / 25.4}
"""Radius of a fingertip of 2 cm diameter, as in Wan & Howe 2018."""


@dataclass(frozen=True)
class Design(Overwriting, Strict, Forced):
    """Compute the sensor for a friction, the friction for a sensor, or the budget of a finger.

    With --friction: the coarsest sensor for surely stable grasps. With a sensor, given by
    --receptive-field or --sensor-resolution: the least friction. With both: whether the sensor is
    fine enough for each friction. With an interval of friction, joints, further errors or an
    object: how much of the friction angle each uncertainty takes, what margin is left, and the
    limit of each uncertainty given the others.

    Example:
        # The coarsest sensor for two frictions
        grasp3d design --friction 0.2 0.5
        # What each uncertainty of a finger costs, and the encoders that it needs
        grasp3d design --friction 0.4..0.6 --receptive-field 4 --joint-lengths 6cm --object-size 50
    """

    friction: FrictionList = ()

    fingertip_radius: Annotated[
        LengthOption, Group("fingertip"), Main("radius of a round fingertip (default: 10mm)")
    ] = None
    """Radius of a hemispherical fingertip (default: 10mm)."""

    flat: Annotated[bool, Group("fingertip")] = False
    """The fingertip is flat."""

    cylinder: Annotated[bool, Group("fingertip")] = False
    """The fingertip is a cylinder of that radius: its normal turns around the axis only."""

    fingertip_axes: Annotated[tuple[LengthOption, ...], Group("fingertip")] = ()
    """Semi-axes of a fingertip that is an ellipsoid."""

    receptive_field: Annotated[
        LengthOption, Group("sensor"), Main("arc within which contacts look the same")
    ] = None
    """Sensor: length of the arc on the fingertip within which it cannot distinguish contacts."""

    pitch: Annotated[LengthOption, Group("sensor")] = None
    """Distance between neighbouring sensing elements whose receptive fields overlap: together they
    distinguish more than one of them."""

    sensor_resolution: Annotated[
        Radians | None, Group("sensor"), Main("the sensor by its resolution instead")
    ] = None
    """Sensor, by its resolution in degrees instead."""

    object_size: Annotated[
        LengthOption, Group("object"), Main("distance between two opposing fingers")
    ] = None
    """Distance between two opposing fingers; with it the uncertainty of contact locations is
    included."""

    joints: JointOptions = field(default_factory=JointOptions)

    grasps: GraspOptions = field(default_factory=GraspOptions)

    figure: Annotated[Path | None, Main("figure of the budgets: .svg .png .pdf")] = None
    """Figure of the budgets as stacked bars, one for each friction (.svg, .png or .pdf); what is
    printed does not depend on it."""

    print_unit: Unit = "mm"
    """Unit of the printed lengths, and of lengths without a unit."""

    def __post_init__(self) -> None:
        self._check_tip()
        if self.receptive_field is not None and self.sensor_resolution is not None:
            raise SettingError(
                "--receptive-field and --sensor-resolution each define the sensor; give one"
            )
        if self.pitch is not None and self.receptive_field is None:
            raise SettingError("--pitch is that of receptive fields; give --receptive-field")
        if self.object_size is not None and self.grasps.object is not None:
            raise SettingError(
                "--object-size and --object each define the distance between the fingers; give one"
            )
        size = self.length("object_size")
        if size is not None and not 0.0 < size < math.inf:
            raise SettingError(f"object size must be a finite length above 0; got {size:g}")

    def _check_tip(self) -> None:
        fingertip = {
            "--fingertip-radius": self.fingertip_radius is not None,
            "--flat": self.flat,
            "--fingertip-axes": bool(self.fingertip_axes),
        }
        names = [name for name, is_given in fingertip.items() if is_given]
        if len(names) > 1:
            raise SettingError(f"{' and '.join(names)} each define the fingertip; give one")
        if self.cylinder and names[:1] not in ([], ["--fingertip-radius"]):
            raise SettingError(f"--cylinder takes a --fingertip-radius; {names[0]} is another tip")
        if self.fingertip_axes and self.sensor_resolution is not None:
            raise SettingError(
                "the resolution of an ellipsoid varies over the fingertip; give --receptive-field "
                "instead of --sensor-resolution"
            )

    @property
    def has_budget(self) -> bool:
        """Whether the options ask for more than Wan & Howe's sensor and friction."""
        return (
            any(smallest < largest for smallest, largest in self.friction)
            or self.joints != JointOptions()
            or self.grasps != GraspOptions()
            or self.cylinder
            or bool(self.fingertip_axes)
        )

    @property
    def radius(self) -> float:
        """Radius of the fingertip; inf: flat."""
        if self.flat:
            return math.inf
        radius = self.length("fingertip_radius")
        return DEFAULT_RADIUS[self.print_unit] if radius is None else radius

    def length(self, name: str) -> float | None:
        """Return a length of these options, or of those on grasps, in the printed unit."""
        options = self if hasattr(self, name) else self.grasps
        length: float | None = length_in_unit(name, getattr(options, name), self.print_unit)
        return length
