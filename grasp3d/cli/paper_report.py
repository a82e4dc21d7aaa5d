"""What `grasp3d paper` shows."""

from pathlib import Path

from rich.console import Console

from grasp3d.cli.report import as_printed
from grasp3d.paper.writing import Paper


def print_paper(paper: Paper, output: Path) -> None:
    """Print what was written, every figure once, and what is missing."""
    console = Console(emoji=False)
    ends: dict[str, list[str]] = {}
    for path in paper.written:
        ends.setdefault(path.stem, []).append(path.suffix)
    names = ", ".join(f"{stem}{' '.join(suffixes)}" for stem, suffixes in ends.items())
    for note in paper.notes:
        console.print(f"[yellow]note:[/] {as_printed(note)}", soft_wrap=True)
    console.print(as_printed(f"written to {output}: {names}"), soft_wrap=True)
