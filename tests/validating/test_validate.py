"""Grasps with outcomes that are drawn from a known function of the margin, end to end."""

import math
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import grasp3d
from grasp3d import GraspModel, Load, ObjectMesh, ParallelGripper, load_mesh, validate_grasps
from grasp3d.errors import ContactError, SettingError
from grasp3d.grasps.evaluation import evaluate_grasps
from grasp3d.grasps.pose_files import write_poses
from grasp3d.grasps.poses import GraspPoses
from grasp3d.system.tables import read_columns
from grasp3d.validating import Validation, ValidationSettings, sentences, write_validation
from grasp3d.validating.success import labels_at
from tests.helpers import shapes
from tests.helpers.tried_grasps import chances, expected_roc_auc, poses_on

FRANKA = ParallelGripper.preset("franka")
COUNT = 240
QUICK = ValidationSettings(resamples=100, worst=3)


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
        tried(held), mesh=mesh(), hand=FRANKA, settings=QUICK, **options  # type: ignore[arg-type]
    )  # fmt: skip


@cache
def drawn() -> tuple[Validation, float]:
    """Outcomes drawn from a logistic function of the margin, and the area that is expected."""
    likely = chances(margins())
    held = np.random.default_rng(0).random(COUNT) < likely
    return validated(held), expected_roc_auc(margins(), likely)


@pytest.mark.slow
def test_outcomes_that_follow_the_margin_are_predicted() -> None:
    assert 0.04 < np.isnan(margins()).mean() < 0.3
    found = validated(margins() > 0.05)
    assert found.quality("margin").roc_auc == 1.0
    assert found.quality("critical_angle").roc_auc == 1.0
    assert found.quality("antipodal_angle").roc_auc > 0.99
    assert found.quality("margin").average_precision == 1.0
    best = found.calibration.youden
    assert (best.sensitivity, best.specificity) == (1.0, 1.0)
    assert 0.05 < best.margin < 0.08
    assert found.calibration.reached.margin <= best.margin
    opposite = validated(~(margins() > 0.05))
    assert opposite.quality("margin").roc_auc == 0.0
    assert not opposite.calibration.is_monotone


def test_the_area_is_that_of_the_function_that_outcomes_are_drawn_from() -> None:
    found, expected = drawn()
    assert 0.7 < expected < 0.95
    low, high = found.quality("margin").roc_auc_interval
    assert low < found.quality("margin").roc_auc < high
    assert low < expected < high
    assert found.quality("margin").roc_auc == pytest.approx(expected, abs=0.05)
    assert found.calibration.is_monotone


def test_it_agrees_with_an_evaluation() -> None:
    found, _ = drawn()
    grasps = found.grasps
    np.testing.assert_array_equal(grasps.scores["margin"], margins())
    assert (grasps.closed == ~np.isnan(margins())).all()
    assert found.files[0].not_closed == np.isnan(margins()).sum()
    default = next(
        one for one in found.labels
        if one.friction == 0.5 and one.sensor_resolution == pytest.approx(math.radians(22.6))
    )  # fmt: skip
    low = labels_at(grasps.angle_upper, grasps.angle_lower, GraspModel(), 0.5, 0.3944)
    assert default.counts == pytest.approx(np.bincount(low, minlength=3), abs=1)
    assert (grasps.label <= low).all()  # some are not reachable
    assert sum(default.held) == grasps.held.sum()
    assert len(found.labels) == 12
    assert "grip_force" not in grasps.scores


@pytest.mark.slow
def test_neither_chunks_nor_threads_change_it(monkeypatch: pytest.MonkeyPatch) -> None:
    one, _ = drawn()
    monkeypatch.setattr("grasp3d.validating.validate.CHUNK", 50)
    two = validated(one.grasps.held)
    for name, values in one.grasps.scores.items():
        np.testing.assert_array_equal(values, two.grasps.scores[name], err_msg=name)
    assert one.qualities == two.qualities
    assert one.labels == two.labels
    assert [each.row for each in one.disagreements] == [each.row for each in two.disagreements]


def test_the_greatest_disagreements_are_listed() -> None:
    found, _ = drawn()
    grasps, values = found.grasps, margins()
    failed = [one for one in found.disagreements if one.kind == "failed"]
    largest = np.sort(values[~grasps.held & (grasps.label == 2)])[::-1][:3]
    assert [one.margin for one in failed] == largest.tolist()
    assert not any(grasps.held[one.row] for one in failed)
    assert all(one.causes for one in failed)
    assert [one.margin for one in failed] == [values[one.row] for one in failed]


def test_reasons_are_counted_of_all_that_contradict_their_label() -> None:
    model = GraspModel(friction=0.2, sensor_resolution=0.0)
    found = validated(np.arange(COUNT) % 2 == 0, model=model)
    grasps, values = found.grasps, found.grasps.scores["margin"]
    unstable = grasps.closed & (grasps.label == 0) & grasps.held
    assert unstable.sum() > 5
    held = [one for one in found.disagreements if one.kind == "held"]
    # Beside the greatest there is the greatest with each reason.
    assert [one.margin for one in held][:3] == np.sort(values[unstable])[:3].tolist()
    totals = {one.reason.kind: one.of for one in found.reasons}
    assert totals == {
        "failed": (~grasps.held & (grasps.label == 2)).sum(),
        "held": unstable.sum(),
        "held_open": (grasps.held & ~grasps.closed).sum(),
    }
    counts: dict[tuple[str, str], int] = {
        (one.reason.kind, one.reason.name): one.count for one in found.reasons
    }
    masks = {"failed": ~grasps.held & (grasps.label == 2), "held": unstable}
    for kind, mask in masks.items():
        small = grasps.scores["contact_area"] < 0.05 * FRANKA.touch_area
        assert counts.get((kind, "small contact"), 0) == (small & mask).sum()
    assert sum(n for (kind, _), n in counts.items() if kind == "held_open") == totals["held_open"]


def test_held_grasps_that_do_not_close_are_listed_apart() -> None:
    held = np.isnan(margins()) | (margins() > 0.0)
    found = validated(held)
    apart = [one for one in found.disagreements if one.kind == "held_open"]
    states = {one.reason for one in found.reasons if one.reason.kind == "held_open"}
    assert {cause.reason for one in apart for cause in one.causes} == states
    assert 3 <= len(apart) < 3 + len(states)
    assert all(math.isnan(one.margin) for one in apart)
    assert "pose, gripper or mesh differ" in str(apart[0].causes[0])
    assert f"{found.files[0].not_closed} of them held" in sentences.closing_of(found)


def test_several_objects_are_drawn_whole(tmp_path: Path) -> None:
    held = np.random.default_rng(1).random(COUNT) < 0.5
    points, faces = shapes.lopsided(3)
    larger = load_mesh((0.0251 * points, faces), unit="m", max_edge=0.02)
    for k, one in enumerate((mesh(), larger)):
        one.to_trimesh().export(tmp_path / f"{k}.ply")
        part = tried(held).take(np.arange(20 * k, 20 * k + 20))
        write_poses(tmp_path / f"{k}.json", replace(part, object_file=f"{k}.ply", hand=FRANKA))
        write_poses(tmp_path / f"{k}b.json", replace(part, object_file=f"{k}.ply", hand=FRANKA))
    files = [tmp_path / f"{name}.json" for name in ("0", "0b", "1")]
    options = grasp3d.MeshOptions(unit="m", max_edge=0.02)
    found = validate_grasps(files, options=options, settings=QUICK)
    assert [one.object_number for one in found.files] == [0, 0, 1]
    assert (found.objects, found.by_object, found.grasps.size) == (2, True, 60)
    assert found.grasps.file.tolist() == [0] * 20 + [1] * 20 + [2] * 20
    assert "of 2 objects only, too few" in found.warnings[-1]
    assert "resamples (seed 0) of the 2 objects" in sentences.intervals_of(found)


@pytest.mark.slow
def test_a_load_adds_the_grip_force() -> None:
    found = validated(margins() > 0.0, load=Load(mass="50 g"))
    force = found.grasps.scores["grip_force"]
    assert np.isfinite(force[margins() > 0.1]).all()
    assert found.quality("grip_force").roc_auc > 0.6
    assert "mass 50 g, as given" in sentences.sources_of(found)[0]


@pytest.mark.slow
@pytest.mark.slow
def test_each_grasp_is_loaded_with_its_own_mass() -> None:
    """In any order; a mass that is given overrides them, and a file of one mass is one run."""
    held, masses = margins() > 0.0, np.where(np.arange(COUNT) % 3, 0.05, 2.0)
    given = replace(tried(held), columns={"mass": masses})
    both, light, heavy = (
        validate_grasps(given, mesh=mesh(), hand=FRANKA, settings=QUICK, load=load)
        for load in (None, Load(mass=0.05), Load(mass=2.0))
    )
    assert both.grasps.grasp.tolist() == list(range(1, COUNT + 1))
    for name, values in both.grasps.scores.items():
        parts = (light.grasps.scores[name], heavy.grasps.scores[name])
        np.testing.assert_array_equal(values, np.where(masses < 1.0, *parts), err_msg=name)
    assert (light.grasps.columns["grip_force"] != heavy.grasps.columns["grip_force"]).any()
    np.testing.assert_array_equal(both.grasps.columns["mass"], masses)
    assert "mass 50 g to 2 kg, by the column mass" in sentences.sources_of(both)[0]
    assert "mass 2 kg, as given" in sentences.sources_of(heavy)[0]
    one, pressed = (
        validate_grasps(
            [given, tried(held)], mesh=mesh(), hand=FRANKA, settings=QUICK, load=load
        )
        for load in (None, Load(grip_force=40.0))
    )  # fmt: skip
    lack = "the mass is known in 1 of 2 files only: grasps of the others"
    assert f"{lack} have the worst forces" in one.warnings
    assert np.isnan(one.grasps.scores["payload"][COUNT:]).all()
    assert f"{lack} are loaded with 1 kg" in pressed.warnings
    assert "mass not known, so forces are for 1 kg" in sentences.sources_of(pressed)[1]
    assert both.objects == 1


def test_equal_outcomes_rank_nothing() -> None:
    found = validated(np.ones(COUNT, bool))
    assert math.isnan(found.quality("margin").roc_auc)
    assert math.isnan(found.quality("margin").roc_auc_interval[0])
    assert found.warnings[-1] == f"poses: all {COUNT} grasps held, so no score can be ranked"
    assert found.labels[0].held == found.labels[0].counts
    assert "none, as all outcomes are the same" in sentences.calibration_of(found)[1]
    failed = validated(np.zeros(COUNT, bool))
    assert math.isnan(failed.quality("margin").average_precision)


def test_poses_in_another_unit_close_on_nothing() -> None:
    far = poses().poses.copy()
    far[:, :3, 3] *= 1000.0
    given = GraspPoses(poses=far, outcome=np.arange(COUNT) % 2, unit="m")
    message = r"all poses \(240\) are far from the object.*if their lengths are in mm"
    with pytest.raises(ContactError, match=message):
        validate_grasps(given, mesh=mesh(), hand=FRANKA, settings=QUICK)


@pytest.mark.slow
def test_a_gripper_that_states_its_resolution_is_believed() -> None:
    held = margins() > 0.0
    tips = ParallelGripper.preset("tactile")
    found = validate_grasps(tried(held), mesh=mesh(), hand=tips, settings=QUICK)
    assert found.model.sensor_resolution == tips.resolution != GraspModel().sensor_resolution
    model = GraspModel(friction=0.8, sensor_resolution=0.2, location_error="1mm")
    given = validate_grasps(tried(held), model, mesh=mesh(), hand=tips, settings=QUICK)
    assert given.model == model
    assert "labels, margins and forces at μ 0.8, α 11.46°, locations ± 1 mm" in (
        sentences.model_of(given)
    )


def test_models_without_margins_are_refused() -> None:
    held = margins() > 0.0
    with pytest.raises(SettingError, match="which method extremes has not"):
        validated(held, model=GraspModel(method="extremes"))


def test_the_tables_have_what_was_found(tmp_path: Path) -> None:
    found, _ = drawn()
    write_validation(tmp_path / "new" / "out", found)
    tables = {path.stem: read_columns(path) for path in (tmp_path / "new" / "out").iterdir()}
    grasps = tables["grasps"]
    np.testing.assert_array_equal(grasps["success"], found.grasps.held)
    np.testing.assert_allclose(grasps["margin"].astype(float), margins())
    assert set(grasps["closing"]) <= {"closed", "nothing", "slips_out"}
    assert (np.isnan(margins()) == (grasps["closing"] != "closed")).all()
    assert {*found.grasps.columns, *found.grasps.scores} < grasps.keys()
    np.testing.assert_allclose(grasps["area1"].astype(float), found.grasps.columns["area1"])
    differences = tables["differences"]
    count = len(found.qualities)
    assert len(differences["p"]) == count * (count - 1) // 2
    assert set(differences["score"][: count - 1]) == {"quality"}
    objects = tables["objects"]
    assert (objects["object"].tolist(), objects["grasps"].tolist()) == ([1], [COUNT])
    assert objects["margin"][0] == found.quality("margin").roc_auc
    assert tables["reasons"]["grasps"].tolist() == [one.count for one in found.reasons]
    scores = tables["scores"]
    assert scores["score"].tolist() == [one.score.name for one in found.qualities]
    assert scores["roc_auc"][0] == found.quality("quality").roc_auc
    assert tables["labels"]["grasps"].sum() == 12 * COUNT
    assert tables["calibration"]["held"].sum() == found.grasps.held[found.grasps.closed].sum()
