"""Marks of a grasp: contacts with arrows, lines between them, friction cones, the approach."""

import math
from dataclasses import dataclass
from itertools import combinations

import numpy as np
import pyvista

from grasp3d.arrays import Floats, unit_rows
from grasp3d.contact.contacts import tangents
from grasp3d.grasps.evaluated_poses import EvaluatedPoses
from grasp3d.hand.gripper_pose import GripperPose
from grasp3d.settings import GraspModel

CONTACT_RADIUS, ROD_RADIUS, RIM = 0.013, 0.0035, 0.0035
"""Radii of contacts and of the lines between them, and width of their rims, relative to the
object's size."""

ARROW, HEAD, HEAD_RADIUS, SHAFT = 0.19, 0.035, 0.0095, 0.0022
"""Dimensions of the arrows at contacts, relative to the object's size: length with the head, length
and radius of the head, radius of the shaft."""

CONE_LENGTH = 0.15
"""Length of a cone's sides, relative to the object's size."""

APPROACH = np.array([1.6, 0.15])
"""Distances of the tail and the tip of the approach arrow from the TCP, in finger lengths. The tail
is in the translucent palm, which no object hides."""

APPROACH_HEAD, APPROACH_HEAD_RADIUS, APPROACH_SHAFT = 0.35, 0.12, 0.04
"""Length and radius of the head, and radius of the shaft, relative to the arrow's length."""

CIRCLE = np.linspace(0.0, 2.0 * math.pi, 41)
"""Angles along a closed circle [rad]."""

NO_POINTS: Floats = np.empty((0, 3))

Shapes = dict[str, pyvista.PolyData]
"""Shapes by layer."""


@dataclass(frozen=True, eq=False)
class MarkedContacts:
    """Contacts with their normals, as drawn."""

    points: Floats
    """Contacts, shape (n, 3)."""
    normals: Floats
    """Inward unit normals, shape (n, 3)."""
    model: GraspModel | None = None
    """Friction and resolution, for the cones."""
    held: GripperPose | None = None
    """Pose of the gripper; None: cones are drawn, as there is none or it does not reach them."""

    @classmethod
    def of_pose(cls, grasps: EvaluatedPoses, row: int) -> "MarkedContacts":
        """Return the contacts of a pose, with the hand that makes them.

        Links that touch, or the fingers of a gripper, have the colour of the label.

        Args:
            grasps: Evaluated poses.
            row: Number of the pose.
        """
        return cls(*grasps.contacts_of(row), grasps.model, grasps.held_at(row))

    def tails(self, size: float) -> Floats:
        """Tails of the arrows at the contacts, for an object of a given size, shape (n, 3)."""
        return self.points - ARROW * size * self.normals

    @property
    def drawn(self) -> tuple[object, ...]:
        """Key of everything that the marks depend on."""
        held, model = self.held, self.model
        angles = model and not held and (model.friction_angle, model.tilt, model.sure_angle)
        pose = held and (
            held.pose.tobytes(),
            held.opening,
            held.posture.tobytes(),
            *held.colors.items(),
        )
        return self.points.tobytes(), self.normals.tobytes(), pose or angles


NO_CONTACTS = MarkedContacts(NO_POINTS, NO_POINTS)


def copies(shape: pyvista.PolyData, points: Floats, ways: Floats) -> pyvista.PolyData:
    """Copies of a shape with their origins at points (n, 3) and their x axes along ways (n, 3)."""
    places = pyvista.PolyData(points)
    places["way"] = ways
    found: pyvista.PolyData = places.glyph(orient="way", scale=False, geom=shape)
    return found


def arrow(length: float, head: float, head_radius: float, shaft: float) -> pyvista.PolyData:
    """An arrow along x whose tip is at the origin, with a given length and radius of its head."""
    return pyvista.Arrow(
        start=(-length, 0.0, 0.0), scale=length, tip_length=head / length,
        tip_radius=head_radius / length, shaft_radius=shaft / length,
    )  # fmt: skip


def contact_marks(
    layer: str, grasp: MarkedContacts, size: float, *, arrows: bool = True, lines: bool = False,
    wide: float = 1.0,
) -> Shapes:  # fmt: skip
    """Spheres at contacts, arrows along the inward normals, and rims around both.

    Args:
        layer: Layer of the marks; the layer of the rims is named after it.
        grasp: The contacts.
        size: Size of the object.
        arrows: Whether to add arrows.
        lines: Whether to add lines between contacts: all pairs for up to three, else neighbours.
        wide: Factor of the radius of the spheres.
    """
    marks: Shapes = {}
    if not len(grasp.points):
        return marks
    for name, extra in ((layer, 0.0), (f"{layer} rims", RIM * size)):
        ball = pyvista.Sphere(radius=wide * CONTACT_RADIUS * size + extra)
        shape = copies(ball, grasp.points, grasp.normals)
        if arrows:
            gap = CONTACT_RADIUS * size - extra
            head = HEAD * size + 2.0 * extra, HEAD_RADIUS * size + extra
            one = arrow(ARROW * size - gap, *head, SHAFT * size + extra)
            shape += copies(one, grasp.points - gap * grasp.normals, grasp.normals)
        if lines:
            radius = ROD_RADIUS * size + extra
            shape += _connections(grasp.points).tube(radius=radius, n_sides=16)
        marks[name] = shape
    return marks


def _connections(points: Floats) -> pyvista.PolyData:
    count = len(points)
    pairs = np.array(list(combinations(range(count), 2)))
    if count > 3:
        pairs = np.stack([np.arange(count), np.roll(np.arange(count), -1)], axis=1)
    lines: pyvista.PolyData = pyvista.line_segments_from_points(points[pairs].reshape(-1, 3))
    return lines


def cone_marks(grasp: MarkedContacts, size: float) -> Shapes:
    """Friction cones outside the surface, by layer: nominal, safe, and about extreme normals.

    Args:
        grasp: The contacts.
        size: Size of the object.
    """
    model, length, points, outward = grasp.model, CONE_LENGTH * size, grasp.points, -grasp.normals
    if model is None or len(points) < 2:
        return {}
    beta, sure = model.friction_angle, model.sure_angle
    marks = {"cones": copies(cone(beta, length), points, outward)}
    marks["nominal rims"] = marks["halo"] = copies(rim(beta, length), points, outward)
    if sure > 0.0:
        marks["safe cones"] = copies(cone(sure, length), points, outward)
        marks["safe rims"] = copies(rim(sure, length), points, outward)
        marks["halo"] = marks["halo"] + marks["safe rims"]
    if model.tilt > 0.0:
        extreme = np.concatenate(_extreme_normals(grasp, model.tilt))
        marks["extreme cones"] = copies(rim(beta, length), np.tile(points, (2, 1)), -extreme)
    return marks


def cone(angle: float, length: float) -> pyvista.PolyData:
    """Open lateral surface of a cone that has its apex at the origin and opens along x.

    Args:
        angle: Half-angle [rad], above 0 and below pi / 2.
        length: Length of the sides.
    """
    height = length * math.cos(angle)
    return pyvista.Cone(
        center=(0.5 * height, 0.0, 0.0), direction=(-1.0, 0.0, 0.0), height=height,
        radius=length * math.sin(angle), resolution=len(CIRCLE) - 1, capping=False,
    )  # fmt: skip


def rim(angle: float, length: float) -> pyvista.PolyData:
    """Circle at the open end of `cone`."""
    x, radius = np.full(len(CIRCLE), length * math.cos(angle)), length * math.sin(angle)
    circle = np.column_stack([x, radius * np.cos(CIRCLE), radius * np.sin(CIRCLE)])
    lines: pyvista.PolyData = pyvista.lines_from_points(circle)
    return lines


def approach_mark(pose: GripperPose, length: float) -> Shapes:
    """Arrow along the approach between fingers of a length; none for hands without a TCP."""
    if pose.has_joints:
        return {}
    tail, tip = APPROACH * length
    whole = tail - tip
    one = arrow(whole, APPROACH_HEAD * whole, APPROACH_HEAD_RADIUS * whole, APPROACH_SHAFT * whole)
    way = pose.pose[:3, 2]
    return {"approach": copies(one, (pose.pose[:3, 3] - tip * way)[None], way[None])}


def _extreme_normals(grasp: MarkedContacts, tilt: float) -> list[Floats]:
    """Both extreme inward normals in the plane of the contact line, shape (n, 3) each."""
    points, normals = grasp.points, grasp.normals
    toward = (points.sum(axis=0) - points) / (len(points) - 1) - points
    along = (toward * normals).sum(axis=1, keepdims=True) * normals
    side = unit_rows(toward - along)
    straight = np.linalg.norm(toward - along, axis=1) < 1e-6 * np.linalg.norm(toward, axis=1)
    side[straight] = tangents(normals[straight])[0]
    return [math.cos(tilt) * normals + sign * math.sin(tilt) * side for sign in (-1.0, 1.0)]
