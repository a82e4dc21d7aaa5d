"""Markers of a grasp: contacts, lines between them, friction cones, fixed fingers."""

import math
from collections.abc import Sequence
from itertools import combinations

import numpy as np
import pyvista
from vtkmodules.vtkRenderingCore import vtkMapper

from grasp3d.arrays import Floats, unit_rows
from grasp3d.contact.friction_cones import tangents
from grasp3d.hand.gripper_pose import GripperPose
from grasp3d.hand.hand import Hand
from grasp3d.hand.triangles import ARC_COLOR
from grasp3d.pictures.camera import pixel_ratio
from grasp3d.pictures.layers import AMBIENT
from grasp3d.pictures.marks import MarkedContacts
from grasp3d.pictures.subject import Subject
from grasp3d.settings import GraspModel

CONTACT_RADIUS, ROD_RADIUS, RIM = 0.013, 0.0035, 0.0035
"""Radii of contact markers and rods, and width of their dark rim, relative to the object's size."""

CONE_LENGTH = 0.15
"""Length of a cone's sides, relative to the object's size."""

HEAD, HEAD_RADIUS, SHAFT = 0.035, 0.0095, 0.0022
"""Arrows: length and radius of the head, radius of the shaft, all likewise relative."""

ARROW = 0.19
"""Length of the arrow at a contact, likewise relative."""

APPROACH = np.array([1.6, 0.15])
"""Distances of the tail and the tip of the approach's arrow from the TCP, in finger lengths: the
tail is in the translucent palm, which no object hides."""

APPROACH_HEAD, APPROACH_HEAD_RADIUS, APPROACH_SHAFT = 0.35, 0.12, 0.04
"""The same of the approach's arrow, relative to its length."""

HIDDEN_OPACITY = 0.4
"""Opacity of markers behind the surface."""

DEPTH_OFFSET = -60000.0
"""Depth offset that puts hidden markers in front of the surface [units of depth]."""

ROUND, LATITUDES = 40, 11
"""Corners of a circle; circles of a sphere, with its poles."""

CIRCLE = np.linspace(0.0, 2.0 * math.pi, ROUND + 1)
"""Angles along a closed circle [rad]."""

WHITE, BLACK, GREY = "#FFFFFF", "#1A1A1A", "#4A5562"
BLUE = "#0072B2"
"""Colour of the safe cone, which no label has."""
SAME = 1e-9
"""Distance below which two contacts count as one, relative to the object's size."""


NO_POINTS: Floats = np.empty((0, 3))
NO_CONTACTS = MarkedContacts(NO_POINTS, NO_POINTS)


class Marks:
    """Markers in one renderer, updated only when their content changes."""

    def __init__(self, renderer: pyvista.Renderer) -> None:
        # Actors cover those made before them, and are covered by the surface in front of them.
        renderer.UseOITOff()
        self._halo = _Marker(renderer, WHITE, width=4.0)
        self._grey_lines = _Marker(renderer, GREY, width=2.0)
        self._blue_lines = _Marker(renderer, BLUE, width=2.5)
        self._thin_lines = _Marker(renderer, BLACK, width=1.2)
        self._hidden_rims = _Marker(renderer, BLACK, rim=True, hidden=True)
        self._hidden = _Marker(renderer, WHITE, hidden=True)
        self._hidden_fixed = _Marker(renderer, BLACK, hidden=True)
        self._hidden_cones = _Marker(renderer, GREY, opacity=0.22, hidden=True)
        self._hidden_safe_cones = _Marker(renderer, BLUE, opacity=0.5, hidden=True)
        self._cones = _Marker(renderer, GREY, opacity=0.22)
        self._safe_cones = _Marker(renderer, BLUE, opacity=0.5)
        self._rims = _Marker(renderer, BLACK, rim=True)
        self._contacts = _Marker(renderer, WHITE)
        self._fixed_rims = _Marker(renderer, WHITE, rim=True)
        self._fixed = _Marker(renderer, BLACK)
        self._hidden_approach = _Marker(renderer, ARC_COLOR, hidden=True)
        self._approach = _Marker(renderer, ARC_COLOR)
        self._content: tuple[object, ...] = (None,) * 3
        self.points = self._fixed_tails = NO_POINTS
        """Tails of the arrows that are drawn, shape (n, 3)."""

    def show(
        self,
        subject: Subject,
        grasp: MarkedContacts | None,
        fixed: Floats,
        hand: Hand | None = None,
    ) -> None:
        """Mark a grasp and fixed fingers.

        Args:
            subject: The surface.
            grasp: The grasp; None: there is none. Where a gripper holds it, its approach is drawn
                instead of cones, which would be inside the fingers.
            fixed: Contact points of fixed fingers, shape (n, 3).
            hand: The gripper.
        """
        shown, approach = grasp or NO_CONTACTS, NO_POINTS
        contacts, model = MarkedContacts(shown.points, shown.normals), shown.model
        if hand is not None and shown.held is not None:
            approach = _approach_ends(shown.held, hand.finger_length)
        size, fixed_key = subject.mesh.size, (id(subject.mesh.vertices), fixed.tobytes())
        grasp_key = (contacts.points.tobytes(), contacts.normals.tobytes())
        safe = model and model.sure_angle
        of_links = hand is not None and shown.held is not None and shown.held.has_joints
        cones = len(contacts.points) > 1 and not (len(approach) or of_links)
        cones_key = model and (model.friction_angle, model.tilt, safe, approach.tobytes())
        before, self._content = self._content, (fixed_key, grasp_key, cones_key)
        if fixed_key != before[0]:
            arrows = _fixed_contacts(subject, fixed)
            self._show_fixed(arrows, size)
            self._fixed_tails = _tails(arrows, size)
        if (fixed_key, grasp_key) != before[:2]:
            self._show_grasp(contacts, fixed, size, connected=not of_links)
        if (fixed_key, grasp_key, cones_key) != before:
            outside = contacts if cones else NO_CONTACTS
            self._show_cones(outside, model, size)
            self._show_approach(approach)
            self.points = np.concatenate([_tails(outside, size), self._fixed_tails])

    def hide(self) -> None:
        """Show no markers."""
        self._content = (None,) * 3
        self.points = self._fixed_tails = NO_POINTS
        for marker in vars(self).values():
            if isinstance(marker, _Marker):
                marker.show([])

    def _show_grasp(
        self, grasp: MarkedContacts, fixed: Floats, size: float, *, connected: bool
    ) -> None:
        gaps = np.linalg.norm(grasp.points[:, None] - fixed[None], axis=2)
        free = MarkedContacts(
            *(one[(gaps > SAME * size).all(axis=1)] for one in (grasp.points, grasp.normals))
        )
        several = len(grasp.points) > 1
        for extra, hidden, visible in (
            (0.0, self._hidden, self._contacts),
            (RIM * size, self._hidden_rims, self._rims),
        ):
            shapes = spheres(free.points, CONTACT_RADIUS * size + extra)
            if several and connected:
                shapes += cylinders(*_connections(grasp.points), ROD_RADIUS * size + extra)
            if several:
                shapes += _arrows(free, size, extra)
            hidden.show(shapes)
            visible.show(shapes)

    def _show_fixed(self, fixed: MarkedContacts, size: float) -> None:
        radius, rim = 1.15 * CONTACT_RADIUS * size, RIM * size
        plain = [*spheres(fixed.points, radius), *_arrows(fixed, size, 0.0)]
        self._fixed.show(plain)
        self._hidden_fixed.show(plain)
        self._fixed_rims.show([*spheres(fixed.points, radius + rim), *_arrows(fixed, size, rim)])

    def _show_cones(self, grasp: MarkedContacts, model: GraspModel | None, size: float) -> None:
        """Draw the cones outside the surface, around the outward normals."""
        outward, length = -grasp.normals, CONE_LENGTH * size
        beta, tilt, inner = 0.0, 0.0, 0.0
        if model is not None:
            beta, tilt = model.friction_angle, model.tilt
            inner = max(0.0, model.sure_angle)
        for angle, markers in (
            (beta, (self._hidden_cones, self._cones)),
            (inner, (self._hidden_safe_cones, self._safe_cones)),
        ):
            for marker in markers:
                marker.show(cone_surfaces(grasp.points, outward, angle, length))
        nominal = cone_rims(grasp.points, outward, beta, length)
        safe = cone_rims(grasp.points, outward, inner, length) if inner else []
        extreme = _extreme_cones(grasp, beta, tilt, length) if tilt > 0.0 else []
        self._grey_lines.show(nominal)
        self._blue_lines.show(safe)
        self._thin_lines.show(extreme)
        self._halo.show([*nominal, *safe])

    def _show_approach(self, ends: Floats) -> None:
        shapes = []
        if len(ends):
            tail, tip = ends[:1], ends[1:]
            length, neck = math.dist(*ends), tip + APPROACH_HEAD * (tail - tip)
            shapes = [
                *cylinders(tail, neck, APPROACH_SHAFT * length),
                *cones(neck, tip, APPROACH_HEAD_RADIUS * length),
            ]
        self._hidden_approach.show(shapes)
        self._approach.show(shapes)


class _Marker:
    """An actor for the markers of one appearance."""

    def __init__(
        self,
        renderer: pyvista.Renderer,
        color: str | tuple[int, int, int],
        *,
        opacity: float = 1.0,
        rim: bool = False,
        hidden: bool = False,
        width: float = 0.0,
    ) -> None:
        """Make an empty actor.

        Args:
            renderer: Renderer that draws it.
            color: Any colour of PyVista.
            opacity: From 0 to 1.
            rim: Draw only back faces, as a rim around smaller markers.
            hidden: Show it faintly in front of the surface that hides it.
            width: Line width [pixels at 72 per inch]; 0: triangles.
        """
        self._renderer, self._width = renderer, width
        self._actor = new_actor(
            renderer, color, opacity=HIDDEN_OPACITY * opacity if hidden else opacity,
            lighting=False, culling="front" if rim else "none",
        )  # fmt: skip
        if hidden:
            vtkMapper.SetResolveCoincidentTopologyToPolygonOffset()
            mapper = self._actor.mapper
            mapper.SetRelativeCoincidentTopologyPolygonOffsetParameters(0.0, DEPTH_OFFSET)
        if not width:
            self._actor.ForceTranslucentOn()  # drawn in the order in which they are made

    def show(self, shapes: Sequence[pyvista.PolyData]) -> None:
        """Draw triangles or lines; hide the actor if there are none."""
        if shapes:
            self._actor.mapper.SetInputData(shapes[0].append_polydata(*shapes[1:]))
        if self._width:
            self._actor.prop.line_width = self._width * pixel_ratio(self._renderer)
        self._actor.visibility = bool(shapes)


def new_actor(
    renderer: pyvista.Renderer,
    color: str | tuple[int, int, int],
    *,
    opacity: float = 1.0,
    lighting: bool = True,
    culling: str = "none",
) -> pyvista.Actor:
    """An actor of one colour without content, which is hidden.

    Args:
        renderer: Renderer that draws it.
        color: Any colour of PyVista.
        opacity: From 0 to 1.
        lighting: Whether its brightness depends on its direction.
        culling: Faces that are not drawn: 'front', 'back' or 'none'.
    """
    actor = pyvista.Actor(mapper=pyvista.DataSetMapper())
    actor.mapper.SetScalarVisibility(False)  # noqa: FBT003
    look = actor.prop
    look.color, look.opacity, look.lighting, look.culling = color, opacity, lighting, culling
    look.ambient, look.diffuse = AMBIENT, 1.0 - AMBIENT
    actor.PickableOff()
    actor.VisibilityOff()
    renderer.AddActor(actor)
    return actor


def spheres(centers: Floats, radius: float) -> list[pyvista.PolyData]:
    """Spheres about points (n, 3)."""
    return [
        pyvista.Sphere(
            center=point, radius=radius, theta_resolution=ROUND, phi_resolution=LATITUDES
        )
        for point in centers
    ]


def cylinders(starts: Floats, ends: Floats, radius: float) -> list[pyvista.PolyData]:
    """Closed cylinders between points, both of shape (n, 3)."""
    return [
        pyvista.Cylinder(
            center=0.5 * (start + end), direction=end - start, height=math.dist(start, end),
            radius=radius, resolution=ROUND,
        )
        for start, end in zip(starts, ends, strict=True)
    ]  # fmt: skip


def cones(
    bases: Floats, tips: Floats, radius: float, *, open_base: bool = False
) -> list[pyvista.PolyData]:
    """Cones with the centres of their bases and their tips at points, both of shape (n, 3)."""
    return [
        pyvista.Cone(
            center=0.5 * (base + tip), direction=tip - base, height=math.dist(base, tip),
            radius=radius, resolution=ROUND, capping=not open_base,
        )
        for base, tip in zip(bases, tips, strict=True)
    ]  # fmt: skip


def cone_surfaces(
    apexes: Floats, axes: Floats, angle: float, length: float
) -> list[pyvista.PolyData]:
    """Open lateral surfaces of cones; none if the angle is 0.

    Args:
        apexes: Apexes of the cones, shape (n, 3).
        axes: Unit vectors along which they open, shape (n, 3).
        angle: Half-angle [rad], from 0 to below pi / 2.
        length: Length of the sides.
    """
    if not angle:
        return []
    bases = apexes + length * math.cos(angle) * axes
    return cones(bases, apexes, length * math.sin(angle), open_base=True)


def cone_rims(apexes: Floats, axes: Floats, angle: float, length: float) -> list[pyvista.PolyData]:
    """Circles at the open ends of `cone_surfaces`."""
    first, second = tangents(axes)
    across = np.cos(CIRCLE)[:, None, None] * first + np.sin(CIRCLE)[:, None, None] * second
    circles = apexes + length * (math.cos(angle) * axes + math.sin(angle) * across)  # (k, n, 3)
    return lines(np.swapaxes(circles, 0, 1))


def lines(paths: Floats) -> list[pyvista.PolyData]:
    """Polylines, shape (n, k, 3)."""
    return [pyvista.MultipleLines(path) for path in paths]


def _connections(points: Floats) -> tuple[Floats, Floats]:
    """Ends of the lines between contacts: all pairs of up to three, neighbours of more."""
    count = len(points)
    pairs = list(combinations(range(count), 2))
    if count > 3:
        pairs = [(one, (one + 1) % count) for one in range(count)]
    first, second = np.array(pairs).T
    return points[first], points[second]


def _arrows(contacts: MarkedContacts, size: float, extra: float) -> list[pyvista.PolyData]:
    """Arrows along the inward normals that end at contacts."""
    tails = _tails(contacts, size)
    ends = contacts.points - (CONTACT_RADIUS * size - extra) * contacts.normals
    necks = ends - (HEAD * size + 2.0 * extra) * contacts.normals
    shafts = cylinders(tails, necks, SHAFT * size + extra)
    return [*shafts, *cones(necks, ends, HEAD_RADIUS * size + extra)]


def _approach_ends(pose: GripperPose, length: float) -> Floats:
    """Tail and tip of the arrow along the approach between fingers of a length, (2, 3).

    (0, 3) of a hand with joints, which has no TCP.
    """
    if pose.has_joints:
        return NO_POINTS
    return np.asarray(pose.pose[:3, 3] - np.outer(APPROACH * length, pose.pose[:3, 2]))


def _tails(contacts: MarkedContacts, size: float) -> Floats:
    """Tails of such arrows, shape (n, 3)."""
    return contacts.points - ARROW * size * contacts.normals


def _extreme_cones(
    grasp: MarkedContacts, beta: float, tilt: float, length: float
) -> list[pyvista.PolyData]:
    """Outlines of the cones about the two extreme normals in the plane of the contact line."""
    others = grasp.points.sum(axis=0) - grasp.points
    toward = others / (len(grasp.points) - 1) - grasp.points
    along = (toward * grasp.normals).sum(axis=1, keepdims=True) * grasp.normals
    side = unit_rows(toward - along)
    straight = np.linalg.norm(toward - along, axis=1) < 1e-6 * np.linalg.norm(toward, axis=1)
    side[straight] = tangents(grasp.normals[straight])[0]
    outlines: list[pyvista.PolyData] = []
    for turn in (-tilt, tilt):
        axes = -np.cos(turn) * grasp.normals + np.sin(turn) * side
        across = np.sin(turn) * grasp.normals + np.cos(turn) * side
        ends = [
            grasp.points + length * (np.cos(beta) * axes + sign * np.sin(beta) * across)
            for sign in (-1.0, 1.0)
        ]
        outlines += cone_rims(grasp.points, axes, beta, length)
        outlines += lines(np.stack([ends[0], grasp.points, ends[1]], axis=1))
    return outlines


def _fixed_contacts(subject: Subject, fixed: Floats) -> MarkedContacts:
    """Fixed fingers with the normals of their nearest vertices."""
    nearest = [
        int(np.argmin(((subject.mesh.vertices - point) ** 2).sum(axis=1))) for point in fixed
    ]
    return MarkedContacts(fixed, subject.mesh.normals[np.array(nearest, dtype=int)])
