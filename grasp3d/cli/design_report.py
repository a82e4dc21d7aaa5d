"""What `grasp3d design` shows."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from rich.console import Console
from rich.table import Table

from grasp3d.contact.friction_cones import effective_friction
from grasp3d.contact.sensor import Sensor, resolution_limit
from grasp3d.settings import Unit

ROUNDING = 1e-12
"""A margin that is none [rad]."""

_COUNTED = (
    "Numbers of sensors are for the whole hemisphere, by area: 'discs' as Wan & Howe count, 'caps' "
    "on the curved surface. Both are lower bounds: real layouts overlap, by a fifth at least."
)
_LOCATIONS = "Locations are uncertain too: give --object-size to count them."
_PAPER = (
    "Wan & Howe give 53°, about 9 mm and 10 sensors for friction 0.5; for 0.2, 22.6°, about 4 mm "
    "and 50 sensors: their 50 comes from rounding 3.95 mm to 4."
)


@dataclass(frozen=True)
class Setup:
    """What stands around the question."""

    radius: float
    """Of the fingertip; inf: flat."""
    object_size: float | None
    unit: Unit

    @property
    def flat(self) -> bool:
        """Whether the fingertip is flat."""
        return math.isinf(self.radius)

    @property
    def fingertip(self) -> str:
        """The fingertip in words."""
        if self.flat:
            return "flat"
        radius = self.length(self.radius)
        return f"radius {radius}, curvature {1.0 / self.radius:.4g} per {self.unit}"

    @property
    def openings(self) -> tuple[tuple[float, str], ...]:
        """Distances between two fingers at which to answer, and what counts there."""
        normals = (math.inf, "By the normals alone, as Wan & Howe do:")
        if self.object_size is None:
            return (normals,)
        size = self.length(self.object_size)
        return normals, (self.object_size, f"Counting locations too, two fingers {size} apart:")

    def length(self, value: float) -> str:
        """A length in words."""
        return f"{value:.4g} {self.unit}"

    def print_notes(self, console: Console) -> None:
        """Print what numbers of sensors mean, and that locations have not been counted."""
        if not self.flat:
            console.print(_COUNTED)
        if self.object_size is None:
            console.print(_LOCATIONS)


def print_limits(setup: Setup, frictions: Sequence[float], *, paper: bool = False) -> None:
    """Print how fine a sensor must be at each friction; `paper`: tell the paper's numbers too."""
    # A flat tip has a limit only where locations count; without a size `limiting` says so.
    openings = setup.openings[1:] if setup.flat and setup.object_size else setup.openings
    tables = [(what, _limits(setup, opening, frictions)) for opening, what in openings]
    console = Console()
    console.print("[bold]Which sensor is fine enough for this friction?[/]")
    console.print(f"fingertip: {setup.fingertip}")
    _print_tables(console, tables)
    console.print(
        "\nOnly a sensor finer than this lets grasps be surely stable; how much of an object is, "
        "grasp3d sweep tells."
    )
    setup.print_notes(console)
    if paper:
        console.print(_PAPER)


def _limits(setup: Setup, opening: float, frictions: Sequence[float]) -> Table:
    headings = ["friction", f"receptive field\nbelow, {setup.unit}"]
    if not setup.flat:
        headings += ["resolution\nbelow", "sensors,\ndiscs", "sensors,\ncaps"]
    table = _table(*headings)
    for friction in frictions:
        sensor = Sensor.limiting(friction, setup.radius, opening=opening)
        row = [f"{friction:g}", f"{sensor.receptive_field:#.4g}"]
        if not setup.flat:
            row += [_angle(sensor.resolution), *_counts(sensor)]
        table.add_row(*row)
    return table


def print_sensor(setup: Setup, sensor: Sensor) -> None:
    """Print what a sensor resolves, and the least friction that is enough for it."""
    table = Table(box=None, pad_edge=False, show_header=False)
    table.add_column(overflow="fold")
    table.add_column(overflow="fold")
    for row in [*_sensor_rows(setup, sensor), *_size_rows(setup, sensor)]:
        table.add_row(*row)
    warnings = () if setup.object_size is None else sensor.warnings(setup.object_size)
    console = Console()
    console.print("[bold]Which friction is enough for this sensor?[/]")
    console.print(table)
    for warning in warnings:
        console.print(f"[yellow]warning:[/] {warning}")
    setup.print_notes(console)


def _sensor_rows(setup: Setup, sensor: Sensor) -> Iterator[tuple[str, str]]:
    yield "fingertip", setup.fingertip
    yield "receptive field", setup.length(sensor.receptive_field)
    yield "sensor resolution", _angle(sensor.resolution)
    yield "location uncertainty", f"± {setup.length(sensor.location_uncertainty)}"
    if not sensor.flat:
        discs, caps = _counts(sensor)
        yield "sensors on the hemisphere", f"at least {discs} (discs), {caps} (caps)"
    yield "friction needed", _above(sensor.required_friction)


def _size_rows(setup: Setup, sensor: Sensor) -> Iterator[tuple[str, str]]:
    if setup.object_size is not None:
        yield f"two fingers {setup.length(setup.object_size)} apart", ""
        yield "  their line turns by up to", _angle(sensor.line_error(setup.object_size))
        needed = sensor.required_friction_at(setup.object_size)
        yield "  friction needed with that", _above(needed)


def print_verdicts(setup: Setup, sensor: Sensor, frictions: Sequence[float]) -> None:
    """Print whether a sensor is fine enough at each friction, and what friction it leaves."""
    tables = [(what, _verdicts(sensor, opening, frictions)) for opening, what in setup.openings]
    console = Console()
    console.print("\n[bold]Is this sensor fine enough for this friction?[/]")
    console.print("For the best grasps: two fingers that push straight at each other.")
    _print_tables(console, tables)
    console.print(
        "\nmargin: the friction angle less what a normal may be off the fingers' line; effective "
        "friction: what is left of the friction. Places of an object where no grasp is straight "
        "need a finer sensor: see grasp3d sweep."
    )


def _verdicts(sensor: Sensor, opening: float, frictions: Sequence[float]) -> Table:
    table = _table("friction", "fine\nenough", "margin", "effective\nfriction")
    worst = sensor.misalignment(opening)
    for friction in frictions:
        margin = resolution_limit(friction) / 2.0 - worst
        left = float(effective_friction(friction, 2.0 * worst))
        enough = "yes" if margin > ROUNDING else "no"
        table.add_row(f"{friction:g}", enough, _angle(margin), f"{left:.4g}")
    return table


def _table(*headings: str) -> Table:
    table = Table(box=None, pad_edge=False)
    for heading in headings:
        table.add_column(heading, justify="right", overflow="fold")
    return table


def _print_tables(console: Console, tables: Sequence[tuple[str, Table]]) -> None:
    for what, table in tables:
        console.print(f"\n{what}")
        console.print(table)


def _above(friction: float) -> str:
    return f"above {friction:.4g}" if math.isfinite(friction) else "none is enough"


def _counts(sensor: Sensor) -> tuple[str, str]:
    return _count(sensor.sensors_by_discs), _count(sensor.sensors_by_caps)


def _count(sensors: int | None) -> str:
    return "inf" if sensors is None else str(sensors)


def _angle(angle: float) -> str:
    return f"{round(math.degrees(angle), 2) + 0.0:.2f}°"  # never -0.00
