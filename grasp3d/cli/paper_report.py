"""Printed report of `grasp3d paper`."""

from pathlib import Path

from rich.console import Console

from grasp3d.cli.report import escaped
from grasp3d.paper.writing import Paper


def print_paper(paper: Paper, output: Path) -> None:
    """Print the notes, and the names of the written files, each figure once.

    Args:
        paper: Result of `write_paper`.
        output: Folder of the files.
    """
    console = Console(emoji=False)
    suffixes: dict[str, list[str]] = {}
    for path in paper.written:
        suffixes.setdefault(path.stem, []).append(path.suffix)
    names = ", ".join(f"{stem}{' '.join(ends)}" for stem, ends in suffixes.items())
    for note in paper.notes:
        console.print(f"[yellow]note:[/] {escaped(note)}", soft_wrap=True)
    console.print(escaped(f"written to {output}: {names}"), soft_wrap=True)
