"""A hand class that is written in the tests alone: evaluated, explained, drawn, written, read."""

from pathlib import Path

import numpy as np
import pytest

import grasp3d
from grasp3d import Label
from grasp3d.describe import verdict_of
from grasp3d.formats import GraspPoses
from grasp3d.hand import hand_files
from grasp3d.hand.hand import Hand
from grasp3d.outcomes import validate_grasps
from grasp3d.viewer.inspection import inspect_pose
from tests.helpers import shapes
from tests.helpers.pincers import FORMAT, Pincers, above, pincers_of


def test_a_new_hand_is_evaluated_explained_written_and_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(hand_files.READERS, FORMAT, pincers_of)
    hand = Pincers()
    assert isinstance(hand, Hand)
    box = grasp3d.load_mesh(shapes.box((0.06, 0.04, 0.02)), unit="m")
    poses = GraspPoses(poses=np.array([above(0.0, 0.0), above(0.0, 0.1)]), unit="m")
    load = grasp3d.Load(mass=0.1, task="weight within 0 of -y")
    found = grasp3d.evaluate_grasps(box, poses, hand=hand, load=load)
    assert found.label.tolist() == [Label.S, Label.U]
    assert found.reason.tolist() == ["", "the jaws close on nothing"]
    assert found.critical_angle[0] == pytest.approx(0.0, abs=1e-6)
    assert str(verdict_of(found)).startswith("Surely held by pincers: 1 of 2 grasps")
    assert len(found.held_at(0).triangles(hand).vertices) > 0
    assert dict(inspect_pose(found, found.model).numbers)["pose"] == "grasp_1"
    grasp3d.write_grasps(tmp_path / "found.json", found)
    again = grasp3d.read_grasps(tmp_path / "found.json")
    assert isinstance(again, GraspPoses)
    assert again.hand == hand
    tried = GraspPoses(poses=poses.poses, outcome=[1.0, 0.0], unit="m")
    assert validate_grasps(tried, mesh=box, hand=hand).rates[Label.S].rate == 1.0
