"""Grasps of a gripper in MuJoCo: given ones and the best ones, errors that are drawn, refusals."""

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
from grasp3d import GraspModel, ObjectMesh, ParallelGripper, load_mesh
from grasp3d.errors import GraspError, SettingError
from grasp3d.formats import GraspPoses
from grasp3d.jobs import ClusterSettings
from grasp3d.outcomes import Fate, SimulationSettings, simulate_grasps
from grasp3d.outcomes.pulling import Attempt
from grasp3d.outcomes.scene import Stage
from grasp3d.outcomes.simulate import Job, Outcome, simulate_attempts, simulate_job
from tests.helpers import slider_hand
from tests.outcomes.test_fingers import stage

HERE = ClusterSettings(workers=0)
QUICK = SimulationSettings(pull_time=0.02, time_step=2e-3)


@cache
def mesh(unit: str = "cm") -> ObjectMesh:
    """A box in centimetres, so that units make a difference."""
    return load_mesh(trimesh.creation.box([4.0, 6.0, 10.0]), unit=unit)


def small(**changes: float) -> ParallelGripper:
    """A gripper with pads of few balls."""
    return replace(ParallelGripper.preset("wsg50"), pad_width=0.01, pad_height=0.01, **changes)


def above(*heights: float) -> GraspPoses:
    """Poses from above [cm]."""
    poses = np.tile(np.diag([1.0, -1.0, -1.0, 1.0]), (len(heights), 1, 1))
    poses[:, 2, 3] = heights
    return GraspPoses(poses=poses, unit="cm")


def test_given_poses_are_tried() -> None:
    from_above = np.diag([1.0, -1.0, -1.0, 1.0])
    from_above[2, 3] = 3.0  # 2 cm above it the palm is in the object
    beside = from_above + [[0, 0, 0, 0], [0, 0, 0, 10.0], [0, 0, 0, 0], [0, 0, 0, 0]]
    poses = GraspPoses(poses=[from_above, beside], pregrasp_opening=[6.0, 3.0], unit="cm")
    tried = simulate_grasps(
        mesh(), poses, hand="franka", cluster=HERE, simulation={"pull_time": 0.1}
    )
    assert tried.columns["fate"].tolist() == ["held", "missed"]
    assert tried.columns["label"].tolist() == ["S", "U"]
    assert tried.outcome.tolist() == [1.0, 0.0]
    narrow = GraspPoses(poses=from_above, pregrasp_opening=3.0, unit="cm")
    blocked = simulate_grasps(mesh(), narrow, hand="franka", cluster=HERE)
    assert (blocked.columns["fate"].tolist(), blocked.outcome.tolist()) == (["blocked"], [0.0])


def test_without_poses_the_best_ones_are_tried() -> None:
    hand = small()
    tried = simulate_grasps(mesh(), hand=hand, simulation=replace(QUICK, count=2), cluster=HERE)
    best = grasp3d.best_grasps(grasp3d.label_surface(mesh(), hand=hand), 2)
    np.testing.assert_array_equal(tried.poses, best.poses)
    assert tried.outcome.tolist() == [1.0, 1.0]
    ball = load_mesh(trimesh.creation.icosphere(2, 0.2), unit="m")
    with pytest.raises(GraspError, match="the gripper has no grasp on it that may hold"):
        simulate_grasps(ball, hand=hand, simulation=QUICK, cluster=HERE)


def test_outcomes_are_read_by_validate(tmp_path: Path) -> None:
    tried = simulate_grasps(mesh(), above(3, 20, 4), hand=small(), simulation=QUICK, cluster=HERE)
    grasp3d.write_grasps(tmp_path / "tried.csv", tried)
    found = grasp3d.validate_grasps(tmp_path / "tried.csv", mesh=mesh(), hand=small())
    assert found.held.tolist() == (tried.outcome == 1.0).tolist() == [True, False, True]


def test_true_poses_are_drawn_around_the_given_ones() -> None:
    """Labels are those of the given poses; what is simulated is each with its error."""
    poses = replace(above(3, 3), names=("one", "two"))
    settings = replace(QUICK, pose_error="2mm,4deg", trials=3, grip_force=3.0)
    tried = simulate_grasps(mesh(), poses, hand=small(), simulation=settings, cluster=HERE)
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
    again = simulate_grasps(mesh(), poses, hand=small(), simulation=settings, cluster=HERE)
    np.testing.assert_array_equal(again.columns["pull_shift_m"], columns["pull_shift_m"])
    assert tried.settings["simulation_pose_error"] == "2 mm,4 deg"


def test_a_true_pose_is_that_of_its_error_in_the_given_frame(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    seen: list[Attempt] = []

    def watched(attempts: list[Attempt], *others: object) -> object:
        seen.extend(attempts)
        return simulate_attempts(attempts, *others)  # type: ignore[arg-type]

    monkeypatch.setattr("grasp3d.outcomes.simulate.simulate_attempts", watched)
    settings = replace(QUICK, pose_error="3mm")
    tried = simulate_grasps(mesh(), above(3), hand=small(), simulation=settings, cluster=HERE)
    shift = [tried.columns[f"error_{axis}_m"][0] for axis in "xyz"]
    # The gripper's y and z point against those of the object.
    expected = [shift[0], -shift[1], 0.03 - shift[2]]
    np.testing.assert_allclose(seen[0].pose[:3, 3], expected, atol=1e-12)
    assert seen[0].opening == small().max_opening


def test_true_friction_is_drawn_from_its_interval() -> None:
    """Two pads hold what weighs 2 mu F: about half of the interval holds it."""
    model, settings = GraspModel(friction="0.2..0.8"), replace(QUICK, trials=8, pull_time=0.2)
    settings = replace(settings, object_mass=10.0 / 9.80665, grip_force=10.0, max_shift="3mm")
    tried = simulate_grasps(
        mesh(), above(0), model, hand=small(finger_length=0.1), simulation=settings, cluster=HERE
    )
    friction = tried.columns["true_friction"]
    assert 0.2 <= friction.min() < 0.45
    assert 0.55 < friction.max() <= 0.8
    clear = np.abs(friction - 0.5) > 0.04
    np.testing.assert_array_equal((tried.outcome == 1.0)[clear], (friction > 0.5)[clear])


@pytest.mark.parametrize(("force", "held"), [(5.5, 1.0), (4.5, 0.0)])
def test_without_a_force_it_is_the_greatest_of_the_gripper(force: float, held: float) -> None:
    """Two pads of friction 0.5 hold what weighs as much as either presses."""
    hand = small(max_force=force)
    settings = replace(QUICK, pull_time=0.2, max_shift="3mm", object_mass=5.0 / 9.80665)
    tried = simulate_grasps(mesh(), above(0), hand=hand, simulation=settings, cluster=HERE)
    assert tried.outcome.tolist() == [held]
    assert tried.settings["simulation_grip_force"] == force


@pytest.mark.slow
def test_processes_do_not_matter() -> None:
    one, other = (
        simulate_grasps(
            mesh(), above(3, 2, 1), hand=small(), simulation=replace(QUICK, trials=3),
            cluster=ClusterSettings(workers=workers),
        )
        for workers in (0, 2)
    )  # fmt: skip
    np.testing.assert_array_equal(one.columns["slip_m"], other.columns["slip_m"])


def test_what_cannot_be_simulated_is_refused(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    no_unit = load_mesh(trimesh.creation.box([4.0, 6.0, 10.0]))
    with pytest.raises(
        SettingError, match=r"a simulation is in metres, but the unit of .* is not known"
    ):
        simulate_grasps(no_unit, hand="franka", cluster=HERE)
    with pytest.raises(SettingError, match=r"only parallel grippers are simulated; '.*' is none"):
        simulate_grasps(mesh(), hand=slider_hand.hand(tmp_path), cluster=HERE)
    with pytest.raises(SettingError, match=r"only parallel grippers are simulated; none is given"):
        simulate_grasps(mesh(), hand=None, cluster=HERE)
    monkeypatch.setitem(sys.modules, "coacd", None)
    with pytest.raises(SettingError, match=r"needs coacd.*pip install 'grasp3d\[physics\]'"):
        simulate_grasps(mesh(), hand="franka", cluster=HERE)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"count": 0}, "count must be from 1 to 1000; got 0"),
        ({"max_turn": 4.0}, "max_turn must be above 0 and at most 180 degrees; got 229"),
        ({"max_shift": "0mm"}, "max_shift must be a finite length above 0"),
        ({"pad_stiffness": "3 N/cm"}, "pad_stiffness must be a number .N/m., or a number with a"),
    ],
)
def test_settings_outside_their_range_are_refused(fields: dict[str, object], message: str) -> None:
    with pytest.raises(SettingError, match=message):
        SimulationSettings(**fields)  # type: ignore[arg-type]


FINE = Attempt(np.eye(4), 0.05, 0.5)


def _crash(job: Job, stage: Stage) -> tuple[Outcome, ...]:
    if job.number == 0:
        os._exit(7)
    return simulate_job(job, stage)


@pytest.mark.slow
def test_a_crash_is_an_error_of_its_grasps_only(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("grasp3d.outcomes.simulate.simulate_job", _crash)
    monkeypatch.setattr("grasp3d.outcomes.simulate.ATTEMPTS", 1)
    outcomes = simulate_attempts([FINE] * 2, stage(), ClusterSettings(workers=1))
    assert [one.fate for one in outcomes] == [Fate.BROKEN, Fate.HELD]


def test_where_every_simulation_fails_the_reason_is_given() -> None:
    broken = replace(stage(), parts=(np.zeros((4, 3)),))
    with pytest.raises(GraspError, match="no grasp could be simulated: the simulation unexpected"):
        simulate_attempts([FINE], broken, HERE)
