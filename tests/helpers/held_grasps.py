"""Labels with a gripper whose poses are made by hand, for what displays them."""

import math
from functools import cache

import numpy as np

from grasp3d import GraspModel, Sampling, SurfaceLabels, label_surface, load_mesh
from grasp3d.arrays import Floats, Ints, locked, unit_rows
from grasp3d.hand.parallel_gripper import ParallelGripper
from grasp3d.hand.reach import Reach, Reachability
from grasp3d.hand.reach_settings import ReachSettings
from grasp3d.hand.scene import Scene
from grasp3d.hand.table import Table
from grasp3d.surface.grasp_table import GraspTable
from grasp3d.surface.vertex_fields import Reason
from tests.helpers import shapes
from tests.helpers.vertex_labels import with_arrays

JAWS = ParallelGripper(
    name="jaws",
    max_opening=0.08,
    finger_thickness=0.01,
    finger_width=0.02,
    finger_length=0.045,
    pad_width=0.02,
    pad_height=0.015,
    palm_thickness=0.11,
    palm_width=0.05,
    palm_length=0.06,
)
"""A gripper of usual size."""


def with_reach(labels: SurfaceLabels, hand: ParallelGripper = JAWS) -> SurfaceLabels:
    """Labels on a table with poses from above, wherever the contacts are side by side.

    Grasps whose closing axis is nearly vertical count as not reached.
    """
    mesh = labels.mesh
    table = Table.below(mesh)
    points = np.stack([mesh.vertices, labels.partners[:, 0]], axis=1)
    x = unit_rows(np.nan_to_num(points[:, 1] - points[:, 0]))
    down = -table.normal
    level = np.linalg.norm(x @ down[:, None], axis=1) < 0.5
    reached = (labels.reason == Reason.FOUND) & level
    z = unit_rows(down - (x @ down)[:, None] * x)
    poses = np.zeros((len(x), 4, 4))
    poses[:, :3] = np.stack([x, np.cross(z, x), z, points.mean(axis=1)], axis=2)
    poses[:, 3, 3] = 1.0
    lost = ~reached & (labels.reason == Reason.FOUND)
    z_axis = mesh.vertices[:, 2]
    height = (z_axis - z_axis.min()) / np.ptp(z_axis)

    def where_reached(values: Floats) -> Floats:
        return locked(np.where(reached, values, math.nan))

    reach = Reach(
        state=locked(np.where(reached, Reachability.REACHED, Reachability.TABLE), np.uint8),
        poses=locked(np.where(reached[:, None, None], poses, math.nan)),
        approach_margin=where_reached(0.2 + height),
        opening=where_reached(labels.opening),
        pregrasp_opening=where_reached(labels.opening + 0.004),
        depth=where_reached(np.zeros(len(x))),
        free=locked(np.repeat(reached[:, None], 32, axis=1)),
    )
    angles = [
        np.where(lost, math.inf, one) for one in (labels.critical_angle, labels.critical_angle_best)
    ]
    return with_arrays(
        labels,
        angles=(angles[0], angles[1]),
        reason=np.where(lost, Reason.NOT_REACHED, labels.reason),
        reach=reach,
        scene=Scene.of(ReachSettings(hand, table="as-is"), mesh),
    )


@cache
def held_box() -> SurfaceLabels:
    """A box on a table, 60 x 40 x 80 mm, in metres."""
    mesh = load_mesh(shapes.box((0.06, 0.04, 0.08)), unit="m", max_edge=0.02)
    return with_reach(label_surface(mesh, GraspModel(), sampling=Sampling(rays=16)))


def reached(labels: SurfaceLabels) -> Ints:
    """Vertices whose grasps the gripper reaches."""
    assert labels.reach is not None
    return np.flatnonzero(labels.reach.state == Reachability.REACHED)


def not_reached(labels: SurfaceLabels) -> Ints:
    """Vertices with grasps, none of which the gripper reaches."""
    return np.flatnonzero(labels.reason == Reason.NOT_REACHED)


def neighbours_grasps(labels: SurfaceLabels, vertex: int, count: int) -> GraspTable:
    """The grasps of the nearest vertices of a vertex, its own first."""
    near = reached(labels)
    gaps = np.linalg.norm(labels.mesh.vertices[near] - labels.mesh.vertices[vertex], axis=1)
    return labels.take(near[np.argsort(gaps, kind="stable")[:count]]).whole()
