"""The command `grasp3d paper`: recomputes figures and numbers of Wan & Howe 2018."""

from grasp3d.cli import progress_bars
from grasp3d.cli.report import NOTE, Report, escaped
from grasp3d.cli.tool_commands import Paper
from grasp3d.paper.paper_settings import PaperSettings
from grasp3d.paper.writing import write_paper


def run(command: Paper) -> int:
    """Run the command, and return the exit code."""
    settings = PaperSettings(command.friction, command.sensor_resolution)
    with progress_bars.progress("recomputing the paper", quiet=command.quiet):
        paper = write_paper(
            command.output, settings, object_file=command.object, fixed=command.fixed
        )
    if command.quiet:
        return 0
    report = Report()
    report.lines(paper.notes, NOTE)
    suffixes: dict[str, list[str]] = {}  # each figure is named once
    for path in paper.written:
        suffixes.setdefault(path.stem, []).append(path.suffix)
    names = ", ".join(f"{stem}{' '.join(ends)}" for stem, ends in suffixes.items())
    report.line(escaped(f"written to {command.output}: {names}"))
    return 0
