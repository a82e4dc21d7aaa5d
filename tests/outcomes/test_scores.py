"""Scores of evaluated poses against known shapes."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from grasp3d import GraspModel, Load, ObjectMesh, ParallelGripper, load_mesh
from grasp3d.formats.poses import GraspPoses
from grasp3d.grasps.evaluated_poses import EvaluatedPoses
from grasp3d.grasps.evaluation import evaluate_grasps
from grasp3d.outcomes import SCORES
from grasp3d.outcomes.validation import columns_of, scores_of
from tests.helpers import shapes
from tests.helpers.tried_grasps import poses_on

FRANKA = replace(ParallelGripper.preset("franka"), inner_faces=())


@cache
def blob() -> ObjectMesh:
    points, faces = shapes.lopsided(3)
    return load_mesh((0.025 * points, faces), unit="m", max_edge=0.02)


@cache
def on_blob() -> EvaluatedPoses:
    poses = poses_on(blob(), 60, 0, 0.075)
    return evaluate_grasps(blob(), poses, GraspModel(), hand=FRANKA, load=Load(mass=0.1))


def test_a_box_has_known_scores() -> None:
    box = load_mesh(shapes.box((0.06, 0.04, 0.02)), unit="m")
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    pose[1, 3] = 0.005
    outside = pose + [[0, 0, 0, 0], [0, 0, 0, 0.1], [0, 0, 0, 0], [0, 0, 0, 0]]
    given = GraspPoses(poses=np.array([pose, outside]), unit="m")
    found = scores_of(evaluate_grasps(box, given, hand=FRANKA))
    known = {
        "critical_angle": 0.0,
        "margin": math.atan(0.5) - math.radians(11.3),
        "label": 2.0,
        "reachable": 1.0,
        "antipodal_angle": 0.0,
        "normal_product": -1.0,
        "center_of_mass_distance": 0.005,
        "opening": 0.06,
        "contact_area": FRANKA.pad_width * FRANKA.pad_height,
    }
    for name, value in known.items():
        assert found[name][0] == pytest.approx(value, abs=1e-6), name
    assert found["epsilon"][0] > 0.0
    assert "grip_force" not in found
    assert found["label"][1] == found["reachable"][1] == 0.0
    assert (found["quality"][1], found["score"][1]) == (-1.0, 0.0)
    for name in found.keys() - {"label", "reachable", "quality", "score"}:
        assert np.isnan(found[name][1]), name


@pytest.mark.slow
def test_scores_do_not_depend_on_the_unit_of_the_mesh() -> None:
    points, faces = shapes.lopsided(3)
    in_mm = load_mesh((25.0 * points, faces), unit="mm", max_edge="20mm")
    given = {"hand": FRANKA, "load": Load(mass=0.1), "object_motion": "fixed"}
    one, two = (
        scores_of(evaluate_grasps(mesh, on_blob().given, GraspModel(), **given))
        for mesh in (blob(), in_mm)
    )
    assert set(one) == {score.name for score in SCORES}
    for name, values in one.items():
        rtol = 1e-2 if name in {"epsilon", "grip_force", "payload"} else 1e-6  # bounded to 1 %
        if name in {"quality", "score"}:
            rtol = 1e-2
        np.testing.assert_allclose(two[name], values, rtol=rtol, atol=1e-9, err_msg=name)


def test_the_antipodal_angle_is_the_critical_angle_of_fingers_that_squeeze() -> None:
    found = scores_of(on_blob())
    squeezed = found["antipodal_angle"] < math.pi / 2.0
    assert squeezed.sum() > 40
    expected = found["critical_angle"][squeezed]
    np.testing.assert_allclose(found["antipodal_angle"][squeezed], expected, atol=1e-9)


def test_a_load_and_a_force_at_hand_add_scores() -> None:
    found, closed = scores_of(on_blob()), on_blob().jaws.closed
    np.testing.assert_array_equal(found["payload"][closed], on_blob().payload[closed])
    np.testing.assert_array_equal(found["label"], on_blob().label)
    bare = scores_of(evaluate_grasps(blob(), on_blob().given, hand=FRANKA))
    assert not {"payload", "grip_force"} & bare.keys()


def test_columns_are_all_results_and_scores_in_si_units() -> None:
    points, faces = shapes.lopsided(3)
    in_mm = load_mesh((25.0 * points, faces), unit="mm", max_edge="20mm")
    given = on_blob().given
    found = evaluate_grasps(in_mm, given, hand=FRANKA, load=Load(mass=0.1), object_motion="fixed")
    columns, table = columns_of(found), found.to_table()
    assert {*table.column_names, *(score.name for score in SCORES)} == columns.keys()
    for name in ("opening", "x1", "z2", "area1", "nx1", "margin"):
        expected = np.array(table[name].to_pylist(), dtype=float)
        np.testing.assert_allclose(columns[name], expected, atol=1e-15, err_msg=name)
    for name in ("closing", "label", "reachable", "reason", "name"):
        assert columns[name].tolist() == table[name].to_pylist()


def test_every_score_has_its_direction_and_a_worst_value() -> None:
    better = {score.name: score.better for score in SCORES}
    assert {name for name, direction in better.items() if direction == "larger"} == {
        "margin", "label", "epsilon", "payload", "reachable", "contact_area", "quality", "score",
    }  # fmt: skip
    for score in SCORES:
        ranked = score.ranked(np.array([1.0, 2.0, np.nan]))
        assert ranked[2] == -math.inf
        assert (ranked[0] < ranked[1]) == (score.better == "larger")
