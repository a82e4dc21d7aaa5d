"""Given poses: jaws closed on the object, labels, reach, and published outcomes."""

import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation
from scipy.stats import rankdata

from grasp3d import Contacts, GraspModel, Load, ObjectMesh, load_mesh
from grasp3d.errors import ContactError, SettingError
from grasp3d.formats import read_poses, write_grasps
from grasp3d.formats.poses import GraspPoses
from grasp3d.grasps import EvaluatedPoses
from grasp3d.grasps.evaluation import evaluate_grasps
from grasp3d.hand.closing import Closing
from grasp3d.hand.parallel_gripper import ParallelGripper
from grasp3d.hand.table import Approach, Table
from grasp3d.quality import critical_friction_angle
from grasp3d.stability.classification import classify
from grasp3d.stability.label import Label
from tests.helpers import shapes
from tests.helpers.closing_jaws import Floats, pads, pose, random_poses

BOX = (0.06, 0.04, 0.02)
FROM_ABOVE = Rotation.from_rotvec([math.pi, 0.0, 0.0])
MODEL = GraspModel(friction=0.5, sensor_resolution=math.radians(20.0))


@pytest.fixture(scope="module")
def box() -> ObjectMesh:
    return load_mesh(shapes.box(BOX), unit="m")


@pytest.fixture(scope="module")
def blob() -> ObjectMesh:
    vertices, faces = shapes.lopsided()
    return load_mesh((0.025 * vertices, faces), unit="m", max_edge=1.0)


def evaluated(mesh: Any, matrices: Any, **options: Any) -> EvaluatedPoses:
    poses = GraspPoses(poses=np.array(matrices), unit="m")
    return evaluate_grasps(mesh, poses, MODEL, **{"hand": pads(), **options})


def test_a_box_from_above(box: ObjectMesh) -> None:
    matrices = [
        pose((0.0, 0.0, 0.005), FROM_ABOVE),
        pose((0.0, 0.08, 0.0), FROM_ABOVE),
        pose((0.0, 0.0, -0.005)),
    ]
    table = Table(np.array([0.0, 0.0, 1.0]), -0.01)
    found = evaluated(box, matrices, table=table)
    assert [Closing(code).name for code in found.state] == ["CLOSED", "NOTHING", "CLOSED"]
    assert found.label.tolist() == [2, 0, 0]
    assert found.reason.tolist() == ["", "the jaws close on nothing", found.reason[2]]
    assert found.reason[2].startswith("palm meets the table, by ")
    assert found.critical_angle == pytest.approx([0.0, math.nan, 0.0], abs=1e-6, nan_ok=True)
    assert found.max_resolution == pytest.approx(
        [2.0 * math.atan(0.5), math.nan, 2.0 * math.atan(0.5)], nan_ok=True
    )
    assert found.opening == pytest.approx([0.06, math.nan, 0.06], nan_ok=True)
    assert found.epsilon[0] > 0.0
    assert np.isnan(found.epsilon).tolist() == [False, True, False]
    assert found.collides[[0, 2]].tolist() == [False, True]
    assert found.reachable.tolist() == [True, False, False]
    without = evaluated(box, matrices)
    assert without.reachable.tolist() == [True, False, True]
    tilted = Approach(np.array([0.0, 1.0, -1.0]), within=math.radians(40.0))
    assert not evaluated(box, matrices, approach=tilted).reachable.any()
    wide = load_mesh(shapes.box((0.0785, 0.04, 0.02)), unit="m")  # for the clearance
    for hand, reaches in ((pads(), False), (pads(clearance=0.0005), True)):
        found = evaluated(wide, matrices[:1], hand=hand)
        assert (found.jaws.closed[0], found.reachable[0]) == (True, reaches)


def test_labels_and_numbers_are_those_of_the_contacts(blob: ObjectMesh) -> None:
    found = evaluated(blob, random_poses(80, 0.005, seed=7))
    rows = found.jaws.closed
    assert rows.sum() > 30
    points = found.jaws.points[rows] - blob.center_mass
    contacts = Contacts(points, found.jaws.normals[rows], MODEL.friction)
    expected = classify(contacts, MODEL.sensor_resolution)
    np.testing.assert_array_equal(found.robustness.label[rows], expected.label)
    assert len(np.unique(found.label)) == 3
    blocked = ~found.reachable[rows]
    np.testing.assert_array_equal(found.label[rows], np.where(blocked, 0, expected.label))
    np.testing.assert_allclose(found.critical_angle[rows], critical_friction_angle(contacts))
    assert (found.epsilon_min[rows] <= found.epsilon[rows]).all()
    assert (found.epsilon[rows] <= found.epsilon_max[rows] + 1e-12).all()
    assert (found.epsilon_min[rows][found.label[rows] == 2] > 0.0).all()
    assert (found.label[~rows] == 0).all()


def test_matrices_are_poses_in_the_meshs_unit(box: ObjectMesh) -> None:
    matrices = [pose((0.0, 0.0, 0.005), FROM_ABOVE), pose((0.0, 0.08, 0.0), FROM_ABOVE)]
    same = evaluated(box, matrices)
    for given in (matrices, np.array(matrices), tuple(matrices)):
        found = evaluate_grasps(box, given, MODEL, hand=pads())
        assert found.to_table().equals(same.to_table())
    one = evaluate_grasps(box, matrices[0], MODEL, hand=pads())
    assert one.to_table().equals(same.take(np.array([0])).to_table())
    with pytest.raises(SettingError, match="poses are evaluated for a gripper"):
        evaluate_grasps(box, matrices, MODEL)
    with pytest.raises(SettingError, match=r"not to contacts; give poses, of shape \(k, 4, 4\)"):
        evaluate_grasps(box, np.zeros((1, 2, 3)), MODEL, hand=pads())
    with pytest.raises(ContactError, match="its axes have the lengths"):
        evaluate_grasps(box, np.diag([2.0, 2.0, 2.0, 1.0]), MODEL, hand=pads())
    inside = GraspPoses(poses=matrices, opening=0.04, pregrasp_opening=[0.044, 0.036], unit="m")
    with pytest.raises(ContactError, match="grasp_2 is an internal grasp, as are 1 of 2"):
        evaluate_grasps(box, inside, MODEL, hand=pads())
    far = pose((60.0, 10.0, 5.0))
    warned = evaluated(box, [far, matrices[0]]).warnings
    assert any("1 of 2 poses are over 20 object sizes away" in line for line in warned)
    with pytest.raises(ContactError, match="their lengths are in mm, not in m, give their unit"):
        evaluated(box, [far, far])


def test_forces_and_payloads_are_those_of_the_load(box: ObjectMesh) -> None:
    matrices = [pose((0.0, 0.0, 0.005), FROM_ABOVE), pose((0.0, 0.08, 0.0), FROM_ABOVE)]
    assert "grip_force" not in evaluated(box, matrices).to_table().column_names
    found = evaluated(box, matrices, load=Load(mass=0.1, grip_force=40.0))
    table = found.to_table()
    assert table["grip_force"].to_pylist() == found.grip_force.tolist()
    assert table["payload"].to_pylist() == found.payload.tolist()
    # Of forces of a length in the worst tilt what is needed grows with the mass.
    assert found.payload[0] == pytest.approx(0.1 * 40.0 / found.grip_force[0])
    assert (found.payload[1], found.grip_force[1]) == (0.0, math.inf)


def test_a_mesh_without_a_unit_takes_the_scale_that_poses_state(box: ObjectMesh) -> None:
    scale = 3e-4
    raw = load_mesh(shapes.box(tuple(side / scale for side in BOX)))  # type: ignore[arg-type]
    poses = GraspPoses(poses=pose(turn=FROM_ABOVE), unit="m", object_scale=scale)
    found = evaluate_grasps(raw, poses, MODEL, hand=pads())
    same = evaluate_grasps(box, poses, MODEL, hand=pads())
    assert found.mesh.unit == "m"
    assert found.mesh.volume == pytest.approx(box.volume)
    np.testing.assert_allclose(found.jaws.points, same.jaws.points, atol=1e-9)
    np.testing.assert_allclose(found.epsilon, same.epsilon, rtol=0.02)
    assert found.given.object_scale == scale
    with pytest.raises(SettingError, match="unit"):
        evaluate_grasps(raw, replace(poses, object_scale=None), MODEL, hand=pads())


@pytest.mark.parametrize(("scale", "unit"), [(0.001, "mm"), (0.01, "cm"), (0.0254, "in")])
def test_a_scale_that_is_not_that_of_the_mesh_is_named(
    box: ObjectMesh, scale: float, unit: str
) -> None:
    poses = GraspPoses(poses=pose(turn=FROM_ABOVE), unit="m", object_scale=scale)
    text = f"numbers of {scale:g} m (object_scale), but the unit of arrays is m: give --unit {unit}"
    assert [line for line in evaluate_grasps(box, poses, hand=pads()).warnings if text in line]
    same = replace(poses, object_scale=1.0 + 1e-6)
    assert evaluate_grasps(box, same, hand=pads()).warnings == box.report.warnings
    with pytest.raises(SettingError, match=re.escape(text)):
        evaluate_grasps(box, replace(poses, object_file="a/b/arrays"), hand=pads())
    with pytest.raises(SettingError, match=r"leave --unit out$"):
        evaluate_grasps(box, replace(poses, object_file="arrays", object_scale=0.02), hand=pads())


@pytest.mark.parametrize("suffix", [".json", ".csv"])
def test_results_are_written_as_poses_and_read_back(
    box: ObjectMesh, tmp_path: Path, suffix: str
) -> None:
    matrices = np.array([pose(turn=FROM_ABOVE), pose((0.0, 1.0, 0.0))])
    given = GraspPoses(
        poses=matrices, unit="m", outcome=[1.0, 0.0], names=("held", "missed"),
        settings={"table": "0.0 0.0 1.0 0.0", "friction": 0.9, "note": "mine"},
    )  # fmt: skip
    found = evaluate_grasps(box, given, MODEL, hand=pads())
    write_grasps(tmp_path / f"a{suffix}", found)
    of_file = evaluate_grasps(box, tmp_path / f"a{suffix}", MODEL, hand=pads())
    np.testing.assert_allclose(of_file.score, found.score, rtol=1e-6)
    again = read_poses(tmp_path / f"a{suffix}")
    np.testing.assert_allclose(again.poses, matrices, atol=1e-12)
    assert (again.names, again.outcome.tolist()) == (("held", "missed"), [1.0, 0.0])
    assert again.columns["closing"].tolist() == ["closed", "nothing"]
    assert again.columns["label"].tolist() == ["S", "U"]
    assert np.isnan(again.columns["critical_angle"][1])
    if suffix == ".json":  # the settings are those of the evaluation, not of the file
        assert (again.settings["table"], again.settings["friction"]) == ("none", MODEL.friction)
        assert (again.settings["note"], again.settings["object_motion"]) == ("mine", "free")


def auc(scores: Floats, held: Any) -> float:
    ranks, count = rankdata(scores), int(held.sum())
    return float((ranks[held].sum() - count * (count + 1) / 2.0) / (count * (len(held) - count)))


@pytest.mark.slow
def test_published_poses_on_a_mug() -> None:
    """Poses were sampled free of collision, of a hand whose fingers are not quite boxes.

    A mug that gives way is held as the outcomes say. Of one that cannot move, the pads touch a wall
    with an edge or a corner, and critical angles there say little about what happens once the mug
    has turned.
    """
    folder = shapes.shared("datasets", "acronym")
    hand = ParallelGripper.preset("franka")
    poses = read_poses(next(folder.glob("*.h5")), hand=hand)
    solid = trimesh.load_mesh(next(folder.glob("*.obj")), process=False)
    mesh = load_mesh((solid.vertices, solid.faces), max_edge=1e9)
    found = evaluate_grasps(mesh, poses, GraspModel(friction=0.5), hand=hand)
    assert found.mesh.unit == "m"
    assert (found.state == Closing.STARTS_INSIDE).sum() < 5
    assert found.jaws.closed.mean() > 0.95
    held = found.outcome == 1.0
    assert auc(-np.nan_to_num(found.critical_angle, nan=math.pi), held) >= 0.93
    surely = held[found.label == Label.S]
    assert surely.mean() >= 0.91 > held[found.label == Label.M].mean()
    pad = replace(hand, inner_faces=())
    fixed = evaluate_grasps(mesh, poses, GraspModel(), hand=pad, object_motion="fixed")
    assert auc(-np.nan_to_num(fixed.critical_angle, nan=math.pi), held) < 0.4


FRANKA = ParallelGripper.preset("franka")


def test_every_pose_that_is_not_sure_has_a_reason(blob: ObjectMesh) -> None:
    found = evaluated(blob, random_poses(80, 0.005, seed=7))
    assert set(found.letter.tolist()) == {0, 1, 2}
    assert [bool(text) for text in found.reason] == [letter < 2 for letter in found.letter]
    assert sum(kind != "" for kind in found.reasons.kinds) == (found.letter < 2).sum()


@pytest.mark.parametrize(("width", "reason"), [
    (0.079, ""), (0.0805, "finger 1 is 0.25 mm inside the object"),
    (0.09, "wider than the stroke by 10 mm"),
])  # fmt: skip
def test_a_wide_object_is_compared_with_the_stroke(width: float, reason: str) -> None:
    box = load_mesh(trimesh.creation.box([width, 0.04, 0.04]), unit="m")
    assert evaluate_grasps(box, np.eye(4)[None], hand=FRANKA).reason.tolist() == [reason]
