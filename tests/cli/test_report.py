"""Tables of printed reports."""

import io

import pytest
from rich.console import Console

from grasp3d.cli.report import UNLIMITED, Report

WORDS = "the motors do not carry the links alone"
HEADINGS = ("pose", "margin", "holds\nkg", "load", "reason")
ROWS = [(str(row + 1), f"{row}.25°", f"0.{row}04", f"{row} %", WORDS * row) for row in range(2)]


def printed(width: int) -> list[str]:
    report, stream = Report(), io.StringIO()
    report.console = Console(file=stream, width=width, color_system=None, legacy_windows=False)
    report.table(HEADINGS, ROWS, texts=(4,))
    return [line.rstrip() for line in stream.getvalue().splitlines()]


@pytest.mark.parametrize("width", [200, 60, 20])
def test_a_narrow_terminal_folds_texts_and_cuts_no_number(width: int) -> None:
    lines = printed(width)
    assert (max(map(len, lines)) <= width) == (width > 20)
    words = " ".join(lines).split()
    for row in ROWS:
        assert {*row[1:3], *row[-1].split()} <= {*words}
    assert "…" not in " ".join(lines)


def test_files_and_pipes_get_whole_lines() -> None:
    assert Report().console.width == UNLIMITED
    assert len(printed(UNLIMITED)) == 4
