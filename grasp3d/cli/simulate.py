"""The command `grasp3d simulate`: simulates labelled grasps in MuJoCo."""

import math
from collections import Counter
from collections.abc import Iterable
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
    MeshGroup,
    OutputFile,
    Overwrite,
    Quiet,
    SimulatedModel,
)
from grasp3d.cli.report import WARNING, Report, escaped, label_name, length_with_unit, table_of
from grasp3d.errors import OutputError, SettingError
from grasp3d.hand.hand import touching
from grasp3d.physics.simulation_settings import SimulationSettings
from grasp3d.settings import GraspModel, MeshOptions, Sampling
from grasp3d.settings.lengths import small_length
from grasp3d.settings.model_text import model_line
from grasp3d.stability.label import MEANING, Label
from grasp3d.system.counts import counted
from grasp3d.system.names import safe_stem

if TYPE_CHECKING:
    from grasp3d.grasps.poses import GraspPoses
    from grasp3d.physics.simulation import Simulation, SuccessRate

EXPLANATIONS = {
    "held": "held through all pulls, at the contacts that were labelled",
    "regrasped": "object held, but the contacts slipped first: by another grasp",
    "pulled": "held while squeezed, lost to a pull",
    "lost": "slipped or turned away while squeezed",
    "missed": "the two tips never touched it at once",
    "blocked": "the open tips touch the object before they close",
    "broken": "the simulation failed, and says nothing",
}
"""What the fates of grasps mean."""


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

    mesh: MeshGroup = field(default_factory=MeshOptions)

    cluster: ClusterSettings = field(default_factory=ClusterSettings)
    """Which processes simulate, with their limits; each simulates a few grasps at a time."""

    force: Force = False

    overwrite: Overwrite = False

    quiet: Quiet = False

    def run(self) -> int:
        """Run the command, and return the exit code."""
        from grasp3d.cli.existing_files import check_output
        from grasp3d.physics.simulation import write_simulation
        from grasp3d.system.tables import SUFFIXES

        output = self.output or Path(f"{safe_stem(self.file.stem)}_simulation.csv")
        if self.grasps is not None:
            return self._simulate_poses(output)
        check_output(output, SUFFIXES, "table", overwrite=self.overwrite, sources=[self.file])
        simulation = self._simulate()
        write_simulation(output, simulation)
        if not self.quiet:
            print_simulation(simulation, output)
        return 0

    def _simulate_poses(self, output: Path) -> int:
        """Close the gripper at given poses, write and print the outcomes."""
        from grasp3d.cli import progress_bars
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
        with progress_bars.progress(text, quiet=self.quiet):
            outcomes = simulate_poses(
                load_mesh(self.file, self.mesh),
                poses,
                touching(self.hand, self.model),
                hand=self.hand,
                simulation=self.simulation,
                cluster=self.cluster,
            )
        write_poses(output, outcomes)
        if not self.quiet:
            print_poses(outcomes, output)
        return 0

    def _simulate(self) -> "Simulation":
        """Read the mesh, draw grasps and simulate them."""
        from grasp3d.cli import progress_bars
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
        with progress_bars.progress(text, quiet=self.quiet):
            return simulate_grasps(
                mesh,
                self.model if self.hand is None else touching(self.hand, self.model),
                simulation=self.simulation,
                sampling=sampling,
                hand=self.hand,
                cluster=self.cluster,
            )

    @property
    def _sampling(self) -> Sampling:
        """Limits of the opening."""
        least, most = self.min_opening, self.max_opening
        return Sampling(
            min_opening=0.0 if least is None else least,
            max_opening=math.inf if most is None else most,
        )


def print_simulation(simulation: "Simulation", output: Path) -> None:
    """Print what was simulated, success by label and by margin, and what became of the grasps.

    Args:
        simulation: The simulated grasps.
        output: The file that they were written to.
    """
    report = Report()
    for line in _head(simulation):
        report.line(line)
    holding = simulation.rates(held=True)
    rows = [(*_named(rate), _percent(holding[rate.name])) for rate in simulation.rates().values()]
    headings = ("label", "", "grasps", "grasp held", "95 %", "object held")
    report.table(table_of(headings, rows, texts=2))
    margins = [
        (f"{rate.name}°", *_cells(rate)) for rate in simulation.rates_by_margin() if rate.count
    ]
    report.table(table_of(("margin", "grasps", "grasp held", "95 %"), margins))
    _print_fates(report, simulation.fates)
    report.lines(simulation.warnings, WARNING)
    report.written(output)


def print_poses(poses: "GraspPoses", output: Path) -> None:
    """Print what became of given poses, by label.

    Args:
        poses: The simulated poses.
        output: The file that they were written to.
    """
    from grasp3d.physics.simulation import success_rate

    report, rows = Report(), []
    for label in sorted(Label, reverse=True):
        outcome = poses.outcome[poses.columns["label"] == label.name]
        tried = outcome[abs(outcome) < math.inf]
        rows.append(_named(success_rate(label.name, tried == 1.0)))
    report.table(table_of(("label", "", "poses", "object held", "95 %"), rows, texts=2))
    _print_fates(report, poses.columns["fate"].tolist())
    report.written(output)


def _print_fates(report: Report, fates: Iterable[str]) -> None:
    """Print how often each fate was met."""
    counts = Counter(map(str, fates))
    for fate, text in EXPLANATIONS.items():
        if counts[fate]:
            report.line(f"{fate}: {counts[fate]} ({text})")


def _head(simulation: "Simulation") -> list[str]:
    mesh, settings = simulation.mesh, simulation.settings
    depth = small_length(float(simulation.part_depth.max(initial=0.0)), mesh.unit, digits=2)
    angle = math.degrees(float(simulation.part_angle.max(initial=0.0)))
    where = "line between the contacts" if settings.pulled == "line" else "centre of mass"
    size, model = length_with_unit(mesh.size, mesh.unit), model_line(simulation.model, mesh.unit)
    parts = counted(simulation.parts, "convex parts")
    force, weight = f"{settings.force:.3g} N", f"{settings.weight:.3g} N"
    grasps = counted(simulation.size, "grasps")
    return [
        f"[bold]{escaped(mesh.report.source)}[/]: size {size}; {escaped(model)}",
        f"{grasps}; grip force {force}; 6 pulls of {weight} at the {where}",
        f"simulated as {parts}, whose surface is off by at most {depth}, {angle:.1f}° at contacts",
    ]


def _named(rate: "SuccessRate") -> tuple[str, ...]:
    """Cells of the success of a label."""
    label = Label[rate.name]
    return label_name(label), MEANING["scan"][label], *_cells(rate)


def _cells(rate: "SuccessRate") -> tuple[str, str, str]:
    """Number of grasps, the percentage that held, and its interval."""
    interval = f"{100.0 * rate.low:.0f} to {100.0 * rate.high:.0f} %" if rate.count else "–"
    return str(rate.count), _percent(rate), interval


def _percent(rate: "SuccessRate") -> str:
    return "–" if math.isnan(rate.rate) else f"{100.0 * rate.rate:.0f} %"
