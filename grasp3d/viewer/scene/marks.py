"""Markers of a grasp: contacts, lines between them, friction cones, fixed fingers."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
import pyvista
from vtkmodules.vtkRenderingCore import vtkMapper

from grasp3d.arrays import Floats, unit_rows
from grasp3d.contact.friction_cones import tangents
from grasp3d.settings import GraspModel
from grasp3d.viewer.scene.framing import pixel_ratio
from grasp3d.viewer.session.inspection import Inspection
from grasp3d.viewer.subjects.subject import Subject

CONTACT_RADIUS, ROD_RADIUS, RIM = 0.013, 0.0035, 0.0035
"""Radii of contact markers and rods, and width of their dark rim, relative to the object's size."""

CONE_LENGTH = 0.15
"""Length of a cone's sides, relative to the object's size."""

ARROW, HEAD, HEAD_RADIUS, SHAFT = 0.19, 0.035, 0.0095, 0.0022
"""Arrows: length, length and radius of the head, radius of the shaft, all likewise relative."""

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


@dataclass(frozen=True, eq=False)
class MarkedContacts:
    """Contacts with their normals."""

    points: Floats
    """Shape (n, 3)."""
    normals: Floats
    """Inward unit normals, (n, 3)."""


NO_CONTACTS = MarkedContacts(np.empty((0, 3)), np.empty((0, 3)))


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
        self._cones = _Marker(renderer, GREY, opacity=0.22)
        self._safe_cones = _Marker(renderer, BLUE, opacity=0.5)
        self._rims = _Marker(renderer, BLACK, rim=True)
        self._contacts = _Marker(renderer, WHITE)
        self._fixed_rims = _Marker(renderer, WHITE, rim=True)
        self._fixed = _Marker(renderer, BLACK)
        self._content: tuple[object, ...] = (None,) * 3

    def show(
        self,
        subject: Subject,
        inspection: Inspection | None,
        fixed: Floats,
        *,
        cones: bool = True,
    ) -> None:
        """Mark a grasp and fixed fingers.

        Args:
            subject: The surface.
            inspection: The inspected vertex with its grasp; None: there is none.
            fixed: Contact points of fixed fingers, shape (n, 3).
            cones: Whether friction cones are drawn; they would be inside the fingers of a gripper.
        """
        size, fixed_key = subject.mesh.size, (id(subject.mesh.vertices), fixed.tobytes())
        grasp, model = NO_CONTACTS, None
        if inspection is not None:
            grasp = MarkedContacts(inspection.points, inspection.normals)
            model = inspection.model
        grasp_key = (grasp.points.tobytes(), grasp.normals.tobytes())
        safe = model and model.effective_friction_angle
        cones_key = model and (model.friction_angle, model.tilt, safe, cones)
        before, self._content = self._content, (fixed_key, grasp_key, cones_key)
        if fixed_key != before[0]:
            self._show_fixed(_fixed_contacts(subject, fixed), size)
        if (fixed_key, grasp_key) != before[:2]:
            self._show_grasp(grasp, fixed, size)
        if (fixed_key, grasp_key, cones_key) != before:
            with_cones = cones and len(grasp.points) > 1
            self._show_cones(grasp if with_cones else NO_CONTACTS, model, size)

    def hide(self) -> None:
        """Show no markers."""
        self._content = (None,) * 3
        for marker in vars(self).values():
            if isinstance(marker, _Marker):
                marker.show([])

    def _show_grasp(self, grasp: MarkedContacts, fixed: Floats, size: float) -> None:
        gaps = np.linalg.norm(grasp.points[:, None] - fixed[None], axis=2)
        free = MarkedContacts(
            *(one[(gaps > SAME * size).all(axis=1)] for one in (grasp.points, grasp.normals))
        )
        several = len(grasp.points) > 1
        for extra, hidden, visible in (
            (0.0, self._hidden, self._contacts),
            (RIM * size, self._hidden_rims, self._rims),
        ):
            contacts = spheres(free.points, CONTACT_RADIUS * size + extra)
            if several:
                contacts += cylinders(*_connections(grasp.points), ROD_RADIUS * size + extra)
            hidden.show(contacts)
            visible.show([*contacts, *(_arrows(free, size, extra) if several else [])])

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
            inner = max(0.0, model.effective_friction_angle)
        self._cones.show(cone_surfaces(grasp.points, outward, beta, length))
        self._safe_cones.show(cone_surfaces(grasp.points, outward, inner, length))
        nominal = cone_rims(grasp.points, outward, beta, length)
        safe = cone_rims(grasp.points, outward, inner, length) if inner else []
        extreme = _extreme_cones(grasp, beta, tilt, length) if tilt > 0.0 else []
        self._grey_lines.show(nominal)
        self._blue_lines.show(safe)
        self._thin_lines.show(extreme)
        self._halo.show([*nominal, *safe])


class _Marker:
    """An actor for the markers of one appearance."""

    def __init__(
        self,
        renderer: pyvista.Renderer,
        color: str,
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
        self._mapper = pyvista.DataSetMapper()
        self._actor = pyvista.Actor(mapper=self._mapper)
        self._renderer, self._width = renderer, width
        look = self._actor.prop
        look.color, look.lighting = color, False
        look.opacity = HIDDEN_OPACITY if hidden else opacity
        look.culling = "front" if rim else "none"
        if hidden:
            vtkMapper.SetResolveCoincidentTopologyToPolygonOffset()
            self._mapper.SetRelativeCoincidentTopologyPolygonOffsetParameters(0.0, DEPTH_OFFSET)
        if not width:
            self._actor.ForceTranslucentOn()  # drawn in the order in which they are made
        self._actor.PickableOff()
        self._actor.VisibilityOff()
        renderer.AddActor(self._actor)

    def show(self, shapes: Sequence[pyvista.PolyData]) -> None:
        """Draw triangles or lines; hide the actor if there are none."""
        if shapes:
            self._mapper.SetInputData(shapes[0].append_polydata(*shapes[1:]))
        if self._width:
            self._actor.prop.line_width = self._width * pixel_ratio(self._renderer)
        self._actor.visibility = bool(shapes)


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
    tails = contacts.points - ARROW * size * contacts.normals
    ends = contacts.points - (CONTACT_RADIUS * size - extra) * contacts.normals
    necks = ends - (HEAD * size + 2.0 * extra) * contacts.normals
    shafts = cylinders(tails, necks, SHAFT * size + extra)
    return [*shafts, *cones(necks, ends, HEAD_RADIUS * size + extra)]


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
