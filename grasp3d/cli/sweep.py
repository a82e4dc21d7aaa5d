"""`grasp3d sweep`: how much of an object is reliably graspable, over friction and resolution."""

from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from grasp3d.batch.batch_settings import ClusterSettings
from grasp3d.cli.options import ClusterOptions, SamplingOptions, SurfaceOptions
from grasp3d.cli.ranges import resolutions
from grasp3d.errors import GraspError, SettingError
from grasp3d.settings import MeshOptions, Sampling
from grasp3d.system.names import safe_stem

if TYPE_CHECKING:
    from grasp3d.batch.sweeping import SweepSettings, SweptMesh, Target


@dataclass(frozen=True)
class Sweep:
    """Sweep friction and sensor resolution: shares of S, M and U, and how fine a sensor must be.

    Every mesh is labelled once; a folder is swept mesh by mesh, with the mean over its meshes.
    Writes a table and a figure.
    """

    targets: Annotated[
        tuple[str, ...],
        tyro.conf.Positional,
        tyro.conf.arg(metavar="FILE|FOLDER|PATTERN|LIST.txt|circle|square|sphere"),
    ]
    """Name them before the options. Mesh files, folders that are searched with all below them,
    patterns for files in quotes as 'lib/**/*.stl', lists of these, one in each line, addresses of
    all of them such as s3://bucket/lib, and shapes in closed form with one finger fixed: circle,
    square (in the middle of a side) and sphere. ./circle is a file or a folder."""

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

    sampling: SamplingOptions = field(default_factory=Sampling)
    """How candidate grasps are searched."""

    mesh: SurfaceOptions = field(default_factory=MeshOptions)
    """How the mesh is read and prepared."""

    cluster: ClusterOptions = field(default_factory=ClusterSettings)
    """Who does the work where there are several meshes."""

    quiet: Annotated[bool, tyro.conf.arg(aliases=["-q"]), tyro.conf.FlagCreatePairsOff] = False
    """Print nothing but errors."""

    def __post_init__(self) -> None:
        for share in self.share:
            if not 0.0 < share <= 1.0:
                raise SettingError(f"each share must be above 0 and at most 1; got {share:g}")

    def run(self) -> int:
        """Do it; returns the exit code."""
        from grasp3d.batch.sweeping import (
            SweepSettings,
            check_fingers,
            find_targets,
            gather,
        )
        from grasp3d.cli import sweep_report
        from grasp3d.plots.formats import save_as
        from grasp3d.plots.fractions import sweep_figure
        from grasp3d.sweeps import write_sweeps

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
        from grasp3d.batch.sweeping import meshes_of
        from grasp3d.plots.formats import METADATA
        from grasp3d.storage import local_path
        from grasp3d.system.files import check_suffix, check_writable
        from grasp3d.tables import SUFFIXES

        path = Path(targets[0].name)
        name = safe_stem(path.name if targets[0].folder else path.stem)
        table = self.output or Path(f"{name}_sweep.csv" if len(targets) == 1 else "sweep.csv")
        check_suffix(table, SUFFIXES, "table")
        figure = self.figure or table.with_suffix(".svg")
        check_suffix(figure, METADATA, "figure")
        for path in (table, figure):
            check_writable(path)
            for mesh in meshes_of(targets):
                check_writable(path, source=local_path(mesh.source))
        return table, figure

    def _swept(self, targets: list["Target"], settings: "SweepSettings") -> list["SweptMesh"]:
        """Sweep the meshes, each once: one alone in this process, several in processes."""
        from grasp3d.batch.sweeping import lost_mesh, meshes_of, sweep_mesh
        from grasp3d.cli import report

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
        from grasp3d.batch.run import run

        rows = []
        with report.counter("sweeping", len(meshes), quiet=self.quiet) as advance:
            for row in run(sweep_mesh, meshes, settings, lost=lost_mesh, cluster=self.cluster):
                rows.append(row)
                advance()
        return sorted(rows, key=lambda row: row.name)
