"""A load on the command line: what is printed and written."""

import json
import re
from pathlib import Path

import pyarrow.csv as pc
import pytest

from grasp3d.surface.load_case import HARD_FINGERS
from tests.helpers import shapes
from tests.helpers.commands import export, printed

BLOCK = shapes.box((0.08, 0.05, 0.03))
SOFT = ("--unit", "m", "--max-edge", "0.02", "--torsion-radius", "3mm")
LOAD = ("--mass", "500 g", "--grip-force", "40N")


@pytest.mark.slow
def test_label_end_to_end(tmp_path: Path) -> None:
    export(tmp_path / "block.ply", BLOCK)
    text = printed("label", "block.ply", *SOFT, *LOAD, "--best", "2", cwd=tmp_path)
    assert "load: 0.5 kg, weight; force at hand: 40 N per finger" in text
    assert "N of 40 N to hold 0.5 kg in any orientation" in text
    assert re.search(r"10/50/90 % of the area: .*; force in N [\d.]+, .*; payload in kg ", text)
    assert re.search(r"score +β\* +α\* +ε +ε_min +mm +N +kg", text)
    written = json.loads((tmp_path / "block_grasps.json").read_text())
    assert written["grasp3d"]["object_mass"] == 0.5
    best = written["grasps"][0]
    assert best["label"] == "S"
    assert best["payload"] == pytest.approx(40.0 * 0.5 / best["grip_force_largest"])


@pytest.mark.slow
def test_the_remedy_for_hard_fingers_is_printed(tmp_path: Path) -> None:
    export(tmp_path / "block.ply", BLOCK)
    text = printed("label", "block.ply", *SOFT[:4], "--mass", "0.5", cwd=tmp_path)
    assert HARD_FINGERS in text
    assert "force at hand: none given" in text
    assert "; force in N " in text


def test_evaluate_contacts(tmp_path: Path) -> None:
    export(tmp_path / "block.ply", BLOCK)
    grasps = [[[0.0, 0.025, 0.0], [0.0, -0.025, 0.0]], [[0.0, 0.0, 0.015], [0.0, 0.0, -0.015]]]
    (tmp_path / "grasps.json").write_text(json.dumps(grasps))
    task = ("--task", "weight within 0 of -z", "--sensor-resolution", "0", "-o", "out.csv")
    text = printed("evaluate", "block.ply", "grasps.json", *SOFT, *LOAD, *task, cwd=tmp_path)
    assert re.search(r"■ S +surely stable +2 +100.0 %", text)
    assert re.search(r"opening +force +payload", text)
    table = pc.read_csv(tmp_path / "out.csv").to_pydict()
    side = 0.5 * 9.80665 / (2.0 * 0.5)  # friction 0.5
    assert table["grip_force"][0] == pytest.approx(side, rel=0.01)
    # From below one finger carries the weight.
    assert table["grip_force"][1] == pytest.approx(0.5 * 9.80665, rel=0.01)
    assert table["label"] == ["S", "S"]
