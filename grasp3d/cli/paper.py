"""The command `grasp3d paper`: recomputes figures and numbers of Wan & Howe 2018."""

from grasp3d.cli.commands import Paper
from grasp3d.cli.report import NOTE, Report
from grasp3d.paper.writing import PaperSettings, write_paper


def run(command: Paper, report: Report) -> int:
    """Run the command, and return the exit code."""
    settings = PaperSettings(command.friction, command.sensor_resolution)
    with report.progress("recomputing the paper"):
        paper = write_paper(command.output, settings, object_file=command.object)
    report.lines(paper.notes, NOTE)
    report.written(f"{len(paper.written)} files in {command.output}")
    return 0
