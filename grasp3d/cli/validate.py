"""The command `grasp3d validate`: holds labels and scores against what became of grasps."""

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from grasp3d.cli.options import (
    Overwrite,
    Quiet,
    ValidatedModel,
    ValidationGroup,
)
from grasp3d.cli.ranges import parse_angles, parse_frictions
from grasp3d.errors import OutputError
from grasp3d.hand.choices import ObjectMotion
from grasp3d.hand.reach_settings import ReachSettings
from grasp3d.quality.loads import Load
from grasp3d.settings import GraspModel, MeshOptions
from grasp3d.validating.validation_settings import ValidationSettings

if TYPE_CHECKING:
    from grasp3d.validating.validation import Validation


@dataclass(frozen=True)
class Validate:
    """Compare labels and scores of grasps with what became of them.

    Closes the gripper's jaws at poses of which it is known whether the grasp held, and prints how
    well label, margin, epsilon, grip force and simpler scores predict it: area under the ROC curve,
    success within S, M and U, calibration of the margin, and the greatest disagreements.
    """

    grasps: Annotated[
        tuple[Path, ...],
        tyro.conf.Positional,
        tyro.conf.arg(metavar="GRASPS [GRASPS ...]", help_behavior_hint=""),
    ]
    """Files of poses with outcomes: tables (.csv, .parquet) with px py pz qx qy qz qw and a column
    success (or outcome) of 1 or 0, true or false, yes or no, empty where it was not tried; ACRONYM
    (.h5); GraspGen and the files that grasp3d writes (.json)."""

    output: Annotated[
        Path | None, tyro.conf.arg(aliases=["-o"], metavar="FOLDER", help_behavior_hint="")
    ] = None
    """Folder for the report: report.html, with figures and pictures, and its tables as CSV
    (default: only prints)."""

    mesh_file: Annotated[
        Path | None, tyro.conf.arg(name="mesh", metavar="FILE", help_behavior_hint="")
    ] = None
    """Mesh of the object of all grasps (default: the one that each file of grasps names, in the
    scale that it states)."""

    meshes: Annotated[Path | None, tyro.conf.arg(metavar="FOLDER", help_behavior_hint="")] = None
    """Folder in which these meshes are looked up, by their path, then by their base name (default:
    the folder of each file of grasps)."""

    frictions: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NUMBER|FROM:TO:STEP [...]")] = (
        "0.3",
        "0.5",
        "1.0",
    )
    """Coefficients of friction of the table of S, M and U."""

    sensor_resolutions: Annotated[
        tuple[str, ...], tyro.conf.arg(metavar="DEGREES|FROM:TO:STEP [...]")
    ] = ("0", "10", "22.6", "40")
    """Sensor resolutions of that table."""

    statistics: ValidationGroup = field(default_factory=ValidationSettings)
    """What is computed from outcomes, and listed."""

    model: ValidatedModel = field(default_factory=GraspModel)
    """Friction and sensor resolution of label, margin, epsilon and grip force."""

    reach: ReachSettings = field(default_factory=ReachSettings)
    """The gripper of the poses, unless their files state a known one (ACRONYM: the Franka hand),
    and what the objects stand on."""

    load: Load = field(default_factory=Load)
    """What each grasp must hold; without a mass or density that of the file, if it states one."""

    surface: MeshOptions = field(default_factory=MeshOptions)
    """How meshes are read and prepared. A LENGTH is a number in the mesh's unit, or has a unit."""

    object_motion: ObjectMotion = "free"
    """Whether objects give way to the closing jaws: they settle between them, or do not move."""

    overwrite: Overwrite = False

    quiet: Quiet = False

    def run(self) -> int:
        """Run the command, and return the exit code."""
        from grasp3d.cli import validate_report

        settings = replace(
            self.statistics,
            frictions=parse_frictions("--frictions", self.frictions),
            sensor_resolutions=parse_angles("--sensor-resolutions", self.sensor_resolutions),
        )
        self._check_output()
        validation = self._validate(settings)
        if self.output is not None:
            self._write(validation, self.output)
        if not self.quiet:
            validate_report.print_validation(validation, self.output)
        return 0

    def _check_output(self) -> None:
        """Check that the report can be written, and replaces no file of others."""
        from grasp3d.cli.existing_files import check_replaceable
        from grasp3d.plots.validation_page import FILES
        from grasp3d.system.files import check_writable

        if self.output is None:
            return
        if not self.output.exists():
            check_writable(self.output)
            return
        if not self.output.is_dir():
            raise OutputError(f"{self.output}: is a file; name a folder")
        for path in (self.output / name for name in FILES):
            check_replaceable(path, overwrite=self.overwrite)
            if any(path.exists() and file.exists() and path.samefile(file) for file in self.grasps):
                raise OutputError(f"{path}: is a file of grasps; name another folder with -o")

    def _validate(self, settings: ValidationSettings) -> "Validation":
        """Evaluate the grasps, and compare the scores with the outcomes."""
        from grasp3d.cli import progress_bars
        from grasp3d.system.counts import counted
        from grasp3d.validating.validate import validate_grasps

        name = self.grasps[0].name if len(self.grasps) == 1 else counted(len(self.grasps), "files")
        with progress_bars.progress(f"evaluating {name}", quiet=self.quiet):
            return validate_grasps(
                self.grasps,
                self.model,
                mesh=self.mesh_file,
                meshes=self.meshes,
                options=self.surface,
                reach=self.reach,
                object_motion=self.object_motion,
                load=self.load.chosen,
                settings=settings,
            )

    def _write(self, validation: "Validation", folder: Path) -> None:
        """Write the report."""
        from grasp3d.cli import progress_bars
        from grasp3d.plots.validation_page import write_report

        with progress_bars.progress("drawing the report", quiet=self.quiet):
            write_report(folder, validation)
