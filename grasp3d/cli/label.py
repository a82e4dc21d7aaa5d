"""The command `grasp3d label`: labels one mesh, writes it, and prints its report."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from grasp3d.cli.commands import Label
from grasp3d.cli.report import (
    NOTE,
    PERCENTS,
    Grasps,
    Report,
    escaped,
    frame_text,
    load_line,
    percent_text,
    quantiles_text,
)
from grasp3d.describe.explanations import causes_text
from grasp3d.describe.verdict import verdict_of
from grasp3d.errors import OutputError, SettingError
from grasp3d.formats.files import check_frame, check_hand, write_grasps
from grasp3d.formats.format import format_called, format_of, suffixes
from grasp3d.formats.own import SUFFIXES
from grasp3d.formats.surface_files import writer_for
from grasp3d.grasps.best import best_grasps
from grasp3d.grasps.evaluated_poses import EvaluatedPoses, distance_of_distinct
from grasp3d.mesh.surface_points import nearest_vertex
from grasp3d.pictures import opengl
from grasp3d.settings.grasp_model import model_line
from grasp3d.settings.units import parse_lengths
from grasp3d.stability.label import Label as Letter
from grasp3d.surface.fields import CRITICAL_ANGLE, EPSILONS, LOAD_NUMBERS, MAX_RESOLUTION
from grasp3d.surface.grasp_table import GraspTable
from grasp3d.surface.labelling import Labelling
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.surface.sweeps import vertex_weights
from grasp3d.system.context import refuse_warnings
from grasp3d.system.files import check_suffix
from grasp3d.system.names import safe_stem

QUANTILES = (CRITICAL_ANGLE, MAX_RESOLUTION, *EPSILONS, *LOAD_NUMBERS)
"""Columns whose quantiles over the area are printed, if they have a heading."""


def run(command: Label, report: Report) -> int:
    """Run the command, and return the exit code."""
    if command.reach.pose_error and not command.best:
        raise SettingError("--pose-error applies to the best grasps: give --best as well")
    output, grasp_file = _files(command)
    write = writer_for(output)
    labels, vertices = _labels(command, report)
    grasps = best_grasps(labels, command.best) if command.best else None
    tilted = labels.scene.tilt_warning(command.object_pose) if labels.scene else None
    refuse_warnings(filter(None, [tilted]))
    write(output, labels)
    if not command.quiet:
        print_labels(report, labels)
    for text, vertex in zip(command.at, vertices, strict=True):
        _print_at(labels, text, vertex)
    written = [output]
    if grasps is not None:
        written += _write_best(command, report, labels, grasp_file, grasps)
        print_best(report, grasps, command.best or 0)
        if isinstance(grasps, EvaluatedPoses) and grasps.size:
            report.line(frame_text(command.object_pose))
        if grasps.size and not opengl.can_render():
            report.line("no pictures: they need OpenGL (on Debian: libegl1 libgl1)")
        report.warnings(filter(None, [tilted]))
    report.written(*written)
    return 0


def _files(command: Label) -> tuple[Path, Path]:
    """Return the labelled file and the file of the best grasps, checked before the work."""
    name = safe_stem(command.file.stem) if command.output is None else command.output.stem
    output = command.output or Path(f"{name}_labeled.ply")
    name_of = command.grasps_format
    suffix = format_called(name_of).suffixes[0] if name_of else ".json"
    grasp_file = command.grasps or output.with_name(f"{name}_grasps{suffix}")
    grasp_files = (grasp_file, grasp_file.with_suffix(".png")) if command.best else ()
    if command.best:
        _check_grasp_file(command, grasp_file)
        if grasp_file.absolute() == output.absolute():
            raise OutputError(f"{output}: is named for the labelled file and for the best grasps")
    for path in (output, *grasp_files):
        mask = getattr(command.mesh.region, "path", None)
        inputs = [command.file, mask, *command.load.task.files]
        command.check_output(path, inputs=inputs)
    return output, grasp_file


def _check_grasp_file(command: Label, path: Path) -> None:
    """Check before the work that the best grasps can be written to this file."""
    hand, name = command.posed_hand, command.grasps_format
    if name:
        check_suffix(path, format_called(name).suffixes, name)
    check_suffix(path, suffixes() if hand else SUFFIXES, "table")
    form = format_of(path, name)
    if form.outcomes:
        raise SettingError(
            f"{form.title} files state which grasps held, which is not known of grasps that are "
            "found; choose another grasps_format"
        )
    if hand is not None:
        check_hand(form, hand)
    if command.object_pose is not None:
        check_frame(form)
    if command.frame is not None:
        command.frame.to_tcp(hand)


def _labels(command: Label, report: Report) -> tuple[SurfaceLabels, list[int]]:
    """Read and label the mesh; return the labels, and the vertices asked for."""
    task = Labelling.read(
        command.file, command.reach.touching(command.model), command.sampling, command.reach,
        command.load.chosen, command.mesh, force=command.force,
    )  # fmt: skip
    points = (parse_lengths("at", text) for text in command.at)
    vertices = [nearest_vertex(task.mesh, "at", point) for point in points]
    with report.progress(f"labelling {command.file.name}"):
        labels = task.labels()
    with report.progress("measuring"):  # computes what is otherwise computed on first use
        _ = labels.epsilon_range, labels.load_result
    return labels, vertices


def _print_at(labels: SurfaceLabels, text: str, vertex: int) -> None:
    """Print the label, the grasp and the reason at a vertex, as the viewer shows them."""
    from grasp3d.describe.explanations import position_text
    from grasp3d.pictures.subject import subject_of
    from grasp3d.viewer.inspection import inspect

    # It is asked for, so it is printed also with --quiet.
    report, shown = Report(), inspect(subject_of(labels), vertex)
    report.heading(f"at {text}", escaped(shown.reason))
    points, approach = shown.points[1:], labels.approach
    others = [("opposing contact", position_text(point, labels.mesh)) for point in points]
    if approach is not None and np.isfinite(approach[vertex]).all():
        direction = ", ".join(f"{number + 0.0:.3g}" for number in approach[vertex])
        others.append(("approach along", f"({direction})"))
    report.values([("label", Letter(labels.label[vertex]).name), *shown.numbers, *others])


def _write_best(
    command: Label, report: Report, labels: SurfaceLabels, output: Path, grasps: Grasps
) -> list[Path]:
    """Write and, if OpenGL is available, draw the best grasps; return the files written."""
    from grasp3d.pictures.figures import save_as
    from grasp3d.pictures.stills import draw_grasps, grasp_figure

    written, picture = [], output.with_suffix(".png")
    for old in (output, picture):  # files with other settings
        old.unlink(missing_ok=True)
    if grasps.size or isinstance(grasps, GraspTable):  # files of poses cannot be empty
        written.append(output)
        write_grasps(
            output, grasps, format=command.grasps_format, object_pose=command.object_pose,
            frame=command.frame,
        )  # fmt: skip
    else:
        report.line(f"{NOTE} {escaped(str(output))} is not written: there is no pose to write")
    if grasps.size and opengl.can_render():
        with report.progress("drawing grasps"):
            pictures = draw_grasps(grasps, labels)
        written.append(picture)
        save_as(grasp_figure(grasps, pictures, labels.mode), picture)
    return written


def print_best(report: Report, grasps: Grasps, requested: int) -> None:
    """Print the best distinct grasps of a surface, best first.

    Args:
        report: Where to print.
        grasps: The grasps.
        requested: Number of grasps that the user requested.
    """
    if not grasps.size:
        report.line("best grasps: none, as no grasp is S or M")
        return
    count = f"{grasps.size:,} best distinct grasps" if grasps.size > 1 else "best distinct grasp"
    report.line(f"the {count}:")
    report.grasps(grasps, range(grasps.size))
    if grasps.size < requested:
        apart = grasps.mesh.length_text(distance_of_distinct(grasps.mesh), 2)
        near = f"every other S or M grasp is nearer than {apart} to one of these"
        report.line(f"{requested} were requested; {near}")


def print_labels(report: Report, labels: SurfaceLabels) -> None:
    """Print the settings, area fractions, verdict, repairs and warnings of a labelled surface.

    Without a gripper quantiles of angles, epsilon and forces follow.

    Args:
        report: Where to print.
        labels: Labels of the surface.
    """
    mesh, found = labels.mesh, labels.load_result
    areas, fractions = vertex_weights(mesh, "area"), labels.fractions()
    report.mesh(mesh, escaped(", ".join(_settings(labels))))
    report.lines(mesh.region_notes)
    if labels.scene is not None:
        report.line("labels of the best contacts that the gripper reaches, if whole pads touch:")
    report.letters("label", {"area": lambda code: percent_text(fractions[code.name])})
    if labels.sampling is not None:
        report.line(f"[bold]{escaped(str(verdict_of(labels)))}[/]")
    if found is not None:
        report.line(load_line(found.case))
    if labels.scene is None:
        if labels.sampling is not None and (causes := causes_text(labels)):
            report.line(f"reasons for U, by area: {escaped(causes)}")
        if found is not None and found.remedy and np.isfinite(found.grip_force_largest).any():
            report.line(f"most grasps hold nothing: {escaped(found.remedy)}")  # else the verdict
        shown = ((one, one.values_of(labels)) for one in QUANTILES if one.heading)
        texts = [
            quantiles_text(one, values, areas, metres=mesh.unit is not None)
            for one, values in shown
            if values is not None
        ]
        report.line(f"{PERCENTS} quantiles by area: {'; '.join(texts)}")
    report.lines(map(str, mesh.report.repairs), "repaired:")
    report.warnings(labels.warnings)


def _settings(labels: SurfaceLabels) -> Iterator[str]:
    """Yield model, gripper and table, in words."""
    mesh, model, scene = labels.mesh, labels.model, labels.scene
    yield model_line(model, metres=mesh.unit is not None)
    if model.fingers > 2:
        yield f"{model.fingers} fingers"
    if scene is not None:
        yield from scene.words
