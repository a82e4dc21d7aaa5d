"""The verdict on an object under a load: what is printed of it."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from grasp3d import (
    GraspModel,
    ParallelGripper,
    SurfaceLabels,
    best_grasps,
    label_surface,
    load_mesh,
)
from grasp3d.cli.margin_report import force_text
from grasp3d.grasps import verdict_of
from grasp3d.grasps.evaluation import evaluate_grasps
from grasp3d.grasps.grasp_files import poses_of
from grasp3d.grasps.verdict import HoldingVerdict
from grasp3d.quality import Wrenches
from grasp3d.quality.loads import Load
from grasp3d.stability.label import Label
from grasp3d.surface.holding import HARD_FINGERS, Holding
from grasp3d.surface.load_case import LoadCase
from tests.helpers import shapes

PUSH = "wrench 0,0,-5,0,0,0"


@cache
def labels() -> SurfaceLabels:
    mesh = load_mesh(shapes.box((0.08, 0.05, 0.03)), unit="m", max_edge=0.02)
    model = GraspModel(torsion_radius="3mm", sensor_resolution=0.2)
    return label_surface(mesh, model)


def under(load: Load, given: SurfaceLabels | None = None) -> HoldingVerdict:
    return verdict_of((given or labels()).using(load=load)).holding


@pytest.mark.slow
def test_each_sentence() -> None:
    needed = under(Load(mass=0.5)).needed
    held = 5.0 * 0.5 / needed
    for load, sentence, holds in (
        (Load(mass=0.5, grip_force=40), "holds 0.5 kg at 40 N in any orientation", True),
        (Load(mass=0.5, grip_force=5), f"needs {needed:.3g} N; 5 N hold {held:.3g} kg", False),
        (Load(mass=0.5), f"0.5 kg needs {needed:.3g} N in any orientation", None),
        (Load(grip_force=5), f"5 N hold {held:.3g} kg in any orientation", None),
        (Load(), f"each kilogram needs {2.0 * needed:.3g} N in any orientation", None),
        (Load(task=PUSH, grip_force=30), f"resists {PUSH} at 30 N", True),
    ):
        verdict = under(load)
        assert (str(verdict), verdict.holds) == (sentence, holds)
    pushed = under(Load(task=PUSH, grip_force=0.1))
    assert str(pushed) == f"needs {pushed.needed:.3g} N; 0.1 N are at hand"


@pytest.mark.slow
def test_it_follows_the_word_of_the_verdict() -> None:
    verdict = verdict_of(labels().using(load=Load(mass=0.5, grip_force=40)))
    assert str(verdict) == f"{verdict.text}; holds 0.5 kg at 40 N in any orientation"
    assert verdict_of(labels()).holding is None
    assert str(verdict_of(labels())) == verdict.text


def with_forces(largest: float, nominal: float, **changed: object) -> Holding:
    """Holding of one grasp."""
    found = labels().using(load=Load(mass=0.5, grip_force=40)).holding
    one = found.take(slice(0, 1))
    values = {"grip_force_largest": np.array([largest]), "grip_force": np.array([nominal])}
    return replace(one, **{**values, **changed})  # type: ignore[arg-type]


@pytest.mark.slow
@pytest.mark.parametrize("mass", [None, 0.5])
def test_the_mass_has_no_part_in_wrenches_alone(mass: float | None) -> None:
    for load, sentence in (
        (Load(task=PUSH, mass=mass), f"needs 7 N ({PUSH})"),
        (Load(task=PUSH, mass=mass, grip_force=8), f"resists {PUSH} at 8 N"),
        (Load(task=PUSH, mass=mass, grip_force=6), "needs 7 N; 6 N are at hand"),
        (
            Load(task=Wrenches([0, 0, -5, 0, 0, 0]), mass=mass, grip_force=8),
            "resists the given task at 8 N",
        ),
    ):
        case = LoadCase.of(load, labels().mesh, labels().model)
        unweighed = np.full(1, math.nan)
        verdict = HoldingVerdict.of(with_forces(7.0, 7.0, case=case, payload=unweighed))
        assert (str(verdict), verdict.mass) == (sentence, None)


def test_zero_has_no_sign() -> None:
    verdict = HoldingVerdict.of(with_forces(-0.0, -0.0))
    assert math.copysign(1.0, verdict.needed) == 1.0
    assert force_text(-0.0) == "0"


@pytest.mark.slow
def test_reasons_why_nothing_is_held() -> None:
    coarse = HoldingVerdict.of(with_forces(math.inf, 7.0))
    assert str(coarse) == (
        "no grasp surely holds the load (the sensor is too coarse; at the sensed normals 7 N are "
        "enough)"
    )
    unresisted = HoldingVerdict.of(with_forces(math.inf, math.inf))
    assert "no contact force resists the task" in str(unresisted)
    nothing = np.full(1, math.nan)
    empty = with_forces(math.nan, math.nan, grip_force_least=nothing, payload=nothing)
    assert "there is no grasp" in str(HoldingVerdict.of(empty))
    hard = replace(labels().model, torsion_radius=0.0)
    mesh = load_mesh(shapes.box((0.08, 0.05, 0.03)), unit="m", max_edge=0.1,
                     center_of_mass="3mm,1mm,2mm")  # fmt: skip
    found = label_surface(mesh, hard, load=Load(mass=0.5))
    assert HARD_FINGERS in str(verdict_of(found).holding)


@pytest.mark.slow
def test_grasps_that_hold_the_load_come_first() -> None:
    load = Load(mass=0.5, grip_force=12.0)
    found = best_grasps(labels().using(load=load), 10)
    codes = found.holding.label
    assert {Label.S, Label.U} <= {Label(code) for code in codes}
    assert (np.diff(codes.astype(int)) <= 0).all()


@pytest.mark.slow
def test_poses_that_were_found_hold_as_much_when_they_are_evaluated() -> None:
    franka, load = replace(ParallelGripper.preset("franka"), inner_faces=()), Load(mass=0.5)
    model = GraspModel(sensor_resolution=0.2)
    made = label_surface(labels().mesh, model, hand=franka, load=load)
    best = best_grasps(made, 3)
    poses = poses_of(best)
    np.testing.assert_array_equal(poses.columns["payload"], best.holding.payload)
    stale = replace(poses, columns={**poses.columns, "payload": np.zeros(3)})
    evaluated = evaluate_grasps(made.mesh, stale, model, hand=franka, load=load)
    # Both touch flat sides: the pads' centres are the contacts.
    np.testing.assert_allclose(evaluated.holding.payload, best.holding.payload, rtol=0.05)
    assert evaluated.to_poses().columns["label_with_force"].tolist() == ["S"] * 3
    without = evaluate_grasps(made.mesh, stale, model, hand=franka)
    assert "payload" not in without.to_poses().columns
    assert evaluated.to_table()["payload"].to_numpy() == pytest.approx(evaluated.holding.payload)
