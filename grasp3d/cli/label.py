"""The command `grasp3d label`: labels one mesh, writes it, and prints its report."""

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from grasp3d.arrays import Floats
from grasp3d.cli import grasp_report, progress_bars
from grasp3d.cli.commands import Label
from grasp3d.cli.existing_files import check_output
from grasp3d.cli.report import (
    CHECK_HINT,
    PERCENTS,
    Report,
    escaped,
    length_with_unit,
    model_words,
    percent_text,
    print_load,
    quantiles_text,
)
from grasp3d.errors import OutputError, SettingError
from grasp3d.export.writers import writer_for
from grasp3d.grasps.best import best_grasps, check_external, pool_of
from grasp3d.grasps.causes import causes_text
from grasp3d.grasps.evaluated_poses import EvaluatedPoses
from grasp3d.grasps.grasp_files import SUFFIXES, write_grasps
from grasp3d.grasps.pose_files import SUFFIXES as POSES
from grasp3d.grasps.pose_files.files import check_frame, check_hand, format_of, suffixes_of
from grasp3d.grasps.verdict import verdict_of
from grasp3d.hand.jaws import AXES
from grasp3d.hand.scene import Scene
from grasp3d.mesh.surface_points import nearest_vertex
from grasp3d.settings import Sampling
from grasp3d.settings.parsing import plain_values
from grasp3d.settings.units import Unit, parse_lengths
from grasp3d.stability.label import Label as Letter
from grasp3d.surface.area_statistics import vertex_weights
from grasp3d.surface.fields import CRITICAL_ANGLE, EPSILONS, MAX_RESOLUTION
from grasp3d.surface.grasp_table import GraspTable
from grasp3d.surface.labelling import Labelling
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.system.context import refuse_warnings
from grasp3d.system.counts import counted
from grasp3d.system.files import check_suffix
from grasp3d.system.names import safe_stem

REACHED_CONTACTS = "two contacts that the gripper reaches, whole pads assumed to touch"
"""What the letters of an area are, where there is a gripper."""


def run(command: Label) -> int:
    """Run the command, and return the exit code."""
    if command.reach.pose_error and not command.best:
        raise SettingError("--pose-error tries wrong poses of the best grasps: give --best as well")
    output, grasp_file = _files(command)
    write = writer_for(output)
    labels, vertices = _labels(command)
    grasps = best_grasps(labels, command.best) if command.best else None
    if grasps is not None:
        refuse_warnings(grasp_report.warnings_of_best(grasps, command.object_pose))
    write(output, labels)
    if not command.quiet:
        print_labels(labels)
    for text, vertex in zip(command.at, vertices, strict=True):  # asked for, so also with --quiet
        _print_at(labels, text, vertex)
    written = [output]
    if grasps is not None:
        written += _write_best(command, labels, grasp_file, grasps)
    if not command.quiet:
        Report().written(*written)
    return 0


def _files(command: Label) -> tuple[Path, Path]:
    """The labelled file and that of the best grasps, checked before the work."""
    name = safe_stem(command.file.stem) if command.output is None else command.output.stem
    output = command.output or Path(f"{name}_labeled.ply")
    form = command.grasps_format
    suffix = suffixes_of(form)[0] if form else ".json"
    grasp_file = command.grasps or output.with_name(f"{name}_grasps{suffix}")
    grasp_files = (grasp_file, grasp_file.with_suffix(".png")) if command.best else ()
    if command.best:
        _check_grasp_file(command, grasp_file)
        if grasp_file.absolute() == output.absolute():
            raise OutputError(f"{output}: is the labelled file and that of the best grasps")
        if command.posed_hand is not None:
            check_external(command.sampling)
    for path in (output, *grasp_files):
        mask = getattr(command.mesh.region, "path", None)
        inputs = [command.file, mask, *command.load.task.files]
        check_output(path, overwrite=command.overwrite, inputs=inputs)
    return output, grasp_file


def _check_grasp_file(command: Label, path: Path) -> None:
    """Check before the work that the best grasps can be written to a file of that name."""
    hand, form = command.posed_hand, command.grasps_format
    if form:
        check_suffix(path, suffixes_of(form), form)
    check_suffix(path, POSES if hand else SUFFIXES, "table")
    if hand is not None:
        check_hand(form or format_of(path), hand)
    if command.object_pose is not None:
        check_frame(form or format_of(path))
    if command.frame is not None:
        command.frame.to_tcp(hand)


def _labels(command: Label) -> tuple[SurfaceLabels, list[int]]:
    """Read and label the mesh; returns the labels, and the vertices that are asked for."""
    model, load, quiet = command.reach.touching(command.model), command.load.chosen, command.quiet
    sampling = command.sampling
    task = Labelling.read(
        command.file, model, sampling, command.reach, load, command.mesh, force=command.force
    )
    points = (parse_lengths("at", text) for text in command.at)
    vertices = [nearest_vertex(task.mesh, "at", point) for point in points]
    with progress_bars.progress(f"labelling {command.file.name}", quiet=quiet):
        labels = task.labels()
    progress_bars.measure(lambda: labels.epsilon_range, "measuring epsilon", quiet=quiet)
    if load is not None:
        progress_bars.measure(lambda: labels.load_result, "measuring grip forces", quiet=quiet)
    return labels, vertices


def _print_at(labels: SurfaceLabels, text: str, vertex: int) -> None:
    """Print the label, the grasp and the reason at a vertex, as the viewer shows them."""
    from grasp3d.viewer.session.inspection import inspect, position_text
    from grasp3d.viewer.subjects.subject import subject_of

    report, shown = Report(), inspect(subject_of(labels), vertex, labels.model)
    report.heading(f"at {text}", escaped(shown.reason))
    points, approach = shown.points[1:], labels.approach
    others = [("opposing contact", position_text(point, labels.mesh)) for point in points]
    if approach is not None and np.isfinite(approach[vertex]).all():
        direction = ", ".join(f"{number + 0.0:.3g}" for number in approach[vertex])
        others.append(("approach along", f"({direction})"))
    report.values([("label", Letter(labels.label[vertex]).name), *shown.numbers, *others])


def _write_best(
    command: Label, labels: SurfaceLabels, output: Path, grasps: GraspTable | EvaluatedPoses
) -> list[Path]:
    """Print, write and, if OpenGL is available, draw the best grasps; returns what was written."""
    from grasp3d.plots.figures import save_as
    from grasp3d.plots.grasps import grasp_figure
    from grasp3d.rendering.opengl import can_render
    from grasp3d.viewer.scene.sheets import draw_grasps

    written, picture = [], output.with_suffix(".png")
    for old in (output, picture):  # of other settings
        old.unlink(missing_ok=True)
    if grasps.size or isinstance(grasps, GraspTable):  # files of poses cannot be empty
        written.append(output)
        write_grasps(
            output, grasps, format=command.grasps_format, object_pose=command.object_pose,
            frame=command.frame,
        )  # fmt: skip
    can_draw = can_render()
    if grasps.size and can_draw:
        with progress_bars.progress("drawing grasps", quiet=command.quiet):
            pictures = draw_grasps(grasps, labels)
        written.append(picture)
        save_as(grasp_figure(grasps, pictures), picture)
    if not command.quiet:
        grasp_report.print_best(
            grasps, command.best or 0, can_draw=can_draw, object_pose=command.object_pose,
            pool=pool_of(labels) if isinstance(grasps, EvaluatedPoses) else None,
        )  # fmt: skip
    return written


def print_labels(labels: SurfaceLabels) -> None:
    """Print the settings, area fractions, verdict, repairs and warnings of a labelled surface.

    Without a gripper also quantiles of angles, epsilon and forces.

    Args:
        labels: Labels of the surface.
    """
    report, mesh = Report(), labels.mesh
    areas, fractions = vertex_weights(mesh, "area"), labels.fractions()
    report.mesh(mesh, "; ".join(map(escaped, _settings(labels))))
    report.lines(mesh.region_notes)
    if labels.scene is not None:
        report.line(f"area, of {REACHED_CONTACTS}:")
    report.letters("label", {"area": lambda code: percent_text(fractions[code.name])})
    if labels.sampling is not None:
        report.line(f"[bold]{escaped(str(verdict_of(labels)))}[/]")
    if labels.scene is None:
        if labels.sampling is not None and (causes := causes_text(labels)):
            decided = labels.load_result is not None and labels.load_result.label is not None
            forced = "U with the force at hand" if decided else "U"
            report.line(f"{forced}, of the area: {escaped(causes)}")
        shown = (CRITICAL_ANGLE, MAX_RESOLUTION, *EPSILONS[:2])
        values = (np.nan_to_num(getattr(labels, one.name), posinf=math.inf) for one in shown)
        texts = [
            quantiles_text(field, one, areas, metres=mesh.unit is not None)
            for field, one in zip(shown, values, strict=True)
        ]
        report.line(f"{PERCENTS} of the area: {'; '.join(texts)}")
        print_load(report, labels.load_result, areas)
    if lone := int(np.sum(~mesh.on_surface)):
        report.line(f"{counted(lone, 'vertices')} in no face: their label is U, their area 0")
    report.lines(map(str, mesh.report.repairs), "repaired:")
    report.warnings(labels.warnings)
    if mesh.report.warnings:
        report.line(CHECK_HINT)


def _settings(labels: SurfaceLabels) -> Iterator[str]:
    """The model, the gripper, and settings of the search that are not default."""
    mesh, model = labels.mesh, labels.model
    fingers = "" if model.fingers == 2 else f", {model.fingers} fingers"
    yield f"{model_words(model, mesh.unit)}{fingers}"
    if model.method == "extremes":
        cones = "circular cones" if model.edges is None else f"cones of {model.edges} edges"
        yield f"wrench hulls at {model.extreme_normals} extreme normals per contact, {cones}"
    if labels.sampling is not None:
        yield from _differences(labels.sampling, mesh.unit)
    if labels.scene is not None:
        yield from _scene(labels.scene, mesh.size, mesh.unit)
    if labels.search.evaluated and model.fingers > 2:
        yield f"{counted(labels.search.evaluated, 'candidate grasps')} evaluated"


def _scene(scene: Scene, size: float, unit: Unit | None) -> Iterator[str]:
    """The gripper, the table, and the limit of approach directions."""
    hand, table, approach = scene.hand, scene.table, scene.approach
    yield f"gripper {hand.name}, stroke {1000.0 * hand.max_opening:.4g} mm"
    if table is not None:
        height = round(table.offset / size, 9) * size + 0.0  # without rounding errors
        resting = ""
        if table.probability is not None:
            resting = f", resting pose of probability {100.0 * table.probability:.0f} %"
        yield f"table at {length_with_unit(height, unit)}{resting}"
    if approach.within < math.pi:
        yield f"approach within {math.degrees(approach.within):.4g}° of straight down"
    if table is not None or approach.within < math.pi:
        option = "" if table is not None and table.probability is not None else " (--up)"
        yield f"up is {_direction(scene.up)}{option}"


def _direction(vector: Floats) -> str:
    """A direction by the name of its axis, or else as numbers."""
    name = next((name for name, axis in AXES.items() if np.allclose(vector, axis)), None)
    return name or f"({', '.join(f'{number + 0.0:.3g}' for number in vector)})"


def _differences(sampling: Sampling, unit: Unit | None) -> Iterator[str]:
    """The settings of the search that differ from their defaults."""
    defaults, lengths = plain_values(type(sampling)()), sampling.lengths()
    for name, value in plain_values(sampling).items():
        if value == defaults[name]:
            continue
        text = str(value)
        if name in lengths:
            text = length_with_unit(value, unit)
        elif name in {"search_angle", "tolerance"}:
            text = f"{math.degrees(value):.4g}°"
        yield f"{name} {text}"
