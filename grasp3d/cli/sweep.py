"""The command `grasp3d sweep`: area fractions of labels over friction and sensor resolution."""

import math
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import numpy as np

from grasp3d.batch.inputs import MeshFile
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
from grasp3d.cli.commands import Sweep
from grasp3d.cli.options import number, typed_angle
from grasp3d.cli.report import FAILED, Report, angle_text, escaped
from grasp3d.errors import GraspError, SettingError
from grasp3d.pictures.figures import METADATA, save_as
from grasp3d.pictures.fractions import meaning_in, sweep_figure
from grasp3d.settings.friction import friction_interval
from grasp3d.settings.parsing import plain_values
from grasp3d.surface.sweeps import Sweep as Fractions
from grasp3d.surface.sweeps import write_sweeps
from grasp3d.system.names import safe_stem
from grasp3d.system.tables import SUFFIXES

MAX_VALUES = 10_000
"""Most values of a range."""

MAX_SHOWN = 6
"""Meshes up to which each of them is drawn; of more the mean."""

REQUIRED = "required: resolution below which so much of the area is S; --max-edge narrows creases"

COLUMNS = 5
"""Resolutions whose area fractions are printed."""


def run(command: Sweep, report: Report) -> int:
    """Run the command, and return the exit code."""
    settings = SweepSettings(
        friction=frictions_in(command.friction),
        sensor_resolution=angles_in(command.sensor_resolution),
        sampling=command.sampling,
        mesh=command.mesh,
        fingers=command.fingers,
        reach=command.reach,
    )
    fractions = sorted(set(command.fraction))
    names, meshes = find_targets(command.inputs)
    shapes = [sweep_shape(name, settings) for name in names]
    table, figure = _outputs(command, names, meshes)
    swept = _swept(command, report, meshes, settings)
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
        _print_sweeps(report, every, fractions)
    report.lines(failures.values(), FAILED)
    report.warnings(f"{mesh.name}: {line}" for mesh in swept for line in mesh.warnings)
    if failures:
        report.line(f"{len(swept) - len(failures)} swept, {len(failures)} failed")
    report.written(table, *([figure] if shown else []))
    return 1 if failures else 0


def _outputs(command: Sweep, shapes: list[str], meshes: list[MeshFile]) -> tuple[Path, Path]:
    """Return the paths of table and figure, checked to be writable and not to be meshes."""
    names = [*shapes, *(mesh.name for mesh in meshes)]
    stem = f"{safe_stem(Path(names[0]).stem)}_sweep" if len(names) == 1 else "sweep"
    table = command.output or Path(f"{stem}.csv")
    figure = table.with_suffix(".svg")
    sources = [local_path(mesh.source) for mesh in meshes]
    command.check_output(table, SUFFIXES, "table", inputs=sources)
    command.check_output(figure, METADATA, "figure", inputs=sources)
    return table, figure


def _swept(
    command: Sweep, report: Report, meshes: list[MeshFile], settings: SweepSettings
) -> list[SweptMesh]:
    """Sweep each mesh once."""
    work = sweep_mesh if len(meshes) == 1 else sweep_on_one_thread
    swept: list[SweptMesh] = report.each_mesh(
        work, meshes, settings, lost=lost_mesh, text="sweeping", command=command
    )
    if len(meshes) == 1 and swept[0].error:
        raise GraspError(swept[0].error)
    return swept


def _print_sweeps(report: Report, sweeps: Sequence[Fractions], required: list[float]) -> None:
    """Print the area fractions at some of the resolutions, and the required resolutions.

    Args:
        report: Where to print.
        sweeps: Of shapes and meshes, at least one.
        required: Area fractions of S for which the required resolution is printed.
    """
    resolutions = sweeps[0].sensor_resolution
    some = np.linspace(0, len(resolutions) - 1, min(len(resolutions), COLUMNS)).astype(int)
    headings = [f"S/M/U, %\n{math.degrees(resolutions[one]):.4g}°" for one in some]
    headings += [f"required\nfor {100.0 * one:g} %" for one in required]
    rows = [
        [
            escaped(sweep.name),
            f"{friction:.4g}",
            *(_percents(sweep, row, one) for one in some),
            *(angle_text(sweep.required_resolution(one)[row] or math.inf) for one in required),
        ]
        for sweep in sweeps
        for row, friction in enumerate(sweep.friction)
    ]
    report.table(("", "friction", *headings), rows)
    meanings = ", ".join(f"{one.name} {text}" for one, text in meaning_in(sweeps).items())
    report.lines([meanings, REQUIRED])


def _percents(sweep: Fractions, row: int, column: int) -> str:
    """Format the fractions of S, M and U as whole percents whose sum is 100."""
    stable, ambiguous = sweep.stable[row, column], sweep.ambiguous[row, column]
    first, second = round(100.0 * stable), round(100.0 * (stable + ambiguous))
    return f"{first}/{second - first}/{100 - second}"


def frictions_in(words: Iterable[str]) -> tuple[float, ...]:
    """Return coefficients of friction; see `_values`."""
    values = _values(lambda name, word: number(float, name, word), 1.0, "--friction", words)
    for value in values[:1] + values[-1:]:
        friction_interval(f"{value:g}")
    return values


def angles_in(words: Iterable[str]) -> tuple[float, ...]:
    """Return angles [rad] of words, ranges of which are in degrees; see `_values`.

    Example:
        >>> from grasp3d.cli.sweep import angles_in
        >>> angles_in(["0:0.2:0.1", "0.1rad"])
        (0.0, 0.0017453292519943296, 0.003490658503988659, 0.1)
    """
    return _values(typed_angle, math.radians(1.0), "--sensor-resolution", words)


def _values(
    single: Callable[[str, str], float], scale: float, option: str, words: Iterable[str]
) -> tuple[float, ...]:
    """Return the values of words, sorted: single ones, and ranges FROM:TO:STEP with both ends.

    Args:
        single: Parses a single one.
        scale: Value of 1 in a range.
        option: Name of the option, for the error.
        words: The words.

    Raises:
        SettingError: A word is neither, or there are too many values.
    """
    values = set[float]()
    for word in words:
        try:
            if ":" not in word:
                values.add(single(option, word))
                continue
            first, last, step = map(float, word.split(":"))
            count = math.floor((last - first) / step + 1e-9)
        except SettingError as error:
            raise SettingError(f"{error}; or give a range FROM:TO:STEP") from error
        except (ValueError, ArithmeticError):
            count, step = -1, 0.0
        if step <= 0.0 or not 0 <= count < MAX_VALUES:
            raise SettingError(
                f"{option} must be a range FROM:TO:STEP with STEP above 0 and at most {MAX_VALUES} "
                f"values; got {word!r}"
            )
        values |= {scale * round(first + step * one, 9) for one in range(count + 1)}
    return tuple(sorted(values))
