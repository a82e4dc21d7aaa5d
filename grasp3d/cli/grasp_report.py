"""Printed reports of grasps: evaluated contacts and poses, the best of a surface, and measures."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from grasp3d.arrays import Floats
from grasp3d.cli.report import (
    LEVELS,
    NONE,
    PERCENTS,
    Report,
    escaped,
    length_with_unit,
    load_line,
    model_words,
    percent_text,
)
from grasp3d.grasps.audit import READING, READINGS
from grasp3d.grasps.distinct import distance_of_distinct
from grasp3d.grasps.evaluated_poses import EvaluatedPoses
from grasp3d.grasps.evaluation import DISTANCE_ROUNDING
from grasp3d.grasps.hand_grasps import EvaluatedHandGrasps
from grasp3d.grasps.ranking import ranked_rows
from grasp3d.grasps.verdict import verdict_of
from grasp3d.hand.object_pose import ObjectPose
from grasp3d.settings.units import small_length
from grasp3d.stability.label import Label
from grasp3d.surface.fields import GRASPS, HAND_GRASPS, OPENING, REASON, Field, given_poses
from grasp3d.surface.grasp_table import GraspTable
from grasp3d.system.counts import counted

Grasps = GraspTable | EvaluatedPoses | EvaluatedHandGrasps

MAX_ROWS = 10
"""Largest number of evaluated grasps in the table."""

CONTACTS_OF_LINKS = {
    "given": "contacts as given",
    "closed": "contacts closed from the open preshape",
}


def print_grasps(grasps: Grasps, *outputs: Path) -> None:
    """Print the number of grasps of each label, and a table of the best grasps.

    Args:
        grasps: Evaluated contacts, or poses of a gripper or hand.
        outputs: The files that were written.
    """
    report, mesh, size = Report(), grasps.mesh, grasps.size
    words = model_words(grasps.model, mesh.unit)
    report.heading(mesh.report.source, f"{_kind(grasps)}; {words}")
    of = "grasp" if isinstance(grasps, GraspTable) else "pose"
    counts = np.bincount(grasps.letter, minlength=len(Label))
    report.letters(
        "scan",
        {
            f"{of}s": lambda label: str(counts[label]),
            "fraction": lambda label: percent_text(counts[label] / size),
        },
    )
    report.lines(_remarks(grasps))
    if isinstance(grasps, EvaluatedHandGrasps):
        if grasps.hand_load_result is not None:
            report.line(f"[bold]{escaped(str(grasps.verdict))}[/]")
            report.line(escaped(grasps.hand_load_result.link_weights))
    else:
        report.line(f"[bold]{escaped(str(verdict_of(grasps)))}[/]")
        if grasps.load_case is not None:
            report.line(load_line(grasps.load_case))
    report.warnings(grasps.warnings)
    rows = np.arange(size)
    if size > MAX_ROWS:
        rows = ranked_rows(grasps)[:MAX_ROWS]
        report.line(f"the best {MAX_ROWS} of {size}:")
    _print_table(report, grasps, rows.tolist())
    if not isinstance(grasps, GraspTable):
        report.lines(_file_lines(grasps))
    report.written(*outputs)


def _kind(grasps: Grasps) -> str:
    """How many grasps there are, and of what."""
    if isinstance(grasps, GraspTable):
        return f"{counted(grasps.size, 'grasps')} of {grasps.model.fingers} fingers"
    poses = f"{counted(grasps.size, 'poses')} of {escaped(grasps.hand.name)}"
    if not isinstance(grasps, EvaluatedHandGrasps):
        return poses
    distance = small_length(grasps.contact_distance, metres=True)
    return f"{poses}, {CONTACTS_OF_LINKS[grasps.contacts.rule]}, within {distance}"


def _remarks(grasps: Grasps) -> Iterator[str]:
    """What is to be said of all grasps, a line each."""
    mesh, size = grasps.mesh, grasps.size
    if not isinstance(grasps, GraspTable):
        kinds = Counter(kind for kind in grasps.reasons.kinds if kind)
        yield from (f"{count} of {size}: {kind}" for kind, count in kinds.most_common())
        sure = (grasps.letter == Label.S) & grasps.reachable
        yield f"surely stable and reached: {int(sure.sum())} of {size}"
        tried = ~np.isnan(grasps.outcome)
        held = {one: grasps.outcome[tried & (grasps.letter == Label[one])] for one in "SMU"}
        parts = [f"{k} {percent_text(v.mean())} of {len(v)}" for k, v in held.items() if len(v)]
        if parts:
            yield f"held when tried: {', '.join(parts)}"
    else:
        levels = np.quantile(grasps.distance, [0.5, 1.0])
        levels[levels < DISTANCE_ROUNDING * mesh.size] = 0.0
        median, most = (length_with_unit(float(one), mesh.unit) for one in levels)
        yield f"distance of the contacts from the surface: median {median}, at most {most}"
    if mesh.region is not None:
        outside = int(np.isinf(grasps.critical_angle).sum())
        yield f"{outside} of {size} have a contact outside --region: U"


def _print_table(report: Report, grasps: Grasps, rows: Sequence[int]) -> None:
    """Print the numbers of some grasps, and what they mean."""
    fields: Sequence[Field] = GRASPS
    if isinstance(grasps, EvaluatedPoses):
        fields = [one for one in given_poses() if one is not REASON] + [OPENING, REASON]
    elif isinstance(grasps, EvaluatedHandGrasps):
        fields = HAND_GRASPS
    of = "grasp" if isinstance(grasps, GraspTable) else "pose"
    report.records(fields, grasps, rows, of=of, metres=grasps.mesh.unit is not None)


def _file_lines(grasps: EvaluatedPoses | EvaluatedHandGrasps) -> Iterator[str]:
    """The frame of the poses, and how their file was read."""
    given = grasps.given
    yield frame_text(given.object_pose)
    why = ", as the file states none" if given.assumes_frame else ""
    yield f"poses read in the gripper's frame '{given.gripper_frame}'{why} (--frame)"
    if read := given.settings.get(READING):
        yield f"{READINGS[READING]}: {read}"


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
    if not grasps.size:
        report.line("best grasps: none may hold")
        return
    what = "best distinct grasp" if grasps.size == 1 else f"{grasps.size} best distinct grasps"
    report.line(f"the {what}:")
    _print_table(report, grasps, range(grasps.size))
    if isinstance(grasps, EvaluatedPoses):
        report.line(frame_text(object_pose))
    report.warnings(warnings_of_best(grasps, object_pose))
    if grasps.size < requested:
        report.line(f"{requested} were requested; {_why_fewer(grasps, pool)}")
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


def warnings_of_best(
    grasps: GraspTable | EvaluatedPoses, object_pose: ObjectPose | None
) -> list[str]:
    """What is to be known of the best grasps and of their file; arguments as in `print_best`."""
    tilted = None if grasps.scene is None else grasps.scene.tilt_warning(object_pose)
    return [tilted] if tilted else []


def frame_text(pose: ObjectPose | None) -> str:
    """Frame of the poses in the file."""
    frame = "mesh's frame" if pose is None else f"robot's frame {pose.frame!r}"
    return f"poses in the file: in the {frame}"


def print_metrics(metrics: Mapping[str, Floats]) -> None:
    """Print the quantiles of each quality measure over the grasps, and how many are undefined."""
    rows = []
    for name, values in metrics.items():
        defined = values[~np.isnan(values)]
        levels = np.quantile(defined, LEVELS) if len(defined) else ()
        texts = [f"{value:.4g}" for value in levels] or [NONE] * len(LEVELS)
        missing = len(values) - len(defined)
        rows.append([name, *texts, str(missing) if missing else ""])
    heads = [f"{level} %" for level in PERCENTS.removesuffix(" %").split("/")]
    Report().table(("quality measure", *heads, "undefined"), rows)
