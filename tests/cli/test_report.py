"""Tables of printed reports."""

import io

import pytest
from rich.console import Console

from grasp3d.cli.report import Report

WORDS = "the motors do not carry the links alone"
COLUMNS = [
    ("pose", lambda row: str(row + 1)),
    ("margin", lambda row: f"{row}.25°"),
    ("holds\nkg", lambda row: f"0.{row}04"),
    ("load", lambda row: f"{row} %"),
    ("reason", lambda row: WORDS if row else ""),
]


def printed(width: int, *, terminal: bool) -> list[str]:
    report, stream = Report(), io.StringIO()
    report.console = Console(
        file=stream, width=width, force_terminal=terminal, color_system=None, legacy_windows=False
    )
    report.columns(COLUMNS, range(2))
    return [line.rstrip() for line in stream.getvalue().splitlines()]


@pytest.mark.parametrize(("width", "tables"), [(200, 1), (60, 2), (20, 3), (14, 4)])
def test_a_narrow_terminal_shows_columns_in_several_tables(width: int, tables: int) -> None:
    lines = printed(width, terminal=True)
    assert max(map(len, lines)) <= width
    assert [line.split()[0] for line in lines if "pose" in line] == ["pose"] * tables
    words = " ".join(lines).split()
    for row in range(2):
        assert {f"{row}.25°", f"0.{row}04"} < {*words}
    assert {*WORDS.split()} < {*words}
    assert "…" not in " ".join(lines)


def test_files_and_pipes_get_whole_lines() -> None:
    assert printed(20, terminal=False) == printed(200, terminal=True)
