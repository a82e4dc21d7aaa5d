"""Verdicts on objects: each word, its numbers and its sentence."""

import math
from dataclasses import replace
from functools import cache

import pytest

from grasp3d import (
    GraspModel,
    ObjectMesh,
    Sampling,
    SurfaceLabels,
    Table,
    best_grasps,
    label_surface,
    load_mesh,
)
from grasp3d.grasps import verdict_of
from grasp3d.hand.table import Approach
from tests.helpers import shapes
from tests.helpers.grippers import HAND

MODEL = GraspModel(friction=0.4, sensor_resolution=math.radians(15.0))


@cache
def block() -> ObjectMesh:
    return load_mesh(shapes.box((60.0, 40.0, 20.0)), unit="mm", max_edge=10.0)


def beside(mesh: ObjectMesh, model: GraspModel = MODEL, **options: object) -> SurfaceLabels:
    options = {"hand": HAND, **options}
    return label_surface(mesh, model, **options)


def test_a_block_is_holdable() -> None:
    labels = beside(block(), table=Table.below(block()))
    verdict = verdict_of(labels)
    assert verdict.word == "holdable"
    # Opposite sides: the critical angle is 0, and alpha* twice the friction angle.
    assert verdict.max_resolution == pytest.approx(2.0 * math.atan(0.4), abs=1e-6)
    assert verdict.spare_resolution == pytest.approx(verdict.max_resolution - math.radians(15.0))
    # Which grasps are near a better one depends on what the jaws touch.
    assert verdict.count == pytest.approx((best_grasps(labels, 1000).label == 2).sum(), abs=3)
    assert verdict.approach_margin == labels.reach.approach_margin[labels.label == 2].max()
    assert str(verdict).startswith(
        f"holdable: {verdict.count} distinct grasps, the best with 28.6°"
    )


def test_with_a_finer_sensor() -> None:
    coarse = GraspModel(friction=0.4, sensor_resolution=math.radians(50.0))
    labels = beside(block(), coarse)
    verdict = verdict_of(labels)
    assert (verdict.word, verdict.count) == ("with a finer sensor", 0)
    assert verdict.spare_resolution == pytest.approx(2.0 * math.atan(0.4) - math.radians(50.0))
    assert str(verdict) == "with a finer sensor (resolution below 43.6°)"


def test_out_of_reach_has_the_reason_of_most_of_the_surface() -> None:
    sideways = Approach((0.0, 0.0, 1.0), within=math.radians(1.0))
    plate = load_mesh(shapes.box((120.0, 80.0, 3.0)), unit="mm", max_edge=10.0)
    large = load_mesh(shapes.box((100.0, 110.0, 90.0)), unit="mm", max_edge=15.0)
    for labels, reason in (
        (beside(plate, table=Table.below(plate)), "the table is in the way"),
        (beside(plate, approach=sideways), "no approach direction is allowed"),
        (beside(large), "the openings are outside the stroke"),
    ):
        verdict = verdict_of(labels)
        assert str(verdict) == f"out of reach ({reason})"
        assert (verdict.count, verdict.max_resolution) == (0, 0.0)
        assert math.isnan(verdict.spare_resolution)
        assert math.isnan(verdict.approach_margin)


def test_what_is_reached_but_never_stable_leaves_an_object_out_of_reach() -> None:
    """Longer grasps than the 60 mm across are aslant by more than the friction angle."""
    wide, slippery = replace(HAND, min_opening=0.0607), replace(MODEL, friction=0.1)
    labels = beside(block(), slippery, hand=wide)
    assert labels.reach.reached.any()
    verdict = verdict_of(labels)
    assert str(verdict) == "out of reach (the openings are outside the stroke)"


def test_nothing_to_hold_is_no() -> None:
    pyramid = load_mesh(shapes.cone(1.0, 20.0, sections=32), unit="mm", max_edge=20.0)
    model = GraspModel(friction=0.1, sensor_resolution=math.radians(2.0))
    for options in ({"hand": None}, {}):
        verdict = verdict_of(beside(pyramid, model, **options))
        if "hand" in options:
            assert str(verdict) == "not holdable: at no sensor resolution is a grasp S"
        assert verdict.count == 0


def test_without_a_gripper_limits_of_openings_are_no_stroke() -> None:
    labels = beside(block(), hand=None, sampling=Sampling(max_opening=5.0))
    assert verdict_of(labels).word == "no"
    ideal = verdict_of(beside(block(), hand=None))
    assert ideal.word == "holdable"
    assert math.isnan(ideal.approach_margin)
    assert "approach" not in str(ideal)
