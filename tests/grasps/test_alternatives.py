"""Alternatives through one vertex: distinct, reached, best first."""

import itertools
import math
from functools import cache

import numpy as np
import pytest

from grasp3d import GraspModel, SurfaceLabels, Table, label_surface, load_mesh
from grasp3d.errors import SettingError
from grasp3d.grasps import alternatives_at, ranked_rows
from grasp3d.surface.vertex_grasps import Reason
from tests.helpers import shapes
from tests.helpers.grippers import HAND
from tests.helpers.moving_gripper import MovingGripper

MODEL = GraspModel(friction=0.4, sensor_resolution=math.radians(15.0))


@cache
def held() -> SurfaceLabels:
    vertices, faces = shapes.lopsided(3)
    mesh = load_mesh((vertices * 20.0, faces), unit="mm", max_edge=100.0)
    return label_surface(mesh, MODEL, hand=HAND, table=Table.below(mesh))


def chosen(labels: SurfaceLabels, count: int = 5) -> list[int]:
    """Vertices with a stable grasp."""
    found = np.flatnonzero(labels.label == 2)
    return found[:: max(1, len(found) // count)].tolist()


@pytest.mark.slow
def test_alternatives_are_distinct_and_reached() -> None:
    labels = held()
    moving = MovingGripper(labels.mesh, HAND, labels.scene.table)
    several = 0
    for vertex in chosen(labels):
        grasps = alternatives_at(labels, vertex, 4)
        assert 1 <= grasps.size <= 4
        several += grasps.size > 1
        points = grasps.contacts.points
        np.testing.assert_allclose(points[:, 0], labels.mesh.vertices[[vertex] * grasps.size])
        for one, other in itertools.combinations(points[:, 1], 2):
            assert np.linalg.norm(one - other) >= min(10.0, labels.mesh.size / 16) - 1e-9
        assert ranked_rows(grasps).tolist() == list(range(grasps.size))
        assert grasps.reach.reached.all()
        assert moving.collision(grasps.reach, grasps.size - 1) == ""
        # None is better than the grasp of the vertex.
        least = grasps.critical_angle.min()
        assert least <= labels.critical_angle[vertex] + 1e-6
        assert least >= labels.critical_angle[vertex] - 0.005
    assert several > 0


def test_fewer_alternatives_are_the_first_ones() -> None:
    labels = held()
    vertex = chosen(labels)[0]
    one, many = alternatives_at(labels, vertex, 1), alternatives_at(labels, vertex, 6)
    assert one.size == 1
    assert one.critical_angle[0] == pytest.approx(many.critical_angle.min(), abs=1e-3)


def test_a_vertex_that_is_not_reached_has_none() -> None:
    mesh = load_mesh(shapes.box((60.0, 40.0, 20.0)), unit="mm", max_edge=10.0)
    labels = label_surface(mesh, MODEL, hand=HAND, table=Table.below(mesh))
    below = (labels.reason == Reason.NOT_REACHED) & (mesh.vertices[:, 2] < -9.9)
    grasps = alternatives_at(labels, int(np.flatnonzero(below)[0]), 3)
    assert grasps.size == 0
    assert grasps.reach.poses.shape == (0, 4, 4)


def test_bad_vertices_and_counts_are_refused() -> None:
    labels = held()
    ideal = label_surface(labels.mesh, MODEL)
    with pytest.raises(SettingError, match="give a gripper"):
        alternatives_at(ideal, 0, 1)
    for vertex in (-1, len(labels.mesh.vertices)):
        with pytest.raises(SettingError, match="vertex must be from 0"):
            alternatives_at(labels, vertex, 1)
    with pytest.raises(SettingError, match="at least 1"):
        alternatives_at(labels, 0, 0)
