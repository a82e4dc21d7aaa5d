"""The command `grasp3d label`: labels one mesh and writes it."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from grasp3d.cli.options import ModelOptions, Quiet, SamplingOptions, SurfaceOptions
from grasp3d.errors import SettingError
from grasp3d.settings import GraspModel, MeshOptions, Sampling
from grasp3d.system.names import safe_stem

if TYPE_CHECKING:
    from grasp3d.surface.labels import SurfaceLabels


@dataclass(frozen=True)
class Label:
    """Label one mesh: print the area fractions of S, M and U, and write the labelled mesh."""

    file: tyro.conf.Positional[Path]
    """Mesh file: STL, OBJ, PLY, OFF, GLB, 3MF, ..."""

    output: Annotated[Path | None, tyro.conf.arg(aliases=["-o"])] = None
    """Labelled file (.ply, .glb, .npz, .vtp or .parquet); none: NAME_labeled.ply in this folder."""

    best: int | None = None
    """Number of best distinct grasps to print, and to write to NAME_grasps.json, with pictures in
    NAME_grasps.png, in the folder of the labelled file."""

    model: ModelOptions = field(default_factory=GraspModel)
    """Friction, sensor resolution and fingers."""

    sampling: SamplingOptions = field(default_factory=Sampling)
    """How candidate grasps are searched."""

    mesh: SurfaceOptions = field(default_factory=MeshOptions)
    """How the mesh is read and prepared."""

    quiet: Quiet = False

    def __post_init__(self) -> None:
        if self.best is not None and self.best < 1:
            raise SettingError(f"best must be at least 1; got {self.best}")

    def run(self) -> int:
        """Run the command, and return the exit code."""
        from grasp3d.cli import report
        from grasp3d.export import writer_for
        from grasp3d.mesh import prepare_file
        from grasp3d.surface.labelling import label_surface
        from grasp3d.system.files import check_writable

        name = safe_stem(self.file.stem) if self.output is None else self.output.stem
        output = self.output or Path(f"{name}_labeled.ply")
        write = writer_for(output)
        mesh = prepare_file(self.file, self.mesh)
        grasp_file = output.with_name(f"{name}_grasps.json")
        grasp_files = (grasp_file, grasp_file.with_suffix(".png")) if self.best else ()
        for path in (output, *grasp_files):
            check_writable(path, source=self.file)
        with report.progress(f"labelling {self.file.name}", quiet=self.quiet) as progress:
            labels = label_surface(mesh, self.model, sampling=self.sampling, progress=progress)
        with report.progress("measuring epsilon", quiet=self.quiet) as progress:
            labels.compute_epsilon(progress)
        write(output, labels)
        if not self.quiet:
            report.print_labels(labels, output)
        if self.best:
            self._write_best(labels, grasp_file, self.best)
        return 0

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
