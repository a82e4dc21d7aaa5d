"""One simulated grasp: known answers for a box between two tips."""

import math
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from grasp3d.physics import ConvexParts, Fate, Outcome, SimulationSettings
from grasp3d.physics.pulling import PULLS, Attempt, simulate_attempt
from grasp3d.physics.scene import Stage, Tips, grasp_model

SETTINGS = SimulationSettings(pull_time=0.3)
SIZES = np.array([0.04, 0.06, 0.1])
TIPS = Tips(0.003)


CORNERS = np.array(trimesh.creation.box(SIZES).vertices)
STAGE = Stage(ConvexParts((CORNERS,)), np.zeros(3), SIZES, TIPS, SETTINGS)


@cache
def model(tips: Tips = TIPS) -> tuple[Any, Any]:
    return grasp_model(replace(STAGE, tips=tips))


def attempt(
    *, tilt: float = 0.0, height: float = 0.0, center: float = 0.0, friction: float = 0.5
) -> Attempt:
    """Tips on the faces across x, at the height, with the line between them tilted [degrees]."""
    side = 0.5 * SIZES[0] * math.tan(math.radians(tilt))
    points = np.array([[-0.02, -side, height], [0.02, side, height]])
    centres = points + TIPS.radius * np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    line = centres[1] - centres[0]
    x = line / np.linalg.norm(line)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([x, np.cross([0.0, 0.0, 1.0], x), [0.0, 0.0, 1.0]], axis=1)
    pose[:3, 3] = centres.mean(axis=0)
    opening = float(np.linalg.norm(line)) - 2.0 * TIPS.radius + 2e-4
    return Attempt(pose, opening, np.array([0.0, 0.0, height + center]), np.full(2, friction))


def run(given: Attempt, settings: SimulationSettings = SETTINGS, tips: Tips = TIPS) -> Outcome:
    return simulate_attempt(*model(tips), given, replace(STAGE, tips=tips, settings=settings))


def test_tips_across_a_box_hold_it_without_slipping() -> None:
    found = run(attempt())
    assert (found.fate, found.pulls_held, found.held) == (Fate.HELD, len(PULLS), True)
    assert found.slip < 3e-4  # contacts yield
    assert found.turn < 1e-3


@pytest.mark.parametrize(("friction", "holds"), [(0.45, True), (0.25, False)])
def test_friction_above_and_below_the_needed_one(friction: float, holds: bool) -> None:
    """A line 20 degrees from both normals needs a friction of 0.364."""
    assert (run(attempt(tilt=20.0, friction=friction)).fate is Fate.HELD) == holds


def test_an_object_that_turns_into_a_better_grasp_is_held_but_not_by_the_grasp() -> None:
    found = run(attempt(tilt=32.0))
    assert found.fate is Fate.REGRASPED
    assert found.held
    assert found.slip > 2e-3
    assert math.radians(3.0) < found.squeeze_turn < math.radians(15.0)


def test_an_edge_that_squeezes_the_object_out_loses_it() -> None:
    found = run(attempt(tilt=55.0))
    assert (found.fate, found.pulls_held, found.held) == (Fate.LOST, 0, False)


def test_tips_beside_the_object_miss_it() -> None:
    assert run(attempt(height=0.2)).fate is Fate.MISSED


def test_a_weight_beside_the_line_only_torsion_holds() -> None:
    """Hard fingers let it spin about their line, though they do not slip."""
    away = replace(SETTINGS, pulled="center_of_mass")
    hard = run(attempt(height=0.03, center=-0.03), away)
    assert (hard.fate, hard.slip < 1e-3) == (Fate.PULLED, True)
    assert hard.spin > 1.0
    assert hard.turn < 1e-3
    soft = Tips(TIPS.radius, torsion_radius=0.002)
    held = run(attempt(height=0.03, center=-0.03), away, soft)
    assert held.fate is Fate.HELD
    assert held.spin < math.radians(1.0)
    weak = Tips(TIPS.radius, torsion_radius=0.0001)
    longer = replace(away, pull_time=1.0)
    assert run(attempt(height=0.03, center=-0.03), longer, weak).fate is Fate.PULLED


def test_a_force_below_half_the_weight_over_friction_drops_it() -> None:
    """Two fingers hold a weight across with at least 1 / (2 x 0.5) of it each."""
    weak, enough = (replace(SETTINGS, grip_ratio=ratio) for ratio in (0.9, 1.6))
    assert run(attempt(), replace(weak, pull_time=1.0)).fate is Fate.PULLED
    assert run(attempt(), enough).fate is Fate.HELD


def test_the_same_grasp_twice_is_the_same_to_the_last_bit() -> None:
    run(attempt(tilt=5.0))
    assert run(attempt(tilt=32.0)) == run(attempt(tilt=32.0))


def test_open_tips_inside_the_object_are_blocked() -> None:
    inside = replace(attempt(), opening=0.03, may_move=True)
    assert run(inside).fate is Fate.BLOCKED


def test_what_diverges_says_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    spun = replace(attempt(), center=np.array([np.nan, 0.0, 0.0]))
    assert run(spun).fate is Fate.BROKEN
    assert run(attempt()).fate is Fate.HELD  # the model is not spoilt
    assert not list(tmp_path.iterdir())
