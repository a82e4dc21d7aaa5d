"""`grasp3d batch`: labels a library of meshes, and writes tables and a report."""

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
from grasp3d.cli.options import (
    Flag,
    Force,
    Inputs,
    LoadGroup,
    MeshGroup,
    Multifinger,
    OutputFile,
    Quiet,
    ReachGroup,
    SearchGroup,
    given_sampling,
)
from grasp3d.cli.ranges import parse_angles, parse_frictions, parse_lengths, parse_numbers
from grasp3d.errors import SettingError
from grasp3d.hand.reach_settings import ReachSettings
from grasp3d.quality.loads import Load
from grasp3d.settings import GraspModel, MeshOptions, MultifingerSampling, Sampling


@dataclass(frozen=True)
class Batch:
    """Label every mesh of a library, and write a summary and a report.

    It resumes an earlier run of the same command: meshes whose content and settings are unchanged
    are not labelled again.
    """

    inputs: Inputs

    output: Annotated[str, tyro.conf.arg(aliases=["-o"], metavar="FOLDER")]
    """Folder for the results: labels/, fields/, summary/ and report/; also on an object store."""

    cluster: ClusterSettings = field(default_factory=ClusterSettings)
    """Which processes label the meshes."""

    overwrite: Flag = False
    """Label all meshes again, and remove labels of other meshes made with other settings."""

    force: Force = False

    grid_friction: Annotated[
        tuple[str, ...], tyro.conf.arg(metavar="NUMBER|FROM:TO:STEP", help_behavior_hint="")
    ] = ()
    """Coulomb coefficients at which area fractions are computed besides the labels (default: the
    model's)."""

    grid_sensor_resolution: Annotated[
        tuple[str, ...],
        tyro.conf.arg(metavar="DEGREES|FROM:TO:STEP", help_behavior_hint=""),
    ] = ()
    """Sensor resolutions in degrees at which area fractions are computed: numbers, and ranges that
    include both ends (default: 0:60:5 and the model's, with M and U only within the searched cone).
    A grid that is given makes the searched cone large enough for all of it."""

    grid_friction_error: Annotated[
        tuple[str, ...], tyro.conf.arg(metavar="NUMBER|FROM:TO:STEP", help_behavior_hint="")
    ] = ()
    """Errors of friction at which area fractions are computed (default: the model's)."""

    grid_normal_error: Annotated[
        tuple[str, ...], tyro.conf.arg(metavar="DEGREES|FROM:TO:STEP", help_behavior_hint="")
    ] = ()
    """Normal errors in degrees at which area fractions are computed (default: the model's)."""

    grid_location_error: Annotated[
        tuple[str, ...], tyro.conf.arg(metavar="LENGTH|FROM:TO:STEP", help_behavior_hint="")
    ] = ()
    """Location errors at which area fractions are computed, for the grasps found at the model's
    (default: the model's)."""

    best: int = 5
    """Number of best distinct grasps in the summary of each mesh; 0: none."""

    report: bool = True
    """Write report/index.html."""

    log: OutputFile = None
    """File to which a line for each mesh is appended."""

    model: GraspModel = field(default_factory=GraspModel)
    """Friction, sensor resolution and fingers."""

    sampling: SearchGroup = field(default_factory=Sampling)

    multifinger: Multifinger = field(default_factory=MultifingerSampling)

    reach: ReachGroup = field(default_factory=ReachSettings)

    load: LoadGroup = field(default_factory=Load)

    mesh: MeshGroup = field(default_factory=MeshOptions)

    quiet: Quiet = False

    def __post_init__(self) -> None:
        if not self.inputs:
            raise SettingError("no input: name a folder of meshes, or mesh files")

    def run(self) -> int:
        """Run the command; returns the exit code."""
        from grasp3d.batch.library import label_library
        from grasp3d.cli import batch_report
        from grasp3d.cli.existing_files import check_not_task

        for path in (Path(self.output), *([self.log] if self.log else [])):
            check_not_task(path, self.load)
        grid = FractionGrid(
            parse_frictions("--grid-friction", self.grid_friction),
            parse_angles("--grid-sensor-resolution", self.grid_sensor_resolution),
            parse_numbers("--grid-friction-error", self.grid_friction_error),
            parse_angles("--grid-normal-error", self.grid_normal_error),
            parse_lengths("--grid-location-error", self.grid_location_error),
        )
        settings = BatchSettings(
            self.reach.touching(self.model),
            given_sampling(self.sampling, self.multifinger),
            self.mesh,
            grid,
            self.best,
            self.reach,
            self.load.chosen,
        )
        with (
            batch_report.show_progress(quiet=self.quiet, log=self.log) as progress,
            _interrupted_once(),
        ):
            try:
                library = label_library(
                    self.inputs,
                    self.output,
                    settings,
                    cluster=self.cluster,
                    progress=progress,
                    overwrite=self.overwrite,
                    force=self.force,
                    report=self.report,
                )
            except KeyboardInterrupt as stop:
                raise KeyboardInterrupt(f"{progress.counts}; {self._how_to_resume}") from stop
        if self.quiet:
            batch_report.print_failed(library)
        else:
            batch_report.print_library(library, settings.model, report=self.report)
        return 1 if library.failed else 0

    @property
    def _how_to_resume(self) -> str:
        """How to resume an interrupted run."""
        if self.overwrite:
            return (
                "labelled meshes are stored; the same command without --overwrite labels the others"
            )
        return "labelled meshes are stored; the same command labels the others"


@contextmanager
def _interrupted_once() -> Iterator[None]:
    """End the run in order at the first Ctrl-C, or the signal by which clusters end a job."""
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
        if signal.getsignal(signal.SIGINT) is interrupt:  # not interrupted
            for number, handler in zip(signals, before, strict=True):
                signal.signal(number, handler)
