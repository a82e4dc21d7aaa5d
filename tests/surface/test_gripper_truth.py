"""Poses of best grasps on real objects, checked by moving the gripper there step by step."""

import math
from dataclasses import replace

import manifold3d
import numpy as np
import pytest

from grasp3d import (
    GraspModel,
    ObjectMesh,
    ParallelGripper,
    Table,
    best_grasps,
    label_surface,
    load_mesh,
)
from tests.helpers import shapes
from tests.helpers.moving_gripper import MovingGripper

OBJECTS = {
    "ycb_006_mustard_bottle.stl": 1e-3,
    "ycb_025_mug.ply": 4e-4,
    "ycb_042_adjustable_wrench.obj": 4e-4,
    "ode_boot.obj": 1e-3,
}
"""Scans in metres, and how far they are simplified, which saves time."""


def simplified(name: str, distance: float) -> ObjectMesh:
    mesh = load_mesh(shapes.shared("meshes", name), unit="m")
    solid = manifold3d.Manifold(
        manifold3d.Mesh64(np.array(mesh.vertices, order="C"), mesh.faces.astype(np.uint64))
    )
    assert solid.status() == manifold3d.Error.NoError
    small = solid.simplify(distance).to_mesh64()
    points = np.asarray(small.vert_properties)[:, :3]
    return load_mesh((points, np.asarray(small.tri_verts)), unit="m", max_edge=mesh.size / 20.0)


@pytest.mark.slow
@pytest.mark.parametrize("name", list(OBJECTS))
def test_every_pose_of_an_objects_best_grasps_is_free(name: str) -> None:
    mesh = simplified(name, OBJECTS[name])
    model = GraspModel(friction=0.4, sensor_resolution=math.radians(15.0))
    hand = replace(ParallelGripper.preset("franka"), compliance=0.001)
    table = Table.below(mesh)
    labels = label_surface(mesh, model, hand=hand, table=table)
    best = best_grasps(labels, 20)
    assert best.label[0] == 2
    moving = MovingGripper(mesh, hand, table)
    assert [moving.collision(best.reach, row) for row in range(best.size)] == [""] * best.size
    assert (best.reach.pregrasp_opening <= hand.max_opening + 1e-9).all()
