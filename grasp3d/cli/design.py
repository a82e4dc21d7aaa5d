"""The command `grasp3d design`: the sensor that a friction requires, and the reverse."""

from grasp3d.cli.commands import Design
from grasp3d.cli.report import Report, exact_angle
from grasp3d.contact.contacts import effective_friction
from grasp3d.contact.sensor import MARGIN_ROUNDING, Sensor, required_counts, resolution_limit

FRICTIONS = tuple(step / 10.0 for step in range(1, 11))
"""Coefficients of friction that are used if neither friction nor a sensor is given."""

LIMITS = (
    "friction", "receptive field\nbelow, mm", "resolution\nbelow", "sensors,\ndiscs",
    "sensors,\ncaps",
)  # fmt: skip
COMPARED = ("friction", "fine\nenough", "margin", "effective\nfriction", "counts\nat least")

COUNTS = (
    "sensors: lower bounds for the whole hemisphere, by area: 'discs' as in Wan & Howe, 'caps' on "
    "the curved surface; real layouts overlap"
)
MARGIN = (
    "margin: friction angle minus half the resolution; effective friction: that whose angle is the "
    "margin; counts: per revolution of each joint's encoder. All for the best grasps."
)


def run(command: Design, report: Report) -> int:
    """Run the command, and return the exit code."""
    field = command.receptive_field
    radius = 1000.0 * (command.fingertip_radius or 0.01)  # [mm]
    fingertip = ("fingertip", f"radius {radius:.4g} mm")
    if field is None and command.sensor_resolution is None:
        limits = ((one, Sensor.limiting(one, radius)) for one in command.friction or FRICTIONS)
        rows = [
            (
                f"{friction:g}", f"{sensor.receptive_field:#.4g}", exact_angle(sensor.resolution),
                *_counts(sensor),
            )
            for friction, sensor in limits
        ]  # fmt: skip
        report.values([fingertip])
        report.table(LIMITS, rows, texts=())
        report.line(COUNTS)
        return 0
    if field is None:
        sensor = Sensor.for_resolution(command.sensor_resolution or 0.0, radius)
    else:
        sensor = Sensor(1000.0 * field, radius)
    discs, caps = _counts(sensor)
    compared = [_compared(command, sensor, one) for one in command.friction]  # may be refused
    report.values(
        [
            fingertip,
            ("receptive field", f"{sensor.receptive_field:.4g} mm"),
            ("sensor resolution", exact_angle(sensor.resolution)),
            ("location uncertainty", f"within {sensor.location_uncertainty:.4g} mm"),
            ("sensors on the hemisphere", f"at least {discs} (discs), {caps} (caps)"),
            ("required friction", f"above {sensor.required_friction:.4g}"),
        ]
    )
    report.line(COUNTS)
    if compared:
        report.table(COMPARED[: len(compared[0])], compared, texts=())
        report.line(MARGIN)
    return 0


def _compared(command: Design, sensor: Sensor, friction: float) -> list[str]:
    """Cells for a friction: whether a sensor is fine enough for it, and by which margin."""
    margin = resolution_limit(friction) / 2.0 - sensor.tilt
    effective = float(effective_friction(friction, sensor.resolution))
    enough = "yes" if margin > MARGIN_ROUNDING else "no"
    cells = [f"{friction:g}", enough, exact_angle(margin), f"{effective:.4g}"]
    if command.joints is not None:
        counts = required_counts(command.joints, friction, sensor.resolution)
        cells.append("none" if counts is None else f"{counts:,}")
    return cells


def _counts(sensor: Sensor) -> list[str]:
    """Numbers of sensors, counted as discs and as caps."""
    numbers = (sensor.sensors_by_discs, sensor.sensors_by_caps)
    return ["inf" if number is None else str(number) for number in numbers]
