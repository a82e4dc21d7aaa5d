"""The command `grasp3d evaluate`: evaluates given grasps on a mesh."""

from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from grasp3d.cli.commands import Evaluate
from grasp3d.cli.report import (
    Grasps,
    Report,
    escaped,
    frame_text,
    length_with_unit,
    load_line,
    percent_text,
)
from grasp3d.describe.verdict import verdict_of
from grasp3d.errors import SettingError
from grasp3d.formats import holds_poses
from grasp3d.formats.files import read_grasps, write_grasps
from grasp3d.formats.own import SUFFIXES, contacts_in
from grasp3d.grasps.audit import READING, READINGS, explained
from grasp3d.grasps.evaluated_poses import ranked_rows
from grasp3d.grasps.evaluation import (
    DISTANCE_ROUNDING,
    contacts_on,
    evaluate_contacts,
    evaluate_grasps,
    poses_on,
)
from grasp3d.hand.frames import AUTO
from grasp3d.hand.scene import Scene
from grasp3d.mesh import ObjectMesh, load_mesh
from grasp3d.mesh.plausible_lengths import refuse_lengths
from grasp3d.quality.measures import metric_names
from grasp3d.settings import GraspModel, with_fingers
from grasp3d.settings.grasp_model import model_line
from grasp3d.stability.label import Label
from grasp3d.surface.grasp_table import GraspTable
from grasp3d.system.names import counted, safe_stem

MAX_ROWS = 10
"""Largest number of grasps in the printed table."""


def run(command: Evaluate, report: Report) -> int:
    """Run the command, and return the exit code."""
    if command.metrics is not None:
        metric_names(command.metrics)
    output = command.output or Path(f"{safe_stem(command.file.stem)}_grasps.csv")
    of_poses = command.reach.hand, command.contact_rule, command.reach.pose_error
    poses = any(of_poses) or holds_poses(command.contacts)
    if poses and command.reach.hand is None:
        needed = "poses need a gripper or hand: give it with --hand NAME|FILE"
        raise SettingError(f"{command.contacts}: {needed}")
    if poses and command.max_distance is not None:
        raise SettingError("max_distance applies to contacts, not to poses of a gripper")
    mask = getattr(command.mesh.region, "path", None)
    inputs = [command.file, command.contacts, mask, *command.load.task.files]
    command.check_output(output, SUFFIXES, "table", inputs=inputs)
    results = (_poses if poses else _contacts)(command, report)
    metrics = None if command.metrics is None else results.metrics(command.metrics)
    with report.progress("measuring epsilon"):
        results.epsilon  # noqa: B018, computed when it is first read
    write_grasps(output, results, metrics=metrics)
    if not command.quiet:
        print_grasps(report, results, metrics or {})
    report.written(output)
    return 0


def _poses(command: Evaluate, report: Report) -> Any:
    """Evaluate poses of a gripper or hand."""
    given = {"hand": command.reach.hand, **command.of_poses}
    poses, mesh = poses_on(command.contacts, command.file, command.mesh, **given)
    model = command.reach.touching(command.model)
    _refuse_lengths(command, mesh, model)
    scene = Scene.of(command.reach, mesh)
    assert scene is not None
    with report.progress(f"evaluating {command.contacts.name}"):
        if command.frame == AUTO:
            poses = explained(mesh, poses, scene.hand, table=scene.table)
        options: dict[str, Any] = {"contact_rule": command.contact_rule, "scene": scene}
        return evaluate_grasps(mesh, poses, model, load=command.load.chosen, **options)


def _contacts(command: Evaluate, report: Report) -> Any:
    """Evaluate contacts."""
    stated = {**command.of_poses, "frame": command.frame}
    if any(given is not None for given in stated.values()):
        read_grasps(command.contacts, **stated)  # raises: these options are for poses
    contacts, unit = contacts_in(command.contacts)
    model = with_fingers(command.model, contacts.shape[1])
    mesh = load_mesh(command.file, command.mesh)
    contacts = contacts_on(mesh, contacts, unit)
    _refuse_lengths(command, mesh, model)
    with report.progress(f"evaluating {command.contacts.name}"):
        return evaluate_contacts(
            mesh, contacts, model, max_distance=command.max_distance, load=command.load.chosen
        )


def _refuse_lengths(command: Evaluate, mesh: ObjectMesh, model: GraspModel) -> None:
    if not command.force:
        refuse_lengths(mesh, model, max_distance=command.max_distance)


def print_grasps(report: Report, grasps: Grasps, metrics: dict[str, Any]) -> None:
    """Print the number of grasps of each label, and a table of the best grasps.

    Args:
        report: Where to print.
        grasps: Evaluated contacts, or poses of a gripper or hand.
        metrics: Values of quality measures by name; their medians are printed.
    """
    mesh, size = grasps.mesh, grasps.size
    words = [model_line(grasps.model, metres=mesh.unit is not None)]
    words += grasps.scene.words[1:] if grasps.scene else ()
    report.heading(mesh.report.source, escaped(f"{_kind(grasps)}; {', '.join(words)}"))
    counts = np.bincount(grasps.letter, minlength=len(Label))
    fractions = {one: percent_text(float(counts[one] / size)) for one in Label}
    report.letters("scan", {"count": lambda one: str(counts[one]), "": fractions.__getitem__})
    report.lines(_remarks(grasps))
    report.line(f"[bold]{escaped(str(verdict_of(grasps)))}[/]")
    if grasps.load_case is not None:
        report.line(load_line(grasps.load_case))
    report.warnings(grasps.warnings)
    rows = np.arange(size)
    if size > MAX_ROWS:
        rows = ranked_rows(grasps)[:MAX_ROWS]
        report.line(f"the best {MAX_ROWS} of {size}:")
    report.grasps(grasps, rows.tolist())
    if metrics:
        medians = (f"{name} {np.nanmedian(values):.4g}" for name, values in metrics.items())
        report.line(f"medians: {', '.join(medians)}")


def _kind(grasps: Grasps) -> str:
    """Number and kind of the grasps, in words."""
    if isinstance(grasps, GraspTable):
        return f"{counted(grasps.size, 'grasps')} of {grasps.model.fingers} fingers"
    return f"{counted(grasps.size, 'poses')} of {grasps.hand.name}"


def _remarks(grasps: Grasps) -> Iterator[str]:
    """Yield remarks on all grasps, a line each."""
    mesh, size = grasps.mesh, grasps.size
    if isinstance(grasps, GraspTable):
        most = float(grasps.distance.max())
        most *= most >= DISTANCE_ROUNDING * mesh.size
        yield f"contacts at most {length_with_unit(most, mesh.unit)} from the surface"
    else:
        kinds = Counter(kind for kind in grasps.reasons.kinds if kind)
        yield from (f"{count} of {size}: {kind}" for kind, count in kinds.most_common())
        tried = ~np.isnan(grasps.outcome)
        held = {one: grasps.outcome[tried & (grasps.letter == Label[one])] for one in "SMU"}
        parts = [f"{k} {percent_text(v.mean())} of {len(v)}" for k, v in held.items() if len(v)]
        if parts:
            yield f"held when tried: {', '.join(parts)}"
        yield from map(escaped, grasps.remarks)
        given = grasps.given
        yield f"poses read in {given.frame_words}"
        yield frame_text(given.object_pose)
        if read := given.settings.get(READING):
            yield f"{READINGS[READING]}: {read}"
