"""The command `grasp3d label`: labels one mesh and writes it."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from grasp3d.cli.options import (
    Force,
    InputFile,
    LoadGroup,
    MeshGroup,
    Multifinger,
    OutputFile,
    Overwrite,
    Quiet,
    ReachGroup,
    SearchGroup,
    given_sampling,
)
from grasp3d.cli.time_limit import DEFAULT_TIMEOUT, Timeout, check_timeout, time_limit
from grasp3d.errors import SettingError
from grasp3d.hand.reach_settings import ReachSettings
from grasp3d.quality.loads import Load
from grasp3d.settings import (
    GraspModel,
    MeshOptions,
    MultifingerSampling,
    PoseFormat,
    Sampling,
    check_per_finger,
)
from grasp3d.system.names import printable, safe_stem

if TYPE_CHECKING:
    from grasp3d.hand.hand import Hand
    from grasp3d.surface.labels import SurfaceLabels


@dataclass(frozen=True)
class Label:
    """Label one mesh: print area fractions of S, M and U, write the labelled mesh."""

    file: tyro.conf.Positional[InputFile]
    """Mesh file: STL, OBJ, PLY, OFF, GLB, 3MF, ..."""

    output: Annotated[OutputFile, tyro.conf.arg(aliases=["-o"])] = None
    """Labelled file (.ply, .glb, .npz, .vtp or .parquet) (default: NAME_labeled.ply in this
    folder)."""

    best: Annotated[int | None, tyro.conf.arg(metavar="INT", help_behavior_hint="")] = None
    """Number of best distinct grasps to print and to write to a file, with a picture (.png) of the
    same name beside it."""

    grasps: OutputFile = None
    """File of the best grasps (.json, .csv, .parquet; with a gripper also .yaml for isaac_grasp,
    .h5 for ACRONYM, .npy for graspnetAPI) (default: NAME_grasps.json in the folder of the labelled
    file)."""

    grasps_format: Annotated[PoseFormat | None, tyro.conf.arg(help_behavior_hint="")] = None
    """With a gripper: format of that file, for those that are JSON too (default: that of the
    file's suffix)."""

    model: GraspModel = field(default_factory=GraspModel)
    """Friction, sensor resolution and fingers."""

    sampling: SearchGroup = field(default_factory=Sampling)

    multifinger: Multifinger = field(default_factory=MultifingerSampling)

    reach: ReachGroup = field(default_factory=ReachSettings)

    load: LoadGroup = field(default_factory=Load)

    mesh: MeshGroup = field(default_factory=MeshOptions)

    timeout: Timeout = DEFAULT_TIMEOUT

    force: Force = False

    overwrite: Overwrite = False

    quiet: Quiet = False

    def __post_init__(self) -> None:
        if self.best is not None and self.best < 1:
            raise SettingError(f"best must be at least 1; got {self.best}")
        for name in ("grasps", "grasps_format"):
            if getattr(self, name) is not None and self.best is None:
                raise SettingError(f"{name} is for the best grasps; give their number with --best")
        if self.grasps_format == "graspgen":
            raise SettingError(
                "graspgen files state which grasps held, which is not known of grasps that "
                "are found; choose another grasps_format"
            )
        if self.grasps_format and self._posed() is None:
            raise SettingError(
                "grasps_format is for poses of a gripper of two fingers; give one with --hand"
            )
        check_timeout(self.timeout)
        check_per_finger(self.model)

    def run(self) -> int:
        """Run the command, and return the exit code."""
        from grasp3d.cli import label_report
        from grasp3d.cli.existing_files import check_not_task, check_replaceable
        from grasp3d.export.writers import writer_for

        name = safe_stem(self.file.stem) if self.output is None else self.output.stem
        output = self.output or Path(f"{name}_labeled.ply")
        write = writer_for(output)
        grasp_file = self.grasps or self._default_grasp_file(output, name)
        grasp_files = (grasp_file, grasp_file.with_suffix(".png")) if self.best else ()
        self._check_grasp_file(grasp_file)
        for path in (output, *grasp_files):
            check_not_task(path, self.load)
            check_replaceable(path, overwrite=self.overwrite, source=self.file)
        with time_limit(self.timeout, printable(str(self.file))):
            labels = self._labels((output, *grasp_files[:1]))
        write(output, labels)
        if not self.quiet:
            label_report.print_labels(labels, output)
        if self.best:
            self._write_best(labels, grasp_file, self.best)
        return 0

    def _posed(self) -> "Hand | None":
        """The hand, if it has poses for grasps of so many fingers."""
        hand = self.reach.hand
        return hand if hand is not None and self.model.fingers in hand.fingers else None

    def _default_grasp_file(self, output: Path, name: str) -> Path:
        """The file of the best grasps beside the labelled file."""
        from grasp3d.grasps.pose_files.files import suffixes_of

        suffix = suffixes_of(self.grasps_format)[0] if self.grasps_format else ".json"
        return output.with_name(f"{name}_grasps{suffix}")

    def _check_grasp_file(self, path: Path) -> None:
        """Check before the work that the best grasps can be written to a file of that name."""
        from grasp3d.grasps.grasp_files import SUFFIXES
        from grasp3d.grasps.pose_files import SUFFIXES as POSES
        from grasp3d.grasps.pose_files.files import check_hand, format_of, suffixes_of
        from grasp3d.system.files import check_suffix

        hand = self._posed()
        if not self.best:
            return
        if self.grasps_format:
            check_suffix(path, suffixes_of(self.grasps_format), self.grasps_format)
        check_suffix(path, POSES if hand else SUFFIXES, "table")
        if hand is not None:
            check_hand(self.grasps_format or format_of(path), hand)

    def _labels(self, outputs: tuple[Path, ...]) -> "SurfaceLabels":
        """Read and label the mesh; `outputs` must not have been made with other settings."""
        from grasp3d.cli import progress_bars
        from grasp3d.cli.existing_files import check_same_settings
        from grasp3d.surface.labelling import Labelling

        model, load = self.reach.touching(self.model), self.load.chosen
        sampling = given_sampling(self.sampling, self.multifinger).fitted(model.fingers)
        task = Labelling.read(
            self.file, model, sampling, self.reach, load, self.mesh, force=self.force
        )
        for path in outputs:
            check_same_settings(path, task, overwrite=self.overwrite)
        with progress_bars.progress(f"labelling {self.file.name}", quiet=self.quiet):
            labels = task.labels()
        progress_bars.measure(lambda: labels.epsilon_range, "measuring epsilon", quiet=self.quiet)
        if load is not None:
            progress_bars.measure(lambda: labels.holding, "measuring grip forces", quiet=self.quiet)
        return labels

    def _write_best(self, labels: "SurfaceLabels", output: Path, count: int) -> None:
        """Print and write the best distinct grasps, and draw them if OpenGL is available."""
        from grasp3d.cli import grasp_report, progress_bars
        from grasp3d.grasps.distinct import best_grasps
        from grasp3d.grasps.grasp_files import write_grasps
        from grasp3d.plots.figures import save_as
        from grasp3d.plots.grasps import draw_grasps, grasp_figure
        from grasp3d.plots.rendering import can_render

        grasps = best_grasps(labels, count)
        has_file = grasps.size > 0 or labels.reach is None  # files of poses cannot be empty
        if has_file:
            write_grasps(output, grasps, format=self.grasps_format)
        has_pictures = grasps.size > 0 and can_render()
        if has_pictures:
            with progress_bars.progress("drawing grasps", quiet=self.quiet):
                pictures = draw_grasps(labels, grasps)
            save_as(grasp_figure(labels, grasps, pictures), output.with_suffix(".png"))
        if not self.quiet:
            grasp_report.print_best(
                grasps, count, output, has_pictures=has_pictures, has_file=has_file
            )
