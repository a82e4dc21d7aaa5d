"""The command `grasp3d sweep`: area fractions of labels over two of the uncertainties."""

from functools import partial
from pathlib import Path
from typing import Any

from grasp3d.batch.run import run as run_each
from grasp3d.batch.storage.files import local_path
from grasp3d.batch.sweeping import (
    SweepSettings,
    SweptMesh,
    Target,
    check_fingers,
    find_targets,
    gather,
    lost_mesh,
    meshes_of,
    sweep_mesh,
    sweep_on_one_thread,
)
from grasp3d.cli import progress_bars, sweep_report
from grasp3d.cli.commands import FRICTIONS, RESOLUTIONS, Sweep
from grasp3d.cli.existing_files import check_output
from grasp3d.cli.options import given_sampling
from grasp3d.cli.ranges import parse_angles, parse_frictions, parse_lengths, parse_numbers
from grasp3d.cli.report import Report
from grasp3d.errors import GraspError, SettingError
from grasp3d.plots.figures import METADATA, save_as
from grasp3d.plots.fractions import sweep_figure
from grasp3d.plots.heat_maps import heat_map_figure
from grasp3d.settings import GraspModel
from grasp3d.settings.parsing import plain_values
from grasp3d.surface.sweeps import Sweep as SweptFractions
from grasp3d.surface.sweeps import write_sweeps
from grasp3d.system.names import safe_stem
from grasp3d.system.tables import SUFFIXES

SHAPE_SIZE = 2.0
"""Size of the shapes in closed form, in radii."""

MAX_ROWS = 4
"""Rows of a sweep with axes other than friction and resolution that are drawn one by one."""


def run(command: Sweep) -> int:
    """Run the command, and return the exit code."""
    settings = SweepSettings(
        sampling=given_sampling(command.sampling, command.multifinger),
        mesh=command.mesh,
        fingers=command.fingers,
        reach=command.reach,
        **_values(command),
    )
    fractions = sorted(set(command.fraction))
    targets = find_targets(command.targets)
    check_fingers(targets, settings)
    _check_shapes(command, targets, settings)
    table, figure = _outputs(command, targets)
    meshes = _swept(command, targets, settings)
    failures = {mesh.name: mesh.error for mesh in meshes if mesh.error}
    swept = gather(targets, meshes, settings)
    every = list(dict.fromkeys(sweep for target in swept for sweep in target.sweeps))
    sweeps = list(dict.fromkeys(sweep for target in swept for sweep in target.shown))
    write_sweeps(
        table, every, fractions=fractions, failures=failures, settings=plain_values(settings)
    )
    if sweeps:
        members = {target.name: target.members for target in swept if target.members}
        _draw(command, sweeps, members, figure)
    if not command.quiet:
        sweep_report.print_sweeps(swept, fractions)
        sweep_report.print_notes(targets, meshes, fractions)
        Report().written(table, *([figure] if sweeps else []))
    return 1 if failures else 0


def _values(command: Sweep) -> dict[str, Any]:
    """Values of each uncertainty; errors with several values leave one for the defaults."""
    errors: dict[str, tuple[Any, ...]] = {
        "friction_error": parse_numbers("--friction-error", command.friction_error),
        "normal_error": parse_angles("--normal-error", command.normal_error),
        "location_error": parse_lengths("--location-error", command.location_error),
    }
    free = 2 - sum(len(set(values)) > 1 for values in errors.values())
    friction = parse_frictions("--friction", command.friction)
    resolution = parse_angles("--sensor-resolution", command.sensor_resolution)
    default = GraspModel()
    if command.friction == FRICTIONS and (free < 1 or (free < 2 and len(resolution) > 1)):
        friction = (default.friction,)
    if command.sensor_resolution == RESOLUTIONS and (free < 1 or (free < 2 and len(friction) > 1)):
        resolution = (default.sensor_resolution,)
    return {"friction": friction, "sensor_resolution": resolution, **errors}


def _check_shapes(command: Sweep, targets: list[Target], settings: SweepSettings) -> None:
    """Refuse location errors that cannot be meant for shapes, as for meshes."""
    shapes = [target.name for target in targets if not target.files and not target.folder]
    axes = settings.axes
    largest = float(axes.values["location_error"][-1])
    if shapes and axes.unit is None and largest > SHAPE_SIZE and not command.force:
        raise SettingError(
            f"location_error is {largest:.4g}, more than {shapes[0]} is large: for shapes in "
            "closed form it is a part of the radius or half side, such as 0.05; give a smaller "
            "one, or accept it with --force"
        )


def _draw(
    command: Sweep,
    sweeps: list[SweptFractions],
    members: dict[str, tuple[SweptFractions, ...]],
    path: Path,
) -> None:
    """Write the figure."""
    fractions = sorted(set(command.fraction))
    first = sweeps[0]
    several = min(first.stable.shape) > 1
    many = len(first.stable) > MAX_ROWS and not first.axes.is_default
    if several and (command.heat_map or many):
        save_as(heat_map_figure(sweeps, fractions=fractions), path)
    else:
        save_as(sweep_figure(sweeps, members=members, fractions=fractions), path)


def _outputs(command: Sweep, targets: list[Target]) -> tuple[Path, Path]:
    """Return the paths of table and figure, checked to be writable and not to be meshes."""
    path = Path(targets[0].name)
    name = safe_stem(path.name if targets[0].folder else path.stem)
    table = command.output or Path(f"{name}_sweep.csv" if len(targets) == 1 else "sweep.csv")
    figure = command.figure or table.with_suffix(".svg")
    sources = [local_path(mesh.source) for mesh in meshes_of(targets)]
    check_output(table, SUFFIXES, "table", overwrite=command.overwrite, sources=sources)
    check_output(figure, METADATA, "figure", overwrite=command.overwrite, sources=sources)
    return table, figure


def _swept(command: Sweep, targets: list[Target], settings: SweepSettings) -> list[SweptMesh]:
    """Sweep each mesh once: a single mesh in this process, several in child processes."""
    meshes = meshes_of(targets)
    if len(meshes) == 1 and not any(target.folder for target in targets):
        text = f"labelling {meshes[0].name}"
        with progress_bars.progress(text, quiet=command.quiet):
            swept = sweep_mesh(meshes[0], settings, force=command.force)
        if swept.error:
            raise GraspError(swept.error)
        return [swept]
    if not meshes:
        return []
    one_thread = partial(sweep_on_one_thread, force=command.force)
    sweeps = run_each(
        one_thread, meshes, settings, lost=lost_mesh, cluster=command.cluster,
        compiled=True,
    )  # fmt: skip
    rows = progress_bars.counted_results(sweeps, "sweeping", len(meshes), quiet=command.quiet)
    return sorted(rows, key=lambda row: row.name)
