"""The best grasps: they are as evaluated, distinct, in order, and allowing more finds more."""

import itertools
import math
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from grasp3d import (
    Approach,
    GraspModel,
    Label,
    Load,
    ParallelGripper,
    Sampling,
    SurfaceLabels,
    Table,
    evaluate_grasps,
    label_surface,
    load_mesh,
    read_grasps,
    scan_surface,
    write_grasps,
)
from grasp3d.errors import SettingError
from grasp3d.grasps import EvaluatedPoses
from grasp3d.grasps.best import EQUAL, PoseSearch, best_grasps, pool_of
from grasp3d.grasps.evaluated_poses import (
    DISTINCT,
    distance_of_distinct,
    distinct_rows,
    matched_distance,
    most_distinct,
    ranked_rows,
)
from grasp3d.hand.reach import collides
from grasp3d.hand.scene import Scene
from grasp3d.settings.pose_error import PoseError
from grasp3d.surface.labelled_grasps import quality_of_contacts, written_scores
from grasp3d.surface.vertex_fields import Reason
from tests.helpers import shapes
from tests.helpers.closing_jaws import random_poses
from tests.helpers.grippers import HAND
from tests.helpers.random_search import random_poses_on

FRANKA = ParallelGripper.preset("franka")
NUMBERS = ("letter", "score", "quality", "margin", "epsilon", "grip_force", "payload",
           "approach_margin")  # fmt: skip


@cache
def base(name: str = "block") -> SurfaceLabels:
    if name == "block":
        vertices, faces = shapes.lopsided()
        mesh = load_mesh((0.03 * vertices * (1.0, 0.7, 1.6), faces), unit="m", max_edge=0.02)
    else:
        mesh = load_mesh(f"meshes/{name}", unit="m")
    return label_surface(
        mesh, hand=FRANKA, table=Table.below(mesh), load=Load(mass=0.4), sampling=Sampling(rays=8)
    )


def with_settings(
    labels: SurfaceLabels, *, within: float = math.pi, load: Load | None = None, **sampling: Any
) -> SurfaceLabels:
    """The same surface with another approach, load, or limits of openings."""
    return replace(
        labels,
        scene=replace(labels.scene, approach=Approach(within=within)),
        load=load or labels.load,
        sampling=replace(labels.sampling, **sampling),
    )


def assert_same(one: EvaluatedPoses, other: EvaluatedPoses) -> None:
    for name in NUMBERS:
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)


def test_what_is_named_is_what_evaluate_says_bit_for_bit(tmp_path: Path) -> None:
    labels = base()
    best = best_grasps(labels, 5)
    assert isinstance(best, EvaluatedPoses)
    assert best.size > 1
    options: dict[str, Any] = {"scene": labels.scene, "load": labels.load}
    assert_same(best, evaluate_grasps(labels.mesh, best, labels.model, **options))
    alone = evaluate_grasps(labels.mesh, best.take(np.array([1])), labels.model, **options)
    assert_same(best.take(np.array([1])), alone)
    for name in ("a.json", "a.csv", "a.parquet"):
        write_grasps(tmp_path / name, best)
        read = read_grasps(tmp_path / name, hand=FRANKA)
        assert_same(best, evaluate_grasps(labels.mesh, read, labels.model, **options))


def assert_never_worse(narrow: SurfaceLabels, wide: SurfaceLabels) -> None:
    """Allowing more lowers neither the best letter nor the number of S in the pool."""
    few, many = pool_of(narrow), pool_of(wide)
    assert (many.letter == Label.S).sum() >= (few.letter == Label.S).sum()
    named = best_grasps(narrow, 5), best_grasps(wide, 5)
    assert max(named[1].letter, default=0) >= max(named[0].letter, default=0)


@pytest.mark.slow
def test_allowing_more_never_finds_less() -> None:
    labels = base()
    cones = [with_settings(labels, within=math.radians(one)) for one in (30.0, 90.0, 180.0)]
    for narrow, wide in itertools.pairwise(cones):
        assert_never_worse(narrow, wide)
    heavy, light = (with_settings(labels, load=Load(mass=mass)) for mass in (0.8, 0.1))
    assert_never_worse(heavy, light)
    weak, strong = (Load(mass=0.4, grip_force=force) for force in (20.0, 70.0))
    assert_never_worse(with_settings(labels, load=weak), with_settings(labels, load=strong))
    size = labels.mesh.size
    assert_never_worse(with_settings(labels, max_opening=0.4 * size), labels)


def test_the_closing_jaws_leave_the_object_where_it_is_if_that_is_as_good() -> None:
    """So a robot that does not feel the object move grips it where the file says."""
    labels = base()
    best, search = best_grasps(labels, 10), PoseSearch.of(labels)
    assert isinstance(best, EvaluatedPoses)
    rest = best.jaws.poses
    there = search.evaluated(rest)
    free = ~collides(labels.mesh, rest, FRANKA.limits[1], FRANKA, table=labels.scene.table)
    as_good = free & (there.state == 0) & (there.score >= best.score - EQUAL)
    assert as_good.sum() > 2
    np.testing.assert_allclose(rest[as_good], best.poses[as_good], atol=1e-3)


@pytest.mark.slow
def test_what_is_named_may_hold_and_is_distinct() -> None:
    labels = base()
    best = best_grasps(labels, 30)
    assert (best.letter > Label.U).all()
    assert best.reachable.all()
    assert (np.diff(best.score) <= 0.0).all()
    limit = distance_of_distinct(labels.mesh)
    for row in range(best.size):
        gaps = np.delete(matched_distance(best.jaws.points, best.jaws.points[row]), row)
        assert gaps.min() >= limit
    heavy = with_settings(labels, load=Load(mass=60.0))
    assert best_grasps(heavy, 3).size == 0 or best_grasps(heavy, 3).letter.max() == Label.M
    named = best_grasps(heavy, 3, unstable=True)
    assert named.size == 3
    assert named.letter.min() == Label.U
    wrong = replace(labels, scene=replace(labels.scene, pose_error=PoseError.of("2mm,1deg")))
    best = best_grasps(wrong, 4)
    assert best.robustness.tried > 1
    assert (np.diff(best.score) <= 0.0).all()
    with pytest.raises(SettingError, match="grips from outside; leave out grip expand"):
        label_surface(labels.mesh, sampling=Sampling(grip="expand", rays=16), hand=FRANKA)


def test_what_is_named_depends_on_what_is_asked_alone() -> None:
    labels = base()
    first = best_grasps(labels, 5)
    best_grasps(labels, 12)
    again = best_grasps(labels, 5)
    assert_same(first, again)
    np.testing.assert_array_equal(first.poses, best_grasps(labels, 10).poses[:5])
    assert isinstance(first, EvaluatedPoses)
    assert first.given.names == tuple(f"grasp_{number}" for number in range(1, 6))
    assert first.model == GraspModel(fingers=2)
    anywhere = replace(labels, scene=Scene(FRANKA))
    around = with_settings(anywhere, within=math.pi)
    np.testing.assert_array_equal(pool_of(anywhere).poses, pool_of(around).poses)


@pytest.mark.slow
def test_a_random_search_finds_no_better_grasp() -> None:
    labels = base("wrench.glb")
    best = best_grasps(labels, 10)
    poses = random_poses_on(labels.mesh, labels.scene, pairs=1000, seed=5)
    found = evaluate_grasps(labels.mesh, poses, labels.model, scene=labels.scene, load=labels.load)
    assert found.score.max() <= best.score[0] + 0.02
    sure = np.flatnonzero(found.letter == Label.S)
    assert not len(sure) or best.letter[0] == Label.S
    order = sure[np.argsort(-found.score[sure])]
    limit = distance_of_distinct(labels.mesh)
    if len(distinct_rows(found.jaws.points[order], 10, limit)) == 10:
        assert (best.letter == Label.S).sum() == 10


@cache
def labels(fingers: int) -> SurfaceLabels:
    vertices, faces = shapes.sphere(2)
    x, y, z = vertices.T
    blob = vertices * (1.0 + 0.25 * x * y + 0.15 * z**3)[:, None] * (1.0, 0.8, 1.3)
    mesh = load_mesh((blob, faces), unit="cm", max_edge=9.0)
    sampling = Sampling(rays=16) if fingers == 2 else Sampling(candidates=8)
    return label_surface(mesh, GraspModel(fingers=fingers), sampling=sampling)


def farthest_pair(one: np.ndarray, other: np.ndarray) -> float:
    """`matched_distance` by its definition."""
    return min(
        max(math.dist(a, b) for a, b in zip(one, order, strict=True))
        for order in itertools.permutations(other)
    )


@pytest.mark.parametrize("count", [2, 3, 4, 5])
def test_contacts_are_matched_in_every_order(count: int) -> None:
    points = np.random.default_rng(count).normal(size=(20, count, 3))
    other = points[4][::-1]
    found = matched_distance(points, other)
    assert found[4] == 0.0
    assert found == pytest.approx([farthest_pair(grasp, other) for grasp in points])


@pytest.mark.parametrize("fingers", [2, 3])
def test_best_grasps_are_distinct_and_every_other_is_near_a_better_one(fingers: int) -> None:
    labelled = labels(fingers)
    limit = DISTINCT * labelled.mesh.size
    found = best_grasps(labelled, 10_000)
    points = found.contacts.points
    assert 1 < found.size < 100
    for first, second in itertools.combinations(points, 2):
        assert farthest_pair(first, second) >= limit
    assert (np.diff(found.score) <= 1e-12).all()
    assert found.score[0] >= labelled.score.max() - 1e-12
    vertices = np.flatnonzero(labelled.reason == Reason.FOUND)
    scores = labelled.score[vertices]
    may_hold = labelled.letter[vertices] > 0
    for vertex, score in zip(vertices[may_hold][::7], scores[may_hold][::7], strict=True):
        grasp = np.concatenate([labelled.mesh.vertices[vertex, None], labelled.partners[vertex]])
        near = np.array([farthest_pair(grasp, kept) for kept in points]) < limit + 1e-9
        assert (found.score[near] >= score - 1e-9).any()


def test_scans_have_best_grasps_with_the_fixed_finger_and_others_may_have_none() -> None:
    mesh, fixed = load_mesh(shapes.box((1.0, 0.7, 0.5)), max_edge=0.2), np.array([0.0, 0.0, 0.25])
    found = best_grasps(scan_surface(mesh, GraspModel(), fixed=fixed), 4)
    assert found.contacts.points[:, 1] == pytest.approx(np.tile(fixed, (4, 1)))
    assert found.critical_angle[0] == pytest.approx(0.0, abs=1e-9)
    assert found.contacts.points[0, 0] == pytest.approx([0.0, 0.0, -0.25])
    none = label_surface(mesh, sampling=Sampling(rays=8, max_opening=0.01))
    assert best_grasps(none, 3).size == 0
    for count in (0, -3):
        with pytest.raises(SettingError, match="at least 1"):
            best_grasps(none, count)


@pytest.mark.parametrize("seed", range(60))
def test_most_distinct_grasps_leave_no_other_that_is_distinct(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points = rng.uniform(0.0, 3.0, (40, 2, 3)) * (1.0, 1.0, 0.0)
    scores = np.sort(rng.uniform(0.9, 1.0, 40))[::-1]
    chosen = most_distinct(points, scores, 1.0, 40)
    gaps = np.stack([matched_distance(points, one) for one in points[chosen]])
    assert (gaps[:, chosen] + 9.0 * np.eye(len(chosen))).min() >= 1.0
    assert gaps.min(axis=0).max() < 1.0
    assert len(chosen) >= len(distinct_rows(points, 40, 1.0))
    assert scores[chosen[0]] >= scores[0] - 0.01


def several(values: st.SearchStrategy[Any], dtype: type = float) -> st.SearchStrategy[Any]:
    return arrays.arrays(dtype, 12, elements=values)


@given(several(st.integers(0, 2), np.uint8), several(st.floats(-1.0, 1.0)))
def test_a_better_letter_is_a_better_score_and_quality_decides_within_it(
    label: np.ndarray, quality: np.ndarray
) -> None:
    score = written_scores(label, quality)
    assert ((score >= label / 3.0 - 1e-12) & (score <= (label + 1.0) / 3.0 + 1e-12)).all()
    for letter in range(3):
        order = np.argsort(quality[label == letter])
        assert (np.diff(score[label == letter][order]) >= 0.0).all()


@given(several(st.floats(-4.0, 4.0)), several(st.floats(0.0, 1e6)))
def test_contacts_with_a_margin_are_above_those_without(
    margin: np.ndarray, held: np.ndarray
) -> None:
    quality = quality_of_contacts(margin, held)
    assert ((quality >= -1.0) & (quality <= 1.0)).all()
    assert (quality[margin > 0.0] >= 0.0).all()
    assert (quality[margin < -1e-300] < 0.0).all()


@pytest.mark.parametrize("load", [None, Load(mass=0.3, grip_force=20.0)], ids=["no load", "load"])
def test_the_list_and_every_file_are_in_the_order_of_the_score(
    load: Load | None, tmp_path: Path
) -> None:
    vertices, faces = shapes.lopsided()
    mesh = load_mesh((0.025 * vertices, faces), unit="m", max_edge=1e3)
    given = random_poses(60, 0.01, seed=3)
    model = GraspModel(friction=0.4, sensor_resolution=math.radians(15.0))
    found = evaluate_grasps(mesh, given, model, hand=HAND, load=load)
    assert len(set(found.letter)) > 1
    rows = ranked_rows(found)
    assert sorted(rows.tolist()) == list(range(found.size))
    assert (np.diff(found.score[rows]) <= 0.0).all()
    assert (np.diff(found.letter[rows].astype(int)) <= 0).all()
    best = found.take(rows)
    for name in ("a.csv", "a.json", "a.parquet"):
        write_grasps(tmp_path / name, best)
        read = read_grasps(tmp_path / name, hand=HAND)
        np.testing.assert_array_equal(read.scores, best.score)
