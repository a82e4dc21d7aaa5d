"""The command `grasp3d simulate`: simulates labelled grasps in MuJoCo."""

import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

from grasp3d.cli import progress_bars
from grasp3d.cli.commands import Simulate
from grasp3d.cli.existing_files import check_output
from grasp3d.cli.report import NONE, Report, escaped, length_with_unit
from grasp3d.errors import SettingError
from grasp3d.grasps.audit import READINGS, explained
from grasp3d.grasps.evaluation import poses_on
from grasp3d.grasps.pose_files import SUFFIXES as POSES
from grasp3d.grasps.pose_files import write_poses
from grasp3d.grasps.pose_files.files import check_hand, format_of
from grasp3d.grasps.poses import GraspPoses
from grasp3d.hand.frames import AUTO
from grasp3d.hand.hand import touching
from grasp3d.mesh import load_mesh
from grasp3d.mesh.plausible_lengths import refuse_lengths
from grasp3d.physics.engine import mujoco_module
from grasp3d.physics.simulate import simulate_grasps, simulate_poses
from grasp3d.physics.simulation import Simulation, SuccessRate, success_rate, write_simulation
from grasp3d.settings import Sampling
from grasp3d.settings.model_text import model_line
from grasp3d.settings.units import small_length
from grasp3d.stability.label import Label
from grasp3d.system.counts import counted
from grasp3d.system.names import safe_stem
from grasp3d.system.tables import SUFFIXES

EXPLANATIONS = {
    "held": "held through all pulls, at the contacts that were labelled",
    "regrasped": "object held, but the contacts slipped first: by another grasp",
    "pulled": "held while squeezed, lost to a pull",
    "lost": "slipped or turned away while squeezed",
    "missed": "the two tips never touched it at once",
    "blocked": "the open gripper is in the object before it closes",
    "broken": "the simulation failed, and says nothing",
}
"""What the fates of grasps mean."""


def run(command: Simulate) -> int:
    """Run the command, and return the exit code."""
    output = command.output or Path(f"{safe_stem(command.file.stem)}_simulation.csv")
    if command.grasps is not None:
        return _simulate_poses(command, output)
    for name in ("object_pose", "frame"):
        if getattr(command, name) is not None:
            raise SettingError(f"{name} is that of given poses; name their file with --grasps")
    check_output(output, SUFFIXES, "table", overwrite=command.overwrite, inputs=[command.file])
    simulation = _simulate(command)
    write_simulation(output, simulation)
    if not command.quiet:
        print_simulation(simulation, output)
    return 0


def _simulate_poses(command: Simulate, output: Path) -> int:
    """Close the gripper at given poses, write and print the outcomes."""
    assert command.grasps is not None
    if command.hand is None:
        raise SettingError(
            f"{command.grasps}: contains poses; give their gripper with --hand NAME|FILE"
        )
    inputs = [command.file, command.grasps]
    check_output(output, POSES, "pose", overwrite=command.overwrite, inputs=inputs)
    check_hand(format_of(output), command.hand)
    mujoco_module()  # before anything is read
    poses, mesh = poses_on(
        command.grasps, command.file, command.mesh, hand=command.hand, **command.of_poses
    )
    text = f"simulating {command.grasps.name}"
    with progress_bars.progress(text, quiet=command.quiet):
        if command.frame == AUTO:
            poses = explained(mesh, poses, command.hand)
        outcomes = simulate_poses(
            mesh,
            poses,
            touching(command.hand, command.model),
            hand=command.hand,
            simulation=command.simulation,
            cluster=command.cluster,
        )
    write_poses(output, outcomes)
    if not command.quiet:
        print_poses(outcomes, output)
    return 0


def _simulate(command: Simulate) -> Simulation:
    """Read the mesh, draw grasps and simulate them."""
    mujoco_module()  # before the mesh is read
    mesh = load_mesh(command.file, command.mesh)
    least, most = command.min_opening, command.max_opening
    sampling = Sampling(
        min_opening=0.0 if least is None else least, max_opening=math.inf if most is None else most
    )
    if not command.force:
        refuse_lengths(mesh, command.model, sampling, command.simulation)
    text = f"simulating {command.simulation.count} grasps of {command.file.name}"
    with progress_bars.progress(text, quiet=command.quiet):
        return simulate_grasps(
            mesh,
            command.model if command.hand is None else touching(command.hand, command.model),
            simulation=command.simulation,
            sampling=sampling,
            hand=command.hand,
            cluster=command.cluster,
        )


def print_simulation(simulation: Simulation, output: Path) -> None:
    """Print what was simulated, success by label and by margin, and what became of the grasps.

    Args:
        simulation: The simulated grasps.
        output: The file that they were written to.
    """
    report = Report()
    for line in _head(simulation):
        report.line(line)
    held, rates = simulation.rates(held=True), simulation.rates()
    columns = _columns({one: rates[one.name] for one in Label}, "grasps", "grasp held")
    columns["object held"] = lambda label: _percent(held[label.name])
    report.letters("scan", columns)
    margins = [(f"{one.name}°", *_cells(one)) for one in simulation.rates_by_margin() if one.count]
    report.table(("margin", "grasps", "grasp held", "95 %"), margins)
    _print_fates(report, simulation.fates)
    report.warnings(simulation.warnings)
    report.written(output)


def print_poses(poses: GraspPoses, output: Path) -> None:
    """Print what became of given poses, by label.

    Args:
        poses: The simulated poses.
        output: The file that they were written to.
    """

    def rate(label: Label) -> SuccessRate:
        outcome = poses.outcome[poses.columns["label"] == label.name]
        return success_rate(label.name, outcome[abs(outcome) < math.inf] == 1.0)

    report = Report()
    for setting, words in READINGS.items():
        if said := poses.settings.get(setting):
            report.line(f"{words}: {escaped(str(said))}")
    report.letters("scan", _columns({one: rate(one) for one in Label}, "poses", "object held"))
    _print_fates(report, poses.columns["fate"].tolist())
    report.written(output)


def _columns(rates: Mapping[Label, SuccessRate], *names: str) -> dict[str, Callable[[Label], str]]:
    """Columns of a label's number of grasps, how many of them held, and the interval."""
    cells = {label: _cells(rate) for label, rate in rates.items()}
    return {
        name: lambda label, number=number: cells[label][number]  # type: ignore[misc]
        for number, name in enumerate((*names, "95 %"))
    }


def _print_fates(report: Report, fates: Iterable[str]) -> None:
    """Print how often each fate was met."""
    counts = Counter(map(str, fates))
    for fate, text in EXPLANATIONS.items():
        if counts[fate]:
            report.line(f"{fate}: {counts[fate]} ({text})")


def _head(simulation: Simulation) -> list[str]:
    mesh, settings = simulation.mesh, simulation.settings
    depth = small_length(float(simulation.part_depth.max(initial=0.0)), metres=True, digits=2)
    angle = math.degrees(float(simulation.part_angle.max(initial=0.0)))
    where = "line between the contacts" if settings.pulled == "line" else "centre of mass"
    size, model = length_with_unit(mesh.size, mesh.unit), model_line(simulation.model)
    parts = counted(simulation.parts, "convex parts")
    force, weight = f"{settings.force:.3g} N", f"{settings.weight:.3g} N"
    grasps = counted(simulation.size, "grasps")
    return [
        f"[bold]{escaped(mesh.report.source)}[/]: size {size}; {escaped(model)}",
        f"{grasps}; grip force {force}; 6 pulls of {weight} at the {where}",
        f"simulated as {parts}, whose surface is off by at most {depth}, {angle:.1f}° at contacts",
    ]


def _cells(rate: SuccessRate) -> tuple[str, str, str]:
    """Number of grasps, the percentage that held, and its interval."""
    interval = f"{100.0 * rate.low:.0f} to {100.0 * rate.high:.0f} %" if rate.count else NONE
    return str(rate.count), _percent(rate), interval


def _percent(rate: SuccessRate) -> str:
    return NONE if math.isnan(rate.rate) else f"{100.0 * rate.rate:.0f} %"
