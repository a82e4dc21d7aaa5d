"""The command `grasp3d sweep`: area fractions of labels over friction and sensor resolution."""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from grasp3d.batch.batch_settings import BatchSettings
from grasp3d.batch.inputs import MeshFile, find_meshes, local_copy
from grasp3d.cli.commands import Sweep
from grasp3d.cli.options import number, typed_angle
from grasp3d.cli.report import FAILED, Report, angle_text, escaped
from grasp3d.errors import SettingError
from grasp3d.hand.reach_settings import ReachSettings
from grasp3d.pictures.figures import METADATA, meaning_in, save_as, sweep_figure
from grasp3d.planar import Circle, Square
from grasp3d.settings import GraspModel, MeshOptions, Sampling, check_search_settings, search_cone
from grasp3d.settings.grasp_model import friction_interval
from grasp3d.settings.parsing import plain_values
from grasp3d.settings.sampling import check_search_angle
from grasp3d.stability.angle_distributions import AngleDistribution, SphereAngles
from grasp3d.stability.label import Mode
from grasp3d.surface.sweeps import Sweep as Fractions
from grasp3d.surface.sweeps import mean_sweep, sweep, write_sweeps
from grasp3d.system.names import safe_stem
from grasp3d.system.places import local_path
from grasp3d.system.tables import SUFFIXES

MAX_VALUES = 10_000
"""Largest number of values in a range."""

MAX_SHOWN = 6
"""Largest number of meshes that are drawn one by one; of more only the mean is drawn."""

REQUIRED = "required: coarsest resolution for this share of S; a smaller --max-edge narrows creases"

COLUMNS = 5
"""Number of resolutions whose area fractions are printed."""


SHAPES: dict[str, Callable[[], AngleDistribution]] = {
    "circle": Circle,
    "square": Square,
    "sphere": SphereAngles,
}
"""Shapes in closed form, with one finger fixed (on the square in the middle of a side)."""


@dataclass(frozen=True)
class SweepSettings:
    """Frictions and sensor resolutions of a sweep, and settings of the labels.

    Attributes:
        friction: Coulomb coefficients.
        sensor_resolution: Resolutions alpha [rad].
        sampling: Settings of the search. Its search angle, if given, must cover all frictions and
            resolutions.
    """

    friction: tuple[float, ...]
    sensor_resolution: tuple[float, ...]
    sampling: Sampling = field(default_factory=Sampling)
    mesh: MeshOptions = field(default_factory=MeshOptions)
    fingers: int = 2
    reach: ReachSettings = field(default_factory=ReachSettings)

    def __post_init__(self) -> None:
        if not self.friction or not self.sensor_resolution:
            raise SettingError("a sweep needs at least one friction and one sensor resolution")
        for friction in self.friction:
            GraspModel(friction=friction)
        for resolution in self.sensor_resolution:
            GraspModel(sensor_resolution=resolution)
        check_search_settings(self.model, self.sampling)
        check_search_angle(self.sampling, search_cone(self.model))

    @property
    def model(self) -> GraspModel:
        """Model of largest friction and coarsest resolution, which needs the widest search."""
        return GraspModel(
            friction=max(self.friction),
            sensor_resolution=max(self.sensor_resolution),
            fingers=self.fingers,
        )

    def swept(self, name: str, angles: AngleDistribution, mode: Mode) -> Fractions:
        """Compute the area fractions of critical angles at all frictions and resolutions."""
        return sweep(
            angles, friction=self.friction, sensor_resolution=self.sensor_resolution, name=name,
            mode=mode,
        )  # fmt: skip


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
    swept = report.each_mesh(sweep_mesh, meshes, settings, text="sweeping", command=command)
    if len(meshes) == 1 and swept[0].error is not None:
        raise swept[0].error
    failures = {one.job.name: str(one.error) for one in swept if one.error is not None}
    found = [one.value for one in swept if one.value is not None]
    members = [member for member, _ in found]
    several = len(members) > 1
    mean = [mean_sweep(members, name=f"mean of {len(members)} meshes")] if several else []
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
    report.warnings(f"{member.name}: {line}" for member, lines in found for line in lines)
    if failures:
        report.line(f"{len(swept) - len(failures)} swept, {len(failures)} failed")
    report.written(table, *([figure] if shown else []))
    return 1 if failures else 0


def find_targets(inputs: Iterable[str]) -> tuple[list[str], list[MeshFile]]:
    """Find the shapes and meshes to sweep; names of shapes take precedence over file names.

    Args:
        inputs: Names of shapes, or inputs of `find_meshes`; `./circle` is always a path.

    Returns:
        Names of shapes, and meshes; each only once.

    Raises:
        SettingError: There is no input.
        MeshError: A path is missing, or the inputs other than shapes have no mesh.
    """
    distinct = list(dict.fromkeys(inputs))
    if not distinct:
        raise SettingError(
            f"nothing to sweep: name a mesh file, a folder of meshes, or {', '.join(SHAPES)}"
        )
    paths = [item for item in distinct if item not in SHAPES]
    shapes = [item for item in distinct if item in SHAPES]
    return shapes, find_meshes(paths) if paths else []


def sweep_mesh(
    mesh: MeshFile, settings: SweepSettings, *, force: bool = False
) -> tuple[Fractions, tuple[str, ...]]:
    """Label a mesh file once, and compute its area fractions at all frictions and resolutions.

    Args:
        mesh: The file.
        settings: Frictions, sensor resolutions, and settings of the labels.
        force: Accept lengths that are implausible for an object of this size.

    Returns:
        The sweep and its warnings.

    Raises:
        GraspError: The mesh cannot be labelled.
    """
    from grasp3d.surface.labelling import Labelling  # needs ray tracing and the compiler

    own = BatchSettings(mesh=settings.mesh, reach=settings.reach).of_mesh(mesh.own)
    with local_copy(mesh.source) as path:
        task = Labelling.read(
            path, settings.model, settings.sampling, own.reach, None, own.mesh, force=force
        )
    labels = task.labels()
    return settings.swept(mesh.name, labels.angle_distribution(), "label"), labels.warnings


def sweep_shape(name: str, settings: SweepSettings) -> Fractions:
    """Compute the area fractions of a shape in closed form.

    Args:
        name: A key of `SHAPES`.
        settings: Frictions and sensor resolutions, for two fingers.

    Raises:
        SettingError: The settings are for more fingers.
    """
    if settings.fingers != 2:
        raise SettingError(
            f"{name} is known in closed form for two fingers only; got {settings.fingers}"
        )
    return settings.swept(name, SHAPES[name](), "scan")


def _outputs(command: Sweep, shapes: list[str], meshes: list[MeshFile]) -> tuple[Path, Path]:
    """Return the paths of table and figure, after checking that they can be written."""
    names = [*shapes, *(mesh.name for mesh in meshes)]
    stem = f"{safe_stem(Path(names[0]).stem)}_sweep" if len(names) == 1 else "sweep"
    table = command.output or Path(f"{stem}.csv")
    figure = table.with_suffix(".svg")
    sources = [local_path(mesh.source) for mesh in meshes]
    command.check_output(table, SUFFIXES, "table", inputs=sources)
    command.check_output(figure, METADATA, "figure", inputs=sources)
    return table, figure


def _print_sweeps(report: Report, sweeps: Sequence[Fractions], required: list[float]) -> None:
    """Print the area fractions at some of the resolutions, and the required resolutions.

    Args:
        report: Where to print.
        sweeps: Sweeps of shapes and meshes, at least one.
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
    """Return the coefficients of friction of words; see `_values`."""
    values = _values(lambda name, word: number(float, name, word), 1.0, "--friction", words)
    for value in values[:1] + values[-1:]:
        friction_interval(f"{value:g}")
    return values


def angles_in(words: Iterable[str]) -> tuple[float, ...]:
    """Return the angles [rad] of words; ranges are in degrees; see `_values`.

    Example:
        >>> from grasp3d.cli.sweep import angles_in
        >>> angles_in(["0:0.2:0.1", "0.1rad"])
        (0.0, 0.0017453292519943296, 0.003490658503988659, 0.1)
    """
    return _values(typed_angle, math.radians(1.0), "--sensor-resolution", words)


def _values(
    single: Callable[[str, str], float], scale: float, option: str, words: Iterable[str]
) -> tuple[float, ...]:
    """Return the sorted values of words: single values, and ranges FROM:TO:STEP with both ends.

    Args:
        single: Function that parses a single value.
        scale: Unit of the numbers in a range.
        option: Name of the option, for the error.
        words: The words.

    Raises:
        SettingError: A word is neither a value nor a range, or there are too many values.
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
