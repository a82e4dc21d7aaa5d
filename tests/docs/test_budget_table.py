"""The table of budgets in the guide, against the script that prints it."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.mark.slow
def test_the_table_has_the_rows_that_the_script_prints() -> None:
    page = (ROOT / "docs" / "guide" / "uncertainty.md").read_text(encoding="utf-8")
    meshes = [str(ROOT / "meshes" / name) for name in ("nut.obj", "sphere.stl")]
    script = [sys.executable, str(ROOT / "scripts" / "budget_table.py"), *meshes]
    printed = subprocess.run(script, check=True, capture_output=True, text=True).stdout
    rows = [line for line in printed.splitlines() if line.startswith("|")]
    assert len(rows) == 2 + len(meshes)
    for row in rows:
        assert row in page
    named = {line.split(" | ")[0][2:] for line in page.splitlines() if line.startswith("| ")}
    shipped = {path.name for path in (ROOT / "meshes").iterdir()} - {"README.md", "gallery.png"}
    assert shipped <= named
