"""Printed reports of grasps: evaluated contacts and poses, the best of a surface, and measures."""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from grasp3d.arrays import Floats
from grasp3d.cli.report import (
    LEVELS,
    LOAD,
    MARGIN,
    PERCENTS,
    Column,
    Report,
    angle_text,
    escaped,
    force_text,
    label_name,
    load_columns,
    load_line,
    margin_columns,
    model_words,
    percent_text,
    print_load,
    table_of,
    uncertainty_lines,
)
from grasp3d.grasps.audit import READING, READINGS
from grasp3d.grasps.distinct import distance_of_distinct
from grasp3d.grasps.evaluated_poses import EvaluatedPoses, GivenGrasps
from grasp3d.grasps.evaluation import DISTANCE_ROUNDING
from grasp3d.grasps.ranking import ranked_rows
from grasp3d.grasps.verdict import verdict_of
from grasp3d.hand.object_pose import ObjectPose
from grasp3d.settings.model_text import epsilon_min_text
from grasp3d.stability.label import Label
from grasp3d.surface.area_statistics import quantiles
from grasp3d.surface.grasp_table import GraspTable
from grasp3d.system.counts import counted, short_number

MAX_ROWS = 10
"""Largest number of evaluated grasps in the table."""

_SURELY = "α*: the grasp is surely stable at any smaller sensor resolution; "
_CONTACTS_LEGEND = f"β*: critical friction angle; {_SURELY}"
_TOUCHED = "β*: critical friction angle where the jaws touch; "
_POSE = "score: 0 to 1, U below 1/3, S above 2/3; "
_NEEDS = "needs, holds: force and mass at the worst normals; "


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
    print_load(report, grasps.load_result)
    report.warnings(grasps.warnings)
    print_some(report, contact_columns(grasps, distances=True), grasps)
    report.line(_legend(grasps))
    report.written(output)


def print_best(
    grasps: GraspTable | EvaluatedPoses,
    requested: int,
    *,
    can_draw: bool,
    object_pose: ObjectPose | None = None,
    pool: EvaluatedPoses | None = None,
) -> None:
    """Print the best distinct grasps of a surface, best first.

    Args:
        grasps: The grasps.
        requested: Number of grasps that the user requested.
        can_draw: Whether pictures can be drawn.
        object_pose: Pose of the object in the frame of the file; None: it has the mesh's.
        pool: The poses among which they were sought; None: they are those of the vertices.
    """
    report = Report()
    columns, legend = _shown(grasps)
    if not grasps.size:
        report.paragraph("best grasps: none may hold")
    else:
        what = "best distinct grasp" if grasps.size == 1 else f"{grasps.size} best distinct grasps"
        report.paragraph(f"the {what}:")
        report.columns(columns, range(grasps.size))
        report.line(legend)
        if isinstance(grasps, EvaluatedPoses):
            report.line(frame_text(object_pose))
        report.warnings(warnings_of_best(grasps, object_pose))
        if grasps.size < requested:
            report.paragraph(f"{requested} were requested; {_why_fewer(grasps, pool)}")
        if not can_draw:
            report.line(
                "no pictures: they need OpenGL, which is not available (on Debian: libegl1 libgl1)"
            )


def _why_fewer(grasps: GraspTable | EvaluatedPoses, pool: EvaluatedPoses | None) -> str:
    """Why there are not as many best grasps as were requested."""
    apart = grasps.mesh.length_text(distance_of_distinct(grasps.mesh), 2)
    near = f"nearer than {apart} to one of these"
    if pool is None:
        return f"all others that may hold are {near}"
    held = int((pool.letter > Label.U).sum())
    wrong = grasps.scene is not None and bool(grasps.scene.pose_error)
    return (
        f"of {counted(pool.size, 'free poses')} {held} may hold, and each of those that is not "
        f"listed is {near}{', or fails where it is wrong' if wrong else ''}"
    )


def _shown(grasps: GraspTable | EvaluatedPoses) -> tuple[list[Column], str]:
    """The columns of a table of grasps, and its legend."""
    if isinstance(grasps, EvaluatedPoses):
        return pose_columns(grasps), pose_legend(grasps)
    return contact_columns(grasps), _legend(grasps)


def warnings_of_best(
    grasps: GraspTable | EvaluatedPoses, object_pose: ObjectPose | None
) -> list[str]:
    """What is to be known of the best grasps and of their file; arguments as in `print_best`."""
    tilted = None if grasps.scene is None else grasps.scene.tilt_warning(object_pose)
    return [tilted] if tilted else []


def print_poses(poses: EvaluatedPoses, *outputs: Path) -> None:
    """Print the numbers of poses by label and by what is wrong with them, and the best poses.

    Args:
        poses: Evaluated poses.
        outputs: The files that were written.
    """
    report, mesh, model = Report(), poses.mesh, poses.model
    report.heading(
        mesh.report.source,
        f"{counted(poses.size, 'poses')} of gripper {escaped(poses.hand.name)}; "
        f"{model_words(model)}",
    )
    counts = np.bincount(poses.label, minlength=len(Label))
    report.labels(
        "scan", ("poses", "fraction"), lambda label: _number_of(int(counts[label]), poses.size)
    )
    report.lines(reason_lines(poses))
    report.lines(uncertainty_lines(poses, None, of="poses", unit=mesh.unit))
    report.lines(_outside(poses))
    report.lines(outcomes_lines(poses))
    report.line(f"[bold]{escaped(str(verdict_of(poses)))}[/]")
    if poses.load_case is not None:
        report.line(load_line(poses.load_case))
    report.warnings(poses.warnings)
    print_some(report, pose_columns(poses), poses)
    report.line(pose_legend(poses))
    print_files(report, poses, *outputs)


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
        rows = ranked_rows(grasps)[:MAX_ROWS]
        report.paragraph(f"the best {MAX_ROWS} of {grasps.size}:")
    report.columns(columns, rows.tolist())


def _number_of(count: int, total: int) -> tuple[str, str]:
    """Cells of a number of grasps, and of its fraction of all."""
    return str(count), percent_text(count / total)


def _legend(grasps: GraspTable) -> str:
    """Meaning of the columns of contacts."""
    added = ("" if grasps.load_result is None else LOAD) + MARGIN * grasps.model.is_uncertain
    unit = grasps.mesh.unit or "the unit of the mesh, which is not stated"
    return f"{added}{_CONTACTS_LEGEND}{epsilon_min_text(grasps.model)}; lengths in {unit}"


def pose_legend(poses: EvaluatedPoses) -> str:
    """Meaning of the columns of poses."""
    forces = _NEEDS if poses.load is not None else ""
    return f"{_POSE}{forces}{_TOUCHED}opening in m"


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


def contact_columns(grasps: GraspTable, *, distances: bool = False) -> list[Column]:
    """The columns of contacts.

    Args:
        grasps: The grasps.
        distances: Whether they were given, at some distance from the surface.
    """
    columns = [
        *_first_columns(grasps, "grasp"),
        ("α*", lambda row: resolution_text(grasps.max_resolution[row])),
        *margin_columns(grasps),
        ("ε", lambda row: number_text(grasps.epsilon[row])),
        ("ε_min", lambda row: number_text(grasps.epsilon_min[row])),
        ("opening", lambda row: f"{grasps.opening[row]:.4g}"),
    ]
    if grasps.contacts.count > 2:
        columns.append(("separation", lambda row: f"{grasps.separation[row]:.4g}"))
    if distances:
        columns.append(("distance", lambda row: _distance(grasps, grasps.distance[row].max())))
    return [*columns, *load_columns(grasps.load_result)]


def pose_columns(poses: EvaluatedPoses) -> list[Column]:
    """The columns of poses: what their numbers are, or why there is none."""
    columns = _first_columns(poses, "pose")
    if poses.load is not None:
        columns.append(("needs", lambda row: force_text(poses.grip_force[row])))
        if np.isfinite(poses.payload).any():
            columns.append(("holds", lambda row: f"{short_number(poses.payload[row])} kg"))
    else:
        columns.append(("α*", lambda row: resolution_text(poses.max_resolution[row])))
        columns.append(("ε", lambda row: number_text(poses.epsilon[row])))
    head, known = columns[:3], columns[3:]
    known.append(("opening", lambda row: f"{poses.opening[row]:.4g}"))

    def closed(column: Column) -> Column:
        heading, cell = column
        return heading, lambda row: cell(row) if poses.jaws.closed[row] else ""

    return [*head, *map(closed, known), ("reason", lambda row: escaped(str(poses.reason[row])))]


def _first_columns(grasps: GraspTable | EvaluatedPoses, first: str) -> list[Column]:
    """The columns of every table of grasps."""
    return [
        (first, lambda row: str(row + 1)),
        ("label", lambda row: label_name(Label(int(grasps.letter[row])))),
        ("score", lambda row: f"{grasps.score[row]:.2f}"),
        ("β*", lambda row: angle_text(grasps.critical_angle[row])),
    ]


def number_text(value: float) -> str:
    """Format a number; nan means that there is no grasp."""
    return "none" if math.isnan(value) else f"{value:.3f}"


def resolution_text(angle: float) -> str:
    """Format a sensor resolution; 0 means that none is fine enough."""
    return angle_text(angle) if angle > 0.0 else "none"


def reason_lines(poses: GivenGrasps) -> list[str]:
    """How often something is wrong with poses, a line for each reason."""
    kinds = Counter(kind for kind in poses.reasons.kinds if kind)
    return [f"{count} of {poses.size}: {kind}" for kind, count in kinds.most_common()]


def _outside(grasps: GraspTable | EvaluatedPoses) -> tuple[str, ...]:
    """Return how many grasps have a contact outside the region, in one line, if there is one."""
    if grasps.mesh.region is None:
        return ()
    count = int(np.isinf(grasps.critical_angle).sum())
    return (f"{count} of {grasps.size} have a contact outside --region: U",)


def print_files(report: Report, poses: GivenGrasps, *outputs: Path) -> None:
    """Print the frame of the poses, how their file was read, and what was written."""
    given = poses.given
    report.line(frame_text(given.object_pose))
    why = ", as the file states none" if given.assumes_frame else ""
    report.line(f"poses read in the gripper's frame '{given.gripper_frame}'{why} (--frame)")
    if read := given.settings.get(READING):
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
