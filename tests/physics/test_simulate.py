"""Grasps drawn from a surface, labelled and simulated."""

import math
import os
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import trimesh

import grasp3d
from grasp3d import GraspModel, Label, ObjectMesh, ParallelGripper, Sampling, load_mesh
from grasp3d.arrays import angles_between
from grasp3d.batch import ClusterSettings
from grasp3d.errors import GraspError, SettingError
from grasp3d.grasps import GraspPoses
from grasp3d.physics import (
    ConvexParts,
    Fate,
    Simulation,
    SimulationSettings,
    simulate_poses,
    write_simulation,
)
from grasp3d.physics.drawing import tilt_at_random
from grasp3d.physics.scene import Stage, Tips
from grasp3d.physics.simulate import Job, _posed_attempts, simulate_attempts, simulate_job
from grasp3d.physics.simulation import rates_by
from grasp3d.system.tables import read_columns
from grasp3d.validating import SuccessRate
from tests.physics.test_pulling import STAGE, attempt

HERE = ClusterSettings(workers=0)
FEW = SimulationSettings(count=12, pull_time=0.1)
MODEL = GraspModel(friction="0.4..0.6", location_error="1mm")


@cache
def mesh(unit: str = "cm") -> ObjectMesh:
    """A box in centimetres, so that units make a difference."""
    return load_mesh(trimesh.creation.box([4.0, 6.0, 10.0]), unit=unit)


@cache
def found() -> Simulation:
    return grasp3d.simulate_grasps(mesh(), MODEL, simulation=FEW, cluster=HERE)


@pytest.mark.slow
def test_labels_are_those_of_what_is_perceived_within_the_uncertainty_of_what_is_true() -> None:
    one = found()
    assert one.size == FEW.count
    drawn = one.grasps
    tilt = angles_between(drawn.normals, drawn.perceived_normals)
    assert (tilt <= MODEL.tilt + 1e-9).all()
    assert tilt.max() > 0.3 * MODEL.tilt
    shifts = np.linalg.norm(drawn.points - drawn.perceived_points, axis=2)
    assert 2e-4 < shifts.max() <= 1e-3 + 1e-9
    assert ((drawn.friction >= 0.4 - 1e-9) & (drawn.friction <= 0.6 + 1e-9)).all()
    assert ((drawn.label == Label.S) == (drawn.margin > 0.0)).all()
    assert np.bincount(drawn.label).tolist() == [4, 4, 4]


@pytest.mark.slow
def test_true_contacts_are_on_the_surface_and_within_the_tips() -> None:
    drawn, one = found().grasps, found()
    on_face = np.abs(np.abs(drawn.points) / [0.02, 0.03, 0.05] - 1.0).min(axis=2)
    assert on_face.max() < 1e-9
    assert one.part_depth.max() < 1e-6
    for finger, sign in ((0, -1.0), (1, 1.0)):
        middle = (
            one.poses[:, :3, 3]
            + sign * (0.5 * one.openings + 0.003)[:, None] * (one.poses[:, :3, 0])
        )
        touched = middle + 0.003 * drawn.normals[:, finger]
        np.testing.assert_allclose(touched, drawn.points[:, finger], atol=1e-9)


def test_s_hold_and_u_fail() -> None:
    rates = found().rates()
    assert rates["S"].rate == 1.0
    assert rates["U"].rate == 0.0
    assert sum(one.count for one in found().rates_by_margin()) == found().size
    assert (found().success <= found().held).all()


def test_a_true_grasp_beyond_its_friction_never_holds() -> None:
    beta = np.arctan(found().grasps.friction.min(axis=1))
    over = found().true_critical_angle - beta
    assert found().success[over < -math.radians(1.0)].all()
    assert not found().success[over > math.radians(3.0)].any()


@pytest.mark.slow
def test_the_same_seed_gives_the_same_result_in_any_processes() -> None:
    again = grasp3d.simulate_grasps(
        mesh(), MODEL, simulation=FEW, cluster=ClusterSettings(workers=1)
    )
    assert again.outcomes == found().outcomes
    np.testing.assert_array_equal(again.poses, found().poses)


def test_tilts_are_even_over_the_cap() -> None:
    """The area of a cap grows as 1 - cos."""
    normals = np.tile([0.0, 0.6, 0.8], (20_000, 1))
    tilted = tilt_at_random(normals, np.full(len(normals), 0.5), np.random.default_rng(0))
    angle = angles_between(normals, tilted)
    inner = math.acos(1.0 - 0.5 * (1.0 - math.cos(0.5)))
    assert angle.max() <= 0.5 + 1e-12
    assert np.mean(angle < inner) == pytest.approx(0.5, abs=0.02)
    assert (
        np.abs((tilted - normals * (tilted * normals).sum(axis=1)[:, None]).mean(axis=0)).max()
        < 0.02
    )


def test_the_table_has_what_the_result_has(tmp_path: Path) -> None:
    path = tmp_path / "out.csv"
    write_simulation(path, found())
    columns = read_columns(path)
    assert list(columns) == list(found().columns())
    assert (columns["success"] == found().success).all()
    assert columns["opening"] == pytest.approx(found().openings)
    assert columns["slip"] == pytest.approx([one.slip for one in found().outcomes])
    assert set(found().to_dataframe().fate) <= {str(one) for one in Fate}


@pytest.mark.slow
def test_a_gripper_gives_tips_and_limits() -> None:
    hand = ParallelGripper.preset("tactile")
    one = grasp3d.simulate_grasps(
        mesh(), simulation=SimulationSettings(count=3, pull_time=0.05), hand=hand,
        cluster=HERE,
    )  # fmt: skip
    assert (one.openings <= hand.max_opening).all()
    with pytest.raises(SettingError, match="'franka' has flat pads"):
        grasp3d.simulate_grasps(mesh(), hand=ParallelGripper.preset("franka"), cluster=HERE)


def test_what_cannot_be_simulated_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    no_unit = load_mesh(trimesh.creation.box([4.0, 6.0, 10.0]))
    with pytest.raises(
        SettingError, match=r"a simulation is in metres, but the unit of .* is not known"
    ):
        grasp3d.simulate_grasps(no_unit, cluster=HERE)
    with pytest.raises(SettingError, match=r"2 fingers, but the model .* has 3"):
        grasp3d.simulate_grasps(mesh(), GraspModel(fingers=3), cluster=HERE)
    with pytest.raises(SettingError, match="method exact"):
        grasp3d.simulate_grasps(mesh(), GraspModel(method="extremes"), cluster=HERE)
    with pytest.raises(SettingError, match="grip must be squeeze"):
        grasp3d.simulate_grasps(mesh(), sampling=Sampling(grip="both"), cluster=HERE)
    with pytest.raises(GraspError, match="no two points of the surface"):
        grasp3d.simulate_grasps(mesh(), sampling=Sampling(max_opening=1e-5), cluster=HERE)
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(SettingError, match=r"needs mujoco.*pip install 'grasp3d\[physics\]'"):
        grasp3d.simulate_grasps(mesh(), cluster=HERE)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"count": 2}, "count must be from 3 to 100000; got 2"),
        ({"grip_ratio": 0.4}, "grip_ratio must be above 0.5"),
        ({"max_turn": 4.0}, "max_turn must be above 0 and at most 180 degrees; got 229"),
        ({"tip_radius": "0mm"}, "tip_radius must be a finite length above 0"),
        ({"pulled": "up"}, "no pulled is called 'up'; known: line, center_of_mass"),
        ({"pad_stiffness": "3 N/cm"}, "pad_stiffness must be a number .N/m., or a number with a"),
    ],
)
def test_settings_outside_their_range_are_refused(fields: dict[str, object], message: str) -> None:
    with pytest.raises(SettingError, match=message):
        SimulationSettings(**fields)  # type: ignore[arg-type]


def _crash(job: Job, stage: Stage) -> None:
    if job.number == 0:
        os._exit(7)
    return simulate_job(job, stage)  # type: ignore[return-value]


@pytest.mark.slow
def test_a_crash_is_an_error_of_its_grasps_only(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("grasp3d.physics.simulate.simulate_job", _crash)
    monkeypatch.setattr("grasp3d.physics.simulate.ATTEMPTS", 1)
    outcomes, errors = simulate_attempts([attempt()] * 2, STAGE, ClusterSettings(workers=1))
    assert [out.fate for out in outcomes] == [Fate.BROKEN, Fate.HELD]
    assert errors == ("the simulation ended its process without a result (exit code 7)",)


def test_where_every_simulation_fails_the_reason_is_given() -> None:
    broken = replace(STAGE, parts=ConvexParts((np.zeros((4, 3)),)))
    with pytest.raises(GraspError, match="no grasp could be simulated: the simulation unexpected"):
        simulate_attempts([attempt()], broken, HERE)


def test_given_poses_are_tried() -> None:
    from_above = np.diag([1.0, -1.0, -1.0, 1.0])
    from_above[2, 3] = 3.0  # 2 cm above it the palm is in the object
    beside = from_above + [[0, 0, 0, 0], [0, 0, 0, 10.0], [0, 0, 0, 0], [0, 0, 0, 0]]
    poses = GraspPoses(poses=[from_above, beside], pregrasp_opening=[6.0, 3.0], unit="cm")
    tried = simulate_poses(
        mesh(), poses, hand=ParallelGripper.preset("franka"), cluster=HERE,
        simulation=SimulationSettings(pull_time=0.1),
    )  # fmt: skip
    assert tried.columns["fate"].tolist() == ["held", "missed"]
    assert tried.columns["label"].tolist() == ["S", "U"]
    assert tried.outcome.tolist() == [1.0, 0.0]
    narrow = GraspPoses(poses=from_above, pregrasp_opening=3.0, unit="cm")
    blocked = simulate_poses(mesh(), narrow, hand=ParallelGripper.preset("franka"), cluster=HERE)
    assert (blocked.columns["fate"].tolist(), blocked.outcome.tolist()) == (["blocked"], [0.0])


def test_true_poses_are_drawn_around_the_given_ones() -> None:
    """Labels are those of the given poses; what is simulated is each with its error."""
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    pose[:3, 3] = [0.0, 1.0, 3.0]
    poses = GraspPoses(poses=np.stack([pose, pose]), names=("one", "two"), unit="cm")
    settings = SimulationSettings(
        pull_time=0.02, time_step=2e-3, pose_error="2mm,4deg", trials=3, grip_force=3.0
    )
    hand = replace(ParallelGripper.preset("wsg50"), pad_width=0.01, pad_height=0.01)
    tried = simulate_poses(mesh(), poses, hand=hand, simulation=settings, cluster=HERE)
    columns = tried.columns
    assert (tried.names[0], tried.names[3]) == ("one", "two")
    assert columns["trial"].tolist() == [1, 2, 3, 1, 2, 3]
    assert columns["label"].tolist() == ["S"] * 6
    assert columns["squeeze_shift_m"].max() < 3e-3  # it is centred between the fingers
    assert not columns["start_shift_m"].any()
    shifts, turns = (
        np.column_stack([columns[f"error_{name}{end}"] for name in names])
        for names, end in ((("x", "y", "z"), "_m"), (("rx", "ry", "rz"), ""))
    )
    assert 1e-4 < np.abs(shifts).mean() < 2e-3
    assert 0.002 < np.abs(turns).mean() < math.radians(4.0)
    assert len(np.unique(shifts)) == shifts.size
    again = simulate_poses(mesh(), poses, hand=hand, simulation=settings, cluster=HERE)
    np.testing.assert_array_equal(again.columns["shift_m"], columns["shift_m"])
    assert tried.settings["simulation_pose_error"] == "2 mm,4 deg"


def test_a_true_pose_is_that_of_its_error_in_the_given_frame() -> None:
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    pose[2, 3] = 3.0
    hand = ParallelGripper.preset("franka")
    evaluated = grasp3d.evaluate_grasps(mesh(), GraspPoses(poses=pose, unit="cm"), hand=hand)
    error = np.eye(4)
    error[:3, 3] = [0.001, 0.002, 0.003]
    (one,) = _posed_attempts(evaluated, np.array([0]), error[None], Tips(0.003))
    np.testing.assert_allclose(one.pose[:3, 3], [0.001, -0.002, 0.027], atol=1e-12)
    assert (one.opening, one.may_move) == (hand.max_opening, True)


@pytest.mark.parametrize(("force", "held"), [(5.5, 1.0), (4.5, 0.0)])
def test_a_load_gives_mass_and_force(force: float, held: float) -> None:
    """Two pads of friction 0.5 hold what weighs as much as either presses."""
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    hand = replace(
        ParallelGripper.preset("wsg50"), pad_width=0.01, pad_height=0.01, max_force=force
    )
    settings = SimulationSettings(pull_time=0.2, time_step=2e-3, max_shift="3mm", object_mass=9.0)
    load = grasp3d.Load(mass=5.0 / 9.80665)
    tried = simulate_poses(
        mesh(), GraspPoses(poses=pose, unit="cm"), hand=hand, load=load, simulation=settings,
        cluster=HERE,
    )  # fmt: skip
    assert tried.outcome.tolist() == [held]
    assert tried.settings["simulation_grip_force"] == force
    assert "payload" in tried.columns


@pytest.mark.parametrize(("count", "successes"), [(20, 20), (60, 57), (7, 0), (1, 1)])
def test_intervals_are_those_of_wilson(count: int, successes: int) -> None:
    rate, z = successes / count, 1.959963984540054
    middle = (rate + z * z / (2 * count)) / (1 + z * z / count)
    half = z * math.sqrt(rate * (1 - rate) / count + (z / (2 * count)) ** 2) / (1 + z * z / count)
    rates = SuccessRate("", count, successes)
    assert rates.interval == pytest.approx((middle - half, middle + half), abs=1e-9)


def test_bins_hold_every_grasp_once() -> None:
    values, success = np.array([-5.0, 0.0, 3.0, 9.0]), np.array([False, True, False, True])
    rates = list(rates_by(values, success, [-math.inf, 0.0, 5.0, math.inf]))
    assert [(one.name, one.count, one.successes) for one in rates] == [
        ("below 0", 1, 0),
        ("0 to 5", 2, 1),
        ("from 5", 1, 1),
    ]
