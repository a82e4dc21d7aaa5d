"""The best grasps of `grasp3d label` with the labels that they have when the jaws close."""

import json
import math
import re
from pathlib import Path
from typing import Any

import pytest
import trimesh

from grasp3d.hand.hand_files import write_hand
from tests.helpers import shapes
from tests.helpers.commands import printed, run_here
from tests.helpers.grippers import HAND

OPTIONS = ["--unit", "mm", "--max-edge", "12", "--sensor-resolution", "15", "--hand", "hand.json"]
"""Those of label and evaluate."""


def folder_with_cone(folder: Path, degrees: float) -> Path:
    """A folder with a cone of 80 mm, with this half-angle, and a gripper."""
    surface = shapes.cone(math.radians(degrees), 80.0, 24)
    trimesh.Trimesh(*surface, process=False).export(folder / "cone.stl")
    write_hand(folder / "hand.json", HAND)
    return folder


def rows_of(text: str) -> list[list[str]]:
    """Words of the rows of the table of grasps."""
    return [line.split() for line in text.splitlines() if re.match(r" +\d+ +■ [SMU] ", line)]


@pytest.mark.slow
def test_printed_and_written_labels_are_those_of_evaluated_poses(tmp_path: Path) -> None:
    folder = folder_with_cone(tmp_path, 14.0)
    options = (*OPTIONS, "--friction", "0.4")
    first = run_here("label", "cone.stl", *options, "--best", "6", cwd=folder, columns=60)
    assert (first.returncode, first.stderr) == (0, "")
    assert "warning: no label" not in first.stdout
    evaluate = ("evaluate", "cone.stl", "cone_grasps.json", *options, "-o", "b.json")
    printed(*evaluate, cwd=folder)
    found, again = (
        json.loads((folder / name).read_text())["grasps"] for name in ("cone_grasps.json", "b.json")
    )
    assert [one["closed_label"] for one in found] == [one["label"] for one in again]
    margins = [math.nan if one["margin"] is None else one["margin"] for one in again]
    written = [math.nan if one["closed_margin"] is None else one["closed_margin"] for one in found]
    assert written == pytest.approx(margins, abs=1e-7, nan_ok=True)
    assert any(one["closed_label"] < one["label"] for one in found)  # M is before S
    assert not any("closed_label" in one for one in again)
    # Nothing is cut off where the console is narrow.
    headings = next(line for line in first.stdout.splitlines() if line.startswith("grasp "))
    assert headings.split()[-3:] == ["approach", "closed", "score"]
    check_rows(first.stdout, found)


def check_rows(text: str, found: list[dict[str, Any]]) -> None:
    """Check that the table has a row for each grasp: its label, its margin, if any, and a score."""
    printed = rows_of(text)
    assert len(printed) == len(found)
    for words, grasp in zip(printed, found, strict=True):
        assert words[2] == grasp["closed_label"]
        margin = grasp["closed_margin"]
        shown = [] if margin is None else [f"{math.degrees(margin):.1f}°"]
        *closed, score = words[words.index("■", 2) + 1 :]
        assert closed == [grasp["closed_label"], *shown]
        assert re.fullmatch(r"-?[01]\.\d\d", score)


@pytest.mark.slow
def test_a_warning_is_printed_where_no_label_is_confirmed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("grasp3d.rendering.opengl.can_render", lambda: False)
    folder = folder_with_cone(tmp_path, 19.5)
    text = printed("label", "cone.stl", *OPTIONS, "--friction", "0.2", "--best", "3", cwd=folder)
    assert "warning: no label is confirmed when the jaws close (3 U): " in text
    grasps = json.loads((folder / "cone_grasps.json").read_text())["grasps"]
    assert {one["closed_label"] for one in grasps} == {"U"}
    check_rows(text, grasps)
