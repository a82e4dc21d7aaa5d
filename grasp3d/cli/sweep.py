"""The command `grasp3d sweep`: area fractions of labels over friction and sensor resolution."""

import math
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path

import numpy as np

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
from grasp3d.cli import progress_bars
from grasp3d.cli.commands import Sweep
from grasp3d.cli.existing_files import check_output
from grasp3d.cli.ranges import parse_angles, parse_frictions
from grasp3d.cli.report import FAILED, NONE, NOTE, Report, escaped
from grasp3d.errors import GraspError
from grasp3d.plots.figures import METADATA, save_as
from grasp3d.plots.fractions import meaning_in, sweep_figure
from grasp3d.settings.parsing import plain_values
from grasp3d.surface.sweeps import Sweep as Fractions
from grasp3d.surface.sweeps import write_sweeps
from grasp3d.system.names import safe_stem
from grasp3d.system.tables import SUFFIXES

MAX_SHOWN = 6
"""Meshes up to which each of them is drawn; of more the mean."""

COLUMNS = 5
"""Resolutions whose area fractions are printed."""

LEAST = 0.05
"""Resolution below which no sensor is fine enough [degrees]."""

MAX_CREASES = 1.0 / 3.0
"""Area fraction of creases that gives a note, relative to the area that need not be S."""


def run(command: Sweep) -> int:
    """Run the command, and return the exit code."""
    settings = SweepSettings(
        friction=parse_frictions("--friction", command.friction),
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
        report = Report()
        _print_sweeps(report, shown, every, fractions)
        _print_notes(report, names, swept, fractions)
        report.written(table, *([figure] if shown else []))
    return 1 if failures else 0


def _outputs(command: Sweep, shapes: list[str], meshes: list[MeshFile]) -> tuple[Path, Path]:
    """Return the paths of table and figure, checked to be writable and not to be meshes."""
    names = [*shapes, *(mesh.name for mesh in meshes)]
    stem = f"{safe_stem(Path(names[0]).stem)}_sweep" if len(names) == 1 else "sweep"
    table = command.output or Path(f"{stem}.csv")
    figure = command.figure or table.with_suffix(".svg")
    sources = [local_path(mesh.source) for mesh in meshes]
    check_output(table, SUFFIXES, "table", overwrite=command.overwrite, inputs=sources)
    check_output(figure, METADATA, "figure", overwrite=command.overwrite, inputs=sources)
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


def _print_sweeps(
    report: Report, shown: Sequence[Fractions], every: Sequence[Fractions], required: list[float]
) -> None:
    """Print the area fractions at some of the resolutions, and the required resolutions.

    Args:
        report: Where to print.
        shown: Sweeps whose fractions are printed.
        every: Sweeps whose required resolutions are printed.
        required: Area fractions of S for which the required resolution is printed.
    """
    if not shown:
        return
    resolutions = shown[0].sensor_resolution
    some = np.linspace(0, len(resolutions) - 1, min(len(resolutions), COLUMNS)).astype(int)
    report.line("area fractions of S/M/U [%] by sensor resolution:")
    _print_table(
        report,
        shown,
        [f"{math.degrees(resolutions[one]):.4g}°" for one in some],
        lambda sweep, row: [_percents(sweep, row, one) for one in some],
    )
    report.lines([", ".join(f"{one.name} {text}" for one, text in meaning_in(shown).items())])
    if required:
        report.line(
            "\nrequired resolution: below it at least this fraction of the surface is S "
            f"({NONE}: at no resolution)"
        )
        _print_table(
            report,
            every,
            [f"{100.0 * one:g} %" for one in required],
            lambda sweep, row: [_angle(sweep.required_resolution(one)[row]) for one in required],
        )


def _print_table(
    report: Report,
    sweeps: Sequence[Fractions],
    headings: Sequence[str],
    cells: Callable[[Fractions, int], Sequence[str]],
) -> None:
    """Print a table with a line for each sweep and friction."""
    lines = (
        (escaped(sweep.name), f"{friction:.4g}", *cells(sweep, row))
        for sweep in sweeps
        for row, friction in enumerate(sweep.friction)
    )
    report.table(("", "friction", *headings), lines)


def _percents(sweep: Fractions, row: int, column: int) -> str:
    """Format the fractions of S, M and U as whole percents whose sum is 100."""
    stable, ambiguous = sweep.stable[row, column], sweep.ambiguous[row, column]
    first, second = round(100.0 * stable), round(100.0 * (stable + ambiguous))
    return f"{first}/{second - first}/{100 - second}"


def _angle(angle: float) -> str:
    return NONE if math.degrees(angle) < LEAST else f"{math.degrees(angle):.1f}°"


def _print_notes(
    report: Report, shapes: Sequence[str], meshes: Sequence[SweptMesh], required: list[float]
) -> None:
    """Print errors, warnings and notes."""
    report.lines(
        (
            f"{name} is the shape in closed form; for the file or folder of that name write "
            f"./{name}"
            for name in shapes
            if Path(name).exists()
        ),
        NOTE,
    )
    failed = [mesh.error for mesh in meshes if mesh.error]
    report.lines(failed, FAILED)
    report.warnings(f"{mesh.name}: {line}" for mesh in meshes for line in mesh.warnings)
    report.lines(_creased(meshes, required), NOTE)
    if failed:
        report.line(f"{len(meshes) - len(failed)} swept, {len(failed)} failed")


def _creased(meshes: Sequence[SweptMesh], required: list[float]) -> Iterator[str]:
    """Meshes whose required resolution depends on the length of their edges."""
    most = max(required, default=math.nan)
    for mesh in meshes:
        if mesh.crease_fraction > MAX_CREASES * (1.0 - most):
            yield (
                f"{100.0 * mesh.crease_fraction:.0f} % of the area of {mesh.name} is strips along "
                "creases, which are smaller on a finer mesh (--max-edge): the resolution required "
                f"for {100.0 * most:g} % may be larger than printed here"
            )
