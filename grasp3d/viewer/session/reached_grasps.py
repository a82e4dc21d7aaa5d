"""Grasps that a gripper reaches: alternatives through one vertex, and the best of a surface."""

from dataclasses import replace

import numpy as np

from grasp3d.arrays import Ints
from grasp3d.grasps.distinct import alternatives_at, best_grasps, first_vertices
from grasp3d.hand.gripper_pose import has_pose
from grasp3d.surface.grasp_table import GraspTable
from grasp3d.system.context import report_progress
from grasp3d.viewer.subjects.subject import Alternatives, Subject

MOST = 5
"""Most grasps through one vertex that the viewer shows, with the vertex's own."""

SAME = 1e-3
"""Distance of contacts up to which two grasps are the same, in object sizes."""


def find_alternatives(subject: Subject, vertex: int) -> Subject:
    """Add the other grasps through a vertex that the gripper reaches.

    Args:
        subject: A surface with labels and a gripper.
        vertex: A vertex whose grasp is reached.
    """
    report_progress(0.0)
    grasps = alternatives_at(subject.labels, vertex, MOST)
    others = grasps.take(_others(subject, vertex, grasps)[: MOST - 1])
    return replace(subject, alternatives=Alternatives(vertex, others))


def alternatives_of(subject: Subject, vertex: int) -> GraspTable | None:
    """The other grasps of a vertex; None: not searched."""
    others = subject.alternatives
    return others.grasps if others is not None and others.vertex == vertex else None


def is_reached(subject: Subject, vertex: int) -> bool:
    """Whether the pose of a gripper at the vertex's grasp is known."""
    reach = subject.labels.reach
    return reach is not None and vertex < len(reach.poses) and bool(has_pose(reach)[vertex])


def best_vertices(subject: Subject, count: int) -> Ints:
    """Vertices of the best distinct grasps, best first; see `best_grasps`."""
    return first_vertices(best_grasps(subject.labels, count))


def _others(subject: Subject, vertex: int, grasps: GraspTable) -> Ints:
    """Rows of the grasps that have a pose and are not the vertex's own."""
    assert grasps.reach is not None
    gaps = np.linalg.norm(grasps.contacts.points[:, 1:] - subject.labels.partners[vertex], axis=2)
    is_other = ~(gaps <= SAME * subject.mesh.size).all(axis=1)
    return np.flatnonzero(has_pose(grasps.reach) & is_other)
