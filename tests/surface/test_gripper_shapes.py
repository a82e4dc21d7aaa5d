"""Labels with a gripper of shapes whose grasps are known."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import trimesh

from grasp3d import (
    GraspModel,
    ObjectMesh,
    ParallelGripper,
    SurfaceLabels,
    Table,
    label_surface,
    load_mesh,
)
from grasp3d.hand.reach import Reach, Reachability
from tests.helpers import shapes
from tests.helpers.grippers import HAND, SLIM
from tests.helpers.moving_gripper import MovingGripper

MODEL = GraspModel(friction=0.4, sensor_resolution=math.radians(15.0))

SHALLOWEST = 9.0 - 0.4 * 18.0
"""Least reach of the hand's fingers beyond the contacts: the pads' half less the offsets [mm]."""


def mesh_of(body: trimesh.Trimesh, max_edge: str) -> ObjectMesh:
    return load_mesh((body.vertices, body.faces), unit="mm", max_edge=max_edge)


def in_mm(labels: SurfaceLabels) -> tuple[np.ndarray, Reach]:
    """Coordinates of the vertices, and how they are reached, in millimetres."""
    reach = labels.reach
    poses = reach.poses.copy()
    poses[:, :3, 3] *= 1e3
    lengths = {name: 1e3 * getattr(reach, name) for name in ("opening", "pregrasp_opening")}
    return labels.mesh.file_points, replace(reach, poses=poses, **lengths)


def labelled(mesh: ObjectMesh, hand: ParallelGripper = HAND, **options: object) -> SurfaceLabels:
    return label_surface(mesh, MODEL, hand=hand, **options)


def standing(mesh: ObjectMesh, hand: ParallelGripper = HAND, **options: object) -> SurfaceLabels:
    return labelled(mesh, hand, table=Table.below(mesh), **options)


def assert_free(labels: SurfaceLabels, rows: np.ndarray) -> None:
    moving = MovingGripper(labels.mesh, labels.scene.hand, labels.scene.table)
    for row in rows:
        assert moving.collision(labels.reach, row, int(labels.grip[row])) == ""


def _is(values: np.ndarray, size: float) -> np.ndarray:
    """Whether coordinates have a size, on either side."""
    return np.abs(np.abs(values) - size) < 1e-6


@cache
def block() -> SurfaceLabels:
    """A block of 60 x 40 x 20 mm on a table."""
    return standing(load_mesh(shapes.box((60.0, 40.0, 20.0)), unit="mm", max_edge="5mm"))


def test_a_block_on_a_table_is_held_by_its_sides() -> None:
    labels = block()
    mesh, (points, reach) = labels.mesh, in_mm(labels)
    x, y, z = points.T
    height = z + 10.0
    inside = (mesh.contact_normals.counts == 1) & (height > 0.0)
    deep = height > SHALLOWEST
    for sides, opening in ((_is(x, 30.0), 60.0), (_is(y, 20.0), 40.0)):
        chosen = inside & sides & deep
        assert chosen.sum() > 20
        assert (labels.label[chosen] == 2).all()
        assert labels.critical_angle[chosen] == pytest.approx(0.0, abs=1e-6)
        assert reach.opening[chosen] == pytest.approx(opening)
        assert reach.pregrasp_opening[chosen] == pytest.approx(opening + 4.0)
    # Across its height one finger would be in the table; aslant the friction does not suffice.
    flat = (mesh.contact_normals.counts == 1) & _is(z, 10.0)
    assert flat.any()
    assert (labels.label[flat] == 0).all()
    assert Reachability.TABLE in reach.state[flat]
    assert (labels.label[flat & (z < 0.0)] == 0).all()


@pytest.mark.slow
def test_a_block_on_a_table_is_approached_from_above() -> None:
    """As far aside as the lower corners of the fingers, and of the palm, are above the table."""
    labels = block()
    reach, found = in_mm(labels)[1], labels.reach.reached
    tilts = np.arccos(np.clip(-reach.poses[found, 2, 2], -1.0, 1.0))
    assert tilts.max() < math.radians(60.0)
    tcp = reach.poses[found, 2, 3] + 10.0
    lowest = tcp - 9.0 * np.cos(tilts) - 10.0 * np.sin(tilts)
    level = np.abs(reach.poses[found, 2, 0]) < 1e-6
    assert level.sum() > 100
    assert (lowest[level] >= -1e-6).all()
    assert (tilts < 1e-6).sum() > 50
    assert_free(labels, np.flatnonzero(found)[::60])


@cache
def cup() -> ObjectMesh:
    """A cup of 72 mm outer diameter and 80 mm height, with walls and bottom of 4 mm."""
    outside = trimesh.creation.cylinder(36.0, 80.0, sections=48)
    inside = trimesh.creation.cylinder(32.0, 80.0, sections=48)
    inside.apply_translation((0.0, 0.0, 4.0))
    return mesh_of(trimesh.boolean.difference([outside, inside], engine="manifold"), "10mm")


@pytest.mark.slow
@pytest.mark.parametrize("stands", [True, False])
def test_a_cup_is_held_at_its_rim_and_never_through_its_bottom(stands: bool) -> None:
    mesh = cup()
    labels = standing(mesh, SLIM) if stands else labelled(mesh, SLIM)
    points, reach = in_mm(labels)
    radius, z = np.linalg.norm(points[:, :2], axis=1), points[:, 2]
    below_rim = 40.0 - z
    wall = (np.abs(radius - 32.0) < 0.1) & (below_rim > SHALLOWEST) & (below_rim < 30.0)
    assert wall.sum() > 40
    assert (labels.label[wall] == 2).all()
    assert reach.opening[wall] == pytest.approx(4.0, abs=0.1)
    down = -labels.reach.poses[wall, 2, 2]
    assert (down > math.cos(math.radians(60.0))).all()
    assert_free(labels, np.flatnonzero(wall)[::30])
    bottom = (radius < 30.0) & (np.abs(z + 36.0) < 1e-6)
    assert bottom.sum() > 3
    ideal = label_surface(mesh, MODEL)
    assert (ideal.label[bottom] == 2).all()
    assert (labels.label[bottom] < 2).all()
    across = labels.reach.reached & (np.abs(labels.reach.poses[:, 2, 0]) > 0.9)
    assert not (across & (radius < 30.0)).any()


@pytest.mark.slow
def test_a_flat_plate_on_a_stand_is_held_at_its_rim() -> None:
    """As far from the rim as the fingers are long."""
    mesh = load_mesh(shapes.box((200.0, 200.0, 3.0)), unit="mm", max_edge="10mm")
    labels = labelled(mesh, table=Table(np.array([0.0, 0.0, 1.0]), -0.2))
    x, y, z = mesh.file_points.T
    from_rim = np.minimum(100.0 - np.abs(x), 100.0 - np.abs(y))
    flat = _is(z, 1.5) & (mesh.contact_normals.counts == 1)
    reach = 45.0 - SHALLOWEST
    # Ends of the fingers are beyond the contacts, and the palm behind them.
    near = flat & (from_rim < reach - 0.1)
    assert near.sum() > 100
    assert (labels.label[near] == 2).all()
    far = flat & (from_rim > reach + 0.1)
    assert far.sum() > 100
    assert (labels.label[far] == 0).all()
    assert (labels.reach.state[far & (from_rim > 80.0)] == Reachability.BLOCKED).all()


def test_a_plate_is_held_by_its_edges_if_the_fingers_go_under_the_contacts() -> None:
    for height, reached in ((2.0 * SHALLOWEST + 0.2, True), (2.0 * SHALLOWEST - 0.2, False)):
        plate = trimesh.creation.box((60.0, 60.0, height)).subdivide()
        labels = standing(mesh_of(plate, "90mm"))
        middle = np.abs(labels.mesh.vertices[:, 2]) < 1e-9
        middle &= labels.mesh.contact_normals.counts == 1
        assert middle.sum() >= 4
        assert (labels.label[middle] == 2 * reached).all()


def test_a_ball_in_the_stroke_is_held_from_everywhere() -> None:
    ball = load_mesh(shapes.sphere(2, 12.0), unit="mm", max_edge="100mm")
    labels = labelled(ball)
    assert (labels.label == 2).all()
    assert labels.reach.opening == pytest.approx(0.024, rel=0.01)
    assert labels.reach.approach_margin == pytest.approx(math.pi)
