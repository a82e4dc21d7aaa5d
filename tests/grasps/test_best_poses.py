"""The best poses of a gripper: they are as evaluated, and allowing more finds more."""

import itertools
import math
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import grasp3d
from grasp3d import (
    Approach,
    GraspModel,
    Label,
    Load,
    ParallelGripper,
    Sampling,
    SurfaceLabels,
    Table,
    best_grasps,
    evaluate_grasps,
    label_surface,
    load_mesh,
    read_grasps,
    write_grasps,
)
from grasp3d.errors import SettingError
from grasp3d.grasps import EvaluatedPoses
from grasp3d.grasps.best import EQUAL, PoseSearch, pool_of
from grasp3d.grasps.evaluated_poses import distance_of_distinct, distinct_rows, matched_distance
from grasp3d.hand.reach import collides
from grasp3d.hand.scene import Scene
from tests.helpers import shapes
from tests.helpers.random_search import random_poses_on

FRANKA = ParallelGripper.preset("franka")
SOFT = replace(FRANKA, compliance=0.003)
"""Its pads give way enough to press against the inside of a ring."""

NUMBERS = ("letter", "score", "quality", "margin", "epsilon", "grip_force", "payload",
           "approach_margin")  # fmt: skip


@cache
def base(name: str = "block") -> SurfaceLabels:
    """A labelled surface on a table."""
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


@pytest.mark.parametrize(
    ("name", "form"),
    [("a.yaml", None), ("a.h5", None), ("a.npy", None), ("b.json", "moveit")],
)
def test_through_other_formats_numbers_are_the_same_within_rounding(
    tmp_path: Path, name: str, form: Any
) -> None:
    for needed in {"a.yaml": ("yaml",), "a.h5": ("h5py",)}.get(name, ()):
        shapes.reader(needed)
    labels = base()
    best = best_grasps(labels, 5)
    write_grasps(tmp_path / name, best, format=form)
    read = read_grasps(tmp_path / name, hand=FRANKA, unit="m")
    again = evaluate_grasps(labels.mesh, read, labels.model, scene=labels.scene, load=labels.load)
    order = [int(np.abs(again.poses - pose).max(axis=(1, 2)).argmin()) for pose in best.poses]
    np.testing.assert_array_equal(best.letter, again.letter[order])
    np.testing.assert_allclose(best.score, again.score[order], atol=1e-6)


def assert_never_worse(narrow: SurfaceLabels, wide: SurfaceLabels) -> None:
    """Allowing more lowers neither the best letter nor the number of S in the pool."""
    few, many = pool_of(narrow), pool_of(wide)
    assert (many.letter == Label.S).sum() >= (few.letter == Label.S).sum()
    named = best_grasps(narrow, 5), best_grasps(wide, 5)
    assert max(named[1].letter, default=0) >= max(named[0].letter, default=0)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["block", "mug.glb"])
def test_allowing_more_never_finds_less(name: str) -> None:
    labels = base(name)
    cones = [with_settings(labels, within=math.radians(one)) for one in (30.0, 60.0, 90.0, 180.0)]
    for narrow, wide in itertools.pairwise(cones):
        assert_never_worse(narrow, wide)
    for heavy, light in ((0.8, 0.4), (0.4, 0.1)):
        loads = (Load(mass=heavy), Load(mass=light))
        assert_never_worse(*(with_settings(labels, load=load) for load in loads))
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


def test_grasps_that_tolerate_errors_come_first() -> None:
    labels = base()
    scene = replace(labels.scene, pose_error=grasp3d.settings.pose_error.PoseError.of("2mm,1deg"))
    wrong = replace(labels, scene=scene)
    best = best_grasps(wrong, 4)
    assert best.robustness.tried > 1
    assert (np.diff(best.score) <= 0.0).all()
    again = evaluate_grasps(labels.mesh, best, labels.model, scene=scene, load=labels.load)
    assert_same(best, again)


def test_internal_grasps_are_refused() -> None:
    ring, inside = shapes.tube(0.034, 0.042, 0.02, sections=32), Sampling(grip="expand", rays=16)
    mesh = load_mesh(ring, unit="m", max_edge=0.02)
    with pytest.raises(SettingError, match="grips from outside; leave out grip expand"):
        label_surface(mesh, sampling=inside, hand=SOFT)


def test_what_is_named_depends_on_what_is_asked_alone() -> None:
    labels = base()
    first = best_grasps(labels, 5)
    best_grasps(labels, 12)
    again = best_grasps(labels, 5)
    assert_same(first, again)
    np.testing.assert_array_equal(first.poses, best_grasps(labels, 10).poses[:5])
    assert isinstance(first, EvaluatedPoses)
    assert first.given.names == tuple(f"grasp_{number}" for number in range(1, 6))


def test_any_direction_allows_what_all_directions_about_one_do() -> None:
    labels = replace(base(), scene=Scene(FRANKA))
    around = with_settings(labels, within=math.pi)
    np.testing.assert_array_equal(pool_of(labels).poses, pool_of(around).poses)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "mass"), [("wrench.glb", 0.4), ("knob.ply", 0.1)])
def test_a_random_search_finds_no_better_grasp(name: str, mass: float) -> None:
    labels = with_settings(base(name), load=Load(mass=mass))
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


def test_the_model_of_labels_is_that_of_the_poses() -> None:
    labels = base()
    assert best_grasps(labels, 1).model == GraspModel(fingers=2)
