"""The command `grasp3d simulate`: simulates labelled grasps in MuJoCo."""

import math
from collections import Counter
from collections.abc import Iterable
from pathlib import Path

from grasp3d.cli import progress_bars
from grasp3d.cli.commands import Simulate
from grasp3d.cli.existing_files import check_output
from grasp3d.cli.report import Report, escaped, label_meaning
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
from grasp3d.physics.simulation import Simulation, write_simulation
from grasp3d.settings.model_text import model_line
from grasp3d.stability.label import Label
from grasp3d.system.counts import counted
from grasp3d.system.names import safe_stem
from grasp3d.system.tables import SUFFIXES
from grasp3d.validating.success import success_rate

LABELS = sorted(Label)[::-1]


def run(command: Simulate) -> int:
    """Run the command, and return the exit code."""
    output = command.output or Path(f"{safe_stem(command.file.stem)}_simulation.csv")
    report = Report(quiet=command.quiet)
    if command.grasps is not None:
        poses = _simulate_poses(command, command.grasps, output)
        write_poses(output, poses)
        print_poses(report, poses)
    else:
        for name in ("object_pose", "frame"):
            if getattr(command, name) is not None:
                raise SettingError(f"{name} is that of given poses; name their file with --grasps")
        check_output(output, SUFFIXES, "table", overwrite=command.overwrite, inputs=[command.file])
        simulation = _simulate(command)
        write_simulation(output, simulation)
        print_simulation(report, simulation)
    report.written(output)
    return 0


def _simulate_poses(command: Simulate, file: Path, output: Path) -> GraspPoses:
    """Close the gripper at given poses."""
    if command.hand is None:
        raise SettingError(f"{file}: contains poses; give their gripper with --hand NAME|FILE")
    inputs = [command.file, file]
    check_output(output, POSES, "pose", overwrite=command.overwrite, inputs=inputs)
    check_hand(format_of(output), command.hand)
    mujoco_module()  # before anything is read
    poses, mesh = poses_on(file, command.file, command.mesh, hand=command.hand, **command.of_poses)
    with progress_bars.progress(f"simulating {file.name}", quiet=command.quiet):
        if command.frame == AUTO:
            poses = explained(mesh, poses, command.hand)
        return simulate_poses(
            mesh,
            poses,
            touching(command.hand, command.model),
            hand=command.hand,
            simulation=command.simulation,
            cluster=command.cluster,
        )


def _simulate(command: Simulate) -> Simulation:
    """Read the mesh, draw grasps and simulate them."""
    mujoco_module()  # before the mesh is read
    mesh, model, hand = load_mesh(command.file, command.mesh), command.model, command.hand
    if not command.force:
        refuse_lengths(mesh, model, command.sampling, command.simulation)
    text = f"simulating {command.simulation.count} grasps of {command.file.name}"
    with progress_bars.progress(text, quiet=command.quiet):
        return simulate_grasps(
            mesh,
            model if hand is None else touching(hand, model),
            simulation=command.simulation,
            sampling=command.sampling,
            hand=hand,
            cluster=command.cluster,
        )


def print_simulation(report: Report, simulation: Simulation) -> None:
    """Print what was simulated, success by label and by margin, and what became of the grasps."""
    mesh, settings = simulation.mesh, simulation.settings
    where = "line between the contacts" if settings.pulled == "line" else "centre of mass"
    report.mesh(mesh, escaped(model_line(simulation.model)))
    report.line(
        f"{counted(simulation.size, 'grasps')}, {counted(simulation.parts, 'convex parts')}; grip "
        f"force {settings.force:.3g} N; 6 pulls of {settings.weight:.3g} N at the {where}"
    )
    rates = simulation.rates()
    report.rates("label", ((label_meaning(label), rates[label.name]) for label in LABELS))
    margins = ((f"{one.name}°", one) for one in simulation.rates_by_margin())
    report.rates("margin", margins)
    report.line(_fates(simulation.fates))
    report.warnings(simulation.warnings)


def print_poses(report: Report, poses: GraspPoses) -> None:
    """Print what became of given poses, by label."""
    for setting, words in READINGS.items():
        if said := poses.settings.get(setting):
            report.line(f"{words}: {escaped(str(said))}")
    labels = poses.columns["label"]
    tried = {one: poses.outcome[labels == one.name] for one in LABELS}
    rates = (
        (label_meaning(one), success_rate(one.name, outcome[abs(outcome) < math.inf] == 1.0))
        for one, outcome in tried.items()
    )
    report.rates("label", rates)
    report.line(_fates(poses.columns["fate"]))


def _fates(fates: Iterable[str]) -> str:
    """How many grasps met each fate, as one line."""
    return ", ".join(f"{count} {fate}" for fate, count in Counter(map(str, fates)).most_common())
