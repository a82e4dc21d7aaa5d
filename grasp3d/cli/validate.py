"""The command `grasp3d validate`: holds labels and scores against what became of grasps."""

from grasp3d.cli import progress_bars
from grasp3d.cli.commands import Validate
from grasp3d.cli.existing_files import check_output
from grasp3d.cli.report import Report, escaped
from grasp3d.errors import OutputError
from grasp3d.plots.validations import FIGURES, save_figures
from grasp3d.system.counts import counted
from grasp3d.system.files import check_writable
from grasp3d.validating import sentences, text_tables
from grasp3d.validating.disagreements import MEANING
from grasp3d.validating.validate import validate_grasps
from grasp3d.validating.validation import TABLES, Validation, write_validation


def run(command: Validate) -> int:
    """Run the command, and return the exit code."""
    _check_output(command)
    name = counted(len(command.grasps), "files")
    with progress_bars.progress(f"evaluating {name}", quiet=command.quiet):
        validation = validate_grasps(
            command.grasps,
            command.model,
            mesh=command.mesh,
            meshes=command.meshes,
            options=command.surface,
            reach=command.reach,
            load=command.load.chosen,
            outcome=command.outcome,
            object_pose=command.object_pose,
            frame=command.frame,
            settings=command.statistics,
        )
    if command.output is not None:
        write_validation(command.output, validation)
        save_figures(command.output, validation)
    report = Report(quiet=command.quiet)
    print_validation(report, validation)
    if command.output is not None:
        report.written(f"tables and figures in {command.output}")
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


def print_validation(report: Report, validation: Validation) -> None:
    """Print how well the scores predict the outcomes."""
    report.lines([sentences.counts_of(validation), sentences.model_of(validation)])
    report.lines([*sentences.sources_of(validation), sentences.closing_of(validation)])
    report.warnings(validation.warnings)
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
            report.lines(f"{one.count:,} {one.reason.name}: {one.reason.why}" for one in reasons)


def _print_table(report: Report, table: text_tables.TextTable) -> None:
    heads, rows = table
    report.table([*map(escaped, heads)], ([*map(escaped, row)] for row in rows))
