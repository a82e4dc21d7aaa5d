"""The command `grasp3d design`: relates friction, sensors, encoders, and their uncertainty."""

import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from grasp3d.cli import progress_bars
from grasp3d.cli.budget_report import Tip, mean_budgets, print_designs, print_finger
from grasp3d.cli.design_command import Design, GraspOptions
from grasp3d.cli.design_report import print_limits, print_sensor
from grasp3d.cli.existing_files import check_output
from grasp3d.cli.report import Report
from grasp3d.contact.budget import FingerDesign, GraspSamples
from grasp3d.contact.sensor import Sensor, overlapping_field
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
        from grasp3d.cli.design import grasps_of

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
