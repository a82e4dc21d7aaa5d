"""The command `grasp3d validate`: holds labels and scores against what became of grasps."""

import math
from dataclasses import replace
from pathlib import Path

from rich.table import Table

from grasp3d.cli import progress_bars
from grasp3d.cli.commands import Validate
from grasp3d.cli.existing_files import check_output
from grasp3d.cli.ranges import parse_angles, parse_frictions
from grasp3d.cli.report import Report, escaped, label_name, table_of
from grasp3d.errors import OutputError
from grasp3d.plots.validation_page import FILES, write_report
from grasp3d.stability.label import Label
from grasp3d.system.counts import counted, noun
from grasp3d.system.files import check_writable
from grasp3d.validating import sentences
from grasp3d.validating.disagreements import MEANING, ReasonCount
from grasp3d.validating.intervals import wilson
from grasp3d.validating.qualities import mean_over_objects
from grasp3d.validating.sentences import degrees, percent
from grasp3d.validating.success import LabelSuccess
from grasp3d.validating.validate import validate_grasps
from grasp3d.validating.validation import Validation
from grasp3d.validating.validation_settings import ValidationSettings

MOST_WARNINGS = 10
"""Most warnings that are printed."""


def run(command: Validate) -> int:
    """Run the command, and return the exit code."""
    settings = replace(
        command.statistics,
        frictions=parse_frictions("--frictions", command.frictions),
        sensor_resolutions=parse_angles("--sensor-resolutions", command.sensor_resolutions),
    )
    _check_output(command)
    validation = _validate(command, settings)
    if command.output is not None:
        with progress_bars.progress("drawing the report", quiet=command.quiet):
            write_report(command.output, validation)
    if not command.quiet:
        print_validation(validation, command.output)
    return 0


def _check_output(command: Validate) -> None:
    """Check that the report can be written, and replaces no file of others."""
    if command.output is None:
        return
    if not command.output.exists():
        check_writable(command.output)
        return
    if not command.output.is_dir():
        raise OutputError(f"{command.output}: is a file; name a folder")
    for path in (command.output / name for name in FILES):
        check_output(path, overwrite=command.overwrite)
        if any(path.exists() and file.exists() and path.samefile(file) for file in command.grasps):
            raise OutputError(f"{path}: is a file of grasps; name another folder with -o")


def _validate(command: Validate, settings: ValidationSettings) -> Validation:
    """Evaluate the grasps, and compare the scores with the outcomes."""
    first, *others = command.grasps
    name = counted(len(command.grasps), "files") if others else first.name
    with progress_bars.progress(f"evaluating {name}", quiet=command.quiet):
        return validate_grasps(
            command.grasps,
            command.model,
            mesh=command.mesh_file,
            meshes=command.meshes,
            options=command.surface,
            reach=command.reach,
            object_motion=command.object_motion,
            load=command.load.chosen,
            outcome=command.outcome,
            format=command.grasps_format,
            object_pose=command.object_pose,
            frame=command.frame,
            settings=settings,
        )


def print_validation(validation: Validation, output: Path | None) -> None:
    """Print how well the scores predict the outcomes.

    Args:
        validation: The result.
        output: Folder of the report; None: it was not written.
    """
    report = Report()
    report.lines([sentences.counts_of(validation), sentences.model_of(validation)])
    report.lines([*sentences.sources_of(validation), sentences.closing_of(validation)])
    report.warnings(validation.warnings[:MOST_WARNINGS])
    if len(validation.warnings) > MOST_WARNINGS:
        more = counted(len(validation.warnings) - MOST_WARNINGS, "warnings")
        report.paragraph(f"and {more} more")
    report.table(_scores(validation))
    report.lines([sentences.intervals_of(validation), *sentences.objects_of(validation)])
    if not validation.grasps.one_sided:
        report.table(_differences(validation))
    report.table(_labels(validation))
    report.table(_calibration(validation))
    report.lines(sentences.calibration_of(validation))
    for kind, meaning in MEANING.items():
        reasons = [one for one in validation.reasons if one.reason.kind == kind]
        if reasons:
            report.paragraph(f"[bold]{meaning}: {counted(reasons[0].of, 'grasps')}[/]")
            report.lines([_reason(validation, one) for one in reasons], " ")
    if output is not None:
        report.lines([f"written: {output / 'report.html'} and its tables"])


def _scores(validation: Validation) -> Table:
    """ROC-AUC and average precision of each score."""
    rows = []
    for one in validation.qualities:
        precision = _interval(one.average_precision_interval)
        rows.append(
            [
                escaped(one.score.title),
                one.score.better,
                f"{_number(one.roc_auc)} {_interval(one.roc_auc_interval)}",
                f"{_number(one.average_precision)} {precision}",
            ]
        )
        if validation.by_object:
            rows[-1].append(_number(mean_over_objects(validation.by_objects, one.score.name)))
    heads = ["score", "better", "ROC-AUC, 95 %", "precision, 95 %"]
    return table_of([*heads, *["by object"] * validation.by_object], rows)


def _differences(validation: Validation) -> Table:
    """By how much the first score predicts better than the others."""
    first = validation.qualities[0].score
    rows = (
        (
            escaped(one.other.title),
            f"{one.difference:+.3f} {one.interval[0]:+.3f} to {one.interval[1]:+.3f}",
            f"{one.p:.3f}",
        )
        for one in validation.differences
        if one.score == first
    )
    return table_of((f"{escaped(first.title)} less", "ROC-AUC, 95 %, paired", "p"), rows)


def _labels(validation: Validation) -> Table:
    """Success within S, M and U over friction and resolution."""
    order = sorted(Label, reverse=True)
    rows = (
        (
            f"{success.friction:.4g}",
            f"{math.degrees(success.sensor_resolution):.4g}°",
            *(_success(success, label) for label in order),
        )
        for success in validation.labels
    )
    return table_of(("μ", "α", *(f"{label_name(label)} held, 95 %, of" for label in order)), rows)


def _success(success: LabelSuccess, label: Label) -> str:
    """Fraction that held, with its interval, and the number of grasps."""
    if not success.counts[label]:
        return "none"
    low, high = success.interval(label.name)
    fraction = percent(success.fraction(label.name))
    return f"{fraction} {100.0 * low:.0f}-{100.0 * high:<3.0f}{success.counts[label]:>6,}"


def _calibration(validation: Validation) -> Table:
    """Success in bins of the margin."""
    rows = []
    missing = ~validation.grasps.closed
    if missing.any():
        successes, count = int(validation.grasps.held[missing].sum()), int(missing.sum())
        ends = _interval(wilson(successes, count))
        rows.append(("jaws do not close", f"{count:,}", percent(successes / count), ends))
    for part in validation.calibration.bins:
        span = f"{degrees(part.low)} to {degrees(part.high)}"
        rows.append((span, f"{part.count:,}", percent(part.fraction), _interval(part.interval)))
    return table_of(("margin", "grasps", "held", "95 %"), rows)


def _reason(validation: Validation, one: ReasonCount) -> str:
    """How many grasps have a reason, and the greatest of their disagreements."""
    grasps, named = validation.grasps, []
    for case in validation.disagreements:
        for cause in case.causes:
            if cause.reason == one.reason:
                file = Path(validation.files[int(grasps.file[case.row])].name).name
                where = f" of {file}" if len(validation.files) > 1 else ""
                value = f" ({cause.value})" if cause.value else ""
                named.append(f"{int(grasps.grasp[case.row])}{where}{value}")
    examples = f"; {noun(len(named), 'grasps')} {', '.join(named)}" if named else ""
    return f"{one.count:,} {one.reason.name}: {one.reason.why}{examples}"


def _number(value: float) -> str:
    return "undefined" if math.isnan(value) else f"{value:.3f}"


def _interval(ends: tuple[float, float]) -> str:
    return "" if math.isnan(ends[0]) else f"{ends[0]:.3f}-{ends[1]:.3f}"
