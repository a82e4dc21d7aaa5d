"""`grasp3d batch`: a folder of meshes in, a folder of labelled meshes and a summary out."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from grasp3d.cli.options import ModelOptions, SamplingOptions, SurfaceOptions
from grasp3d.errors import SettingError
from grasp3d.settings import GraspModel, MeshOptions, Sampling

SUMMARY = "summary.parquet"


@dataclass(frozen=True)
class Batch:
    """Label every mesh of a library: one labelled PLY each, and a summary table."""

    inputs: Annotated[tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="FOLDER|FILE")]
    """Mesh files, and folders that are searched with all below them."""

    output: Annotated[Path, tyro.conf.arg(aliases=["-o"])]
    """Folder for the labelled meshes and summary.parquet."""

    workers: int | None = None
    """Processes to use; none: one per processor."""

    model: ModelOptions = field(default_factory=GraspModel)
    """Friction and touch."""

    sampling: SamplingOptions = field(default_factory=Sampling)
    """How candidate grasps are searched."""

    mesh: SurfaceOptions = field(default_factory=MeshOptions)
    """How the mesh is read and prepared."""

    quiet: Annotated[bool, tyro.conf.arg(aliases=["-q"]), tyro.conf.FlagCreatePairsOff] = False
    """Print nothing but errors."""

    def __post_init__(self) -> None:
        if not self.inputs:
            raise SettingError("no input: name a folder of meshes, or mesh files")
        if self.workers is not None and self.workers < 1:
            raise SettingError(f"workers must be at least 1; got {self.workers}")

    def run(self) -> int:
        """Do it; returns the exit code."""
        from grasp3d.batch.job import BatchSettings, label_file, lost_row  # noqa: PLC0415
        from grasp3d.batch.plan import make_folders, plan  # noqa: PLC0415
        from grasp3d.batch.run import run  # noqa: PLC0415
        from grasp3d.batch.store import write_summary  # noqa: PLC0415
        from grasp3d.cli import report  # noqa: PLC0415
        from grasp3d.files import check_writable  # noqa: PLC0415
        from grasp3d.processors import available_processors  # noqa: PLC0415

        jobs = plan(self.inputs, self.output)
        make_folders(jobs)
        check_writable(self.output / SUMMARY)
        settings = BatchSettings(self.model, self.sampling, self.mesh)
        rows = []
        with report.counter("labelling", len(jobs), quiet=self.quiet) as advance:
            try:
                workers = self.workers or available_processors()
                for row in run(label_file, jobs, settings, lost=lost_row, workers=workers):
                    rows.append(row)
                    advance()
            finally:  # also when interrupted: what is done is done
                write_summary(self.output / SUMMARY, rows, settings)
        if not self.quiet:
            report.print_batch(rows, self.output)
        return 1 if any(row.error for row in rows) else 0
