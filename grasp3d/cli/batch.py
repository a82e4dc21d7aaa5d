"""`grasp3d batch`: a library of meshes in; labelled meshes, tables and a report out."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType
from typing import Annotated

import tyro

from grasp3d.batch.batch_settings import BatchSettings, ClusterSettings, FractionGrid
from grasp3d.cli.options import ClusterOptions, ModelOptions, SamplingOptions, SurfaceOptions
from grasp3d.cli.ranges import resolutions
from grasp3d.errors import SettingError
from grasp3d.settings import GraspModel, MeshOptions, Sampling


@dataclass(frozen=True)
class Batch:
    """Label every mesh of a library, and write a summary and a report.

    It goes on where an earlier run of the same command ended: meshes whose content and settings are
    unchanged are not labelled again.
    """

    inputs: Annotated[
        tuple[str, ...],
        tyro.conf.Positional,
        tyro.conf.arg(metavar="FOLDER|FILE|GLOB|LIST.txt|URL"),
    ]
    """Folders that are searched with all below them, mesh files, globs in quotes, lists of these
    (.txt, a line each); also on an object store (s3://BUCKET/FOLDER)."""

    output: Annotated[str, tyro.conf.arg(aliases=["-o"])]
    """Folder for the results: labels/, fields/, summary/ and report/; also on an object store."""

    cluster: ClusterOptions = field(default_factory=ClusterSettings)
    """Who does the work."""

    force: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Label all anew."""

    grid_friction: tuple[float, ...] = ()
    """Coulomb coefficients at which shares are taken besides labels; none: that of the model."""

    grid_sensor_resolution: Annotated[
        tuple[str, ...], tyro.conf.arg(metavar="DEGREES|FROM:TO:STEP [...]")
    ] = ()
    """Sensor resolutions in degrees at which shares are taken: numbers, and ranges with both ends;
    none: 0:60:5 and that of the model, M and U as far as grasps are searched. Grasps are searched
    as widely as a grid that is given needs."""

    best: int = 5
    """Best distinct grasps that the summary keeps of each mesh; 0: none."""

    report: bool = True
    """Write report/index.html."""

    log: Path | None = None
    """File that a line for each mesh is added to."""

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

    def run(self) -> int:
        """Do it; returns the exit code."""
        from grasp3d.batch.library import label_library
        from grasp3d.cli import batch_report
        from grasp3d.cli.batch_progress import batch_progress

        grid = FractionGrid(self.grid_friction, resolutions(self.grid_sensor_resolution))
        settings = BatchSettings(self.model, self.sampling, self.mesh, grid, self.best)
        with batch_progress(quiet=self.quiet, log=self.log) as watch, _interrupted_once():
            try:
                library = label_library(
                    self.inputs,
                    self.output,
                    settings,
                    cluster=self.cluster,
                    force=self.force,
                    report=self.report,
                    watch=watch,
                )
            except KeyboardInterrupt as stop:
                raise KeyboardInterrupt(f"{watch.counts}; {self._kept}") from stop
        if self.quiet:
            batch_report.print_failed(library)
        else:
            batch_report.print_library(library, report=self.report)
        return 1 if library.failed else 0

    @property
    def _kept(self) -> str:
        """What is left of an interrupted run."""
        if self.force:
            return "what is labelled is kept, the same command without --force goes on from there"
        return "what is labelled is kept, the same command goes on from there"


@contextmanager
def _interrupted_once() -> Iterator[None]:
    """Take Ctrl-C, or the signal by which clusters end a job, once: then the run ends in order."""
    signals = (signal.SIGINT, signal.SIGTERM)

    def interrupt(_number: int, _frame: FrameType | None) -> None:
        for number in signals:
            signal.signal(number, signal.SIG_IGN)
        raise KeyboardInterrupt

    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = [signal.signal(number, interrupt) for number in signals]
    try:
        yield
    finally:
        if signal.getsignal(signal.SIGINT) is interrupt:  # nobody did
            for number, handler in zip(signals, before, strict=True):
                signal.signal(number, handler)
