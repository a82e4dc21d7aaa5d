"""The command `grasp3d validate`: compares labels and scores of grasps with outcomes."""

import math
from pathlib import Path

from grasp3d.cli.commands import Validate
from grasp3d.cli.report import Report, escaped, label_meaning, label_name, percent_text
from grasp3d.outcomes.validate import validate_grasps
from grasp3d.outcomes.validation import Validation, validation_figure, write_validation
from grasp3d.pictures.figures import METADATA, save_as
from grasp3d.settings.grasp_model import model_line
from grasp3d.stability.label import Label
from grasp3d.surface.fields import NONE
from grasp3d.system.names import counted
from grasp3d.system.tables import SUFFIXES

MOST_FILES = 8
"""Largest number of sentences on the sources of files that are printed."""

MOST_WRONG = 10
"""Largest number of contradictions that are listed, for S that failed and U that held each."""

LISTED = ("grasp", "file", "label", "score", "reason")
"""Columns of this list."""


def run(command: Validate, report: Report) -> int:
    """Run the command, and return the exit code."""
    table = command.output
    figure = table and table.with_suffix(".svg")
    for path, suffixes, what in ((table, SUFFIXES, "table"), (figure, METADATA, "figure")):
        command.check_output(path, suffixes, what, inputs=command.grasps)
    name = counted(len(command.grasps), "files")
    with report.progress(f"evaluating {name}"):
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
        )
    if table is not None and figure is not None:
        write_validation(table, validation)
        save_as(validation_figure(validation), figure)
    print_validation(report, validation)
    if table is not None and figure is not None:
        report.written(table, figure)
    return 0


def print_validation(report: Report, found: Validation) -> None:
    """Print how well labels and scores predict the outcomes, and which labels are wrong."""
    held, not_tried = int(found.held.sum()), sum(one.not_tried for one in found.files)
    outcome = f"an outcome ({found.outcome})" if found.outcome else "an outcome"
    left_out = f"; {not_tried:,} without an outcome are left out" if not_tried else ""
    models = dict.fromkeys(model_line(file.model) for file in found.files)
    sources = list(dict.fromkeys(file.sources for file in found.files))
    more = [f"and {len(sources) - MOST_FILES} more"] if len(sources) > MOST_FILES else []
    missing = int((found.columns["closing"] != "closed").sum())
    report.line(
        f"{counted(found.size, 'grasps')} with {escaped(outcome)} on "
        f"{counted(found.objects, 'objects')}: {held:,} held "
        f"({percent_text(held / found.size)}){left_out}"
    )
    report.lines(f"labels, margins and forces for {model}" for model in models)
    report.lines([*sources[:MOST_FILES], *more])
    if missing:
        no_grasp = "the hand does not close on the mesh: U, with the worst value of every score"
        report.line(f"at {counted(missing, 'poses')} {no_grasp}")
    report.warnings(found.warnings)
    report.rates("label", ((label_meaning(one), rate) for one, rate in found.rates.items()))
    rows = [
        (one.score.title, one.score.better, *map(_number, (one.roc_auc, one.low, one.high)))
        for one in found.qualities
    ]
    report.table(("score", "better", "ROC-AUC", "from", "to"), rows, texts=(0, 1))
    of = f"other objects, by {found.objects} objects" if found.objects > 1 else "this object"
    report.line(f"ROC-AUC: 0.5 is chance; 95 % intervals, for {of}")
    _print_wrong(report, found)


def _print_wrong(report: Report, found: Validation) -> None:
    """List S that failed and U that held, the greatest contradictions first."""
    letters = found.columns["label"][found.wrong]
    failed, held = (found.wrong[letters == letter] for letter in "SU")
    report.heading("wrong labels", f"{len(failed):,} S that failed, {len(held):,} U that held")
    rows = []
    for row in (*failed[:MOST_WRONG], *held[:MOST_WRONG]):
        grasp, file, letter, score, reason = (found.columns[name][row] for name in LISTED)
        label = label_name(Label[letter])
        rows.append((str(grasp), escaped(Path(file).name), label, f"{score:.3f}", escaped(reason)))
    if rows:
        report.table(LISTED, rows, texts=(1, 2, 4))


def _number(value: float) -> str:
    return NONE if math.isnan(value) else f"{value:.3f}"
