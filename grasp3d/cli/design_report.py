"""Printed report of `grasp3d design`."""

import math
from collections.abc import Iterator, Sequence

import numpy as np
from rich.table import Table

from grasp3d.cli.design_command import Design
from grasp3d.cli.report import WARNING, Report, exact_angle, table_of
from grasp3d.contact.friction_cones import effective_friction
from grasp3d.contact.sensor import Sensor, resolution_limit
from grasp3d.contact.tips import CylinderTip, EllipsoidTip
from grasp3d.settings.lengths import Unit
from grasp3d.system.context import refuse_warnings

Tip = float | CylinderTip | EllipsoidTip

ROUNDING = 1e-12
"""Margin up to which a sensor is not fine enough [rad]."""

FLAT = "0°: its normal is the same everywhere"
"""Sensor resolution of a flat fingertip."""

_COUNTS_NOTE = (
    "Numbers of sensors are for the whole hemisphere, by area: 'discs' as in Wan & Howe, 'caps' "
    "on the curved surface. Both are lower bounds: real layouts overlap, by a fifth at least."
)
LOCATIONS_NOTE = (
    "The uncertainty of contact locations is not included: give --object-size or --object to "
    "include it."
)
_PAPER_NOTE = (
    "Wan & Howe report 53°, about 9 mm and 10 sensors for friction 0.5; for 0.2, 22.6°, about 4 mm "
    "and 50 sensors: their 50 comes from rounding 3.95 mm to 4."
)


def print_limits(command: Design, frictions: Sequence[float]) -> None:
    """Print the coarsest sensor for each friction.

    Args:
        command: Fingertip, object size and unit; without any option the numbers of Wan & Howe 2018
            are printed for comparison.
        frictions: Coulomb coefficients, above 0.
    """
    flat = math.isinf(command.radius)
    # A flat tip has a limit only if locations are included; otherwise `limiting` raises an error.
    openings = _openings(command)[1:] if flat and command.object_size else _openings(command)
    tables = [(heading, _limits(command, opening, frictions)) for opening, heading in openings]
    report = Report()
    report.paragraph("[bold]Required sensor for each friction[/]")
    report.paragraph(f"fingertip: {tip_text(command.print_unit, command.radius)}")
    _print_tables(report, tables)
    report.paragraph(
        "\nGrasps can be surely stable only with a finer sensor than this; grasp3d sweep computes "
        "the area fraction of an object where they are."
    )
    _print_notes(report, command)
    if command == Design():
        report.paragraph(_PAPER_NOTE)


def _limits(command: Design, opening: float, frictions: Sequence[float]) -> Table:
    flat = math.isinf(command.radius)
    headings = ["friction", f"receptive field\nbelow, {command.print_unit}"]
    if not flat:
        headings += ["resolution\nbelow", "sensors,\ndiscs", "sensors,\ncaps"]
    rows = []
    for friction in frictions:
        sensor = Sensor.limiting(friction, command.radius, opening=opening)
        row = [f"{friction:g}", f"{sensor.receptive_field:#.4g}"]
        if not flat:
            row += [exact_angle(sensor.resolution), *_counts(sensor)]
        rows.append(row)
    return table_of(headings, rows, texts=0, folded=True)


def print_sensor(command: Design, sensor: Sensor, frictions: Sequence[float]) -> None:
    """Print the properties of a sensor, the friction that it requires, and how frictions compare.

    Args:
        command: Fingertip, object size and unit.
        sensor: The sensor.
        frictions: Coulomb coefficients, above 0.
    """
    size, report = command.length("object_size"), Report()
    warnings = () if size is None else sensor.warnings(size)
    refuse_warnings(warnings)
    report.paragraph("[bold]Required friction for this sensor[/]")
    report.fields(_sensor_rows(command, sensor))
    for warning in warnings:
        report.paragraph(f"{WARNING} {warning}")
    _print_notes(report, command)
    if not frictions:
        return
    report.paragraph("\n[bold]Comparison of this sensor with each friction[/]")
    report.paragraph(
        "For the best grasps: two fingers that push along the line through both contacts."
    )
    openings = _openings(command)
    tables = [(heading, _comparison(sensor, opening, frictions)) for opening, heading in openings]
    _print_tables(report, tables)
    report.paragraph(
        "\nmargin: friction angle minus the largest angle between a normal and this line; "
        "effective friction: friction whose friction angle is the margin. Where the contact "
        "normals are not along the line, a finer sensor is required: see grasp3d sweep."
    )


def _sensor_rows(command: Design, sensor: Sensor) -> Iterator[tuple[str, str]]:
    unit, size = command.print_unit, command.length("object_size")
    yield "fingertip", tip_text(unit, command.radius)
    yield from sensor_rows(unit, command.radius, sensor)
    if not sensor.flat:
        discs, caps = _counts(sensor)
        yield "sensors on the hemisphere", f"at least {discs} (discs), {caps} (caps)"
    yield "required friction", _above(sensor.required_friction)
    if size is not None:
        yield f"two fingers {size:.4g} {unit} apart", ""
        yield "  their line tilts by up to", exact_angle(sensor.line_error(size))
        yield "  required friction with this", _above(sensor.required_friction_at(size))


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


def tip_text(unit: Unit, tip: Tip) -> str:
    """Describe a fingertip: a radius, inf for a flat one, or a tip of another shape."""
    if isinstance(tip, EllipsoidTip):
        return f"ellipsoid, semi-axes {' x '.join(f'{axis:.4g}' for axis in tip.semi_axes)} {unit}"
    if isinstance(tip, CylinderTip):
        return f"cylinder, radius {tip.radius:.4g} {unit}"
    curved = f"radius {tip:.4g} {unit}, curvature {1.0 / tip:.4g} per {unit}"
    return "flat" if math.isinf(tip) else curved


def sensor_rows(unit: Unit, tip: Tip, sensor: Sensor) -> Iterator[tuple[str, str]]:
    """Names and values of a sensor.

    Args:
        unit: Unit of all lengths.
        tip: The fingertip, see `tip_text`.
        sensor: The sensor, the coarsest one on a tip whose curvature varies.
    """
    yield "receptive field", f"{sensor.receptive_field:.4g} {unit}"
    if isinstance(tip, EllipsoidTip):
        yield "sensor resolution, at worst", exact_angle(sensor.resolution)
        for axis in range(3):
            towards = np.eye(3)[axis]
            resolution = tip.resolution_at(sensor.receptive_field, towards).resolution
            yield f"  at the end of semi-axis {axis + 1}", exact_angle(resolution)
        yield "sensors on half of it", f"at least {tip.sensors_by_discs(sensor.receptive_field)}"
    elif isinstance(tip, CylinderTip):
        yield "sensor resolution, at worst", f"{exact_angle(sensor.resolution)}, around the axis"
    elif sensor.flat:
        yield "sensor resolution", FLAT
    else:
        yield "sensor resolution", exact_angle(sensor.resolution)
    yield "location uncertainty", f"within {sensor.location_uncertainty:.4g} {unit}"


def _openings(command: Design) -> tuple[tuple[float, str], ...]:
    """Distances between two fingers with headings; inf: locations are not included."""
    normals = (math.inf, "Uncertain normals only, as in Wan & Howe:")
    size = command.length("object_size")
    if size is None:
        return (normals,)
    apart = f"{size:.4g} {command.print_unit} apart"
    return normals, (size, f"Uncertain normals and locations, two fingers {apart}:")


def _print_notes(report: Report, command: Design) -> None:
    """Print the notes on numbers of sensors and on uncertain locations."""
    if not math.isinf(command.radius):
        report.paragraph(_COUNTS_NOTE)
    if command.object_size is None:
        report.paragraph(LOCATIONS_NOTE)
