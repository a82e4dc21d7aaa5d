"""The command `grasp3d simulate`: simulates grasps of a gripper in MuJoCo."""

from collections import Counter
from pathlib import Path

from grasp3d.cli.commands import Simulate
from grasp3d.cli.report import Report, escaped, label_meaning
from grasp3d.errors import SettingError
from grasp3d.formats.files import check_hand, write_grasps
from grasp3d.formats.format import format_of, suffixes
from grasp3d.formats.poses import GraspPoses
from grasp3d.grasps.audit import READINGS, explained
from grasp3d.grasps.evaluation import poses_on
from grasp3d.hand.frames import AUTO
from grasp3d.hand.hand import touching
from grasp3d.mesh import load_mesh
from grasp3d.mesh.plausible_lengths import refuse_lengths
from grasp3d.outcomes.simulate import coacd_module, simulate_grasps
from grasp3d.outcomes.success import success_rate
from grasp3d.stability.label import Label
from grasp3d.system.names import safe_stem


def run(command: Simulate, report: Report) -> int:
    """Run the command, and return the exit code."""
    output = command.output or Path(f"{safe_stem(command.file.stem)}_simulation.csv")
    inputs = [command.file, command.grasps]
    command.check_output(output, suffixes(), "pose", inputs=inputs)
    check_hand(format_of(output), command.hand)
    coacd_module()  # before any file is read
    tried = _simulate(command, report)
    write_grasps(output, tried)
    if command.grasps is not None:
        report.line(escaped(f"poses read in {tried.frame_words}"))
    print_outcomes(report, tried)
    report.written(output)
    return 0


def _simulate(command: Simulate, report: Report) -> GraspPoses:
    """Read mesh and poses, and simulate the grasps."""
    poses, model = None, touching(command.hand, command.model)
    if command.grasps is not None:
        given = {"hand": command.hand, **command.of_poses}
        poses, mesh = poses_on(command.grasps, command.file, command.mesh, **given)
    else:
        for name in ("object_pose", "frame"):
            if getattr(command, name) is not None:
                raise SettingError(f"{name} applies to given poses; name their file with --grasps")
        mesh = load_mesh(command.file, command.mesh)
    if not command.force:
        refuse_lengths(mesh, model, command.simulation)
    with report.progress(f"simulating {command.file.name}"):
        if poses is not None and command.frame == AUTO:
            poses = explained(mesh, poses, command.hand)
        return simulate_grasps(
            mesh, poses, model, hand=command.hand, simulation=command.simulation,
            cluster=command.cluster,
        )  # fmt: skip


def print_outcomes(report: Report, tried: GraspPoses) -> None:
    """Print how many grasps of each label held, and the fates of all grasps."""
    for setting, words in READINGS.items():
        if said := tried.settings.get(setting):
            report.line(f"{words}: {escaped(str(said))}")
    rates = []
    for label in sorted(Label, reverse=True):
        outcome = tried.outcome[tried.columns["label"] == label.name]
        held = outcome[outcome >= 0.0] == 1.0
        rates.append((label_meaning(label), success_rate(label.name, held)))
    report.rates("label", rates)
    fates = Counter(tried.columns["fate"].tolist()).most_common()
    report.line(", ".join(f"{count} {fate}" for fate, count in fates))
