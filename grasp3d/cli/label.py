"""The command `grasp3d label`: labels one mesh and writes it."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from grasp3d.cli.options import (
    Force,
    InputFile,
    ModelOptions,
    OutputFile,
    Overwrite,
    Quiet,
    SamplingOptions,
    SurfaceOptions,
    command,
)
from grasp3d.cli.time_limit import DEFAULT_TIMEOUT, Timeout, check_timeout, time_limit
from grasp3d.errors import SettingError
from grasp3d.settings import GraspModel, MeshOptions, Sampling
from grasp3d.system.names import printable, safe_stem
from grasp3d.system.steps import begin_step

if TYPE_CHECKING:
    from grasp3d.surface.labels import SurfaceLabels


@command
@dataclass(frozen=True)
class Label:
    """Label one mesh: print area fractions of S, M and U, write the labelled mesh."""

    file: tyro.conf.Positional[InputFile]
    """Mesh file: STL, OBJ, PLY, OFF, GLB, 3MF, ..."""

    output: Annotated[OutputFile, tyro.conf.arg(aliases=["-o"])] = None
    """Labelled file (.ply, .glb, .npz, .vtp or .parquet) (default: NAME_labeled.ply in this
    folder)."""

    best: Annotated[int | None, tyro.conf.arg(metavar="INT", help_behavior_hint="")] = None
    """Number of best distinct grasps to print, and to write to NAME_grasps.json, with pictures in
    NAME_grasps.png, in the folder of the labelled file."""

    model: ModelOptions = field(default_factory=GraspModel)
    """Friction, sensor resolution and fingers."""

    sampling: SamplingOptions = field(default_factory=Sampling)
    """How candidate grasps are searched. A LENGTH is a number in the mesh's unit, or has a unit:
    80mm, 8cm, 0.08m, 3in."""

    mesh: SurfaceOptions = field(default_factory=MeshOptions)
    """How the mesh is read and prepared. A LENGTH is a number in the mesh's unit, or has a unit."""

    timeout: Timeout = DEFAULT_TIMEOUT

    force: Force = False

    overwrite: Overwrite = False

    quiet: Quiet = False

    def __post_init__(self) -> None:
        if self.best is not None and self.best < 1:
            raise SettingError(f"best must be at least 1; got {self.best}")
        check_timeout(self.timeout)

    def run(self) -> int:
        """Run the command, and return the exit code."""
        from grasp3d.cli import report
        from grasp3d.cli.existing_files import check_replaceable
        from grasp3d.export import writer_for

        name = safe_stem(self.file.stem) if self.output is None else self.output.stem
        output = self.output or Path(f"{name}_labeled.ply")
        write = writer_for(output)
        grasp_file = output.with_name(f"{name}_grasps.json")
        grasp_files = (grasp_file, grasp_file.with_suffix(".png")) if self.best else ()
        for path in (output, *grasp_files):
            check_replaceable(path, overwrite=self.overwrite, source=self.file)
        with time_limit(self.timeout, printable(str(self.file))):
            labels = self._labels((output, *grasp_files[:1]))
        write(output, labels)
        if not self.quiet:
            report.print_labels(labels, output)
        if self.best:
            self._write_best(labels, grasp_file, self.best)
        return 0

    def _labels(self, outputs: tuple[Path, ...]) -> "SurfaceLabels":
        """Read and label the mesh; `outputs` must not have been made with other settings."""
        from grasp3d.cli import report
        from grasp3d.cli.existing_files import check_same_settings
        from grasp3d.mesh import prepare_file
        from grasp3d.mesh.plausible_lengths import refuse_lengths
        from grasp3d.surface.labelling import label_surface

        mesh = prepare_file(self.file, self.mesh)
        model = self.model.in_unit(mesh.unit, source=mesh.report.source)
        sampling = self.sampling.in_unit(mesh.unit, source=mesh.report.source)
        if not self.force:
            refuse_lengths(mesh, model.lengths() | sampling.lengths())
        for path in outputs:
            check_same_settings(path, mesh, model, sampling, overwrite=self.overwrite)
        with report.progress(f"labelling {self.file.name}", quiet=self.quiet) as progress:
            labels = label_surface(mesh, model, sampling=sampling, progress=progress)
        begin_step("measuring epsilon")
        with report.progress("measuring epsilon", quiet=self.quiet) as progress:
            labels.compute_epsilon(progress)
        return labels

    def _write_best(self, labels: "SurfaceLabels", output: Path, count: int) -> None:
        """Print and write the best distinct grasps, and draw them if OpenGL is available."""
        from grasp3d.cli import grasp_report, report
        from grasp3d.grasps.distinct import best_grasps
        from grasp3d.grasps.writing import write_grasps
        from grasp3d.plots.formats import save_as
        from grasp3d.plots.grasps import draw_grasps, grasp_figure
        from grasp3d.rendering import can_render

        grasps = best_grasps(labels, count)
        write_grasps(output, grasps)
        drawn = grasps.size > 0 and can_render()
        if drawn:
            with report.progress("drawing grasps", quiet=self.quiet) as progress:
                pictures = draw_grasps(labels, grasps, progress=progress)
            save_as(grasp_figure(labels, grasps, pictures), output.with_suffix(".png"))
        if not self.quiet:
            grasp_report.print_best(grasps, count, output, drawn=drawn)
