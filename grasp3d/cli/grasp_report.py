"""Printed reports of grasps: evaluated contacts and poses, the best of a surface, and measures."""

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np

from grasp3d.arrays import Bytes, Floats, Ints
from grasp3d.cli.report import (
    LEVELS,
    LOAD,
    MARGIN,
    PERCENTS,
    Column,
    Report,
    angle_text,
    escaped,
    holding_columns,
    label_name,
    margin_columns,
    model_words,
    percent_text,
    print_load,
    table_of,
    uncertainty_lines,
)
from grasp3d.grasps.audit import READING, READINGS
from grasp3d.grasps.evaluated_poses import EvaluatedPoses, GivenGrasps
from grasp3d.grasps.evaluation import DISTANCE_ROUNDING
from grasp3d.grasps.ranking import listed_rows, stated_label
from grasp3d.grasps.verdict import verdict_of
from grasp3d.hand.closed_jaws import MEANING as CLOSINGS
from grasp3d.hand.closed_jaws import Closing
from grasp3d.hand.object_pose import ObjectPose
from grasp3d.settings.lengths import small_length
from grasp3d.settings.model_text import epsilon_min_text
from grasp3d.stability.label import MEANING, Label
from grasp3d.surface.area_statistics import quantiles
from grasp3d.surface.closed_grasps import UNKNOWN, ClosedGrasps
from grasp3d.surface.grasp_table import GraspTable
from grasp3d.surface.robustness import Robustness
from grasp3d.surface.rows import NO_ROW
from grasp3d.system.counts import counted

MAX_ROWS = 10
"""Largest number of evaluated grasps in the table."""

_SURELY = "α*: the grasp is surely stable at any smaller sensor resolution; "
_CONTACTS_LEGEND = f"β*: critical friction angle; {_SURELY}"
_POSES_LEGEND = (
    f"β*: critical friction angle at the mean normals of the touched patches; {_SURELY}"
    "area: the smaller patch; opening in "
)
_APPROACH = "approach: how far the approach may turn about the closing axis; "
_CLOSED = (
    "label: at what the jaws touch when they close, with the force at hand; closed: the same "
    "without a load, and its margin, the friction angle to spare; "
)
_TRIED = (
    "tried: the worst label of {} poses that are wrong by at most {}, the stated one among them"
)
_SCORE = "score: how well the touched patches hold at the worst normals, -1 to 1{}{}"


def print_evaluated(grasps: GraspTable, output: Path) -> None:
    """Print the number of grasps of each label, and a table of the best grasps.

    Args:
        grasps: Evaluated grasps.
        output: The file that they were written to.
    """
    report, mesh, size = Report(), grasps.mesh, grasps.size
    count = f"{counted(size, 'grasps')} of {grasps.model.fingers} fingers"
    report.heading(mesh.report.source, f"{count}; {model_words(grasps.model)}")
    counts = np.bincount(grasps.label, minlength=len(Label))
    report.labels(
        "scan", ("grasps", "fraction"), lambda label: _number_of(int(counts[label]), size)
    )
    angles = quantiles(grasps.critical_angle, LEVELS, np.ones(size))
    texts = ", ".join(map(angle_text, angles))
    report.paragraph(f"critical friction angle, {PERCENTS} of the grasps: {texts}")
    report.lines(uncertainty_lines(grasps, None, of="grasps", unit=mesh.unit))
    report.lines(_outside(grasps))
    report.paragraph(_distance_text(grasps))
    report.line(f"[bold]{escaped(str(verdict_of(grasps)))}[/]")
    print_load(report, grasps.holding)
    report.warnings(grasps.warnings)
    columns = [
        *_columns(grasps, grasps.label), *_conditional_columns(grasps, distances=True)
    ]  # fmt: skip
    print_some(report, columns, grasps)
    report.line(_legend(grasps))
    report.written(output)


def print_best(
    grasps: GraspTable,
    requested: int,
    output: Path,
    *,
    has_pictures: bool,
    has_file: bool = True,
    object_pose: ObjectPose | None = None,
) -> None:
    """Print the best distinct grasps of a surface, best first.

    Args:
        grasps: The grasps.
        requested: Number of grasps that the user requested.
        output: The file that they were written to.
        has_pictures: Whether pictures of them were written to a file of the same name.
        has_file: Whether that file was written.
        object_pose: Pose of the object in the frame of that file; None: it has the mesh's.
    """
    report = Report()
    if not grasps.size:
        report.paragraph("best grasps: none found")
    else:
        what = "best distinct grasp" if grasps.size == 1 else f"{grasps.size} best distinct grasps"
        report.paragraph(f"the {what}:")
        codes = stated_label(grasps, grasps.closed)  # those in whose order they are
        columns = [*_columns(grasps, codes), *_conditional_columns(grasps)]
        report.columns(columns, range(grasps.size))
        report.line(_legend(grasps))
        if grasps.closed is not None:
            report.lines(_robust_legend(grasps, grasps.closed.robustness))
        if grasps.has_poses:
            report.line(frame_text(object_pose))
        report.warnings(warnings_of_best(grasps, object_pose))
        if grasps.size < requested:
            report.paragraph(f"{requested} were requested; all others are similar to one of these")
        if not has_pictures:
            report.line(
                "no pictures: they need OpenGL, which is not available (on Debian: libegl1 libgl1)"
            )
    if has_file:
        report.written(output, *([output.with_suffix(".png")] if has_pictures else []))


def warnings_of_best(grasps: GraspTable, object_pose: ObjectPose | None) -> list[str]:
    """What is to be known of the best grasps and of their file; arguments as in `print_best`."""
    closed = None if grasps.closed is None else grasps.closed.note(grasps.label)
    tilted = None if grasps.scene is None else grasps.scene.tilt_warning(object_pose)
    return [text for text in (closed, tilted) if text]


def print_poses(poses: EvaluatedPoses, output: Path) -> None:
    """Print the numbers of poses by label and by what the jaws do, and the best poses.

    Args:
        poses: Evaluated poses.
        output: The file that they were written to.
    """
    report, mesh, model = Report(), poses.mesh, poses.model
    report.heading(
        mesh.report.source,
        f"{counted(poses.size, 'poses')} of gripper {escaped(poses.hand.name)}; "
        f"{model_words(model)}",
    )
    rows = [(*names, *_number_of(count, poses.size)) for names, count in _pose_counts(poses)]
    report.table(table_of(("", "", "poses", "fraction"), rows, texts=2))
    report.lines(uncertainty_lines(poses, None, of="poses", unit=mesh.unit))
    report.lines(_outside(poses))
    report.lines(outcomes_lines(poses))
    report.line(f"[bold]{escaped(str(verdict_of(poses)))}[/]")
    print_load(report, poses.holding)
    report.warnings(poses.warnings)
    print_some(report, _pose_columns(poses), poses)
    report.line(f"{_added_legend(poses)}{_POSES_LEGEND}{mesh.unit}")
    report.lines(_robust_legend(poses, poses.robustness))
    print_files(report, poses, output)


def print_metrics(metrics: Mapping[str, Floats]) -> None:
    """Print the quantiles of each quality measure over the grasps, and how many are undefined."""
    rows = []
    for name, values in metrics.items():
        defined = values[~np.isnan(values)]
        texts = ["none"] * len(LEVELS)
        if len(defined):
            texts = [f"{value:.4g}" for value in np.quantile(defined, LEVELS)]
        missing = len(values) - len(defined)
        rows.append([name, *texts, str(missing) if missing else ""])
    levels = (f"{100.0 * level:.0f} %" for level in LEVELS)
    Report().table(table_of(("quality measure", *levels, "undefined"), rows))


def print_some(report: Report, columns: Sequence[Column], grasps: GraspTable | GivenGrasps) -> None:
    """Print a table of the grasps; where they are many, of those to be taken first."""
    rows = np.arange(grasps.size)
    if grasps.size > MAX_ROWS:
        rows = listed_rows(grasps, MAX_ROWS)
        report.paragraph(f"the best {MAX_ROWS} of {grasps.size}:")
    report.columns(columns, rows.tolist())


def _number_of(count: int, total: int) -> tuple[str, str]:
    """Cells of a number of grasps, and of its fraction of all."""
    return str(count), percent_text(count / total)


def _added_legend(grasps: GraspTable | EvaluatedPoses) -> str:
    """Meaning of the columns on loads and margins, if there are any."""
    forces = "" if grasps.holding is None else LOAD
    return forces + (MARGIN if grasps.model.is_uncertain else "")


def _legend(grasps: GraspTable) -> str:
    approach = "" if grasps.reach is None else _APPROACH
    closed = "" if grasps.closed is None else _CLOSED
    unit = grasps.mesh.unit or "the unit of the mesh, which is not stated"
    return (
        f"{approach}{closed}{_added_legend(grasps)}{_CONTACTS_LEGEND}"
        f"{epsilon_min_text(grasps.model)}; lengths in {unit}"
    )


def frame_text(pose: ObjectPose | None) -> str:
    """Frame of the poses in the file."""
    frame = "mesh's frame" if pose is None else f"robot's frame {pose.frame!r}"
    return f"poses in the file: in the {frame}"


def _distance_text(grasps: GraspTable) -> str:
    """Return the median and the largest distance of the contacts from the surface."""
    unit = grasps.mesh.unit or "(unit not stated)"
    median, most = (_distance(grasps, value) for value in np.quantile(grasps.distance, [0.5, 1.0]))
    return f"distance of the contacts from the surface: median {median}, at most {most} {unit}"


def _distance(grasps: GraspTable, distance: float) -> str:
    """Format a distance from the surface; rounding errors are 0."""
    return "0" if distance < DISTANCE_ROUNDING * grasps.mesh.size else f"{distance:.3g}"


def _columns(
    grasps: GraspTable | EvaluatedPoses, labels: Ints | Bytes, first: str = "grasp"
) -> list[Column]:
    """The columns of every table of grasps, with their `Label` codes (b,)."""
    return [
        (first, lambda row: str(row + 1)),
        ("label", lambda row: label_name(Label(int(labels[row])))),
        ("β*", lambda row: angle_text(grasps.critical_angle[row])),
        ("α*", lambda row: resolution_text(grasps.max_resolution[row])),
        *margin_columns(grasps),
        ("ε", lambda row: number_text(grasps.epsilon[row])),
        ("ε_min", lambda row: number_text(grasps.epsilon_min[row])),
        ("opening", lambda row: f"{grasps.opening[row]:.4g}"),
    ]


def _conditional_columns(grasps: GraspTable, *, distances: bool = False) -> list[Column]:
    """The columns of some grasps: of several fingers, a gripper, a load."""
    reach, closed = grasps.reach, grasps.closed
    columns: list[Column] = []
    if grasps.contacts.count > 2:
        columns.append(("separation", lambda row: f"{grasps.separation[row]:.4g}"))
    if distances:
        columns.append(("distance", lambda row: _distance(grasps, grasps.distance[row].max())))
    if grasps.has_poses and reach is not None:
        margin = np.degrees(reach.approach_margin)
        columns.append(("approach", lambda row: f"±{margin[row]:.0f}°"))
    if closed is not None:
        columns.append(("closed", lambda row: _closed_text(closed, row)))
        columns += _robust_columns(closed.robustness, closed.row)
    return [*columns, *holding_columns(grasps.holding)]


def _closed_text(closed: ClosedGrasps, row: int) -> str:
    """Label and margin of a grasp after closing; empty where they are not known."""
    code, margin = int(closed.label[row]), closed.margin[row]
    if code == UNKNOWN:
        return ""
    name = label_name(Label(code))
    return name if math.isnan(margin) else f"{name} {angle_text(margin)}"


def _robust_columns(robustness: Robustness | None, rows: Ints) -> list[Column]:
    """The worst label of wrong poses, if any were tried, and the score of closed jaws.

    Args:
        robustness: Of closed jaws; None: none were closed.
        rows: Row of each grasp in it, -1: not known, shape (b,).
    """
    if robustness is None:
        return []

    def tried(row: int) -> str:
        name, share = label_name(Label(int(found.label_tried[row]))), found.closing_share[row]
        if share == 1.0:
            return f"{name} of {found.tried}"
        return f"{name}, {min(round(100.0 * share), 99)} % close"

    def known(cell: Callable[[int], str]) -> Callable[[int], str]:
        return lambda row: "" if rows[row] == NO_ROW else cell(int(rows[row]))

    found = robustness
    score: Column = ("score", known(lambda row: f"{found.robust_score[row]:.2f}"))
    return [*[("tried", known(tried))] * (found.tried > 1), score]


def _robust_legend(grasps: GraspTable | EvaluatedPoses, robustness: Robustness | None) -> list[str]:
    """Meanings of `_robust_columns`, a line each."""
    if robustness is None or grasps.scene is None:
        return []
    many, case, error = robustness.tried > 1, grasps.load_case, grasps.scene.pose_error
    wrong = str(error).removesuffix(",0 deg").replace(",", " and ")
    missing = "force" if case is not None and case.decided else "mass"
    relative = f"; robust scores are per newton of grip: no {missing} is given"
    return [
        *[_TRIED.format(robustness.tried, wrong)] * many,
        _SCORE.format(
            ", mean of these poses" if many else "",
            ", from 0.5 on they hold the load" if robustness.by_mass else relative,
        ),
    ]


def number_text(value: float) -> str:
    """Format a number; nan means that there is no grasp."""
    return "none" if math.isnan(value) else f"{value:.3f}"


def resolution_text(angle: float) -> str:
    """Format a sensor resolution; 0 means that none is fine enough."""
    return angle_text(angle) if angle > 0.0 else "none"


def _pose_counts(poses: EvaluatedPoses) -> list[tuple[tuple[str, str], int]]:
    """The numbers of labels, of jaws that do not close, and of collisions, with their meanings."""
    closed = poses.jaws.closed
    return [
        *(
            (
                (label_name(label), MEANING["scan"][label]),
                int((closed & (poses.label == label)).sum()),
            )
            for label in sorted(Label, reverse=True)
        ),
        *(
            (("", meaning), int((poses.state == state).sum()))
            for state, meaning in CLOSINGS.items()
            if state != Closing.CLOSED
        ),
        (("", "closed, but the gripper collides"), int((closed & poses.collides).sum())),
        (("", "closed and reachable"), int(poses.reachable.sum())),
    ]


def _outside(grasps: GraspTable | EvaluatedPoses) -> tuple[str, ...]:
    """Return how many grasps have a contact outside the region, in one line, if there is one."""
    if grasps.mesh.region is None:
        return ()
    count = int(np.isinf(grasps.critical_angle).sum())
    return (f"{count} of {grasps.size} have a contact outside --region: U",)


def print_files(report: Report, poses: GivenGrasps, *outputs: Path) -> None:
    """Print the frame of the poses, how their file was read, and what was written."""
    report.line(frame_text(poses.given.object_pose))
    if read := poses.given.settings.get(READING):
        report.line(f"{READINGS[READING]}: {escaped(read)}")
    report.written(*outputs)


def outcomes_lines(poses: GivenGrasps) -> list[str]:
    """Return the fraction of the poses of each label that held, of those that were tried."""
    parts = []
    for label in sorted(Label, reverse=True):
        tried = poses.outcome[(poses.label == label) & ~np.isnan(poses.outcome)]
        if len(tried):
            parts.append(f"{label.name} {percent_text(tried.mean())} of {len(tried)}")
    return [f"held when tried: {', '.join(parts)}"] if parts else []


def _pose_columns(poses: EvaluatedPoses) -> list[Column]:
    """The columns of poses; where the jaws do not close, only label and jaws are known."""

    def closed(column: Column, otherwise: str) -> Column:
        heading, cell = column
        is_closed = poses.state == Closing.CLOSED
        return heading, lambda row: cell(row) if is_closed[row] else otherwise

    def jaws(row: int) -> str:
        state = Closing(int(poses.state[row]))
        name = state.name.lower().replace("_", " ")
        if state != Closing.CLOSED:
            return name
        if shift := abs(poses.jaws.shift[row]):
            name += f", gave way {small_length(shift, poses.mesh.unit, 2)}"
        return f"{name}, collides" if poses.collides[row] else name

    number, label, *measures, opening = _columns(poses, poses.label, "pose")
    area: Column = ("area", lambda row: f"{poses.jaws.area[row].min():.3g}")
    return [
        number,
        label,
        *(closed(column, "none") for column in measures),
        *(closed(column, "") for column in (opening, area, *holding_columns(poses.holding))),
        *_robust_columns(poses.robustness, np.arange(poses.size)),
        ("jaws", jaws),
    ]
