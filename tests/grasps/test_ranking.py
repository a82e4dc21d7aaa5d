"""The order of grasps: its law, and what comes first with grippers and loads."""

import math
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from grasp3d import (
    GraspModel,
    Label,
    Load,
    ParallelGripper,
    Sampling,
    best_grasps,
    evaluate_grasps,
    label_surface,
    load_mesh,
    read_grasps,
    read_hand,
    write_grasps,
)
from grasp3d.grasps import EvaluatedPoses, poses_of
from grasp3d.grasps.ranking import (
    APPROACH,
    FORCE,
    PLACE,
    RESOLUTION,
    STEP,
    margins_in_units,
    ranked_rows,
    stated_label,
    written_scores,
)
from grasp3d.hand.reach import Reachability
from grasp3d.surface import GraspTable
from grasp3d.surface.closed_grasps import UNKNOWN, ClosedGrasps
from tests.helpers import shapes
from tests.helpers.grippers import HAND, SLIM, TIPS

MODEL = GraspModel(friction=0.4, sensor_resolution=math.radians(15.0))
SIZE = 12
"""Grasps that are ranked."""

LOAD = Load(mass=0.5, grip_force=30.0)


@cache
def table(*, load: bool = False) -> GraspTable:
    """Some grasps of a block, whose numbers are replaced."""
    mesh = load_mesh(shapes.box((60.0, 40.0, 20.0)), unit="mm", max_edge=14.0)
    labels = label_surface(mesh, MODEL, hand=HAND, load=LOAD if load else None)
    return labels.grasps.take(np.arange(SIZE))


def several(values: st.SearchStrategy[Any], dtype: type = float) -> st.SearchStrategy[Any]:
    return arrays.arrays(dtype, SIZE, elements=values)


ANGLES = st.sampled_from([-0.4, -0.01, 0.0, 0.01, 0.011, 0.2, 0.3]) | st.floats(-1.5, 1.5)
APPROACHES = st.sampled_from([0.0, math.pi / 32, math.pi / 16, math.pi])
DEPTHS = st.sampled_from([2.0, 9.0]) | st.floats(0.0, 18.0)
FORCES = st.sampled_from([0.0, 10.0, 30.0, math.inf, math.nan]) | st.floats(0.1, 100.0)
CODES = st.integers(0, 2)
EPSILONS = st.sampled_from([0.0, 0.1, math.nan]) | st.floats(0.0, 1.0)


@st.composite
def tables(draw: st.DrawFn) -> tuple[GraspTable, ClosedGrasps | None]:
    """Tables with any labels, margins, epsilon and forces, and what the jaws touch, or none."""
    has_load = draw(st.booleans())
    base = table(load=has_load)
    reach = replace(
        base.reach, approach_margin=draw(several(APPROACHES)), depth=draw(several(DEPTHS))
    )
    grasps = replace(base, reach=reach)
    values: dict[str, Any] = {
        "label": draw(several(CODES, np.uint8)),
        "margin": draw(several(ANGLES)),
        "epsilon": draw(several(EPSILONS)),
    }
    if has_load:
        least, largest = np.sort([draw(several(FORCES)), draw(several(FORCES))], axis=0)
        values["holding"] = replace(
            base.holding, grip_force_least=least, grip_force_largest=largest,
            payload=draw(several(FORCES)),
        )  # fmt: skip
    vars(grasps).update(values)
    closed = replace(
        base.closed,
        label=draw(several(st.integers(UNKNOWN, 2), np.int64)),
        margin=draw(several(ANGLES | st.just(math.nan))),
    )
    return grasps, closed if draw(st.booleans()) else None


def respects(grasps: GraspTable | EvaluatedPoses, closed: ClosedGrasps | None = None) -> np.ndarray:
    """Everything that may be better or worse, more is better, a row for each grasp."""
    epsilon = np.nan_to_num(grasps.epsilon)
    margins = margins_in_units(grasps, closed).values()
    robust = np.full(len(epsilon), np.nan)
    if isinstance(grasps, EvaluatedPoses):
        robust = grasps.robustness.robust_score
    elif closed is not None:
        robust = closed.number("robust_score")
    score = np.nan_to_num(robust, nan=-1.0)
    return np.stack([stated_label(grasps, closed), score, *margins, epsilon], axis=1)


def is_above(one: np.ndarray, other: np.ndarray) -> bool:
    """Whether a grasp is at least as good in everything, and better in something."""
    return bool((one >= other).all() and (one > other).any())


def assert_lawful(values: np.ndarray) -> None:
    """No grasp is above one that is at least as good in everything and better in something."""
    for place in range(len(values)):
        assert not any(is_above(below, values[place]) for below in values[place + 1 :])


@pytest.mark.slow
@settings(suppress_health_check=[HealthCheck.too_slow])  # the first one labels a block
@given(tables())
def test_no_grasp_is_above_one_that_is_as_good_in_everything_and_better_in_one(
    case: tuple[GraspTable, ClosedGrasps | None],
) -> None:
    rows = ranked_rows(*case)
    assert sorted(rows) == list(range(SIZE))
    assert_lawful(respects(*case)[rows])
    assert (np.diff(stated_label(*case)[rows]) <= 0).all()


@pytest.mark.slow
@settings(suppress_health_check=[HealthCheck.too_slow])
@given(tables())
def test_what_is_written_as_score_has_the_same_order(
    case: tuple[GraspTable, ClosedGrasps | None],
) -> None:
    scores, labels = written_scores(*case), stated_label(*case)
    assert (np.diff(scores[ranked_rows(*case)]) <= 0.0).all()
    assert ((scores >= labels / 3.0 - 1e-12) | (scores == scores.min())).all()
    assert (scores <= (labels + 1.0) / 3.0 + 1e-12).all()


@pytest.mark.slow
def test_no_file_ranks_a_grasp_first_that_drops_the_object(tmp_path: Path) -> None:
    """A hammer that is too heavy for some: sorted by what any format states, they come last."""
    mesh = load_mesh("meshes/hammer.ply", unit="m")
    hand = ParallelGripper.preset("franka")
    best = best_grasps(label_surface(mesh, hand=hand, load=Load(mass=0.67, grip_force=70.0)), 10)
    labels = stated_label(best, best.closed)
    assert len(set(labels)) > 1
    for name, kind in {"a.json": None, "a.yaml": None, "b.json": "moveit", "a.csv": None}.items():
        write_grasps(tmp_path / name, best, format=kind)
        scores = read_grasps(tmp_path / name, hand=hand).scores
        assert (np.diff(scores) <= 0.0).all()
        assert scores[labels == Label.U].max(initial=0.0) <= 1.0 / 3.0 < scores[0]


def test_the_smallest_margins_are_compared_first() -> None:
    """A grasp that is good in everything is before one that is best in one and bad in another."""
    grasps = replace(table())
    approach = np.full(SIZE, APPROACH)
    approach[3], approach[5] = 0.0, 3.0 * APPROACH
    depth = np.full(SIZE, 9.0)
    depth[7] = 1.0
    vars(grasps).update(
        reach=replace(grasps.reach, approach_margin=approach, depth=depth),
        label=np.full(SIZE, 2, np.uint8),
        margin=np.where(np.arange(SIZE) == 3, 0.5, 0.1),
        epsilon=np.linspace(0.0, 0.1, SIZE),
    )
    order = ranked_rows(grasps).tolist()
    assert order[0] == 5  # more approach than the others, which differ in epsilon
    assert order[-2:] == [7, 3]  # near the end of the pads; no approach to spare
    assert order[1:-2] == [11, 10, 9, 8, 6, 4, 2, 1, 0]


def test_units_are_those_of_what_is_stated() -> None:
    grasps = table(load=True)
    margins, metres = margins_in_units(grasps), 1e-3
    assert list(margins) == ["resolution", "approach", "place", "load"]
    spare = MODEL.sensor_resolution * margins["resolution"]
    np.testing.assert_allclose(  # below -alpha no sensor is fine enough
        np.maximum(spare, -MODEL.sensor_resolution),
        grasps.max_resolution - MODEL.sensor_resolution,
        atol=1e-9,
    )
    np.testing.assert_allclose(margins["approach"] * APPROACH, grasps.reach.approach_margin)
    depth = metres * grasps.reach.depth
    expected = np.minimum(0.5 * HAND.pad_width, np.minimum(depth, HAND.pad_height - depth))
    np.testing.assert_allclose(margins["place"] * PLACE, expected)
    np.testing.assert_allclose(margins["load"], grasps.holding.payload / LOAD.mass - 1.0)


def test_defaults_are_the_units_of_what_is_not_stated() -> None:
    mesh = table().mesh
    points = table().contacts.points
    exact = GraspModel(friction=0.4, sensor_resolution=0.0, torsion_radius="3mm")
    grasps = evaluate_grasps(mesh, points, exact, load=Load(mass=0.5))
    margins = margins_in_units(grasps)
    assert list(margins) == ["resolution", "load"]
    np.testing.assert_allclose(margins["resolution"], 2.0 * grasps.margin / RESOLUTION)
    needed = grasps.holding.grip_force_largest
    np.testing.assert_allclose(margins["load"], FORCE / needed - 1.0)


def test_round_tips_have_no_border_of_pads() -> None:
    mesh = table().mesh
    tips = label_surface(mesh, MODEL, hand=TIPS).grasps
    assert list(margins_in_units(tips)) == ["resolution", "approach"]


def test_after_closing_contacts_are_where_the_jaws_touch() -> None:
    """A plate that is held at its upper edge touches only the ends of the pads."""
    mesh = load_mesh(shapes.box((60.0, 5.0, 30.0)), unit="mm", max_edge=6.0)
    poses = np.tile(np.eye(4), (3, 1, 1))
    poses[:, :3, :3] = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]).T
    poses[:, 2, 3] = [15.0, 20.0, 100.0]  # the pads reach 9 mm beyond: 9 and 4 mm of overlap
    found = evaluate_grasps(mesh, poses, MODEL, hand=HAND)
    place = margins_in_units(found)["place"] * PLACE
    np.testing.assert_allclose(place[:2], [0.0045, 0.002], atol=2e-4)
    assert place[2] == -math.inf
    assert ranked_rows(found).tolist() == [0, 1]


def test_a_pose_that_collides_comes_last() -> None:
    labels = label_surface(table().mesh, MODEL, hand=HAND)
    best = best_grasps(labels, 6)
    found = evaluate_grasps(best.mesh, poses_of(best), MODEL, hand=HAND)
    first = int(ranked_rows(found)[0])
    blocked = np.arange(found.size) == first
    assert found.reachable[first]
    hit = replace(found, collides=blocked, reachable=found.reachable & ~blocked)
    assert int(ranked_rows(hit)[-1]) == first
    table_of = best.take(np.arange(best.size))
    state = np.where(blocked, Reachability.BLOCKED, table_of.reach.state)
    lost = replace(table_of, reach=replace(table_of.reach, state=state))
    assert int(ranked_rows(lost)[-1]) == first


@pytest.mark.slow
@pytest.mark.parametrize("load", [None, Load(mass=0.1)], ids=["no load", "load"])
def test_the_first_grasp_of_a_mug_can_be_executed(load: Load | None) -> None:
    """Before there was a grasp of no approach margin at the front."""
    labels = label_surface(load_mesh("meshes/mug.glb"), hand=read_hand("franka"), load=load)
    best = best_grasps(labels, 12)
    assert_lawful(respects(best, best.closed))
    codes = stated_label(best, best.closed)
    assert (np.diff(codes) <= 0).all()
    assert codes[0] == Label.S
    assert best.reach.approach_margin[0] >= APPROACH
    assert min(values[0] for values in margins_in_units(best, best.closed).values()) > STEP
    if load is not None:
        assert best.holding.payload[0] > 0.1


@pytest.mark.slow
def test_fingers_that_push_outward_are_not_surely_stable_with_a_load_either() -> None:
    """What the jaws touch is not known of them."""
    corners, faces = shapes.tube(sections=24)
    ring = load_mesh((corners * 60.0, faces), unit="mm", max_edge=14.0)
    for load in (None, Load(mass=0.05)):
        labels = label_surface(ring, MODEL, sampling=Sampling(grip="expand"), hand=SLIM, load=load)
        best = best_grasps(labels, 3)
        assert best.size
        assert (stated_label(best, best.closed) <= Label.M).all()
