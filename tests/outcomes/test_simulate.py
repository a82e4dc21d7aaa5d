"""Grasps of a gripper in MuJoCo: closed forms of its fingers, errors that are drawn, refusals."""

import math
import os
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from scipy.spatial import ConvexHull

import grasp3d
from grasp3d import GraspModel, ObjectMesh, ParallelGripper, load_mesh
from grasp3d.arrays import Floats
from grasp3d.errors import GraspError, MeshError, SettingError
from grasp3d.formats import GraspPoses
from grasp3d.jobs import ClusterSettings
from grasp3d.outcomes import Fate, SimulationSettings, convex_parts, simulate_grasps
from grasp3d.outcomes import simulate as module
from grasp3d.outcomes.pulling import Attempt, Outcome, simulate_attempt
from grasp3d.outcomes.scene import PROTRUDING, Fingers, Stage, grasp_model
from grasp3d.outcomes.simulate import Job, parts_of, simulate_attempts, simulate_job
from grasp3d.outcomes.simulation_settings import GRAVITY
from tests.helpers import slider_hand

SIDE = 0.01
HAND = replace(ParallelGripper.preset("wsg50"), pad_width=SIDE, pad_height=SIDE)
"""Small pads, of few balls."""

STIFFNESS, FRICTION, FORCE = 5e4, 0.5, 20.0
SIZES = (0.04, 0.06, 0.06)
TORSION = 0.3826
"""Mean distance of a square's points from its middle, of its side."""


@cache
def fingers() -> Fingers:
    return Fingers.of(HAND, STIFFNESS)


def close(
    weight: float, *, force: float = FORCE, centre: tuple[float, float, float] = (0, 0, 0),
    box: tuple[float, float, float] = (0, 0, 0), opening: float = 0.05, allowed: float = 0.0,
    acceleration: float = 0.0, time: float = 0.2, made: Fingers | None = None,
    corners: Floats | None = None, friction: float = FRICTION,
) -> tuple[Outcome, float]:  # fmt: skip
    """Close the gripper on a box of a weight [N] whose middle is at `box`; outcome, and opening."""
    settings = SimulationSettings(
        object_mass=weight / GRAVITY, pull_time=time, time_step=2e-3,
        max_shift=0.005, give_way=allowed, pull_acceleration=acceleration,
    )  # fmt: skip
    solid = np.array(trimesh.creation.box(SIZES).vertices) + box if corners is None else corners
    middle, sizes = np.array(centre), np.array(SIZES)
    stage = Stage((solid,), middle, sizes, made or fingers(), settings, force)
    model, data = grasp_model(stage)
    attempt = Attempt(np.eye(4), opening, friction)
    return simulate_attempt(model, data, attempt, stage), -2.0 * float(data.qpos[7])


def stage() -> Stage:
    """A box of 10 g in small pads."""
    settings = SimulationSettings(object_mass=0.01, pull_time=0.1, time_step=2e-3)
    corners = np.array(trimesh.creation.box(SIZES).vertices)
    return Stage((corners,), np.zeros(3), np.array(SIZES), fingers(), settings, FORCE)


@pytest.mark.parametrize("force", [0.5, 60.0])
@pytest.mark.parametrize(("part", "fate"), [(0.93, Fate.HELD), (1.07, Fate.PULLED)])
def test_two_pads_hold_a_weight_of_twice_the_friction(
    force: float, part: float, fate: Fate
) -> None:
    weight = part * 2.0 * FRICTION * force
    assert close(weight, force=force)[0].fate is fate
    assert close(weight / 3.0, force=force, acceleration=2.0 * GRAVITY)[0].fate is fate
    assert close(weight, force=force, friction=0.8 * FRICTION)[0].fate is Fate.PULLED


@pytest.mark.parametrize("lever", [0.02, 0.05])
@pytest.mark.parametrize(("part", "fate"), [(0.87, Fate.HELD), (1.13, Fate.PULLED)])
def test_torsion_of_a_pad_is_that_of_its_face(lever: float, part: float, fate: Fate) -> None:
    """(w / 2 mu F)^2 + (w lever / 2 mu F r)^2 = 1, r the mean distance from the middle."""
    moment = lever / (TORSION * SIDE)
    limit = 2.0 * FRICTION * FORCE / math.hypot(1.0, moment)
    assert close(part * limit, centre=(0.0, lever, 0.0))[0].fate is fate


def test_pads_do_not_creep_under_torsion() -> None:
    lever = 0.03
    limit = 2.0 * FRICTION * FORCE / math.hypot(1.0, lever / (TORSION * SIDE))
    short, long = (
        close(0.7 * limit, centre=(0.0, lever, 0.0), time=time)[0] for time in (0.1, 0.5)
    )
    assert short.fate is long.fate is Fate.HELD
    assert long.pull_turn - short.pull_turn < math.radians(0.02)


@pytest.mark.parametrize(("part", "fate"), [(0.8, Fate.HELD), (1.25, Fate.PULLED)])
def test_an_object_over_the_end_is_held_by_the_patch_that_is_left(part: float, fate: Fate) -> None:
    """As above, with the mean distance of the points of that patch, and its middle as centre."""
    patch = 0.4 * SIDE
    height = 0.5 * (SIDE + SIZES[2]) - patch  # of the box's middle
    lever = height - 0.5 * (SIDE - patch)
    across, along = np.meshgrid(
        np.linspace(-0.5, 0.5, 101) * SIDE, np.linspace(-0.5, 0.5, 41) * patch
    )
    moment = lever / float(np.hypot(across, along).mean())
    weight = part * 2.0 * FRICTION * FORCE / math.hypot(1.0, moment)
    found, _ = close(weight, centre=(0.0, 0.0, height), box=(0.0, 0.0, height))
    assert found.fate is fate


@pytest.mark.parametrize("force", [10.0, 40.0])
def test_pads_give_way_by_force_over_stiffness(force: float) -> None:
    found, opening = close(0.05, force=force)
    assert found.fate is Fate.HELD
    assert SIZES[0] - opening == pytest.approx(2.0 * force / STIFFNESS, rel=0.03)


def test_the_palm_is_in_the_way_of_what_is_deep_between_the_fingers() -> None:
    front = HAND.end - HAND.finger_length
    assert close(1.0, box=(0.0, 0.0, front + 0.5 * SIZES[2] - 3e-3))[0].fate is Fate.BLOCKED
    assert close(1.0, box=(0.0, 0.0, front + 0.5 * SIZES[2] + 1e-3))[0].fate is not Fate.BLOCKED


def test_an_object_gives_way_to_the_open_gripper_by_no_more_than_is_stated() -> None:
    inside = 0.003
    beside = (0.5 * (0.05 - SIZES[0]) + inside, 0.0, 0.0)
    assert close(1.0, box=beside, centre=beside)[0].fate is Fate.BLOCKED
    found, _ = close(1.0, box=beside, centre=beside, allowed=0.004)
    assert found.fate is Fate.HELD
    assert found.start_shift_m == pytest.approx(inside, abs=4e-4)
    no_way_out = SIZES[0] - 0.003
    assert close(1.0, opening=no_way_out, allowed=0.005)[0].fate is Fate.BLOCKED


@pytest.mark.parametrize("name", ["franka", "robotiq_2f85"])
def test_balls_touch_the_pad_and_stay_within_it(name: str) -> None:
    jaws = ParallelGripper.preset(name)
    made = Fingers.of(jaws, 1.0)
    assert (made.centres[:, 0] + made.radii).max() == pytest.approx(0.0, abs=1e-12)
    assert (made.centres[:, 2] + made.radii).max() <= jaws.end + PROTRUDING + 1e-12
    on_pad = np.abs(made.centres[:, 2]) < 0.5 * jaws.pad_height
    assert 0.85 <= made.stiffness * on_pad.sum() <= 1.01  # franka's pad lacks corners
    assert -min(one[:, 0].min() for one in made.solids) == jaws.finger_thickness
    assert made.palm[:, 2].max() == pytest.approx(jaws.end - jaws.finger_length)


def test_hard_round_tips_bear_no_torsion_about_their_line() -> None:
    """The object turns below them, which does not count; with a torsion radius it does."""
    hand = ParallelGripper.preset("tactile")
    beside = (0.0, 0.03, 0.0)
    ball = Fingers.of(hand, STIFFNESS)
    assert (ball.radii.tolist(), ball.soft) == ([hand.tip_radius], False)
    assert ball.centres.tolist() == [[-hand.tip_radius, 0.0, 0.0]]
    hard, _ = close(1.0, centre=beside, made=ball, time=0.5)
    assert hard.pull_turn < math.radians(2.0)
    weak, _ = close(1.0, centre=beside, made=Fingers.of(hand, STIFFNESS, 1e-4), time=0.5)
    assert weak.fate is Fate.PULLED
    held, _ = close(1.0, centre=beside, made=Fingers.of(hand, STIFFNESS, 4e-3), time=0.5)
    assert held.fate is Fate.HELD


def test_what_diverges_says_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    model, data = grasp_model(stage())
    spun = Attempt(np.full((4, 4), np.nan), 0.05, FRICTION)
    assert simulate_attempt(model, data, spun, stage()).fate is Fate.BROKEN
    fine = Attempt(np.eye(4), 0.05, FRICTION)
    assert simulate_attempt(model, data, fine, stage()).fate is Fate.HELD  # it is not spoilt
    assert not list(tmp_path.iterdir())


HERE = ClusterSettings(workers=0)
QUICK = SimulationSettings(pull_time=0.02, time_step=2e-3)


@cache
def mesh(unit: str = "cm") -> ObjectMesh:
    """A box in centimetres, so that units make a difference."""
    return load_mesh(trimesh.creation.box([4.0, 6.0, 10.0]), unit=unit)


def small(**changes: float) -> ParallelGripper:
    return replace(ParallelGripper.preset("wsg50"), pad_width=0.01, pad_height=0.01, **changes)


def above(*heights: float) -> GraspPoses:
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
    found = grasp3d.validate_grasps(tried, mesh=mesh(), hand=hand)
    assert found.held.tolist() == [True, True]
    ball = load_mesh(trimesh.creation.icosphere(2, 0.2), unit="m")
    with pytest.raises(GraspError, match="the gripper has no grasp on it that may hold"):
        simulate_grasps(ball, hand=hand, simulation=QUICK, cluster=HERE)


def test_true_poses_and_frictions_are_drawn_around_the_given_ones(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Labels are those of the given poses; what is simulated is each with its error."""
    seen: list[Attempt] = []

    def watched(attempts: list[Attempt], *others: Any) -> object:
        seen.extend(attempts)
        return simulate_attempts(attempts, *others)

    monkeypatch.setattr("grasp3d.outcomes.simulate.simulate_attempts", watched)
    poses, model = replace(above(3, 3), names=("one", "two")), GraspModel(friction="0.4..0.6")
    settings = replace(QUICK, pose_error="2mm,4deg", trials=3, grip_force=3.0)
    tried = simulate_grasps(mesh(), poses, model, hand=small(), simulation=settings, cluster=HERE)
    columns = tried.columns
    assert (tried.names[0], tried.names[3]) == ("one", "two")
    assert columns["trial"].tolist() == [1, 2, 3, 1, 2, 3]
    assert columns["label"].tolist() == ["S"] * 6
    friction = columns["true_friction"]
    assert 0.4 <= friction.min() < 0.5 < friction.max() <= 0.6
    assert [one.friction for one in seen] == friction.tolist()
    # The gripper's y and z point against those of the object.
    shift = np.array([columns[f"error_{axis}_m"][0] for axis in "xyz"]) * [1.0, -1.0, -1.0]
    np.testing.assert_allclose(seen[0].pose[:3, 3], shift + [0.0, 0.0, 0.03], atol=1e-12)
    assert seen[0].opening == small().max_opening
    assert columns["squeeze_shift_m"].max() < 3e-3  # it is centred between the fingers
    assert not columns["start_shift_m"].any()
    shifts, turns = (
        np.column_stack([columns[f"error_{name}{end}"] for name in names])
        for names, end in ((("x", "y", "z"), "_m"), (("rx", "ry", "rz"), ""))
    )
    assert 1e-4 < np.abs(shifts).mean() < 2e-3
    assert 0.002 < np.abs(turns).mean() < math.radians(4.0)
    assert len(np.unique(shifts)) == shifts.size
    again = simulate_grasps(mesh(), poses, model, hand=small(), simulation=settings, cluster=HERE)
    np.testing.assert_array_equal(again.columns["pull_shift_m"], columns["pull_shift_m"])
    assert tried.settings["simulation_pose_error"] == "2 mm,4 deg"


@pytest.mark.parametrize(("force", "held"), [(5.5, 1.0), (4.5, 0.0)])
def test_without_a_force_it_is_the_greatest_of_the_gripper(force: float, held: float) -> None:
    """Two pads of friction 0.5 hold what weighs as much as either presses."""
    hand = small(max_force=force)
    settings = replace(QUICK, pull_time=0.2, max_shift="3mm", object_mass=5.0 / 9.80665)
    tried = simulate_grasps(mesh(), above(0), hand=hand, simulation=settings, cluster=HERE)
    assert tried.outcome.tolist() == [held]
    assert tried.settings["simulation_grip_force"] == force


def test_what_cannot_be_simulated_is_refused(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    no_unit = load_mesh(trimesh.creation.box([4.0, 6.0, 10.0]))
    for body, hand, words in (
        (no_unit, "franka", r"a simulation is in metres, but the unit of .* is not known"),
        (mesh(), slider_hand.hand(tmp_path), r"only parallel grippers are simulated; '.*' is none"),
        (mesh(), None, r"only parallel grippers are simulated; none is given"),
    ):
        with pytest.raises(SettingError, match=words):
            simulate_grasps(body, hand=hand, cluster=HERE)
    box = trimesh.creation.box([1.0, 1.0, 1.1])
    hole = load_mesh((box.vertices, box.faces[:-2]), unit="cm", repair="none", max_edge=9.0)
    with pytest.raises(MeshError, match="is open, so it bounds no body"):
        parts_of(hole, SimulationSettings(), HERE)
    monkeypatch.setitem(sys.modules, "coacd", None)
    for needed in (
        lambda: simulate_grasps(mesh(), hand="franka", cluster=HERE),
        lambda: convex_parts(box.vertices, box.faces),
    ):
        with pytest.raises(SettingError, match=r"needs coacd.*pip install 'grasp3d\[physics\]'"):
            needed()


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


@pytest.mark.slow
def test_an_l_shape_has_two_parts_which_are_kept(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv(module.CACHE, str(tmp_path))
    boxes = [trimesh.creation.box(bounds=[[0, 0, 0], b]) for b in ([3, 1, 1], [1, 3, 1])]
    body = load_mesh(trimesh.util.concatenate(boxes), unit="cm", max_edge=9.0)
    found = convex_parts(body.vertices, body.faces, threshold=0.05)
    assert len(found) == 2
    volumes = [ConvexHull(one).volume for one in found]
    assert sum(volumes) == pytest.approx(body.volume, rel=0.02)
    (file,) = (tmp_path / "parts").iterdir()
    again = convex_parts(body.vertices, body.faces, threshold=0.05)
    for one, other in zip(found, again, strict=True):
        np.testing.assert_array_equal(one, other)
    file.write_bytes(b"damaged")
    assert len(convex_parts(body.vertices, body.faces, threshold=0.05)) == 2
