"""The command `grasp3d design`: relates friction and the resolution of tactile sensors."""

import math
from dataclasses import dataclass
from typing import Annotated

import tyro

from grasp3d.cli.options import Flag, Frictions, LengthOption, SensorResolution, command
from grasp3d.contact.sensor import Sensor, radius_of, resolution_limit
from grasp3d.errors import SettingError
from grasp3d.lengths import Unit, length_in_unit

DEFAULT_FRICTIONS = tuple(step / 10.0 for step in range(1, 11))
DEFAULT_RADIUS: dict[Unit, float] = {"m": 0.01, "cm": 1.0, "mm": 10.0, "in": 10.0 / 25.4}
"""Radius of a fingertip of 2 cm diameter, as in Wan & Howe 2018."""

_NO_DEFAULT = tyro.conf.arg(help_behavior_hint="")
_CURVATURE = tyro.conf.arg(metavar="FLOAT", help_behavior_hint="")


@command
@dataclass(frozen=True)
class Design:
    """Compute the sensor for a friction, or the friction for a sensor.

    With --friction: the coarsest sensor for surely stable grasps. With a sensor, given by
    --receptive-field or --sensor-resolution: the least friction. With both: whether the sensor is
    fine enough for each friction.
    """

    friction: Annotated[Frictions, _NO_DEFAULT] = ()

    fingertip_radius: LengthOption = None
    """Radius of a hemispherical fingertip (default: 10mm)."""

    curvature: Annotated[float | None, _CURVATURE] = None
    """Curvature of the fingertip instead of its radius: 1 / radius, in 1 / --print-unit; 0 for a
    flat fingertip."""

    flat: Flag = False
    """The fingertip is flat."""

    receptive_field: LengthOption = None
    """Sensor: length of the arc on the fingertip within which it cannot distinguish contacts."""

    sensor_resolution: SensorResolution = None
    """Sensor, by its resolution in degrees instead."""

    object_size: LengthOption = None
    """Distance between two opposing fingers; with it the uncertainty of contact locations is
    included."""

    print_unit: Unit = "mm"
    """Unit of the printed lengths, and of lengths without a unit."""

    def __post_init__(self) -> None:
        fingertip = {
            "--fingertip-radius": self.fingertip_radius is not None,
            "--curvature": self.curvature is not None,
            "--flat": self.flat,
        }
        given = [name for name, is_given in fingertip.items() if is_given]
        if len(given) > 1:
            raise SettingError(f"{' and '.join(given)} each define the fingertip; give one")
        if self.receptive_field is not None and self.sensor_resolution is not None:
            raise SettingError(
                "--receptive-field and --sensor-resolution each define the sensor; give one"
            )
        for friction in self.friction:
            resolution_limit(friction)  # raises an error before anything is printed
        size = self._length("object_size")
        if size is not None and not 0.0 < size < math.inf:
            raise SettingError(f"object size must be a finite length above 0; got {size:g}")

    def run(self) -> int:
        """Run the command, and return the exit code."""
        from grasp3d.cli import design_report as report

        setup = report.Setup(self.radius, self._length("object_size"), self.print_unit)
        sensor = self.sensor
        if sensor is None:
            frictions = self.friction or DEFAULT_FRICTIONS
            report.print_limits(setup, frictions, paper=self == Design())
            return 0
        report.print_sensor(setup, sensor)
        if self.friction:
            report.print_comparison(setup, sensor, self.friction)
        return 0

    @property
    def radius(self) -> float:
        """Radius of the fingertip; inf: flat."""
        if self.flat:
            return math.inf
        if self.curvature is not None:
            return radius_of(self.curvature)
        radius = self._length("fingertip_radius")
        return DEFAULT_RADIUS[self.print_unit] if radius is None else radius

    @property
    def sensor(self) -> Sensor | None:
        """The sensor of the options; None: the options define none."""
        field = self._length("receptive_field")
        if field is not None:
            return Sensor(field, self.radius)
        if self.sensor_resolution is not None:
            return Sensor.for_resolution(self.sensor_resolution, self.radius)
        return None

    def _length(self, name: str) -> float | None:
        """A length in the printed unit."""
        length: float | None = length_in_unit(name, getattr(self, name), self.print_unit)
        return length
