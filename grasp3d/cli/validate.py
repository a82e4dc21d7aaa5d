"""The command `grasp3d validate`: holds labels and scores against what became of grasps."""

from dataclasses import replace
from pathlib import Path

from grasp3d.cli import progress_bars
from grasp3d.cli.commands import Validate
from grasp3d.cli.existing_files import check_output
from grasp3d.cli.ranges import parse_angles, parse_frictions
from grasp3d.cli.report import Report, escaped
from grasp3d.errors import OutputError
from grasp3d.plots.validations import FIGURES, save_figures
from grasp3d.system.counts import counted, noun
from grasp3d.system.files import check_writable
from grasp3d.validating import sentences, text_tables
from grasp3d.validating.disagreements import MEANING, ReasonCount
from grasp3d.validating.validate import validate_grasps
from grasp3d.validating.validation import TABLES, Validation, write_validation
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
        write_validation(command.output, validation)
        save_figures(command.output, validation)
    if not command.quiet:
        print_validation(validation, command.output)
    return 0


def _check_output(command: Validate) -> None:
    """Check that tables and figures can be written, and replace no file of others."""
    if command.output is None:
        return
    if not command.output.exists():
        check_writable(command.output)
        return
    if not command.output.is_dir():
        raise OutputError(f"{command.output}: is a file; name a folder")
    for path in (command.output / name for name in (*FIGURES, *TABLES)):
        check_output(path, overwrite=command.overwrite, inputs=command.grasps)


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
            object_pose=command.object_pose,
            frame=command.frame,
            settings=settings,
        )


def print_validation(validation: Validation, output: Path | None) -> None:
    """Print how well the scores predict the outcomes.

    Args:
        validation: The result.
        output: Folder of tables and figures; None: none are written.
    """
    report = Report()
    report.lines([sentences.counts_of(validation), sentences.model_of(validation)])
    report.lines([*sentences.sources_of(validation), sentences.closing_of(validation)])
    report.warnings(validation.warnings[:MOST_WARNINGS])
    if len(validation.warnings) > MOST_WARNINGS:
        report.line(f"and {counted(len(validation.warnings) - MOST_WARNINGS, 'warnings')} more")
    _print_table(report, text_tables.scores_of(validation))
    report.lines([sentences.intervals_of(validation), *sentences.objects_of(validation)])
    if not validation.grasps.one_sided:
        _print_table(report, text_tables.differences_of(validation))
    _print_table(report, text_tables.labels_of(validation))
    _print_table(report, text_tables.calibration_of(validation))
    report.lines(sentences.calibration_of(validation))
    for kind, meaning in MEANING.items():
        reasons = [one for one in validation.reasons if one.reason.kind == kind]
        if reasons:
            report.heading(meaning, counted(reasons[0].of, "grasps"))
            report.lines([_reason(validation, one) for one in reasons], " ")
    if output is not None:
        report.written(f"tables and figures in {output}")


def _print_table(report: Report, table: text_tables.TextTable) -> None:
    heads, rows = table
    report.table([*map(escaped, heads)], ([*map(escaped, row)] for row in rows))


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
