"""The command `grasp3d sweep`: area fractions of labels over friction and sensor resolution."""

from functools import partial
from pathlib import Path

from grasp3d.batch.inputs import MeshFile
from grasp3d.batch.run import run as run_each
from grasp3d.batch.storage.files import local_path
from grasp3d.batch.sweeping import (
    SweepSettings,
    SweptMesh,
    find_targets,
    lost_mesh,
    mean_of,
    sweep_mesh,
    sweep_on_one_thread,
    sweep_shape,
)
from grasp3d.cli import progress_bars, sweep_report
from grasp3d.cli.commands import Sweep
from grasp3d.cli.existing_files import check_output
from grasp3d.cli.ranges import parse_angles, parse_numbers
from grasp3d.cli.report import Report
from grasp3d.errors import GraspError
from grasp3d.plots.figures import METADATA, save_as
from grasp3d.plots.fractions import sweep_figure
from grasp3d.settings.parsing import plain_values
from grasp3d.surface.sweeps import write_sweeps
from grasp3d.system.names import safe_stem
from grasp3d.system.tables import SUFFIXES

MAX_SHOWN = 6
"""Meshes up to which each of them is drawn; of more the mean."""


def run(command: Sweep) -> int:
    """Run the command, and return the exit code."""
    settings = SweepSettings(
        friction=parse_numbers("--friction", command.friction),
        sensor_resolution=parse_angles("--sensor-resolution", command.sensor_resolution),
        sampling=command.sampling,
        mesh=command.mesh,
        fingers=command.fingers,
        reach=command.reach,
    )
    fractions = sorted(set(command.fraction))
    names, meshes = find_targets(command.targets)
    shapes = [sweep_shape(name, settings) for name in names]
    table, figure = _outputs(command, names, meshes)
    swept = _swept(command, meshes, settings)
    failures = {mesh.name: mesh.error for mesh in swept if mesh.error}
    members = [mesh.sweep for mesh in swept if mesh.sweep is not None]
    mean = mean_of(members)
    every = [*shapes, *members, *mean]
    shown = every if len(members) <= MAX_SHOWN else [*shapes, *mean]
    write_sweeps(
        table, every, fractions=fractions, failures=failures, settings=plain_values(settings)
    )
    if shown:
        drawn = sweep_figure(shown, members=members if mean else (), fractions=fractions)
        save_as(drawn, figure)
    if not command.quiet:
        sweep_report.print_sweeps(shown, every, fractions)
        sweep_report.print_notes(names, swept, fractions)
        Report().written(table, *([figure] if shown else []))
    return 1 if failures else 0


def _outputs(command: Sweep, shapes: list[str], meshes: list[MeshFile]) -> tuple[Path, Path]:
    """Return the paths of table and figure, checked to be writable and not to be meshes."""
    names = [*shapes, *(mesh.name for mesh in meshes)]
    stem = f"{safe_stem(Path(names[0]).stem)}_sweep" if len(names) == 1 else "sweep"
    table = command.output or Path(f"{stem}.csv")
    figure = command.figure or table.with_suffix(".svg")
    sources = [local_path(mesh.source) for mesh in meshes]
    check_output(table, SUFFIXES, "table", overwrite=command.overwrite, sources=sources)
    check_output(figure, METADATA, "figure", overwrite=command.overwrite, sources=sources)
    return table, figure


def _swept(command: Sweep, meshes: list[MeshFile], settings: SweepSettings) -> list[SweptMesh]:
    """Sweep each mesh once: a single mesh in this process, several in child processes."""
    if len(meshes) == 1:
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
