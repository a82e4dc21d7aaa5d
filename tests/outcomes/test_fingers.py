"""Whole grippers against closed forms: friction, torsion, stiffness, and starting inside."""

import math
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import trimesh

from grasp3d import ParallelGripper
from grasp3d.arrays import Floats
from grasp3d.outcomes import Fate, SimulationSettings
from grasp3d.outcomes.pulling import PULLS, Attempt, Outcome, simulate_attempt
from grasp3d.outcomes.scene import PROTRUDING, Fingers, Stage, grasp_model
from grasp3d.outcomes.simulation_settings import GRAVITY

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
    assert close(part * 2.0 * FRICTION * force, force=force)[0].fate is fate


@pytest.mark.parametrize(("part", "fate"), [(0.93, Fate.HELD), (1.07, Fate.PULLED)])
def test_an_acceleration_adds_to_gravity(part: float, fate: Fate) -> None:
    weight = part * 2.0 * FRICTION * FORCE / 3.0
    assert close(weight, acceleration=2.0 * GRAVITY)[0].fate is fate


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


def test_beyond_the_end_of_the_pad_there_is_nothing() -> None:
    """Within the rounding of its edge it is touched, but slides off."""
    for past, fate in ((2e-4, Fate.LOST), (1e-3, Fate.MISSED)):
        height = 0.5 * (SIDE + SIZES[2]) + past
        assert close(1.0, box=(0.0, 0.0, height))[0].fate is fate


@pytest.mark.parametrize("force", [10.0, 40.0])
def test_pads_give_way_by_force_over_stiffness(force: float) -> None:
    found, opening = close(0.05, force=force)
    assert found.fate is Fate.HELD
    assert SIZES[0] - opening == pytest.approx(2.0 * force / STIFFNESS, rel=0.03)


def test_patches_on_a_ball_grow_with_the_force() -> None:
    """Springs of modulus k per area below a ball of radius R: F = pi R k depth^2."""
    jaws, radius, stiffness = ParallelGripper.preset("wsg50"), 0.03, 1e5
    modulus = stiffness / (jaws.pad_width * jaws.pad_height)
    depth = math.sqrt(20.0 / (math.pi * radius * modulus))
    found, opening = close(
        0.01, force=20.0, opening=0.065, made=Fingers.of(jaws, stiffness),
        corners=np.array(trimesh.creation.icosphere(4, radius).vertices),
    )  # fmt: skip
    assert found.fate is Fate.HELD
    assert 0.5 * (2.0 * radius - opening) == pytest.approx(depth, rel=0.2)


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


def test_an_object_without_a_way_out_is_blocked() -> None:
    assert close(1.0, opening=SIZES[0] - 0.003, allowed=0.005)[0].fate is Fate.BLOCKED


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


def test_each_attempt_has_its_own_friction() -> None:
    weight = 0.9 * 2.0 * FRICTION * FORCE
    assert close(weight)[0].fate is Fate.HELD
    assert close(weight, friction=0.8 * FRICTION)[0].fate is Fate.PULLED


def test_pulls_that_hold_are_counted() -> None:
    """A palm or pads stop the object along the closing axis, whatever the friction."""
    found, _ = close(2.0, friction=0.01, force=40.0, time=0.5)
    assert found.fate is Fate.PULLED
    assert 0 < found.pulls_held < len(PULLS)


def test_hard_round_tips_bear_no_torsion_about_their_line() -> None:
    """The object turns below them, which does not count; with a torsion radius it does."""
    hand = ParallelGripper.preset("tactile")
    beside = (0.0, 0.03, 0.0)
    hard, _ = close(1.0, centre=beside, made=Fingers.of(hand, STIFFNESS), time=0.5)
    assert hard.pull_turn < math.radians(2.0)
    weak, _ = close(1.0, centre=beside, made=Fingers.of(hand, STIFFNESS, 1e-4), time=0.5)
    assert weak.fate is Fate.PULLED
    held, _ = close(1.0, centre=beside, made=Fingers.of(hand, STIFFNESS, 4e-3), time=0.5)
    assert held.fate is Fate.HELD


def test_the_same_grasp_twice_is_the_same_to_the_last_bit() -> None:
    assert close(5.0, centre=(0.0, 0.01, 0.0)) == close(5.0, centre=(0.0, 0.01, 0.0))


def test_what_diverges_says_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    model, data = grasp_model(stage())
    spun = Attempt(np.full((4, 4), np.nan), 0.05, FRICTION)
    assert simulate_attempt(model, data, spun, stage()).fate is Fate.BROKEN
    fine = Attempt(np.eye(4), 0.05, FRICTION)
    assert simulate_attempt(model, data, fine, stage()).fate is Fate.HELD  # it is not spoilt
    assert not list(tmp_path.iterdir())


def test_a_round_tip_is_one_ball() -> None:
    jaws = ParallelGripper.preset("tactile")
    made = Fingers.of(jaws, 3.0)
    assert (made.radii.tolist(), made.stiffness) == ([jaws.tip_radius], 3.0)
    assert made.centres.tolist() == [[-jaws.tip_radius, 0.0, 0.0]]
    assert not made.soft
    assert fingers().soft
    assert Fingers.of(jaws, 3.0, 0.001).soft
