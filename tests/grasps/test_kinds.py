"""Kinds of grasps, and the order of the best ones with a gripper."""

import math
from functools import cache

import numpy as np
import trimesh

from grasp3d import GraspModel, SurfaceLabels, Table, best_grasps, label_surface, load_mesh
from grasp3d.grasps import grasp_kinds
from tests.helpers import shapes
from tests.helpers.grippers import HAND

MODEL = GraspModel(friction=0.4, sensor_resolution=math.radians(15.0))


@cache
def block() -> SurfaceLabels:
    """A block of 60 x 40 x 20 mm on a table: kinds are across either pair of sides."""
    mesh = load_mesh(shapes.box((60.0, 40.0, 20.0)), unit="mm", max_edge=7.0)
    return label_surface(mesh, MODEL, hand=HAND, table=Table.below(mesh))


@cache
def dumbbell() -> SurfaceLabels:
    """Two bars that a thin rod joins; each can be held across."""
    bars = [trimesh.creation.box((20.0, 30.0, 20.0)) for _ in range(2)]
    bars[1].apply_translation((100.0, 0.0, 0.0))
    rod = trimesh.creation.box((90.0, 6.0, 6.0))
    rod.apply_translation((50.0, 0.0, 0.0))
    body = trimesh.boolean.union([*bars, rod], engine="manifold")
    mesh = load_mesh((body.vertices, body.faces), unit="mm", max_edge=7.0)
    return label_surface(mesh, MODEL, hand=HAND, table=Table.below(mesh))


def test_opposite_sides_are_of_other_kinds_than_the_others() -> None:
    labels = block()
    kinds, x, y = grasp_kinds(labels), *np.abs(labels.mesh.vertices[:, :2]).T
    smooth = (labels.mesh.normal_sets.counts == 1) & (labels.label == 2)
    long, short = smooth & (x > 29.9), smooth & (y > 19.9)
    assert long.any()
    assert short.any()
    assert not set(kinds[long]) & set(kinds[short])


def test_without_a_gripper_neighbours_with_near_partners_are_of_one_kind() -> None:
    ball = load_mesh(shapes.sphere(2), max_edge=9.0)
    kinds = grasp_kinds(label_surface(ball, MODEL))
    assert set(kinds) == {0}


def test_kinds_take_turns_among_the_best() -> None:
    labels = dumbbell()
    best = best_grasps(labels, 8)
    middle = best.contacts.points.mean(axis=1)[:, 0]
    bodies = {"bar" if abs(x - 50.0) > 35.0 else "rod" for x in middle}
    assert bodies == {"bar", "rod"}
    assert (best.label == 2).all()
    many = best_grasps(labels, 40)
    assert (np.diff(many.closed.label) <= 0).all()
    # The first one of a shorter list is that of a longer one.
    np.testing.assert_array_equal(many.contacts.points[0], best.contacts.points[0])


def test_best_grasps_have_the_reach_of_their_vertices() -> None:
    labels = block()
    best = best_grasps(labels, 5)
    assert best.scene is labels.scene
    assert best.reach.reached.all()
    for row in range(best.size):
        distances = np.linalg.norm(labels.mesh.vertices - best.contacts.points[row, 0], axis=1)
        vertex = labels.mesh.canonical[distances.argmin()]
        np.testing.assert_array_equal(best.reach.poses[row], labels.reach.poses[vertex])
