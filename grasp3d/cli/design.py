"""The command `grasp3d design`: relates friction, sensors, encoders, and their uncertainty."""

import math
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from grasp3d.cli.design_options import FrictionList, GraspOptions, JointOptions
from grasp3d.cli.options import Flag, Force, LengthOption, OutputFile, SensorResolution
from grasp3d.cli.report import Report
from grasp3d.contact.sensor import Sensor, overlapping_field, radius_of
from grasp3d.errors import SettingError
from grasp3d.settings.lengths import AnyLength, Unit, length_in_unit, measure
from grasp3d.settings.uncertainty import Uncertainty

if TYPE_CHECKING:
    from grasp3d.contact.budget import FingerDesign, GraspSamples
    from grasp3d.contact.tips import CylinderTip, EllipsoidTip

DEFAULT_FRICTIONS = tuple(step / 10.0 for step in range(1, 11))
DEFAULT_RADIUS: dict[Unit, float] = {"m": 0.01, "cm": 1.0, "mm": 10.0, "in": 10.0 / 25.4}
"""Radius of a fingertip of 2 cm diameter, as in Wan & Howe 2018."""

BUDGET_FRICTION = (0.5, 0.5)
"""Friction of a budget if none is given."""

_CURVATURE = tyro.conf.arg(metavar="FLOAT", help_behavior_hint="")


@dataclass(frozen=True)
class Design:
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

    fingertip_radius: LengthOption = None
    """Radius of a hemispherical fingertip (default: 10mm)."""

    curvature: Annotated[float | None, _CURVATURE] = None
    """Curvature of the fingertip instead of its radius: 1 / radius, in 1 / --print-unit; 0 for a
    flat fingertip."""

    flat: Flag = False
    """The fingertip is flat."""

    cylinder: Flag = False
    """The fingertip is a cylinder of that radius: its normal turns around the axis only."""

    fingertip_axes: Annotated[
        tuple[LengthOption, ...],
        tyro.conf.arg(metavar="LENGTH LENGTH LENGTH", help_behavior_hint=""),
    ] = ()
    """Semi-axes of a fingertip that is an ellipsoid."""

    receptive_field: LengthOption = None
    """Sensor: length of the arc on the fingertip within which it cannot distinguish contacts."""

    pitch: LengthOption = None
    """Distance between neighbouring sensing elements whose receptive fields overlap: together they
    distinguish more than one of them."""

    sensor_resolution: SensorResolution = None
    """Sensor, by its resolution in degrees instead."""

    object_size: LengthOption = None
    """Distance between two opposing fingers; with it the uncertainty of contact locations is
    included."""

    joints: JointOptions = field(default_factory=JointOptions)
    """The joints of each finger, and their encoders. A LENGTH has a unit, or is in --print-unit."""

    grasps: GraspOptions = field(default_factory=GraspOptions)
    """What else is uncertain, and the grasps that the design is for."""

    figure: OutputFile = None
    """Figure of the budgets as stacked bars, one for each friction (.svg, .png or .pdf); what is
    printed does not depend on it."""

    print_unit: Unit = "mm"
    """Unit of the printed lengths, and of lengths without a unit."""

    force: Force = False

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
        size = self._length("object_size")
        if size is not None and not 0.0 < size < math.inf:
            raise SettingError(f"object size must be a finite length above 0; got {size:g}")

    def _check_tip(self) -> None:
        fingertip = {
            "--fingertip-radius": self.fingertip_radius is not None,
            "--curvature": self.curvature is not None,
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

    def run(self) -> int:
        """Run the command, and return the exit code."""
        self._check_figure()
        if self.has_budget:
            self._print_budget()
        else:
            self._print_sensor()
        if self.figure is not None:
            self._draw(self.figure)
        return 0

    def _check_figure(self) -> None:
        """Check before the work that the figure can be written, and that it shows anything."""
        if self.figure is None:
            return
        from grasp3d.plots.figures import METADATA
        from grasp3d.system.files import check_suffix, check_writable

        check_suffix(self.figure, METADATA, "figure")
        if not self.has_budget and (self.sensor is None or not self.friction):
            raise SettingError(
                "--figure draws the budget of a finger: give --friction and a sensor "
                "(--receptive-field or --sensor-resolution), or what else is uncertain"
            )
        check_writable(self.figure, source=self.grasps.object)

    def _print_sensor(self) -> None:
        """Print what Wan & Howe's model says: the coarsest sensor, or the least friction."""
        from grasp3d.cli import design_report as report

        setup = report.Setup(self.radius, self._length("object_size"), self.print_unit)
        sensor, frictions = self.sensor, tuple(smallest for smallest, _ in self.friction)
        if sensor is None:
            report.print_limits(setup, frictions or DEFAULT_FRICTIONS, paper=self == Design())
            return
        report.print_sensor(setup, sensor)
        if frictions:
            report.print_comparison(setup, sensor, frictions)

    def _print_budget(self) -> None:
        """Print the budget of each friction."""
        from grasp3d.cli import budget_report as report

        designs, (grasps, source) = self.designs, self._grasps
        report.print_finger(
            self.print_unit, self.tip, self.sensor, designs[0].encoders, designs[0].other
        )
        report.print_designs(self.print_unit, self.tip, designs, grasps, source)

    def _draw(self, path: Path) -> None:
        """Draw the budget of each friction as a bar."""
        from grasp3d.cli import budget_report as report
        from grasp3d.plots.budgets import budget_figure
        from grasp3d.plots.figures import save_as

        budgets = report.mean_budgets(self.designs, self._grasps[0])
        save_as(budget_figure({f"μ {friction}": budgets[friction] for friction in budgets}), path)
        Report().written(path)

    @property
    def has_budget(self) -> bool:
        """Whether the options ask for more than Wan & Howe's sensor and friction."""
        return (
            any(smallest < largest for smallest, largest in self.friction)
            or self.joints != JointOptions()
            or self.grasps != GraspOptions()
            or not isinstance(self.tip, float)
        )

    @cached_property
    def designs(self) -> "tuple[FingerDesign, ...]":
        """The finger of the options, at each friction."""
        from grasp3d.contact.budget import FingerDesign

        other = Uncertainty(
            normal_error=self.grasps.normal_error or 0.0,
            location_error=self._converted("location_error", self.grasps.location_error) or 0.0,
        )
        encoders = self.joints.encoders(self.print_unit)
        return tuple(
            FingerDesign(friction, self.sensor, encoders, other)
            for friction in self.friction or (BUDGET_FRICTION,)
        )

    @property
    def radius(self) -> float:
        """Radius of the fingertip; inf: flat."""
        if self.flat:
            return math.inf
        if self.curvature is not None:
            return radius_of(self.curvature)
        radius = self._length("fingertip_radius")
        return DEFAULT_RADIUS[self.print_unit] if radius is None else radius

    @cached_property
    def tip(self) -> "float | CylinderTip | EllipsoidTip":
        """The fingertip: the radius of a round one, inf for a flat one, or a tip of other shape."""
        if not self.cylinder and not self.fingertip_axes:
            return self.radius
        from grasp3d.contact.tips import CylinderTip, EllipsoidTip

        if self.cylinder:
            return CylinderTip(self.radius)
        axes = (self._converted("fingertip_axes", axis) for axis in self.fingertip_axes)
        return EllipsoidTip(tuple(axes))  # type: ignore[arg-type]

    @property
    def sensor(self) -> Sensor | None:
        """The sensor of the options; None: the options define none."""
        length, tip = self._length("receptive_field"), self.tip
        if length is not None:
            pitch = self._length("pitch")
            length = length if pitch is None else overlapping_field(length, pitch)
            return Sensor(length, tip) if isinstance(tip, float) else tip.sensor(length)
        if self.sensor_resolution is not None:
            return Sensor.for_resolution(self.sensor_resolution, self.radius)
        return None

    @cached_property
    def _grasps(self) -> "tuple[GraspSamples, str]":
        """The grasps that the design is for, and what they are of."""
        from grasp3d.contact.budget import GraspSamples

        if self.grasps.object is not None:
            from grasp3d.cli.design_object import grasps_of

            return grasps_of(self.grasps, self.designs, self.print_unit, self._given_lengths)
        size = self._length("object_size")
        if size is not None and not self.force:
            from grasp3d.mesh.plausible_lengths import check_lengths

            error = {"location_error": self._with_unit(self.grasps.location_error)}
            check_lengths(error, size, self.print_unit, "the object (--object-size)")
        opening = math.inf if size is None else size
        return GraspSamples(self.grasps.critical_angle or 0.0, opening), ""

    @property
    def _given_lengths(self) -> dict[str, AnyLength | None]:
        """Lengths that are compared with an object's size, with their units; none with --force."""
        lengths = {
            "location_error": self.grasps.location_error,
            "receptive_field": self.receptive_field,
            "max_opening": self.grasps.max_opening,
        }
        return {} if self.force else {name: self._with_unit(lengths[name]) for name in lengths}

    def _with_unit(self, length: AnyLength | None) -> AnyLength | None:
        """A length with the unit that is meant if it has none."""
        return measure(length, self.print_unit) if isinstance(length, float) else length

    def _length(self, name: str) -> float | None:
        """A length in the printed unit."""
        return self._converted(name, getattr(self, name))

    def _converted(self, name: str, value: AnyLength | None) -> float | None:
        length: float | None = length_in_unit(name, value, self.print_unit)
        return length


def run(command: Design) -> int:
    """Run the command, and return the exit code."""
    return command.run()
