"""The command `grasp3d sweep`: area fractions of labels over two of the uncertainties."""

from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from grasp3d.batch.batch_settings import ClusterSettings
from grasp3d.cli.options import (
    Fingers,
    Flag,
    Force,
    FrictionErrorRanges,
    FrictionRanges,
    Inputs,
    LocationErrorRanges,
    MeshGroup,
    Multifinger,
    NormalErrorRanges,
    OutputFile,
    Overwrite,
    Quiet,
    ReachGroup,
    SearchGroup,
    SensorResolutionRanges,
    given_sampling,
)
from grasp3d.cli.ranges import (
    parse_angles,
    parse_frictions,
    parse_lengths,
    parse_numbers,
)
from grasp3d.cli.report import Report
from grasp3d.errors import GraspError, SettingError
from grasp3d.hand.reach_settings import ReachSettings
from grasp3d.settings import GraspModel, MeshOptions, MultifingerSampling, Sampling
from grasp3d.settings.parsing import plain_values
from grasp3d.system.names import safe_stem

if TYPE_CHECKING:
    from grasp3d.batch.sweeping import SweepSettings, SweptMesh, Target
    from grasp3d.surface.sweeps import Sweep as SweptFractions

FRICTIONS, RESOLUTIONS = ("0.2", "0.5", "1.0"), ("0:60:1", "22.6")
"""Default values of friction and sensor resolution."""

SHAPE_SIZE = 2.0
"""Size of the shapes in closed form, in radii."""

MAX_ROWS = 4
"""Rows of a sweep with axes other than friction and resolution that are drawn one by one."""


@dataclass(frozen=True)
class Sweep:
    """Compute area fractions of S, M and U over friction and sensor resolution.

    Or over any two of the uncertainties: those that have several values. Also prints the sensor
    resolution that is required for given area fractions of S. Each mesh is labelled once, and once
    more for each further location error, at most five times; for a folder the mean over its meshes
    is added. Writes a table and a figure.
    """

    targets: Annotated[Inputs, tyro.conf.arg(metavar="PATH|circle|square|sphere [...]")]
    """To be given before the options. Mesh files, folders, which are searched recursively, globs in
    quotes such as 'lib/**/*.stl', lists of these (.txt, one per line); also on an object store
    (s3://BUCKET/FOLDER). Shapes in closed form with one finger fixed: circle, square (in the middle
    of a side) and sphere; ./circle is a file or folder. Shapes have two fingers."""

    output: Annotated[OutputFile, tyro.conf.arg(aliases=["-o"])] = None
    """Table (.csv or .parquet) (default: NAME_sweep.csv in this folder, sweep.csv for several
    targets)."""

    figure: OutputFile = None
    """Figure (.svg, .png or .pdf) (default: the name of the table with the suffix .svg)."""

    friction: FrictionRanges = FRICTIONS

    sensor_resolution: SensorResolutionRanges = RESOLUTIONS

    friction_error: FrictionErrorRanges = ("0",)

    normal_error: NormalErrorRanges = ("0",)

    location_error: LocationErrorRanges = ("0",)
    """Largest distance between the true and the perceived contact point, a length; for shapes in
    closed form as a part of their radius or half side. Where errors have several values, those of
    friction and sensor resolution are 0.5 and 22.6 unless they are given."""

    heat_map: Flag = False
    """Draw S and M as heat maps over both axes, also for friction and sensor resolution, and for
    four rows or fewer, which otherwise have a panel each."""

    fraction: tuple[float, ...] = (0.5, 0.9)
    """Area fractions of S, above 0 and at most 1. For each the required sensor resolution is
    printed: at any smaller one at least this fraction of the surface is S."""

    fingers: Fingers = 2

    sampling: SearchGroup = field(default_factory=Sampling)

    multifinger: Multifinger = field(default_factory=MultifingerSampling)

    reach: ReachGroup = field(default_factory=ReachSettings)

    mesh: MeshGroup = field(default_factory=MeshOptions)

    cluster: ClusterSettings = field(default_factory=ClusterSettings)
    """Which processes label the meshes, if there are several."""

    force: Force = False

    overwrite: Overwrite = False

    quiet: Quiet = False

    def __post_init__(self) -> None:
        for fraction in self.fraction:
            if not 0.0 < fraction <= 1.0:
                raise SettingError(f"each fraction must be above 0 and at most 1; got {fraction:g}")

    def run(self) -> int:
        """Run the command, and return the exit code."""
        from grasp3d.batch.sweeping import (
            SweepSettings,
            check_fingers,
            find_targets,
            gather,
        )
        from grasp3d.cli import sweep_report
        from grasp3d.surface.sweeps import write_sweeps

        settings = SweepSettings(
            sampling=given_sampling(self.sampling, self.multifinger),
            mesh=self.mesh,
            fingers=self.fingers,
            reach=self.reach,
            **self._values,
        )
        fractions = sorted(set(self.fraction))
        targets = find_targets(self.targets)
        check_fingers(targets, settings)
        self._check_shapes(targets, settings)
        table, figure = self._outputs(targets)
        meshes = self._swept(targets, settings)
        failures = {mesh.name: mesh.error for mesh in meshes if mesh.error}
        swept = gather(targets, meshes, settings)
        every = list(dict.fromkeys(sweep for target in swept for sweep in target.sweeps))
        sweeps = list(dict.fromkeys(sweep for target in swept for sweep in target.shown))
        write_sweeps(
            table, every, fractions=fractions, failures=failures, settings=plain_values(settings)
        )
        if sweeps:
            members = {target.name: target.members for target in swept if target.members}
            self._draw(sweeps, members, figure)
        if not self.quiet:
            sweep_report.print_sweeps(swept, fractions)
            sweep_report.print_notes(targets, meshes, fractions)
            Report().written(table, *([figure] if sweeps else []))
        return 1 if failures else 0

    @property
    def _values(self) -> dict[str, Any]:
        """Values of each uncertainty; errors with several values leave one for the defaults."""
        errors: dict[str, tuple[Any, ...]] = {
            "friction_error": parse_numbers("--friction-error", self.friction_error),
            "normal_error": parse_angles("--normal-error", self.normal_error),
            "location_error": parse_lengths("--location-error", self.location_error),
        }
        free = 2 - sum(len(set(values)) > 1 for values in errors.values())
        friction = parse_frictions("--friction", self.friction)
        resolution = parse_angles("--sensor-resolution", self.sensor_resolution)
        default = GraspModel()
        if self.friction == FRICTIONS and (free < 1 or (free < 2 and len(resolution) > 1)):
            friction = (default.friction,)
        if self.sensor_resolution == RESOLUTIONS and (free < 1 or (free < 2 and len(friction) > 1)):
            resolution = (default.sensor_resolution,)
        return {"friction": friction, "sensor_resolution": resolution, **errors}

    def _check_shapes(self, targets: list["Target"], settings: "SweepSettings") -> None:
        """Refuse location errors that cannot be meant for shapes, as for meshes."""
        shapes = [target.name for target in targets if not target.files and not target.folder]
        axes = settings.axes
        largest = float(axes.values["location_error"][-1])
        if shapes and axes.unit is None and largest > SHAPE_SIZE and not self.force:
            raise SettingError(
                f"location_error is {largest:.4g}, more than {shapes[0]} is large: for shapes in "
                "closed form it is a part of the radius or half side, such as 0.05; give a smaller "
                "one, or accept it with --force"
            )

    def _draw(
        self,
        sweeps: list["SweptFractions"],
        members: dict[str, tuple["SweptFractions", ...]],
        path: Path,
    ) -> None:
        """Write the figure."""
        from grasp3d.plots.figures import save_as

        fractions = sorted(set(self.fraction))
        first = sweeps[0]
        several = min(first.stable.shape) > 1
        many = len(first.stable) > MAX_ROWS and not first.axes.is_default
        if several and (self.heat_map or many):
            from grasp3d.plots.heat_maps import heat_map_figure

            save_as(heat_map_figure(sweeps, fractions=fractions), path)
            return
        from grasp3d.plots.fractions import sweep_figure

        save_as(sweep_figure(sweeps, members=members, fractions=fractions), path)

    def _outputs(self, targets: list["Target"]) -> tuple[Path, Path]:
        """Return the paths of table and figure, checked to be writable and not to be meshes."""
        from grasp3d.batch.storage import local_path
        from grasp3d.batch.sweeping import meshes_of
        from grasp3d.cli.existing_files import check_output
        from grasp3d.plots.figures import METADATA
        from grasp3d.system.tables import SUFFIXES

        path = Path(targets[0].name)
        name = safe_stem(path.name if targets[0].folder else path.stem)
        table = self.output or Path(f"{name}_sweep.csv" if len(targets) == 1 else "sweep.csv")
        figure = self.figure or table.with_suffix(".svg")
        sources = [local_path(mesh.source) for mesh in meshes_of(targets)]
        check_output(table, SUFFIXES, "table", overwrite=self.overwrite, sources=sources)
        check_output(figure, METADATA, "figure", overwrite=self.overwrite, sources=sources)
        return table, figure

    def _swept(self, targets: list["Target"], settings: "SweepSettings") -> list["SweptMesh"]:
        """Sweep each mesh once: a single mesh in this process, several in child processes."""
        from grasp3d.batch.sweeping import lost_mesh, meshes_of, sweep_mesh, sweep_on_one_thread
        from grasp3d.cli import progress_bars

        meshes = meshes_of(targets)
        if len(meshes) == 1 and not any(target.folder for target in targets):
            text = f"labelling {meshes[0].name}"
            with progress_bars.progress(text, quiet=self.quiet):
                swept = sweep_mesh(meshes[0], settings, force=self.force)
            if swept.error:
                raise GraspError(swept.error)
            return [swept]
        if not meshes:
            return []
        from grasp3d.batch.run import run

        rows = []
        with progress_bars.counter("sweeping", len(meshes), quiet=self.quiet) as advance:
            one_thread = partial(sweep_on_one_thread, force=self.force)
            sweeps = run(
                one_thread, meshes, settings, lost=lost_mesh, cluster=self.cluster,
                kernels=self.fingers,
            )  # fmt: skip
            for row in sweeps:
                rows.append(row)
                advance()
        return sorted(rows, key=lambda row: row.name)
