"""The command `grasp3d design`: relates friction, sensors, encoders, and their uncertainty.

Its report with everything that is uncertain is printed here, of budgets and limits; that of the
sensor alone in `design_report`.
"""

import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from rich.table import Table

from grasp3d.cli import progress_bars
from grasp3d.cli.design_command import Design, GraspOptions, friction_text
from grasp3d.cli.design_report import (
    LOCATIONS_NOTE,
    Tip,
    print_limits,
    print_sensor,
    sensor_rows,
    tip_text,
)
from grasp3d.cli.existing_files import check_output
from grasp3d.cli.report import Report, escaped, exact_angle, percent_text, table_of
from grasp3d.contact.budget import CRITICAL, MARGIN, FingerDesign, GraspSamples, MarginBudget
from grasp3d.contact.sensor import JointEncoders, Sensor, overlapping_field
from grasp3d.contact.tips import CylinderTip, EllipsoidTip
from grasp3d.errors import SettingError
from grasp3d.mesh import load_mesh
from grasp3d.mesh.plausible_lengths import refuse_lengths
from grasp3d.settings import GraspModel, MeshOptions, Sampling
from grasp3d.settings.lengths import METRES, AnyLength, Unit, length_in_unit, measure
from grasp3d.settings.uncertainty import Uncertainty, friction_interval
from grasp3d.surface.area_statistics import vertex_weights
from grasp3d.surface.labelling import label_surface
from grasp3d.system.context import within
from grasp3d.system.counts import counted

FRACTIONS = (0.5, 0.9)
"""Area fractions of an object that limits are printed for."""

NARROWEST, WIDEST = 8, 34
"""Characters of a whole bar."""

BESIDE_BAR = 32
"""Characters beside a bar."""

_BAR, _MISSING, _THIN = "█", "░", "▏"
_ASCII = str.maketrans({_BAR: "#", _MISSING: "-", _THIN: "|"})
"""For terminals without block characters."""

_LIMITS_NOTE = (
    "Each limit holds with all other values as given. any: no value is too large; none: none is "
    "small enough."
)
_OBJECT_NOTE = (
    "Counted for two grasps at each vertex, the best with exact locations and the best with the "
    "location error as given: other grasps may be better, so there may be more S and wider limits."
)


def print_finger(unit: Unit, tip: Tip, design: FingerDesign) -> None:
    """Print the fingertip, its sensor, the encoders of its joints, and further errors.

    Args:
        unit: Unit of all lengths.
        tip: Radius of a round fingertip, inf for a flat one, or a tip of another shape.
        design: The finger.
    """
    rows = [("fingertip", tip_text(unit, tip))]
    if isinstance(design.sensor, Sensor):
        rows += sensor_rows(unit, tip, design.sensor)
    if design.encoders is not None:
        rows += _encoder_rows(unit, design.encoders)
    if design.other.normal_error:
        rows.append(("other normal error", f"within {_small_angle(design.other.normal_error)}"))
    if design.other.location_error:
        error = float(design.other.location_error)
        rows.append(("other location error", f"within {error:.4g} {unit}"))
    report = Report()
    report.paragraph("[bold]Finger[/]")
    report.fields(rows)


def _encoder_rows(unit: Unit, encoders: JointEncoders) -> Iterator[tuple[str, str]]:
    errors = encoders.angle_errors
    if not any(errors):
        yield "encoders", f"of {counted(len(errors), 'joints')}, exact: give --encoder-counts"
        return
    yield "encoders", ", ".join(f"± {_small_angle(error)}" for error in errors)
    if encoders.kind == "prismatic":
        yield "  location, along the closing axis", f"± {encoders.closing_error:.4g} {unit}"
        return
    yield "  normals turn by up to", _small_angle(encoders.normal_error)
    yield "  contact location", f"within {encoders.location_error:.4g} {unit}"


def print_designs(
    unit: Unit, tip: Tip, designs: Sequence[FingerDesign], grasps: GraspSamples, source: str
) -> None:
    """Print for each friction the budget, the limits, and what each uncertainty costs an object.

    Args:
        unit: Unit of all lengths.
        tip: The fingertip, see `print_finger`.
        designs: The same finger at several frictions.
        grasps: The grasps that it is for.
        source: The object that they are of; '': one grasp.
    """
    report = Report()
    if source:
        report.line(f"\n[bold]Object[/]: {escaped(source)}")
    for friction, budget in mean_budgets(designs, grasps).items():
        report.paragraph(f"\n{_heading(unit, friction, grasps, source)}")
        _print_bars(report, budget)
        report.paragraph(_verdict(budget, source))
    if source:
        report.paragraph("\n[bold]Area fraction of S: as given, and without an uncertainty[/]")
        report.table(_losses(designs, grasps))
        report.paragraph(_OBJECT_NOTE)
    report.paragraph("\n[bold]Limits[/]")
    limits = [
        dict(_limits(unit, tip, design, grasps, fraction))
        for design in designs
        for fraction in (FRACTIONS if source else (1.0,))
    ]
    report.table(table_of([*limits[0]], ([*row.values()] for row in limits), folded=True))
    report.paragraph(_LIMITS_NOTE)
    if not np.isfinite(grasps.opening).any():
        report.paragraph(LOCATIONS_NOTE)


def mean_budgets(designs: Sequence[FingerDesign], grasps: GraspSamples) -> dict[str, MarginBudget]:
    """The mean budget of the grasps for each friction, which is a text in the result.

    Args:
        designs: The same finger at several frictions.
        grasps: The grasps that it is for.

    Raises:
        SettingError: There is no grasp.
    """
    return {
        friction_text(friction_interval(design.friction)): design.budget(grasps).mean(
            grasps.weights
        )
        for design in designs
    }


def _heading(unit: Unit, friction: str, grasps: GraspSamples, source: str) -> str:
    if source:
        return f"[bold]Budget at friction {friction}[/], mean over the area with a grasp"
    opening = float(np.asarray(grasps.opening).flat[0])
    apart = "" if math.isinf(opening) else f", two fingers {opening:.4g} {unit} apart"
    return f"[bold]Budget at friction {friction}[/]{apart}"


def _print_bars(report: Report, budget: MarginBudget) -> None:
    """Print the friction angle and below it its parts, each bar where the previous bar ends."""
    width = min(WIDEST, max(NARROWEST, report.console.width - BESIDE_BAR))
    total = float(budget.friction_angle)
    scale = width / max(total, float(budget.uncertain + budget.critical_angle))

    def block(bar: str) -> str:
        return bar.translate(_ASCII) if report.console.options.ascii_only else bar

    rows = [("friction angle", exact_angle(total), block(_bar(0.0, total, scale)))]
    start = 0.0
    for name, value in budget.stack.items():
        angle = float(value)
        if name not in (CRITICAL, MARGIN) and angle == 0.0:
            continue
        low, high = sorted((start, start + angle))
        style = "" if name != MARGIN else "green" if angle > 0.0 else "red"
        bar = block(_bar(low, high, scale, _MISSING if angle < 0.0 else _BAR))
        rows.append((name, exact_angle(angle), f"[{style}]{bar}[/]" if style else bar))
        start += angle
    table = table_of(("", "", ""), rows)
    table.columns[2].justify = "left"
    report.table(table)


def _verdict(budget: MarginBudget, source: str) -> str:
    """The margin in words, and what costs the most."""
    angle = exact_angle(float(budget.margin))
    stable = "surely stable" if float(budget.margin) > 0.0 else "not surely stable"
    margin = f"the mean margin is {angle}" if source else f"{stable}: the margin is {angle}"
    if float(budget.critical_angle) >= float(budget.friction_angle):
        return f"{margin}; the critical angle alone exceeds the friction angle"
    costliest = str(budget.costliest)
    return f"{margin}; {costliest} takes the most" if costliest else margin


def _bar(low: float, high: float, scale: float, block: str = _BAR) -> str:
    start, end = round(low * scale), round(high * scale)
    thin = "" if high == low else _THIN
    return " " * start + (block * (end - start) or thin)


def _losses(designs: Sequence[FingerDesign], grasps: GraspSamples) -> Table:
    """Fractions S, and those with one uncertainty removed, a column for each friction."""
    frictions = [friction_text(friction_interval(design.friction)) for design in designs]
    budgets = [design.budget(grasps) for design in designs]
    names = [
        name
        for name in budgets[0].parts
        if any(np.any(budget.parts[name] != 0.0) for budget in budgets)
    ]
    texts = ["as given", *(f"without {name}" for name in names), "without any"]
    columns = []
    for design in designs:
        exact = FingerDesign(design.without("friction").friction)
        changed = (design, *map(design.without, names), exact)
        columns.append([percent_text(finger.stable_fraction(grasps)) for finger in changed])
    rows = zip(texts, *columns, strict=True)
    return table_of(("", *(f"μ {friction}" for friction in frictions)), rows, folded=True)


def _limits(
    unit: Unit, tip: Tip, design: FingerDesign, grasps: GraspSamples, fraction: float
) -> Iterator[tuple[str, str]]:
    """Headings of a table, and the limit of every uncertainty at a friction and a fraction of S."""
    yield "friction", friction_text(friction_interval(design.friction))
    if fraction < 1.0:
        yield "S on", f"{100.0 * fraction:g} %"
    friction = design.required_friction(grasps, fraction)
    yield "least friction\nabove", f"{friction:.4g}" if math.isfinite(friction) else "none"
    field = design.required_field(grasps, fraction, tip=tip)
    yield f"receptive field\nbelow, {unit}", _limit(field)
    if not _is_flat(tip):
        yield "resolution\nbelow", _resolution(field, tip)
    if design.encoders is not None:
        counts = design.required_counts(grasps, fraction)
        yield "counts\nat least", "none" if counts is None else f"{counts:,}"
    if np.isfinite(grasps.opening).any():
        location = design.required_location(grasps, fraction)
        yield f"other location\nerror below, {unit}", _limit(location)


def _is_flat(tip: Tip) -> bool:
    return isinstance(tip, float) and math.isinf(tip)


def _resolution(field: float, tip: Tip) -> str:
    """Resolution of the largest receptive field."""
    if not 0.0 < field < math.inf:
        return _limit(field)
    sensor = Sensor(field, tip) if isinstance(tip, float) else tip.sensor(field)
    return exact_angle(sensor.resolution)


def _limit(value: float) -> str:
    if value == 0.0:
        return "none"
    return f"{value:#.4g}" if math.isfinite(value) else "any"


def _small_angle(angle: float) -> str:
    return f"{math.degrees(angle):.3g}°"


DEFAULT_FRICTIONS = tuple(step / 10.0 for step in range(1, 11))

BUDGET_FRICTION = (0.5, 0.5)
"""Friction of a budget if none is given."""


def run(command: Design) -> int:
    """Run the command, and return the exit code."""
    tip, unit = _tip(command), command.print_unit
    sensor = _sensor(command, tip)
    _check_figure(command, sensor)
    if not command.has_budget:
        frictions = tuple(smallest for smallest, _ in command.friction)
        if sensor is None:
            print_limits(command, frictions or DEFAULT_FRICTIONS)
        else:
            print_sensor(command, sensor, frictions)
        if command.figure is None:
            return 0
    designs = _designs(command, sensor)
    grasps, source = _grasps(command, designs)
    if command.has_budget:
        print_finger(unit, tip, designs[0])
        print_designs(unit, tip, designs, grasps, source)
    if command.figure is not None:
        from grasp3d.plots.budgets import budget_figure
        from grasp3d.plots.figures import save_as

        budgets = mean_budgets(designs, grasps)
        bars = {f"μ {friction}": budget for friction, budget in budgets.items()}
        save_as(budget_figure(bars), command.figure)
        Report().written(command.figure)
    return 0


def _tip(command: Design) -> Tip:
    """The fingertip: the radius of a round one, inf for a flat one, or a tip of other shape."""
    if command.cylinder:
        return CylinderTip(command.radius)
    if not command.fingertip_axes:
        return command.radius
    unit = command.print_unit
    axes = (length_in_unit("fingertip_axes", axis, unit) for axis in command.fingertip_axes)
    return EllipsoidTip(tuple(axes))


def _sensor(command: Design, tip: Tip) -> Sensor | None:
    """The sensor of the options; None: the options define none."""
    length, pitch = command.length("receptive_field"), command.length("pitch")
    if length is not None:
        length = length if pitch is None else overlapping_field(length, pitch)
        return Sensor(length, tip) if isinstance(tip, float) else tip.sensor(length)
    if command.sensor_resolution is not None:
        return Sensor.for_resolution(command.sensor_resolution, command.radius)
    return None


def _check_figure(command: Design, sensor: Sensor | None) -> None:
    """Check before the work that the figure can be written, and that it shows anything."""
    if command.figure is None:
        return
    from grasp3d.plots.figures import METADATA

    sources = [command.grasps.object]
    check_output(command.figure, METADATA, "figure", overwrite=command.overwrite, sources=sources)
    if not command.has_budget and (sensor is None or not command.friction):
        raise SettingError(
            "--figure draws the budget of a finger: give --friction and a sensor "
            "(--receptive-field or --sensor-resolution), or what else is uncertain"
        )


def _designs(command: Design, sensor: Sensor | None) -> tuple[FingerDesign, ...]:
    """The finger of the options, at each friction."""
    other = Uncertainty(
        normal_error=command.grasps.normal_error or 0.0,
        location_error=command.length("location_error") or 0.0,
    )
    encoders = command.joints.encoders(command.print_unit)
    frictions = command.friction or (BUDGET_FRICTION,)
    return tuple(FingerDesign(friction, sensor, encoders, other) for friction in frictions)


def _grasps(command: Design, designs: Sequence[FingerDesign]) -> tuple[GraspSamples, str]:
    """The grasps that the design is for, and what they are of."""
    options, unit, size = command.grasps, command.print_unit, command.length("object_size")
    given = {
        "location_error": options.location_error,
        "receptive_field": command.receptive_field,
        "max_opening": options.max_opening,
    }
    lengths = {
        name: measure(length, unit) if isinstance(length, float) else length
        for name, length in given.items()
    }
    if options.object is not None:
        return grasps_of(options, designs, unit, {} if command.force else lengths)
    if size is not None and not command.force:
        from grasp3d.mesh.plausible_lengths import check_lengths

        error = {"location_error": lengths["location_error"]}
        check_lengths(error, size, unit, "the object (--object-size)")
    return GraspSamples(options.critical_angle or 0.0, math.inf if size is None else size), ""


TYPICAL_ERROR = 0.01
"""Location error of the second search if none is given, as a fraction of the object's size."""


def grasps_of(
    options: GraspOptions,
    designs: Sequence[FingerDesign],
    unit: Unit,
    lengths: Mapping[str, AnyLength | None],
) -> tuple[GraspSamples, str]:
    """Search an object for the best grasps at each vertex, and give their angles and openings.

    The largest friction has the widest search: every grasp is found that any of the designs makes
    S. Which grasp is the best depends on the location error, so there are two: the best where
    locations are exact, and the best at the location error of the designs.

    Args:
        options: The mesh and how it is searched.
        designs: The same finger at several frictions; lengths in `unit`.
        unit: Unit of the lengths, and of the openings returned.
        lengths: As they were given, with a unit; those that cannot be meant for an object of this
            size are refused.

    Returns:
        The grasps, two at each vertex, weighted by area, and the name of the mesh with its number
        of vertices.

    Raises:
        MeshError: The mesh cannot be read.
        SettingError: The unit of the mesh is not known, a length cannot be meant, or no grasp was
            found.
    """
    assert options.object is not None
    mesh = load_mesh(options.object, MeshOptions(unit=options.unit))
    name = mesh.report.source
    if mesh.unit is None:
        raise SettingError(
            f"the unit of {name} is not known, but a design is in {unit}: give the unit of its "
            "coordinates with --unit"
        )
    refuse_lengths(mesh, **lengths)
    widest = math.inf if options.max_opening is None else options.max_opening
    scale = METRES[mesh.unit] / METRES[unit]
    columns = []
    with progress_bars.progress(f"searching {name}", quiet=False):
        for number, model in enumerate(_models(designs, mesh.size * scale, unit)):
            with within(0.5 * number, 0.5 * number + 0.5):
                labels = label_surface(mesh, model, sampling=Sampling(max_opening=widest))
            columns.append((labels.critical_angle, labels.opening * scale))
    critical, opening = (np.stack(column, axis=1) for column in zip(*columns, strict=True))
    if not np.isfinite(critical).any():
        raise SettingError(
            f"no grasp was found on {name} with these settings: use a larger --max-opening or "
            "--friction"
        )
    opening = np.where(np.isfinite(critical), opening, np.inf)
    samples = GraspSamples(critical, opening, vertex_weights(mesh, "area"))
    return samples, f"{name}, {len(mesh.vertices):,} vertices"


def _models(designs: Sequence[FingerDesign], size: float, unit: Unit) -> Iterator[GraspModel]:
    """Models of the two searches: with exact locations, and with the location error."""
    widest = max(designs, key=lambda design: friction_interval(design.friction)[1])
    uncertainty = widest.uncertainty
    given_error = float(uncertainty.location_error)
    for error in (0.0, given_error if given_error > 0.0 else TYPICAL_ERROR * size):
        yield GraspModel(
            friction=friction_interval(widest.friction),
            sensor_resolution=uncertainty.sensor_resolution,
            normal_error=uncertainty.normal_error,
            location_error=f"{error} {unit}",
        )
