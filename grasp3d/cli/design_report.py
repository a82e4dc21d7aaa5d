"""Printed report of `grasp3d design`."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from rich.table import Table

from grasp3d.cli.report import WARNING, Report, exact_angle, table_of
from grasp3d.contact.friction_cones import effective_friction
from grasp3d.contact.sensor import Sensor, resolution_limit
from grasp3d.settings.lengths import Unit

ROUNDING = 1e-12
"""Margin up to which a sensor is not fine enough [rad]."""

FLAT = "0°: its normal is the same everywhere"
"""Sensor resolution of a flat fingertip."""

_COUNTS_NOTE = (
    "Numbers of sensors are for the whole hemisphere, by area: 'discs' as in Wan & Howe, 'caps' "
    "on the curved surface. Both are lower bounds: real layouts overlap, by a fifth at least."
)
_LOCATIONS_NOTE = (
    "The uncertainty of contact locations is not included: give --object-size to include it."
)
_PAPER_NOTE = (
    "Wan & Howe report 53°, about 9 mm and 10 sensors for friction 0.5; for 0.2, 22.6°, about 4 mm "
    "and 50 sensors: their 50 comes from rounding 3.95 mm to 4."
)


@dataclass(frozen=True)
class Setup:
    """Fingertip, object size and unit of a report."""

    radius: float
    """Radius of the fingertip; inf: flat."""
    object_size: float | None
    """Distance between two opposing fingers; None: not given."""
    unit: Unit
    """Unit of all lengths."""

    @property
    def flat(self) -> bool:
        """Whether the fingertip is flat."""
        return math.isinf(self.radius)

    @property
    def fingertip(self) -> str:
        """Description of the fingertip."""
        if self.flat:
            return "flat"
        radius = self.length(self.radius)
        return f"radius {radius}, curvature {1.0 / self.radius:.4g} per {self.unit}"

    @property
    def openings(self) -> tuple[tuple[float, str], ...]:
        """Distances between two fingers with headings; inf: locations are not included."""
        normals = (math.inf, "Uncertain normals only, as in Wan & Howe:")
        if self.object_size is None:
            return (normals,)
        size = self.length(self.object_size)
        return normals, (
            self.object_size,
            f"Uncertain normals and locations, two fingers {size} apart:",
        )

    def length(self, value: float) -> str:
        """Format a length with its unit."""
        return f"{value:.4g} {self.unit}"

    def print_notes(self, report: Report) -> None:
        """Print the notes on numbers of sensors and on uncertain locations."""
        if not self.flat:
            report.paragraph(_COUNTS_NOTE)
        if self.object_size is None:
            report.paragraph(_LOCATIONS_NOTE)


def print_limits(setup: Setup, frictions: Sequence[float], *, paper: bool = False) -> None:
    """Print the coarsest sensor for each friction.

    Args:
        setup: Fingertip, object size and unit.
        frictions: Coulomb coefficients, above 0.
        paper: Whether to print a comparison with the numbers of Wan & Howe 2018.
    """
    # A flat tip has a limit only if locations are included; otherwise `limiting` raises an error.
    openings = setup.openings[1:] if setup.flat and setup.object_size else setup.openings
    tables = [(heading, _limits(setup, opening, frictions)) for opening, heading in openings]
    report = Report()
    report.paragraph("[bold]Required sensor for each friction[/]")
    report.paragraph(f"fingertip: {setup.fingertip}")
    _print_tables(report, tables)
    report.paragraph(
        "\nGrasps can be surely stable only with a finer sensor than this; grasp3d sweep computes "
        "the area fraction of an object where they are."
    )
    setup.print_notes(report)
    if paper:
        report.paragraph(_PAPER_NOTE)


def _limits(setup: Setup, opening: float, frictions: Sequence[float]) -> Table:
    headings = ["friction", f"receptive field\nbelow, {setup.unit}"]
    if not setup.flat:
        headings += ["resolution\nbelow", "sensors,\ndiscs", "sensors,\ncaps"]
    rows = []
    for friction in frictions:
        sensor = Sensor.limiting(friction, setup.radius, opening=opening)
        row = [f"{friction:g}", f"{sensor.receptive_field:#.4g}"]
        if not setup.flat:
            row += [exact_angle(sensor.resolution), *_counts(sensor)]
        rows.append(row)
    return table_of(headings, rows, texts=0, folded=True)


def print_sensor(setup: Setup, sensor: Sensor) -> None:
    """Print the properties of a sensor, and the friction that it requires."""
    warnings = () if setup.object_size is None else sensor.warnings(setup.object_size)
    report = Report()
    report.paragraph("[bold]Required friction for this sensor[/]")
    report.fields([*_sensor_rows(setup, sensor), *_size_rows(setup, sensor)])
    for warning in warnings:
        report.paragraph(f"{WARNING} {warning}")
    setup.print_notes(report)


def _sensor_rows(setup: Setup, sensor: Sensor) -> Iterator[tuple[str, str]]:
    yield "fingertip", setup.fingertip
    yield "receptive field", setup.length(sensor.receptive_field)
    yield "sensor resolution", FLAT if sensor.flat else exact_angle(sensor.resolution)
    yield "location uncertainty", f"within {setup.length(sensor.location_uncertainty)}"
    if not sensor.flat:
        discs, caps = _counts(sensor)
        yield "sensors on the hemisphere", f"at least {discs} (discs), {caps} (caps)"
    yield "required friction", _above(sensor.required_friction)


def _size_rows(setup: Setup, sensor: Sensor) -> Iterator[tuple[str, str]]:
    if setup.object_size is not None:
        yield f"two fingers {setup.length(setup.object_size)} apart", ""
        yield "  their line tilts by up to", exact_angle(sensor.line_error(setup.object_size))
        required = sensor.required_friction_at(setup.object_size)
        yield "  required friction with this", _above(required)


def print_comparison(setup: Setup, sensor: Sensor, frictions: Sequence[float]) -> None:
    """Print whether a sensor is fine enough for each friction, and the effective friction."""
    tables = [
        (heading, _comparison(sensor, opening, frictions)) for opening, heading in setup.openings
    ]
    report = Report()
    report.paragraph("\n[bold]Comparison of this sensor with each friction[/]")
    report.paragraph(
        "For the best grasps: two fingers that push along the line through both contacts."
    )
    _print_tables(report, tables)
    report.paragraph(
        "\nmargin: friction angle minus the largest angle between a normal and this line; "
        "effective friction: friction whose friction angle is the margin. Where the contact "
        "normals are not along the line, a finer sensor is required: see grasp3d sweep."
    )


def _comparison(sensor: Sensor, opening: float, frictions: Sequence[float]) -> Table:
    tilt, rows = sensor.misalignment(opening), []
    for friction in frictions:
        margin = resolution_limit(friction) / 2.0 - tilt
        effective = float(effective_friction(friction, 2.0 * tilt))
        enough = "yes" if margin > ROUNDING else "no"
        rows.append((f"{friction:g}", enough, exact_angle(margin), f"{effective:.4g}"))
    headings = ("friction", "fine\nenough", "margin", "effective\nfriction")
    return table_of(headings, rows, texts=0, folded=True)


def _print_tables(report: Report, tables: Sequence[tuple[str, Table]]) -> None:
    for heading, table in tables:
        report.paragraph(f"\n{heading}")
        report.table(table)


def _above(friction: float) -> str:
    return f"above {friction:.4g}" if math.isfinite(friction) else "none is sufficient"


def _counts(sensor: Sensor) -> tuple[str, str]:
    return _count(sensor.sensors_by_discs), _count(sensor.sensors_by_caps)


def _count(sensors: int | None) -> str:
    return "inf" if sensors is None else str(sensors)
