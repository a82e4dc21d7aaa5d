"""Marks of a grasp: contacts with arrows, lines between them, friction cones, the approach."""

import math
from dataclasses import dataclass
from itertools import combinations

import numpy as np
import pyvista

from grasp3d.arrays import Floats, unit_rows
from grasp3d.contact.friction_cones import tangents
from grasp3d.grasps.evaluated_poses import EvaluatedPoses
from grasp3d.hand.gripper_pose import GripperPose
from grasp3d.settings import GraspModel

CONTACT_RADIUS, ROD_RADIUS, RIM = 0.013, 0.0035, 0.0035
"""Radii of contacts and of the lines between them, and width of their rim, relative to the object's
size."""

ARROW, HEAD, HEAD_RADIUS, SHAFT = 0.19, 0.035, 0.0095, 0.0022
"""Arrows at contacts, likewise: length, with the head, that of the head, its radius, and that of
the shaft."""

CONE_LENGTH = 0.15
"""Length of a cone's sides, likewise."""

APPROACH = np.array([1.6, 0.15])
"""Distances of the tail and the tip of the approach's arrow from the TCP, in finger lengths: the
tail is in the translucent palm, which no object hides."""

APPROACH_HEAD, APPROACH_HEAD_RADIUS, APPROACH_SHAFT = 0.35, 0.12, 0.04
"""The same of the approach's arrow, relative to its length."""

CIRCLE = np.linspace(0.0, 2.0 * math.pi, 41)
"""Angles along a closed circle [rad]."""

NO_POINTS: Floats = np.empty((0, 3))

Shapes = list[pyvista.PolyData]


@dataclass(frozen=True, eq=False)
class MarkedContacts:
    """Contacts with their normals, as they are drawn."""

    points: Floats
    """Shape (n, 3)."""
    normals: Floats
    """Inward unit normals, (n, 3)."""
    model: GraspModel | None = None
    """Friction and resolution of the cones."""
    held: GripperPose | None = None
    """Pose of the gripper; None: there is none, or it does not reach them: cones are drawn."""

    @classmethod
    def of_pose(cls, grasps: EvaluatedPoses, row: int) -> "MarkedContacts":
        """The contacts of a pose, with the hand that makes them.

        The links that touch, or the fingers of a gripper, have the colour of the letter.

        Args:
            grasps: Evaluated poses.
            row: Number of the pose.
        """
        return cls(*grasps.contacts_of(row), grasps.model, grasps.held_at(row))

    def tails(self, size: float) -> Floats:
        """Tails of the arrows at the contacts of an object of a size, shape (n, 3)."""
        return self.points - ARROW * size * self.normals


NO_CONTACTS = MarkedContacts(NO_POINTS, NO_POINTS)


def contact_marks(
    grasp: MarkedContacts, size: float, *, arrows: bool = True, wide: float = 1.0
) -> tuple[Shapes, Shapes]:
    """Spheres at contacts, with arrows along the inward normals, and the rims around them.

    Args:
        grasp: The contacts.
        size: Size of the object.
        arrows: Whether there are arrows.
        wide: Factor of the radius of the spheres.
    """
    marks: list[Shapes] = []
    for extra in (0.0, RIM * size):
        radius = wide * CONTACT_RADIUS * size + extra
        shapes = [pyvista.Sphere(center=point, radius=radius) for point in grasp.points]
        ends = grasp.points - (CONTACT_RADIUS * size - extra) * grasp.normals
        for tail, end in zip(grasp.tails(size), ends, strict=True) if arrows else ():
            shapes.append(
                arrow(
                    tail, end, HEAD * size + 2.0 * extra, HEAD_RADIUS * size + extra,
                    SHAFT * size + extra,
                )
            )  # fmt: skip
        marks.append(shapes)
    return marks[0], marks[1]


def connections(points: Floats, size: float) -> tuple[Shapes, Shapes]:
    """Lines between contacts (n, 3): all pairs of up to three, neighbours of more; their rims."""
    pairs = list(combinations(range(len(points)), 2))
    if len(points) > 3:
        pairs = [(one, (one + 1) % len(points)) for one in range(len(points))]
    thin, thick = (
        [
            pyvista.Tube(pointa=points[i], pointb=points[j], radius=radius * size, n_sides=16)
            for i, j in pairs
        ]
        for radius in (ROD_RADIUS, ROD_RADIUS + RIM)
    )
    return thin, thick


def arrow(
    tail: Floats, tip: Floats, head: float, head_radius: float, shaft: float
) -> pyvista.PolyData:
    """An arrow between two points (3,), with the length and radius of its head."""
    way = tip - tail
    length = float(np.linalg.norm(way))
    return pyvista.Arrow(
        start=tail, direction=way, scale=length, tip_length=head / length,
        tip_radius=head_radius / length, shaft_radius=shaft / length,
    )  # fmt: skip


def cone_marks(grasp: MarkedContacts, size: float) -> dict[str, Shapes]:
    """The friction cones outside the surface, by layer: nominal, safe, and about extreme normals.

    Args:
        grasp: The contacts.
        size: Size of the object.
    """
    model, length = grasp.model, CONE_LENGTH * size
    if model is None or len(grasp.points) < 2:
        return {}
    apexes, outward, beta = grasp.points, -grasp.normals, model.friction_angle
    sure = max(0.0, model.sure_angle)
    nominal, safe = (cone_rims(apexes, outward, angle, length) for angle in (beta, sure))
    return {
        "cones": cones(apexes, outward, beta, length),
        "safe cones": cones(apexes, outward, sure, length),
        "nominal rims": nominal,
        "safe rims": safe,
        "extreme cones": _extreme_cones(grasp, model, length) if model.tilt > 0.0 else [],
        "halo": [*nominal, *safe],
    }


def cones(apexes: Floats, axes: Floats, angle: float, length: float) -> Shapes:
    """Open lateral surfaces of cones; none if the angle is 0.

    Args:
        apexes: Apexes of the cones, shape (n, 3).
        axes: Unit vectors along which they open, shape (n, 3).
        angle: Half-angle [rad], from 0 to below pi / 2.
        length: Length of the sides.
    """
    height = length * math.cos(angle)
    return [
        pyvista.Cone(
            center=apex + 0.5 * height * axis, direction=-axis, height=height,
            radius=length * math.sin(angle), resolution=len(CIRCLE) - 1, capping=False,
        )
        for apex, axis in zip(apexes, axes, strict=True)
        if angle
    ]  # fmt: skip


def cone_rims(apexes: Floats, axes: Floats, angle: float, length: float) -> Shapes:
    """Circles at the open ends of `cones`; none if the angle is 0."""
    first, second = tangents(axes)
    across = np.cos(CIRCLE)[:, None, None] * first + np.sin(CIRCLE)[:, None, None] * second
    circles = apexes + length * (math.cos(angle) * axes + math.sin(angle) * across)  # (k, n, 3)
    return [pyvista.MultipleLines(circle) for circle in circles.swapaxes(0, 1) if angle]


def approach_mark(pose: GripperPose, length: float) -> Shapes:
    """The arrow along the approach between fingers of a length; none of hands without a TCP."""
    if pose.has_joints:
        return []
    tail, tip = pose.pose[:3, 3] - np.outer(APPROACH * length, pose.pose[:3, 2])
    whole = math.dist(tail, tip)
    sizes = APPROACH_HEAD * whole, APPROACH_HEAD_RADIUS * whole, APPROACH_SHAFT * whole
    return [arrow(tail, tip, *sizes)]


def _extreme_cones(grasp: MarkedContacts, model: GraspModel, length: float) -> Shapes:
    """Outlines of the cones about the two extreme normals in the plane of the contact line."""
    points, normals, beta = grasp.points, grasp.normals, model.friction_angle
    toward = (points.sum(axis=0) - points) / (len(points) - 1) - points
    along = (toward * normals).sum(axis=1, keepdims=True) * normals
    side = unit_rows(toward - along)
    straight = np.linalg.norm(toward - along, axis=1) < 1e-6 * np.linalg.norm(toward, axis=1)
    side[straight] = tangents(normals[straight])[0]
    outlines: Shapes = []
    for turn in (-model.tilt, model.tilt):
        axes = -np.cos(turn) * normals + np.sin(turn) * side
        across = np.sin(turn) * normals + np.cos(turn) * side
        ends = [
            points + length * (np.cos(beta) * axes + sign * np.sin(beta) * across)
            for sign in (-1.0, 1.0)
        ]
        outlines += cone_rims(points, axes, beta, length)
        outlines += map(pyvista.MultipleLines, np.stack([ends[0], points, ends[1]], axis=1))
    return outlines
