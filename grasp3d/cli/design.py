"""The command `grasp3d design`: the sensor that a friction requires, and the other way round."""

from collections.abc import Sequence

from grasp3d.cli.report import Report, exact_angle
from grasp3d.cli.tool_commands import Design
from grasp3d.contact.friction_cones import effective_friction
from grasp3d.contact.sensor import MARGIN_ROUNDING, Sensor, required_counts, resolution_limit

FRICTIONS = tuple(step / 10.0 for step in range(1, 11))
"""Coefficients of friction if neither they nor a sensor are given."""

RADIUS = 10.0
"""Radius of a fingertip of 2 cm diameter, as in Wan & Howe 2018 [mm]."""

_COUNTS_NOTE = (
    "Numbers of sensors are for the whole hemisphere, by area: 'discs' as in Wan & Howe, 'caps' "
    "on the curved surface. Both are lower bounds: real layouts overlap, by a fifth at least."
)
_PAPER_NOTE = (
    "Wan & Howe report 53°, about 9 mm and 10 sensors for friction 0.5; for 0.2, 22.6°, about 4 mm "
    "and 50 sensors: their 50 comes from rounding 3.95 mm to 4."
)


def run(command: Design) -> int:
    """Run the command, and return the exit code."""
    given, field = command.fingertip_radius, command.receptive_field
    radius = RADIUS if given is None else 1000.0 * given
    if field is not None:
        _print_sensor(command, Sensor(1000.0 * field, radius))
    elif command.sensor_resolution is not None:
        _print_sensor(command, Sensor.for_resolution(command.sensor_resolution, radius))
    else:
        _print_limits(command, radius)
    return 0


def _print_limits(command: Design, radius: float) -> None:
    """Print the coarsest sensor for each friction."""
    headings = (
        "friction", "receptive field\nbelow, mm", "resolution\nbelow", "sensors,\ndiscs",
        "sensors,\ncaps",
    )  # fmt: skip
    rows = []
    for friction in command.friction or FRICTIONS:
        sensor = Sensor.limiting(friction, radius)
        field, resolution = sensor.receptive_field, exact_angle(sensor.resolution)
        rows.append((f"{friction:g}", f"{field:#.4g}", resolution, *_counts(sensor)))
    report = Report()
    report.line(f"required sensor for each friction; fingertip: radius {radius:.4g} mm")
    report.table(headings, rows, texts=())
    report.line(
        "Grasps can be surely stable only with a finer sensor than this; grasp3d sweep computes "
        "the area fraction of an object where they are."
    )
    report.line(_COUNTS_NOTE)
    if command == Design():
        report.line(_PAPER_NOTE)


def _print_sensor(command: Design, sensor: Sensor) -> None:
    """Print a sensor, the friction that it requires, and how given frictions compare."""
    discs, caps = _counts(sensor)
    headings = ["friction", "fine\nenough", "margin", "effective\nfriction"]
    headings += ["counts\nat least"] * (command.joints is not None)
    rows = [_comparison(command, sensor, one) for one in command.friction]  # may be refused
    report = Report()
    report.values(
        [
            ("fingertip", f"radius {sensor.fingertip_radius:.4g} mm"),
            ("receptive field", f"{sensor.receptive_field:.4g} mm"),
            ("sensor resolution", exact_angle(sensor.resolution)),
            ("location uncertainty", f"within {sensor.location_uncertainty:.4g} mm"),
            ("sensors on the hemisphere", f"at least {discs} (discs), {caps} (caps)"),
            ("required friction", f"above {sensor.required_friction:.4g}"),
        ]
    )
    report.line(_COUNTS_NOTE)
    if rows:
        report.table(headings, rows, texts=())
        counts = "; counts: per revolution of the encoder of each joint" * bool(command.joints)
        report.line(
            "margin: friction angle minus half the resolution; effective friction: friction whose "
            f"friction angle is the margin{counts}. For the best grasps: two fingers that push "
            "along the line through both contacts. Others require a finer sensor: see grasp3d "
            "sweep."
        )


def _comparison(command: Design, sensor: Sensor, friction: float) -> list[str]:
    """Cells of a friction: whether a sensor is fine enough for it, and by how much."""
    margin = resolution_limit(friction) / 2.0 - sensor.tilt
    effective = float(effective_friction(friction, sensor.resolution))
    enough = "yes" if margin > MARGIN_ROUNDING else "no"
    cells = [f"{friction:g}", enough, exact_angle(margin), f"{effective:.4g}"]
    if command.joints is not None:
        counts = required_counts(command.joints, friction, sensor.resolution)
        cells.append("none" if counts is None else f"{counts:,}")
    return cells


def _counts(sensor: Sensor) -> Sequence[str]:
    """Numbers of sensors by discs and by caps."""
    numbers = (sensor.sensors_by_discs, sensor.sensors_by_caps)
    return ["inf" if number is None else str(number) for number in numbers]
