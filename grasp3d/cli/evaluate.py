"""The command `grasp3d evaluate`: evaluates given grasps on a mesh."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from grasp3d.cli.options import (
    Force,
    InputFile,
    LengthOption,
    LoadGroup,
    MeshGroup,
    OutputFile,
    Overwrite,
    Quiet,
)
from grasp3d.errors import OutputError, SettingError
from grasp3d.hand.choices import ObjectMotion
from grasp3d.hand.reach_settings import ReachSettings
from grasp3d.quality.loads import Load
from grasp3d.settings import GraspModel, MeshOptions, with_fingers
from grasp3d.system.names import safe_stem

if TYPE_CHECKING:
    from grasp3d.arrays import Floats
    from grasp3d.grasps.poses import GraspPoses


@dataclass(frozen=True)
class Evaluate:
    """Evaluate given grasps: label, critical friction angle and epsilon of each.

    Each contact is moved to the closest point of the surface. At poses of a gripper its jaws are
    closed on the object.
    """

    file: tyro.conf.Positional[InputFile]
    """Mesh file: STL, OBJ, PLY, OFF, GLB, 3MF, ..."""

    contacts: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="CONTACTS")]
    """Contact points in the mesh's frame and unit: CSV or Parquet with columns x1 y1 z1 x2 y2 z2
    ... and one row per grasp, or JSON with a list of grasps, each a list of points [x, y, z]. Or
    poses of a gripper: the files that grasp3d writes, isaac_grasp (.yaml), ACRONYM (.h5), GraspNet
    (.npy), GraspGen and moveit_msgs/Grasp (.json); they need --hand."""

    output: Annotated[OutputFile, tyro.conf.arg(aliases=["-o"])] = None
    """Results (.csv, .parquet or .json) (default: NAME_grasps.csv in this folder)."""

    max_distance: LengthOption = None
    """Largest distance of a contact from the surface (default: 1/100 of the object's size)."""

    metrics: Annotated[
        str | None, tyro.conf.arg(metavar="all|NAME,NAME", help_behavior_hint="")
    ] = None
    """Quality measures of the literature to compute, print and write as further columns: all, or
    names separated by commas, such as min_weight,grasp_isotropy; an unknown name lists them."""

    object_motion: ObjectMotion = "free"
    """Poses: whether the object gives way to the closing jaws, and settles between them, or does
    not move."""

    model: GraspModel = field(default_factory=GraspModel)
    """Friction and sensor resolution; the number of fingers is that of a grasp's contacts."""

    reach: ReachSettings = field(default_factory=ReachSettings)
    """The gripper of the poses, and what the object stands on."""

    load: LoadGroup = field(default_factory=Load)

    mesh: MeshGroup = field(default_factory=MeshOptions)

    force: Force = False

    overwrite: Overwrite = False

    quiet: Quiet = False

    def run(self) -> int:
        """Run the command, and return the exit code."""
        from grasp3d.cli.existing_files import check_not_task, check_output
        from grasp3d.grasps.grasp_files import SUFFIXES, read_grasps
        from grasp3d.grasps.pose_files import holds_poses
        from grasp3d.grasps.poses import GraspPoses
        from grasp3d.quality.measures.known import metric_names

        if self.metrics is not None:
            metric_names(self.metrics)
        output = self.output or Path(f"{safe_stem(self.file.stem)}_grasps.csv")
        check_not_task(output, self.load)
        self._check_gripper(poses=holds_poses(self.contacts))
        grasps = read_grasps(self.contacts, hand=self.reach.hand)
        if output.exists() and output.samefile(self.contacts):
            what = "poses" if isinstance(grasps, GraspPoses) else "contacts"
            raise OutputError(f"{output}: is the file of {what}; name another file with -o")
        model = self._model(grasps)
        check_output(output, SUFFIXES, "table", overwrite=self.overwrite, sources=[self.file])
        self._evaluate(grasps, model, output)
        return 0

    def _check_gripper(self, *, poses: bool) -> None:
        """Refuse poses without a gripper, and contacts with one."""
        if poses and self.reach.hand is None:
            raise SettingError(
                f"{self.contacts}: contains poses; give their gripper with --hand NAME|FILE"
            )
        if not poses and self.object_motion != "free":
            raise SettingError("object_motion applies to poses of a gripper, not to contacts")
        if poses and self.max_distance is not None:
            raise SettingError("max_distance applies to contacts, not to poses of a gripper")
        if self.metrics is not None and self.model.contact == "patch":
            raise SettingError(
                "the measures of --metrics are those of point contacts: use --contact soft, or "
                "point"
            )
        if self.reach.hand is not None and not poses and self.contacts.is_file():
            raise SettingError(
                f"{self.contacts}: contains no poses; a gripper applies to poses, not to contacts"
            )

    def _model(self, grasps: "GraspPoses | Floats") -> GraspModel:
        """The model of the grasps: at poses of the gripper, or of as many fingers as contacts."""
        from grasp3d.grasps.poses import GraspPoses

        if isinstance(grasps, GraspPoses):
            return self.reach.touching(self.model)
        return with_fingers(self.model, grasps.shape[1])

    def _evaluate(self, grasps: "GraspPoses | Floats", model: GraspModel, output: Path) -> None:
        """Evaluate grasps, write and print the results."""
        from grasp3d.cli import grasp_report, progress_bars
        from grasp3d.grasps.evaluated_poses import EvaluatedPoses
        from grasp3d.grasps.evaluation import evaluate_grasps, in_stated_scale
        from grasp3d.grasps.grasp_files import write_grasps
        from grasp3d.hand.scene import Scene
        from grasp3d.mesh import load_mesh
        from grasp3d.mesh.plausible_lengths import refuse_lengths
        from grasp3d.surface.masses import loaded_mesh

        mesh = in_stated_scale(load_mesh(self.file, self.mesh), grasps)
        mesh, load = loaded_mesh(mesh, self.load.chosen)
        if not self.force:
            refuse_lengths(mesh, model, load, max_distance=self.max_distance)
        with progress_bars.progress(f"evaluating {self.contacts.name}", quiet=self.quiet):
            options: dict[str, Any] = {
                "scene": Scene.of(self.reach, mesh), "object_motion": self.object_motion,
                "max_distance": self.max_distance, "load": load,
            }  # fmt: skip
            results = evaluate_grasps(mesh, grasps, model, **options)
        progress_bars.measure(lambda: results.epsilon_range, "measuring epsilon", quiet=self.quiet)
        metrics = None if self.metrics is None else results.metrics(self.metrics)
        write_grasps(output, results, metrics=metrics)
        if self.quiet:
            return
        if isinstance(results, EvaluatedPoses):
            grasp_report.print_poses(results, output)
        else:
            grasp_report.print_evaluated(results, output)
        if metrics is not None:
            grasp_report.print_metrics(metrics, mesh.unit)
