"""The command `grasp3d simulate`: simulates labelled grasps in MuJoCo."""

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from grasp3d.batch.batch_settings import ClusterSettings
from grasp3d.cli.options import (
    Force,
    HandOption,
    InputFile,
    LengthOption,
    OutputFile,
    Overwrite,
    Quiet,
    SimulatedModel,
)
from grasp3d.errors import OutputError, SettingError
from grasp3d.hand.hand import touching
from grasp3d.physics.simulation_settings import SimulationSettings
from grasp3d.settings import GraspModel, MeshOptions, Sampling
from grasp3d.system.names import safe_stem

if TYPE_CHECKING:
    from grasp3d.physics.simulation import Simulation


@dataclass(frozen=True)
class Simulate:
    """Simulate labelled grasps in MuJoCo: do S hold, and U fail?

    Draws pairs of contacts from the surface, labels them from what a sensor perceives of them, and
    simulates them as they truly are: two round tips press on the object, which is then pulled by
    its weight in six directions. With --grasps, a gripper closes at given poses instead. Needs the
    extra: pip install 'grasp3d[physics]'.
    """

    file: tyro.conf.Positional[InputFile]
    """Mesh file: STL, OBJ, PLY, OFF, GLB, 3MF, ..."""

    output: Annotated[OutputFile, tyro.conf.arg(aliases=["-o"])] = None
    """Table with a row for each grasp (.csv or .parquet), or poses with outcomes in any format that
    has them (default: NAME_simulation.csv in this folder)."""

    grasps: Annotated[Path | None, tyro.conf.arg(metavar="FILE", help_behavior_hint="")] = None
    """File of poses of a gripper to simulate, in any format that grasp3d evaluate reads (default:
    grasps are drawn from the surface)."""

    hand: HandOption = None
    """Name of a preset, or a file, of the gripper of the poses. Of drawn grasps: a gripper with
    round tips, whose radius and limits of the opening are taken (default: tips of --tip-radius)."""

    min_opening: LengthOption = 0.0
    """Smallest distance between the contacts, a length (default: 0)."""

    max_opening: LengthOption = None
    """Largest distance between the contacts, a length (default: none)."""

    simulation: SimulationSettings = field(default_factory=SimulationSettings)
    """Grasps, tips, forces and limits of the simulation. A LENGTH is a number in the mesh's unit,
    or has a unit: 3mm."""

    model: SimulatedModel = field(default_factory=GraspModel)
    """Friction and what is uncertain, from which labels follow, and within which the true contacts
    are drawn."""

    mesh: MeshOptions = field(default_factory=MeshOptions)
    """How the mesh is read and prepared. A LENGTH is a number in the mesh's unit, or has a unit."""

    cluster: ClusterSettings = field(default_factory=ClusterSettings)
    """Which processes simulate, with their limits; each simulates a few grasps at a time."""

    force: Force = False

    overwrite: Overwrite = False

    quiet: Quiet = False

    def run(self) -> int:
        """Run the command, and return the exit code."""
        from grasp3d.cli import simulate_report
        from grasp3d.cli.existing_files import check_replaceable
        from grasp3d.physics.simulation import write_simulation
        from grasp3d.system.files import check_suffix
        from grasp3d.system.tables import SUFFIXES

        output = self.output or Path(f"{safe_stem(self.file.stem)}_simulation.csv")
        if self.grasps is not None:
            return self._simulate_poses(output)
        check_suffix(output, SUFFIXES, "table")
        check_replaceable(output, overwrite=self.overwrite, source=self.file)
        found = self._found()
        write_simulation(output, found)
        if not self.quiet:
            simulate_report.print_simulation(found, output)
        return 0

    def _simulate_poses(self, output: Path) -> int:
        """Close the gripper at given poses, write and print the outcomes."""
        from grasp3d.cli import report, simulate_report
        from grasp3d.cli.existing_files import check_replaceable
        from grasp3d.grasps.pose_files import read_poses, write_poses
        from grasp3d.mesh import load_mesh
        from grasp3d.physics.simulate import simulate_poses

        assert self.grasps is not None
        if self.hand is None:
            raise SettingError(
                f"{self.grasps}: contains poses; give their gripper with --hand NAME|FILE"
            )
        if output.exists() and self.grasps.exists() and output.samefile(self.grasps):
            raise OutputError(f"{output}: is the file of poses; name another file with -o")
        poses = read_poses(self.grasps, hand=self.hand)
        check_replaceable(output, overwrite=self.overwrite, source=self.file)
        text = f"simulating {self.grasps.name}"
        with report.progress(text, quiet=self.quiet) as progress:
            found = simulate_poses(
                load_mesh(self.file, self.mesh),
                poses,
                touching(self.hand, self.model),
                hand=self.hand,
                simulation=self.simulation,
                cluster=self.cluster,
                progress=progress,
            )
        write_poses(output, found)
        if not self.quiet:
            simulate_report.print_poses(found, output)
        return 0

    def _found(self) -> "Simulation":
        """Read the mesh, draw grasps and simulate them."""
        from grasp3d.cli import report
        from grasp3d.mesh import load_mesh
        from grasp3d.mesh.plausible_lengths import refuse_lengths
        from grasp3d.physics.engine import mujoco_module
        from grasp3d.physics.simulate import simulate_grasps

        mujoco_module()  # before the mesh is read
        mesh = load_mesh(self.file, self.mesh)
        sampling = self._sampling
        if not self.force:
            refuse_lengths(mesh, self.model, sampling, self.simulation)
        text = f"simulating {self.simulation.count} grasps of {self.file.name}"
        with report.progress(text, quiet=self.quiet) as progress:
            return simulate_grasps(
                mesh,
                self.model if self.hand is None else touching(self.hand, self.model),
                simulation=self.simulation,
                sampling=sampling,
                hand=self.hand,
                cluster=self.cluster,
                progress=progress,
            )

    @property
    def _sampling(self) -> Sampling:
        """Limits of the opening."""
        least, most = self.min_opening, self.max_opening
        return Sampling(
            min_opening=0.0 if least is None else least,
            max_opening=math.inf if most is None else most,
        )
