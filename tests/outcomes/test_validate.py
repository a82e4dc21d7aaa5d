"""Grasps with outcomes that are drawn from a known function of the margin, end to end."""

import math
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import grasp3d
from grasp3d import GraspModel, Load, ObjectMesh, ParallelGripper, load_mesh, validate_grasps
from grasp3d.errors import SettingError
from grasp3d.formats import write_grasps
from grasp3d.formats.poses import GraspPoses
from grasp3d.grasps.evaluation import evaluate_grasps
from grasp3d.outcomes import SCORES, Validation, write_validation
from grasp3d.outcomes.validation import roc_auc, scores_of, validation_figure
from grasp3d.system.tables import read_columns
from tests.helpers import shapes, slider_hand
from tests.helpers.tried_grasps import chances, expected_roc_auc, poses_on

FRANKA = ParallelGripper.preset("franka")
COUNT = 240


@cache
def mesh() -> ObjectMesh:
    points, faces = shapes.lopsided(3)
    return load_mesh((0.025 * points, faces), unit="m", max_edge=0.02)


@cache
def poses() -> GraspPoses:
    """Poses on it, some of which miss it."""
    given = poses_on(mesh(), COUNT, 0, 0.075).poses.copy()
    given[:12, :3, 3] += 0.2
    return GraspPoses(poses=given, unit="m")


@cache
def margins() -> np.ndarray:
    return np.array(evaluate_grasps(mesh(), poses(), GraspModel(), hand=FRANKA).margin)


def tried(held: np.ndarray) -> GraspPoses:
    return replace(poses(), outcome=held.astype(float))


def validated(held: np.ndarray, **options: object) -> Validation:
    return validate_grasps(
        tried(held), mesh=mesh(), hand=FRANKA, **options  # type: ignore[arg-type]
    )  # fmt: skip


@cache
def drawn() -> Validation:
    return validated(np.random.default_rng(0).random(COUNT) < chances(margins()))


def test_outcomes_that_follow_the_margin_are_predicted() -> None:
    assert 0.04 < np.isnan(margins()).mean() < 0.3
    found = validated(margins() > 0.05)
    assert found.quality("margin").roc_auc == found.quality("critical_angle").roc_auc == 1.0
    assert found.quality("antipodal_angle").roc_auc > 0.99
    assert "grip_force" not in found.columns
    assert validated(~(margins() > 0.05)).quality("margin").roc_auc == 0.0
    margin, expected = drawn().quality("margin"), expected_roc_auc(margins(), chances(margins()))
    assert margin.low < expected < margin.high
    assert margin.roc_auc == pytest.approx(expected, abs=0.05)
    with pytest.raises(SettingError, match="which method extremes has not"):
        validated(margins() > 0.0, model=GraspModel(method="extremes"))


def test_it_agrees_with_an_evaluation_in_any_chunks(monkeypatch: pytest.MonkeyPatch) -> None:
    found = drawn()
    expected = evaluate_grasps(mesh(), poses(), GraspModel(), hand=FRANKA)
    np.testing.assert_array_equal(found.columns["margin"], margins())
    np.testing.assert_array_equal(found.columns["score"], expected.score)
    for label, rate in found.rates.items():
        own = expected.label == label
        assert (rate.count, rate.successes) == (own.sum(), found.held[own].sum())
    assert sum(rate.count for rate in found.rates.values()) == COUNT
    with monkeypatch.context() as patch:
        patch.setattr("grasp3d.outcomes.validate.CHUNK", 50)
        parts = validated(found.held)
    assert found.qualities == parts.qualities
    for name, values in found.columns.items():
        np.testing.assert_array_equal(values, parts.columns[name], err_msg=name)


def test_wrong_labels_are_listed_the_greatest_contradictions_first() -> None:
    found = drawn()
    label, score = found.columns["label"][found.wrong], found.columns["score"][found.wrong]
    count = int((~found.held & (found.columns["label"] == "S")).sum())
    assert (set(label[:count]), set(label[count:])) == ({"S"}, {"U"})
    assert len(found.wrong) - count == (found.held & (found.columns["label"] == "U")).sum()
    assert (np.diff(score[:count]) <= 0.0).all()
    assert (np.diff(score[count:]) >= 0.0).all()


def test_several_objects_are_drawn_whole(tmp_path: Path) -> None:
    held = np.random.default_rng(1).random(COUNT) < 0.5
    points, faces = shapes.lopsided(3)
    larger = load_mesh((0.0251 * points, faces), unit="m", max_edge=0.02)
    for k, one in enumerate((mesh(), larger)):
        one.to_trimesh().export(tmp_path / f"{k}.ply")
        part = tried(held).take(np.arange(20 * k, 20 * k + 20))
        write_grasps(tmp_path / f"{k}.json", replace(part, object_file=f"{k}.ply", hand=FRANKA))
        write_grasps(tmp_path / f"{k}b.json", replace(part, object_file=f"{k}.ply", hand=FRANKA))
    files = [tmp_path / f"{name}.json" for name in ("0", "0b", "1")]
    options = grasp3d.MeshOptions(unit="m", max_edge=0.02)
    found = validate_grasps(files, options=options)
    assert [one.object_number for one in found.files] == [1, 1, 2]
    assert (found.objects, found.size) == (2, 60)
    assert found.columns["file"].tolist() == [str(file) for file in files for _ in range(20)]
    assert found.columns["grasp"].tolist() == [*range(1, 21)] * 3
    for one in found.qualities:
        expected = roc_auc(found.held, found.ranked(one.score), found.columns["object"])
        assert (one.roc_auc, one.low, one.high) == expected


@pytest.mark.slow
def test_each_grasp_is_loaded_with_its_own_mass() -> None:
    """In any order; a mass that is given overrides them, and a file of one mass is one run."""
    held, masses = margins() > 0.0, np.where(np.arange(COUNT) % 3, 0.05, 2.0)
    given = replace(tried(held), columns={"mass": masses})
    both, light, heavy = (
        validate_grasps(given, mesh=mesh(), hand=FRANKA, load=load)
        for load in (None, Load(mass=0.05), Load(mass=2.0))
    )
    assert both.columns["grasp"].tolist() == list(range(1, COUNT + 1))
    for score in SCORES:
        parts = (light.columns[score.name], heavy.columns[score.name])
        expected = np.where(masses < 1.0, *parts)
        np.testing.assert_array_equal(both.columns[score.name], expected, err_msg=score.name)
    assert (light.columns["grip_force"] != heavy.columns["grip_force"]).any()
    np.testing.assert_array_equal(both.columns["mass"], masses)
    assert "mass 0.05 to 2 kg, by the column mass" in both.files[0].sources
    assert "mass 2 kg, as given" in heavy.files[0].sources
    assert both.quality("grip_force").roc_auc > 0.6
    several = validate_grasps([given, tried(held)], mesh=mesh(), hand=FRANKA)
    assert np.isnan(several.columns["payload"][COUNT:]).all()
    assert (several.objects, several.size) == (1, 2 * COUNT)


def test_a_gripper_that_states_its_resolution_is_believed() -> None:
    tips, model = ParallelGripper.preset("tactile"), GraspModel(sensor_resolution=0.2)
    some = tried(margins() > 0.0).take(np.arange(20, 60))
    own, given = (
        validate_grasps(some, one, mesh=mesh(), hand=tips).files[0].model for one in (None, model)
    )
    assert own.sensor_resolution == tips.sensor_resolution != GraspModel().sensor_resolution
    assert given == model


def test_the_table_has_what_was_found(tmp_path: Path) -> None:
    found = drawn()
    write_validation(tmp_path / "out.parquet", found)
    table = read_columns(tmp_path / "out.parquet")
    assert table.keys() == found.columns.keys()
    np.testing.assert_array_equal(table["outcome"] == 1.0, found.held)
    for name in ("margin", "critical_angle", "score"):
        np.testing.assert_array_equal(table[name], found.columns[name], err_msg=name)


def test_one_figure_shows_what_is_known() -> None:
    found = drawn()
    left, right = validation_figure(found).axes
    counts = [f"{rate.name}\n{rate.count:,}" for rate in found.rates.values()]
    assert [text.get_text() for text in left.get_xticklabels()] == counts
    margin = found.quality("margin").roc_auc
    assert f"margin {margin:.2f}" in [line.get_label() for line in right.lines]
    _, alone = validation_figure(validated(np.ones(COUNT, bool))).axes
    assert [line.get_label() for line in alone.lines] == ["chance 0.50"]


def test_poses_of_hands_with_joints_are_compared_as_others_are(tmp_path: Path) -> None:
    """Four sliding fingers, some too far from the box; the outcomes follow the margin."""
    box = load_mesh(shapes.box(slider_hand.BOX), unit="m")
    hand = grasp3d.read_hand(slider_hand.write(tmp_path))
    postures = 0.04 - np.random.default_rng(0).uniform(0.0, 0.012, size=(60, 4))
    given = GraspPoses(poses=np.tile(np.eye(4), (60, 1, 1)), posture=postures, unit="m")
    found = evaluate_grasps(box, given, GraspModel(), hand=hand)
    held = np.nan_to_num(found.margin, nan=-1.0) > 0.0
    given = replace(given, outcome=held.astype(float))
    exact, located = (
        validate_grasps(given, GraspModel(location_error=error), mesh=box, hand=hand)
        for error in (0.0, 0.001)
    )
    assert exact.quality("margin").roc_auc == exact.quality("score").roc_auc == 1.0
    assert exact.rates[grasp3d.Label.S].rate == 1.0
    assert {one.score.name for one in exact.qualities} >= {"quality", "epsilon", "reachable"}
    assert "opening" not in exact.columns
    assert (exact.columns["margin"][held] > located.columns["margin"][held]).all()


FLAT = replace(ParallelGripper.preset("franka"), inner_faces=())


def test_a_box_has_known_scores() -> None:
    box = load_mesh(shapes.box((0.06, 0.04, 0.02)), unit="m")
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    pose[1, 3] = 0.005
    outside = pose + [[0, 0, 0, 0], [0, 0, 0, 0.1], [0, 0, 0, 0], [0, 0, 0, 0]]
    given = GraspPoses(poses=np.array([pose, outside]), unit="m")
    found = scores_of(evaluate_grasps(box, given, hand=FLAT))
    known = {
        "critical_angle": 0.0,
        "margin": math.atan(0.5) - math.radians(11.3),
        "label": 2.0,
        "reachable": 1.0,
        "antipodal_angle": 0.0,
        "normal_product": -1.0,
        "center_of_mass_distance": 0.005,
        "opening": 0.06,
        "contact_area": FLAT.pad_width * FLAT.pad_height,
    }
    for name, value in known.items():
        assert found[name][0] == pytest.approx(value, abs=1e-6), name
    assert found["epsilon"][0] > 0.0
    assert "grip_force" not in found
    assert found["label"][1] == found["reachable"][1] == 0.0
    assert (found["quality"][1], found["score"][1]) == (-1.0, 0.0)
    for name in found.keys() - {"label", "reachable", "quality", "score"}:
        assert np.isnan(found[name][1]), name


def test_every_score_has_its_direction_and_a_worst_value() -> None:
    larger = {score.name for score in SCORES if score.better == "larger"}
    assert larger == {
        "margin", "label", "epsilon", "payload", "reachable", "contact_area", "quality", "score",
    }  # fmt: skip
    for score in SCORES:
        ranked = score.ranked(np.array([1.0, 2.0, np.nan]))
        assert ranked[2] == -np.inf
        assert (ranked[0] < ranked[1]) == (score.name in larger)
