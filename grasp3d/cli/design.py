"""`grasp3d design`: which friction is enough for a sensor, which sensor for a friction."""

import math
from dataclasses import dataclass
from typing import Annotated

import tyro

from grasp3d.contact.sensor import Sensor, radius_of, resolution_limit
from grasp3d.errors import SettingError
from grasp3d.settings import Unit

USUAL_FRICTIONS = tuple(step / 10.0 for step in range(1, 11))
USUAL_RADIUS: dict[Unit, float] = {"m": 0.01, "cm": 1.0, "mm": 10.0, "in": 10.0 / 25.4}
"""A fingertip of 2 cm diameter, as in Wan & Howe 2018."""


def _number(metavar: str = "FLOAT") -> object:
    """An option that is absent unless given."""
    return tyro.conf.arg(metavar=metavar, help_behavior_hint="")


@dataclass(frozen=True)
class Design:
    """Say which friction is enough for a tactile fingertip, or which fingertip for a friction."""

    friction: Annotated[tuple[float, ...], tyro.conf.arg(help_behavior_hint="")] = ()
    """Coulomb coefficients, above 0. With a sensor: is it fine enough? Without: which one is?"""

    fingertip_radius: Annotated[float | None, _number()] = None
    """Radius of a hemispherical fingertip; 10 mm unless a fingertip is given."""

    curvature: Annotated[float | None, _number()] = None
    """Curvature of the fingertip instead of its radius: 1 / radius, 0 for a flat one."""

    flat: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """The fingertip is flat."""

    receptive_field: Annotated[float | None, _number()] = None
    """Sensor: length of the arc on the fingertip on which all contacts feel alike."""

    sensor_resolution: Annotated[float | None, _number("DEGREES")] = None
    """Sensor, by its resolution alpha instead: largest angle between normals that feel alike."""

    object_size: Annotated[float | None, _number()] = None
    """Distance between two opposing fingers: count that the locations are uncertain as well."""

    unit: Unit = "mm"
    """Unit of all lengths."""

    def __post_init__(self) -> None:
        tips = {
            "--fingertip-radius": self.fingertip_radius is not None,
            "--curvature": self.curvature is not None,
            "--flat": self.flat,
        }
        given = [name for name, is_given in tips.items() if is_given]
        if len(given) > 1:
            raise SettingError(f"{' and '.join(given)} each say what the fingertip is; give one")
        if self.receptive_field is not None and self.sensor_resolution is not None:
            raise SettingError(
                "--receptive-field and --sensor-resolution each say what the sensor is; give one"
            )
        for friction in self.friction:
            resolution_limit(friction)  # refuses what is no friction, before anything is shown
        if self.object_size is not None and not 0.0 < self.object_size < math.inf:
            raise SettingError(
                f"object size must be a finite length above 0; got {self.object_size:g}"
            )

    def run(self) -> int:
        """Do it; returns the exit code."""
        from grasp3d.cli import design_report as report

        setup = report.Setup(self.radius, self.object_size, self.unit)
        sensor = self.sensor
        if sensor is None:
            frictions = self.friction or USUAL_FRICTIONS
            report.print_limits(setup, frictions, paper=self == Design())
            return 0
        report.print_sensor(setup, sensor)
        if self.friction:
            report.print_verdicts(setup, sensor, self.friction)
        return 0

    @property
    def radius(self) -> float:
        """Radius of the fingertip; inf: flat."""
        if self.flat:
            return math.inf
        if self.curvature is not None:
            return radius_of(self.curvature)
        if self.fingertip_radius is not None:
            return self.fingertip_radius
        return USUAL_RADIUS[self.unit]

    @property
    def sensor(self) -> Sensor | None:
        """The sensor that is described, if one is."""
        if self.receptive_field is not None:
            return Sensor(self.receptive_field, self.radius)
        if self.sensor_resolution is not None:
            return Sensor.for_resolution(math.radians(self.sensor_resolution), self.radius)
        return None
