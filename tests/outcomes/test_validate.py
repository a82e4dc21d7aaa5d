"""Grasps with outcomes that are drawn from a known function of the margin, end to end."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import grasp3d
from grasp3d import GraspModel, Load, ObjectMesh, ParallelGripper, load_mesh, validate_grasps
from grasp3d.errors import ContactError, SettingError
from grasp3d.formats import write_grasps
from grasp3d.formats.poses import GraspPoses
from grasp3d.grasps.evaluation import evaluate_grasps
from grasp3d.outcomes import SCORES, Validation, write_validation
from grasp3d.outcomes.validation import roc_auc, validation_figure
from grasp3d.system.tables import read_columns
from tests.helpers import shapes, slider_hand
from tests.helpers.tried_grasps import chances, expected_roc_auc, poses_on

FRANKA = ParallelGripper.preset("franka")
COUNT = 240


@cache
def mesh() -> ObjectMesh:
    """A smooth body of 60 mm."""
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
def drawn() -> tuple[Validation, float]:
    """Outcomes drawn from a logistic function of the margin, and the area that is expected."""
    likely = chances(margins())
    held = np.random.default_rng(0).random(COUNT) < likely
    return validated(held), expected_roc_auc(margins(), likely)


def test_outcomes_that_follow_the_margin_are_predicted() -> None:
    assert 0.04 < np.isnan(margins()).mean() < 0.3
    found = validated(margins() > 0.05)
    assert found.quality("margin").roc_auc == found.quality("critical_angle").roc_auc == 1.0
    assert found.quality("antipodal_angle").roc_auc > 0.99
    assert "grip_force" not in found.columns
    assert validated(~(margins() > 0.05)).quality("margin").roc_auc == 0.0


def test_the_area_is_that_of_the_function_that_outcomes_are_drawn_from() -> None:
    found, expected = drawn()
    assert 0.7 < expected < 0.95
    margin = found.quality("margin")
    assert margin.low < expected < margin.high
    assert margin.low < margin.roc_auc < margin.high
    assert margin.roc_auc == pytest.approx(expected, abs=0.05)


def test_it_agrees_with_an_evaluation() -> None:
    found, _ = drawn()
    expected = evaluate_grasps(mesh(), poses(), GraspModel(), hand=FRANKA)
    np.testing.assert_array_equal(found.columns["margin"], margins())
    np.testing.assert_array_equal(found.columns["score"], expected.score)
    for label, rate in found.rates.items():
        own = expected.label == label
        assert (rate.count, rate.successes) == (own.sum(), found.held[own].sum())
    assert sum(rate.count for rate in found.rates.values()) == COUNT


def test_the_label_is_a_score_too() -> None:
    """Its area by counting pairs of letters, of which equal ones are worth half."""
    found, _ = drawn()
    rates = [found.rates[label] for label in sorted(found.rates)]
    pairs = [
        (one.successes * (other.count - other.successes), 0.5 + 0.5 * np.sign(a - b))
        for a, one in enumerate(rates)
        for b, other in enumerate(rates)
    ]
    expected = sum(n * won for n, won in pairs) / sum(n for n, _ in pairs)
    assert found.quality("label").roc_auc == pytest.approx(expected)


def test_chunks_do_not_change_it(monkeypatch: pytest.MonkeyPatch) -> None:
    one, _ = drawn()
    monkeypatch.setattr("grasp3d.outcomes.validate.CHUNK", 50)
    two = validated(one.held)
    for name, values in one.columns.items():
        np.testing.assert_array_equal(values, two.columns[name], err_msg=name)
    assert one.qualities == two.qualities


def test_wrong_labels_are_listed_the_greatest_contradictions_first() -> None:
    found, _ = drawn()
    label, score = found.columns["label"][found.wrong], found.columns["score"][found.wrong]
    count = int((~found.held & (found.columns["label"] == "S")).sum())
    assert 0 < count < len(found.wrong)
    assert set(label[:count]) == {"S"}
    assert set(label[count:]) == {"U"}
    assert not found.held[found.wrong[:count]].any()
    assert found.held[found.wrong[count:]].all()
    assert len(found.wrong) - count == (found.held & (found.columns["label"] == "U")).sum()
    assert (np.diff(score[:count]) <= 0.0).all()
    assert (np.diff(score[count:]) >= 0.0).all()
    assert all(found.columns["reason"][found.wrong[count:]].tolist())


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


def test_equal_outcomes_rank_nothing() -> None:
    found = validated(np.ones(COUNT, bool))
    one = found.quality("margin")
    assert np.isnan([one.roc_auc, one.low, one.high]).all()
    assert found.warnings[-1] == "all grasps held, so no score can be ranked"
    assert all(rate.successes == rate.count for rate in found.rates.values())


def test_poses_in_another_unit_close_on_nothing() -> None:
    far = poses().poses.copy()
    far[:, :3, 3] *= 1000.0
    given = GraspPoses(poses=far, outcome=np.arange(COUNT) % 2, unit="m")
    message = r"all poses \(240\) are far from the object.*if their lengths are in mm"
    with pytest.raises(ContactError, match=message):
        validate_grasps(given, mesh=mesh(), hand=FRANKA)


@pytest.mark.slow
def test_a_gripper_that_states_its_resolution_is_believed() -> None:
    held = margins() > 0.0
    tips = ParallelGripper.preset("tactile")
    found = validate_grasps(tried(held), mesh=mesh(), hand=tips)
    (file,) = found.files
    assert file.model.sensor_resolution == tips.sensor_resolution != GraspModel().sensor_resolution
    model = GraspModel(friction=0.8, sensor_resolution=0.2, location_error="1mm")
    given = validate_grasps(tried(held), model, mesh=mesh(), hand=tips)
    assert given.files[0].model == model


def test_models_without_margins_are_refused() -> None:
    held = margins() > 0.0
    with pytest.raises(SettingError, match="which method extremes has not"):
        validated(held, model=GraspModel(method="extremes"))


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_the_table_has_what_was_found(tmp_path: Path, suffix: str) -> None:
    found, _ = drawn()
    write_validation(tmp_path / f"out{suffix}", found)
    table = read_columns(tmp_path / f"out{suffix}")
    assert table.keys() == found.columns.keys()
    np.testing.assert_array_equal(table["outcome"] == 1.0, found.held)
    for one in found.qualities:
        if one.score.name != "label":
            written = np.nan_to_num(table[one.score.name].astype(float), nan=-7.0)
            own = np.nan_to_num(found.columns[one.score.name].astype(float), nan=-7.0)
            np.testing.assert_allclose(written, own, err_msg=one.score.name)


def test_one_figure_shows_what_is_known() -> None:
    found, _ = drawn()
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
