import itertools
import math
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from grasp3d import (
    GraspModel,
    Sampling,
    SurfaceLabels,
    label_surface,
    load_mesh,
    scan_surface,
)
from grasp3d.errors import SettingError
from grasp3d.grasps.best import best_grasps
from grasp3d.grasps.evaluated_poses import DISTINCT, distinct_rows, matched_distance, most_distinct
from grasp3d.surface.vertex_fields import Reason
from tests.helpers import shapes

Floats = NDArray[np.float64]

ALL = 10_000


@cache
def labels(fingers: int) -> SurfaceLabels:
    """Labels of a blob without symmetry."""
    vertices, faces = shapes.sphere(2)
    x, y, z = vertices.T
    blob = vertices * (1.0 + 0.25 * x * y + 0.15 * z**3)[:, None] * (1.0, 0.8, 1.3)
    mesh = load_mesh((blob, faces), unit="cm", max_edge=9.0)
    sampling = Sampling(rays=16) if fingers == 2 else Sampling(candidates=8)
    return label_surface(mesh, GraspModel(fingers=fingers), sampling=sampling)


@cache
def box_labels() -> SurfaceLabels:
    """Labels of a box, with creases and many equally good grasps."""
    mesh = load_mesh(shapes.box((1.0, 0.7, 0.5)), max_edge=0.2)
    return label_surface(mesh, GraspModel(), sampling=Sampling(rays=16))


def farthest_pair(one: Floats, other: Floats) -> float:
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
    found = best_grasps(labelled, ALL)
    points = found.contacts.points
    assert 1 < found.size < 100
    for first, second in itertools.combinations(points, 2):
        assert farthest_pair(first, second) >= limit
    vertices = np.flatnonzero(labelled.reason == Reason.FOUND)
    scores = labelled.score[vertices]
    may_hold = labelled.letter[vertices] > 0
    for vertex, score in zip(vertices[may_hold][::7], scores[may_hold][::7], strict=True):
        grasp = np.concatenate([labelled.mesh.vertices[vertex, None], labelled.partners[vertex]])
        near = np.array([farthest_pair(grasp, kept) for kept in points]) < limit + 1e-9
        assert (found.score[near] >= score - 1e-9).any()


@pytest.mark.parametrize("fingers", [2, 3])
def test_best_grasps_are_in_the_order_of_the_score(fingers: int) -> None:
    found = best_grasps(labels(fingers), ALL)
    assert (np.diff(found.score) <= 1e-12).all()
    assert found.score[0] >= labels(fingers).score.max() - 1e-12
    first = best_grasps(labels(fingers), 5)
    assert np.array_equal(first.contacts.points, found.contacts.points[:5])


@pytest.mark.parametrize("fingers", [2, 3])
def test_best_grasps_are_the_grasps_of_vertices(fingers: int) -> None:
    labelled = labels(fingers)
    found = best_grasps(labelled, 6)
    assert found.model == labelled.model
    assert (found.distance == 0.0).all()
    assert (found.separation > 0.0).all()
    for row in range(6):
        distances = np.linalg.norm(labelled.mesh.vertices - found.contacts.points[row, 0], axis=1)
        vertex = int(distances.argmin())
        assert distances[vertex] < 1e-12
        assert found.contacts.points[row, 1:] == pytest.approx(labelled.partners[vertex])
        assert found.critical_angle[row] == pytest.approx(labelled.critical_angle[vertex], abs=2e-4)
        assert found.label[row] == labelled.label[vertex]
        assert found.epsilon[row] == pytest.approx(labelled.epsilon[vertex], rel=0.02)
        assert found.opening[row] == pytest.approx(labelled.opening[vertex])


def test_best_grasps_of_a_scan_include_the_fixed_finger() -> None:
    fixed = np.array([0.0, 0.0, 0.25])
    scan = scan_surface(box_labels().mesh, GraspModel(), fixed=fixed)
    found = best_grasps(scan, 4)
    assert found.contacts.points[:, 1] == pytest.approx(np.tile(fixed, (4, 1)))
    assert found.critical_angle[0] == pytest.approx(0.0, abs=1e-9)
    assert found.contacts.points[0, 0] == pytest.approx([0.0, 0.0, -0.25])


def test_a_surface_without_grasps_has_no_best_grasps() -> None:
    mesh = box_labels().mesh
    none = label_surface(mesh, sampling=Sampling(rays=8, max_opening=0.01))
    found = best_grasps(none, 3)
    assert found.size == 0
    for name in ("label", "epsilon", "rank", "opening", "separation", "max_resolution"):
        assert getattr(found, name).shape == (0,)


def test_invalid_counts_are_refused() -> None:
    for count in (0, -3):
        with pytest.raises(SettingError, match="at least 1"):
            best_grasps(box_labels(), count)


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
