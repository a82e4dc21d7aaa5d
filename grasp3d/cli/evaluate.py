"""The command `grasp3d evaluate`: evaluates given grasps on a mesh."""

from pathlib import Path
from typing import Any

from grasp3d.cli import grasp_report, progress_bars
from grasp3d.cli.commands import Evaluate
from grasp3d.cli.existing_files import check_output
from grasp3d.errors import ContactError, MeshError, SettingError
from grasp3d.grasps.audit import explained
from grasp3d.grasps.evaluation import (
    contacts_on,
    evaluate_contacts,
    evaluate_grasps,
    poses_on,
)
from grasp3d.grasps.grasp_files import (
    SUFFIXES,
    contacts_in,
    read_contacts,
    read_grasps,
    write_grasps,
)
from grasp3d.grasps.pose_files import holds_poses, read_poses
from grasp3d.grasps.ranking import ranked_rows
from grasp3d.hand.frames import AUTO
from grasp3d.hand.scene import Scene
from grasp3d.mesh import ObjectMesh, load_mesh
from grasp3d.mesh.plausible_lengths import refuse_lengths
from grasp3d.quality.measures import metric_names
from grasp3d.settings import GraspModel, with_fingers
from grasp3d.system.names import safe_stem

PICTURED = 12
"""Poses in a picture."""

OF_POSES = {"object_motion": "free", "contact_rule": None, "contact_distance": None}
"""Options of poses alone, and their defaults."""


def run(command: Evaluate) -> int:
    """Run the command, and return the exit code."""
    if command.metrics is not None:
        metric_names(command.metrics)
    output = command.output or Path(f"{safe_stem(command.file.stem)}_grasps.csv")
    if command.file.is_dir():
        raise MeshError(
            f"{command.file}: is a folder, but grasps are of one object: name its mesh file, and "
            "evaluate the grasps of other objects with theirs, one after the other"
        )
    poses = holds_poses(command.contacts)
    _check_options(command, poses=poses)
    mask = getattr(command.mesh.region, "path", None)
    inputs = [command.file, command.contacts, mask, *command.load.task.files]
    check_output(output, SUFFIXES, "table", overwrite=command.overwrite, inputs=inputs)
    if command.picture is not None:
        _check_picture(command)
    results = (_poses if poses else _contacts)(command)
    metrics = None if command.metrics is None else results.metrics(command.metrics)
    progress_bars.measure(lambda: results.epsilon, "measuring epsilon", quiet=command.quiet)
    write_grasps(output, results, metrics=metrics)
    if command.picture is not None:
        _draw(command.picture, results, quiet=command.quiet)
    if not command.quiet:
        grasp_report.print_grasps(results, *filter(None, (output, command.picture)))
        if metrics is not None:
            grasp_report.print_metrics(metrics)
    return 0


def _check_picture(command: Evaluate) -> None:
    """Check before the work that a picture can be drawn and written."""
    from grasp3d.plots.figures import METADATA
    from grasp3d.rendering.opengl import check_rendering

    if command.reach.hand is None:
        raise SettingError("picture applies to poses of a gripper or hand")
    check_output(command.picture, METADATA, "figure", overwrite=command.overwrite)
    check_rendering()


def _check_options(command: Evaluate, *, poses: bool) -> None:
    """Refuse options of poses for contacts, the other way round, and poses without a gripper."""
    hand = command.reach.hand
    if poses and hand is None:
        raise SettingError(
            f"{command.contacts}: contains poses; give their gripper with --hand NAME|FILE"
        )
    if poses and command.max_distance is not None:
        raise SettingError("max_distance applies to contacts, not to poses of a gripper")
    if poses:
        return
    changed = [name for name, default in OF_POSES.items() if getattr(command, name) != default]
    if command.reach.pose_error:
        changed.append("pose_error")
    if changed:
        raise SettingError(f"{changed[0]} applies to poses of a gripper, not to contacts")
    if hand is not None:
        try:
            read_contacts(command.contacts)
        except ContactError:
            read_poses(command.contacts, hand=hand)  # says why it contains neither
        raise SettingError(
            f"{command.contacts}: contains no poses; a gripper applies to poses, not to contacts"
        )


def _poses(command: Evaluate) -> Any:
    """Evaluate poses of a gripper or hand."""
    poses, mesh = poses_on(
        command.contacts, command.file, command.mesh, hand=command.reach.hand, **_stated(command)
    )
    model = command.reach.touching(command.model)
    _refuse_lengths(command, mesh, model)
    scene = Scene.of(command.reach, mesh)
    assert scene is not None
    with progress_bars.progress(f"evaluating {command.contacts.name}", quiet=command.quiet):
        if command.frame == AUTO:
            poses = explained(mesh, poses, scene.hand, table=scene.table)
        options: dict[str, Any] = {name: getattr(command, name) for name in OF_POSES}
        return evaluate_grasps(mesh, poses, model, load=command.load.chosen, scene=scene, **options)


def _contacts(command: Evaluate) -> Any:
    """Evaluate contacts."""
    stated = {**_stated(command), "frame": command.frame}
    if any(given is not None for given in stated.values()):
        read_grasps(command.contacts, **stated)  # says that it is for poses
    contacts, unit = contacts_in(command.contacts)
    model = with_fingers(command.model, contacts.shape[1])
    mesh = load_mesh(command.file, command.mesh)
    contacts = contacts_on(mesh, contacts, unit)
    _refuse_lengths(command, mesh, model)
    with progress_bars.progress(f"evaluating {command.contacts.name}", quiet=command.quiet):
        return evaluate_contacts(
            mesh, contacts, model, max_distance=command.max_distance, load=command.load.chosen
        )


def _stated(command: Evaluate) -> dict[str, Any]:
    """What is stated of a file of poses, for `read_grasps`."""
    return {
        **command.of_poses, "outcome": command.outcome, "object_scale": command.object_scale
    }  # fmt: skip


def _draw(path: Path, results: Any, *, quiet: bool) -> None:
    """Draw the poses to be taken first."""
    from grasp3d.plots.figures import save_as
    from grasp3d.plots.grasps import grasp_figure
    from grasp3d.viewer.scene.sheets import draw_grasps

    rows = ranked_rows(results)[:PICTURED]
    shown = results.take(rows)
    with progress_bars.progress("drawing poses", quiet=quiet):
        pictures = draw_grasps(shown)
    save_as(grasp_figure(shown, pictures, [int(row) + 1 for row in rows]), path)


def _refuse_lengths(command: Evaluate, mesh: ObjectMesh, model: GraspModel) -> None:
    if not command.force:
        refuse_lengths(mesh, model, max_distance=command.max_distance)
