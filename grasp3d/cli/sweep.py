"""`grasp3d sweep`: how much of an object is reliably graspable, over friction and resolution."""

import math
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from grasp3d.cli.options import SamplingOptions, SurfaceOptions
from grasp3d.errors import GraspError, SettingError
from grasp3d.names import safe_stem
from grasp3d.settings import MeshOptions, Sampling

if TYPE_CHECKING:
    from grasp3d.batch.sweeping import SweepSettings, SweptMesh, Target

MOST_RESOLUTIONS = 10_000


@dataclass(frozen=True)
class Sweep:
    """Sweep friction and sensor resolution: shares of S, M and U, and how fine a sensor must be.

    Every mesh is labelled once; a folder is swept mesh by mesh, with the mean over its meshes.
    Writes a table and a figure.
    """

    targets: Annotated[
        tuple[str, ...],
        tyro.conf.Positional,
        tyro.conf.arg(metavar="FILE|FOLDER|circle|square|sphere"),
    ]
    """Name them before the options. Mesh files, folders that are searched with all below them,
    and shapes in closed form with one finger fixed: circle, square (in the middle of a side) and
    sphere. ./circle is a file or a folder."""

    output: Annotated[Path | None, tyro.conf.arg(aliases=["-o"])] = None
    """Table (.csv or .parquet); none: NAME_sweep.csv in this folder, of several sweep.csv."""

    figure: Path | None = None
    """Figure (.svg, .png or .pdf); none: beside the table, as .svg."""

    friction: tuple[float, ...] = (0.2, 0.5, 1.0)
    """Coulomb coefficients of friction, above 0."""

    sensor_resolution: Annotated[
        tuple[str, ...], tyro.conf.arg(metavar="DEGREES|FROM:TO:STEP [...]")
    ] = ("0:60:1", "22.6")
    """Sensor resolutions alpha in degrees, from 0 to below 180: numbers, and ranges with both
    ends."""

    share: tuple[float, ...] = (0.5, 0.9)
    """Shares of the surface, above 0 and at most 1: prints the resolution that each requires; with
    any finer sensor so much of the surface is S."""

    fingers: int = 2
    """Fingers of a grasp, 2 to 5; of circle, square and sphere 2."""

    workers: int | None = None
    """Processes to use for several meshes; none: one per processor."""

    sampling: SamplingOptions = field(default_factory=Sampling)
    """How candidate grasps are searched."""

    mesh: SurfaceOptions = field(default_factory=MeshOptions)
    """How the mesh is read and prepared."""

    quiet: Annotated[bool, tyro.conf.arg(aliases=["-q"]), tyro.conf.FlagCreatePairsOff] = False
    """Print nothing but errors."""

    def __post_init__(self) -> None:
        for share in self.share:
            if not 0.0 < share <= 1.0:
                raise SettingError(f"each share must be above 0 and at most 1; got {share:g}")
        if self.workers is not None and self.workers < 1:
            raise SettingError(f"workers must be at least 1; got {self.workers}")

    def run(self) -> int:
        """Do it; returns the exit code."""
        from grasp3d.batch.sweeping import (  # noqa: PLC0415
            SweepSettings,
            check_fingers,
            find_targets,
            gather,
        )
        from grasp3d.cli import sweep_report  # noqa: PLC0415
        from grasp3d.plots.formats import save_as  # noqa: PLC0415
        from grasp3d.plots.fractions import sweep_figure  # noqa: PLC0415
        from grasp3d.sweeps import write_sweeps  # noqa: PLC0415

        settings = SweepSettings(
            tuple(sorted(set(self.friction))),
            resolutions(self.sensor_resolution),
            self.sampling,
            self.mesh,
            self.fingers,
        )
        shares = sorted(set(self.share))
        targets = find_targets(self.targets)
        check_fingers(targets, settings)
        table, figure = self._outputs(targets)
        meshes = self._swept(targets, settings)
        failures = {mesh.name: mesh.error for mesh in meshes if mesh.error}
        swept = gather(targets, meshes, settings)
        every = list(dict.fromkeys(one for target in swept for one in target.sweeps))
        shown = list(dict.fromkeys(one for target in swept for one in target.shown))
        write_sweeps(table, every, shares=shares, failures=failures, settings=asdict(settings))
        if shown:
            members = {target.name: target.members for target in swept if target.members}
            save_as(sweep_figure(shown, members=members, shares=shares), figure)
        if not self.quiet:
            sweep_report.print_sweeps(swept, shares)
            sweep_report.print_notes(targets, meshes, shares)
            sweep_report.print_written([table, *([figure] if shown else [])])
        return 1 if failures else 0

    def _outputs(self, targets: list["Target"]) -> tuple[Path, Path]:
        """Table and figure to write; both can be written, and neither is one of the meshes."""
        from grasp3d.batch.sweeping import meshes_of  # noqa: PLC0415
        from grasp3d.files import check_suffix, check_writable  # noqa: PLC0415
        from grasp3d.plots.formats import METADATA  # noqa: PLC0415
        from grasp3d.tables import SUFFIXES  # noqa: PLC0415

        path = Path(targets[0].name)
        name = safe_stem(path.name if targets[0].folder else path.stem)
        table = self.output or Path(f"{name}_sweep.csv" if len(targets) == 1 else "sweep.csv")
        check_suffix(table, SUFFIXES, "table")
        figure = self.figure or table.with_suffix(".svg")
        check_suffix(figure, METADATA, "figure")
        for path in (table, figure):
            check_writable(path)
            for mesh in meshes_of(targets):
                check_writable(path, source=mesh.source)
        return table, figure

    def _swept(self, targets: list["Target"], settings: "SweepSettings") -> list["SweptMesh"]:
        """Sweep the meshes, each once: one alone in this process, several in processes."""
        from grasp3d.batch.sweeping import lost_mesh, meshes_of, sweep_mesh  # noqa: PLC0415
        from grasp3d.cli import report  # noqa: PLC0415
        from grasp3d.processors import available_processors  # noqa: PLC0415

        meshes = meshes_of(targets)
        if len(meshes) == 1 and not any(target.folder for target in targets):
            text = f"labelling {meshes[0].name}"
            with report.progress(text, quiet=self.quiet) as progress:
                swept = sweep_mesh(meshes[0], settings, threads=None, progress=progress)
            if swept.error:
                raise GraspError(swept.error)
            return [swept]
        if not meshes:
            return []
        from grasp3d.batch.run import run  # noqa: PLC0415

        rows = []
        with report.counter("sweeping", len(meshes), quiet=self.quiet) as advance:
            workers = self.workers or available_processors()
            for row in run(sweep_mesh, meshes, settings, lost=lost_mesh, workers=workers):
                rows.append(row)
                advance()
        return sorted(rows, key=lambda row: row.name)


def resolutions(words: tuple[str, ...]) -> tuple[float, ...]:
    """Read sensor resolutions: numbers and ranges FROM:TO:STEP in degrees.

    Args:
        words: As on the command line.

    Returns:
        In radians, in increasing order, each once.

    Raises:
        SettingError: A word is neither, or there are too many resolutions.
    """
    degrees: set[float] = set()
    for word in words:
        degrees.update(_range(word))
        if len(degrees) > MOST_RESOLUTIONS:
            raise SettingError(f"sensor resolutions: more than {MOST_RESOLUTIONS} ({word})")
    return tuple(math.radians(degree) for degree in sorted(degrees))


def _range(word: str) -> list[float]:
    """Degrees that one word stands for."""
    wanted = f"sensor resolution {word!r}: a number of degrees, or FROM:TO:STEP with STEP above 0"
    try:
        numbers = [float(part) for part in word.split(":")]
    except ValueError as error:
        raise SettingError(wanted) from error
    if len(numbers) == 1:
        return numbers
    if len(numbers) != len(("from", "to", "step")) or not all(map(math.isfinite, numbers)):
        raise SettingError(wanted)
    first, last, step = numbers
    if not (step > 0.0 and first <= last):
        raise SettingError(wanted)
    count = min(int((last - first) / step + 1e-9), MOST_RESOLUTIONS) + 1
    return [round(first + step * index, 9) for index in range(count)]
