"""A box on a table and a gripper, for tests of displays."""

from functools import cache

import numpy as np

from grasp3d import GraspModel, Sampling, SurfaceLabels, label_surface, load_mesh
from grasp3d.arrays import Ints
from grasp3d.hand.parallel_gripper import ParallelGripper
from grasp3d.hand.reach import Reachability
from grasp3d.surface.vertex_fields import Reason
from tests.helpers import shapes

JAWS = ParallelGripper(
    name="jaws", max_opening=0.08, finger_thickness=0.01, finger_width=0.02, finger_length=0.045,
    pad_width=0.02, pad_height=0.015, palm_thickness=0.11, palm_width=0.05, palm_length=0.06,
)  # fmt: skip
"""A gripper of usual size."""


@cache
def held_box() -> SurfaceLabels:
    """A box on a table, 60 x 40 x 80 mm, in metres."""
    mesh = load_mesh(shapes.box((0.06, 0.04, 0.08)), unit="m", max_edge=0.02)
    sampling = Sampling(rays=16)
    return label_surface(mesh, GraspModel(), sampling=sampling, hand=JAWS, table="as-is")


def reached(labels: SurfaceLabels) -> Ints:
    """Vertices whose grasps the gripper reaches."""
    return np.flatnonzero(labels.reach.state == Reachability.REACHED)


def not_reached(labels: SurfaceLabels) -> Ints:
    """Vertices with grasps, none of which the gripper reaches."""
    return np.flatnonzero(labels.reason == Reason.NOT_REACHED)
