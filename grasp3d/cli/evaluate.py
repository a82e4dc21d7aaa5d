"""The command `grasp3d evaluate`: evaluates given grasps on a mesh."""

from collections.abc import Iterator
from itertools import chain
from pathlib import Path
from typing import Any

from grasp3d.arrays import Floats
from grasp3d.cli import grasp_report, progress_bars
from grasp3d.cli.existing_files import check_not_source, check_not_task, check_output
from grasp3d.cli.grasp_commands import Evaluate
from grasp3d.errors import ContactError, SettingError
from grasp3d.grasps.evaluated_parts import PartsSummary
from grasp3d.grasps.evaluated_poses import EvaluatedPoses
from grasp3d.grasps.evaluation import evaluate_contacts, evaluate_grasps, in_stated_scale
from grasp3d.grasps.grasp_files import (
    SUFFIXES,
    contact_parts,
    read_contacts,
    read_grasps,
    write_grasps,
)
from grasp3d.grasps.pose_files import holds_poses, read_poses
from grasp3d.grasps.poses import GraspPoses
from grasp3d.hand.scene import Scene
from grasp3d.mesh import ObjectMesh, load_mesh
from grasp3d.mesh.plausible_lengths import refuse_lengths
from grasp3d.quality.loads import Load
from grasp3d.quality.measures.measuring import metric_names
from grasp3d.settings import GraspModel, with_fingers
from grasp3d.surface.load_case import loaded_mesh
from grasp3d.system.context import within
from grasp3d.system.names import safe_stem


def run(command: Evaluate) -> int:
    """Run the command, and return the exit code."""
    if command.metrics is not None:
        metric_names(command.metrics)
    output = command.output or Path(f"{safe_stem(command.file.stem)}_grasps.csv")
    check_not_task(output, command.load)
    poses = holds_poses(command.contacts)
    _check_gripper(command, poses=poses)
    check_not_source(output, command.contacts, "poses" if poses else "contacts")
    check_output(output, SUFFIXES, "table", overwrite=command.overwrite, sources=[command.file])
    in_parts = not poses and command.metrics is None and command.object_pose is None
    parts = contact_parts(command.contacts) if in_parts and output.suffix != ".json" else None
    if parts is not None:
        _evaluate_parts(command, parts, output)
        return 0
    grasps = read_grasps(command.contacts, hand=command.reach.hand, object_pose=command.object_pose)
    _evaluate(command, grasps, output)
    return 0


def _check_gripper(command: Evaluate, *, poses: bool) -> None:
    """Refuse poses without a gripper, and contacts with one."""
    if poses and command.reach.hand is None:
        raise SettingError(
            f"{command.contacts}: contains poses; give their gripper with --hand NAME|FILE"
        )
    if not poses and command.object_motion != "free":
        raise SettingError("object_motion applies to poses of a gripper, not to contacts")
    if poses and command.max_distance is not None:
        raise SettingError("max_distance applies to contacts, not to poses of a gripper")
    if command.metrics is not None and command.model.contact == "patch":
        raise SettingError(
            "the measures of --metrics are those of point contacts: use --contact soft, or point"
        )
    if command.reach.hand is not None and not poses:
        try:
            read_contacts(command.contacts)
        except ContactError:
            read_poses(command.contacts, hand=command.reach.hand)  # says why it contains neither
        raise SettingError(
            f"{command.contacts}: contains no poses; a gripper applies to poses, not to contacts"
        )


def _evaluate(command: Evaluate, grasps: GraspPoses | Floats, output: Path) -> None:
    """Evaluate grasps, write and print the results."""
    if isinstance(grasps, GraspPoses):
        model = command.reach.touching(command.model)
    else:
        model = with_fingers(command.model, grasps.shape[1])
    mesh = in_stated_scale(load_mesh(command.file, command.mesh), grasps)
    mesh, load = _loaded(command, mesh, model)
    with progress_bars.progress(f"evaluating {command.contacts.name}", quiet=command.quiet):
        options: dict[str, Any] = {
            "scene": Scene.of(command.reach, mesh), "object_motion": command.object_motion,
            "max_distance": command.max_distance, "load": load,
        }  # fmt: skip
        results = evaluate_grasps(mesh, grasps, model, **options)
    progress_bars.measure(lambda: results.epsilon_range, "measuring epsilon", quiet=command.quiet)
    metrics = None if command.metrics is None else results.metrics(command.metrics)
    write_grasps(output, results, metrics=metrics)
    if command.quiet:
        return
    if isinstance(results, EvaluatedPoses):
        grasp_report.print_poses(results, output)
    else:
        grasp_report.print_evaluated(results, output)
    if metrics is not None:
        grasp_report.print_metrics(metrics, mesh.unit)


def _loaded(
    command: Evaluate, mesh: ObjectMesh, model: GraspModel
) -> tuple[ObjectMesh, Load | None]:
    """The mesh and the load, with plausible lengths."""
    mesh, load = loaded_mesh(mesh, command.load.chosen)
    if not command.force:
        refuse_lengths(mesh, model, load, max_distance=command.max_distance)
    return mesh, load


def _evaluate_parts(command: Evaluate, parts: Iterator[tuple[float, Floats]], output: Path) -> None:
    """Evaluate the contacts of a large table, and write the results, a part at a time."""
    from grasp3d.system.tables import table_of_columns, write_parts

    first = next(parts)
    model = with_fingers(command.model, first[1].shape[1])
    mesh, load = _loaded(command, load_mesh(command.file, command.mesh), model)
    summary = PartsSummary(mesh)

    def tables() -> Iterator[Any]:
        done = 0.0
        for fraction, contacts in chain([first], parts):
            with within(done, fraction):
                with within(0.0, 0.7):
                    grasps = evaluate_contacts(
                        mesh, contacts, model, max_distance=command.max_distance, load=load,
                        first=summary.count,
                    )  # fmt: skip
                with within(0.7, 1.0):
                    grasps.compute("epsilon_range")
            columns = grasps.table_columns()
            columns["grasp"] = columns["grasp"] + summary.count
            summary.add(grasps, contacts)
            done = fraction
            yield table_of_columns(columns, settings=grasps.settings())

    with progress_bars.progress(f"evaluating {command.contacts.name}", quiet=command.quiet):
        write_parts(output, tables())
    if not command.quiet:
        numbers, contacts = summary.best()
        best = evaluate_contacts(
            mesh, contacts, model, max_distance=command.max_distance, load=load
        )
        grasp_report.print_parts(summary, best, numbers, output)
