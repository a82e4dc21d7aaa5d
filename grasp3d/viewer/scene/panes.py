"""A pane: a coloured surface with its grasp, gripper and texts, in one renderer of a plotter."""

from dataclasses import replace

import numpy as np
import pyvista
from vtkmodules.vtkCommonDataModel import vtkPlane
from vtkmodules.vtkRenderingCore import vtkTexture

from grasp3d.arrays import Bytes, Floats
from grasp3d.hand.articulated.articulated_hand import ArticulatedHand
from grasp3d.hand.gripper_pose import GripperPose
from grasp3d.hand.hand import Hand
from grasp3d.hand.table import Table
from grasp3d.hand.triangles import (
    ARC_COLOR,
    COLORS,
    TABLE_COLOR,
    Part,
    Triangles,
    approach_triangles,
    table_triangles,
)
from grasp3d.pictures.camera import pixel_ratio
from grasp3d.pictures.captions import Overlay
from grasp3d.pictures.colors import HEX_PALETTE, corner_coordinates, faded, texture_image
from grasp3d.pictures.layers import LIGHT
from grasp3d.pictures.marks import NO_POINTS, MarkedContacts, Marks, new_actor
from grasp3d.pictures.subject import Subject
from grasp3d.pictures.view_settings import Paint
from grasp3d.settings import GraspModel

ARC_OPACITY, TABLE_OPACITY = 0.4, 0.6
OPACITIES = {Part.PALM: 0.3, Part.FINGER: 0.7, Part.PAD: 0.9, Part.TIP: 0.9}
"""Opacities of the parts of a gripper: what it holds remains visible behind it."""

PALETTE = np.array(
    [(*COLORS[part], round(255.0 * OPACITIES[part])) for part in Part], dtype=np.uint8
)
"""Red, green, blue and opacity of the parts."""

OPAQUE = 255
"""Opacity of the links of hands with joints, which overlap, but for the palm."""

EDGE, EDGE_ANGLE, EDGE_WIDTH = "#2B2F33", 40.0, 1.2
"""Colour of the edges of fingers and palm; angle of the faces there [degrees]; width of the lines
[pixels at 72 per inch]."""

ARC_RADIUS, ARC_INNER = 0.95, 0.35
"""Outer radius of the approach arc relative to the fingers' length, and the inner one relative to
the outer one."""


class GripperActors:
    """Draws gripper, approach arc and table in one renderer; updated only when they change."""

    def __init__(self, renderer: pyvista.Renderer) -> None:
        self._renderer = renderer
        self._table = new_actor(renderer, TABLE_COLOR, opacity=TABLE_OPACITY)
        self._arc = new_actor(renderer, ARC_COLOR, opacity=ARC_OPACITY, lighting=False)
        self._gripper = new_actor(renderer, EDGE, culling="back")
        self._links = new_actor(renderer, EDGE, culling="back")
        self._edges = new_actor(renderer, EDGE, lighting=False)
        for actor in (self._gripper, self._links):
            show_scalars(actor, "color", of_points=False)  # red, green, blue, opacity
        self._drawn: tuple[object, ...] = (None,) * 3
        self.table_mapper = self._table.mapper
        self.points = NO_POINTS
        """Corners of palm and fingers of the gripper that is drawn, shape (n, 3)."""
        self.table_points = NO_POINTS
        """Points of the table that is drawn, shape (n, 3)."""

    def show(
        self, subject: Subject, hand: Hand | None, pose: GripperPose | None, table: Table | None
    ) -> bool:
        """Draw a gripper and a table; returns whether another gripper is drawn than before.

        Args:
            subject: The surface.
            hand: The gripper.
            pose: Its pose.
            table: The table.
                Any of these may be None: it is not drawn.
        """
        before, self._drawn = self._drawn, (subject.mesh.vertices, table, pose)
        same_object = before[0] is subject.mesh.vertices
        if not same_object or before[1] is not table:
            self._show_table(subject, table)
        if same_object and before[2] is pose:
            return False
        self._show_gripper(hand, pose)
        return len(self.points) > 0

    def hide(self) -> None:
        """Show nothing."""
        self._drawn = (None,) * 3
        self.points = self.table_points = NO_POINTS
        for actor in (self._table, self._arc, self._gripper, self._links, self._edges):
            actor.visibility = False

    def _show_table(self, subject: Subject, table: Table | None) -> None:
        self._table.visibility = table is not None
        self.table_points = NO_POINTS
        if table is not None:
            plate = table_triangles(table, subject.mesh)
            self._table.mapper.dataset = surface_of(plate)
            self.table_points = plate.vertices

    def _show_gripper(self, hand: Hand | None, pose: GripperPose | None) -> None:
        for actor in (self._gripper, self._links, self._edges, self._arc):
            actor.visibility = False
        self.points = NO_POINTS
        if hand is None or pose is None:
            return
        solid = pose.triangles(hand)
        parts = solid.parts
        colors = PALETTE[parts]
        if pose.has_joints:
            colors[parts != Part.PALM, 3] = OPAQUE
        for link, color in pose.colors.items():
            if pose.has_joints:
                colors[solid.links == link] = (*color, OPAQUE)
            else:
                colors[parts != Part.PALM, :3] = color
        opaque = colors[:, 3] == OPAQUE
        for actor, chosen in ((self._gripper, ~opaque), (self._links, opaque)):
            if not chosen.any():
                continue
            some = surface_of(replace(solid, faces=solid.faces[chosen]))
            some.cell_data["color"] = colors[chosen]
            actor.mapper.dataset = some
            actor.visibility = True
        self._edges.mapper.dataset = (
            surface_of(solid)
            .clean()
            .extract_feature_edges(
                feature_angle=EDGE_ANGLE, boundary_edges=False, manifold_edges=False
            )
        )
        self._edges.prop.line_width = EDGE_WIDTH * pixel_ratio(self._renderer)
        self._edges.visibility = True
        framed = parts <= Part.FINGER
        if isinstance(hand, ArticulatedHand):  # a forearm would make the fingers small
            palm = hand.link_names.index(hand.palm)
            framed = (parts != Part.PALM) | (solid.links == palm)
        self.points = solid.vertices[np.unique(solid.faces[framed])]
        if pose.arcs:
            radius = ARC_RADIUS * hand.finger_length
            arc = approach_triangles(pose.pose, pose.arcs, radius=radius, inner=ARC_INNER)
            self._arc.mapper.dataset = surface_of(arc)
            self._arc.visibility = True


def show_scalars(actor: pyvista.Actor, name: str, *, of_points: bool) -> None:
    """Colour an actor by an array of its data: of points or of cells."""
    mapper = actor.mapper
    mapper.SetScalarVisibility(True)  # noqa: FBT003
    if of_points:
        mapper.SetScalarModeToUsePointFieldData()
    else:
        mapper.SetScalarModeToUseCellFieldData()
    mapper.SelectColorArray(name)
    mapper.SetColorModeToDirectScalars()


def surface_of(triangles: Triangles) -> pyvista.PolyData:
    """Triangles as a surface of PyVista."""
    faces = triangles.faces.astype(int)
    surface: pyvista.PolyData = pyvista.PolyData.from_regular_faces(triangles.vertices, faces)
    return surface


INSIDE = "#8C857B"
"""Colour of back faces, which are visible in a section or if the mesh is open."""

FRAME = "#5B6470"
FRAME_MARGIN = 0.04
"""Distance of a section's outline from the object, relative to its size."""


class Pane:
    """A coloured surface, whole or cut by a section, and what is drawn with it."""

    def __init__(self, renderer: pyvista.Renderer) -> None:
        self.renderer = renderer
        self._subject: Subject | None = None
        self._painted: tuple[Subject, Paint, GraspModel, bool] | None = None
        self._upper: Floats | None = None
        self._data: pyvista.PolyData | None = None
        self._texture, self._image = vtkTexture(), pyvista.ImageData()
        self._rows = np.empty((0, 3), dtype=np.uint8)
        self._front = new_actor(renderer, "white", culling="back")
        self._back = new_actor(renderer, INSIDE, culling="front")
        self._excluded = new_actor(renderer, HEX_PALETTE[-1], culling="back")
        self._surfaces = self._front, self._excluded, self._back
        for actor in self._surfaces:
            actor.prop.interpolation = "Phong"
            actor.PickableOn()
        self._texture.SetInputDataObject(self._image)
        self._texture.RepeatOff()  # the first and the last column are not neighbours
        self._texture.EdgeClampOn()
        self._texture.InterpolateOff()
        self._front.SetTexture(self._texture)
        self._plane = vtkPlane()
        self._cut: tuple[bytes, bytes] | None = None
        self._outline = new_actor(renderer, FRAME, lighting=False)
        # What is made later covers what was made before it.
        self.gripper, self.marks = GripperActors(renderer), Marks(renderer)
        self.captions, self.numbers = Overlay(renderer), Overlay(renderer)
        renderer.background_color = pyvista.Color("white")
        renderer.remove_all_lights()
        renderer.add_light(pyvista.Light(position=LIGHT, light_type="camera light", intensity=1.0))

    def show(
        self, subject: Subject, paint: Paint, model: GraspModel, *, stale: bool = False
    ) -> None:
        """Draw a surface; only what has changed is updated.

        Args:
            subject: The surface.
            paint: The quantity that is shown.
            model: Friction and resolution.
            stale: Use pale colours, as the surface does not belong to the current choices.
        """
        before = self._painted
        if before is not None and before[0] is subject and before[1:] == (paint, model, stale):
            return
        if not _same_shape(subject, self._subject):
            self._draw(subject)
        upper = subject.labels.critical_angle
        same = before is not None and (subject is before[0] and paint == before[1])
        if paint == "label" or not same or upper is not self._upper:
            self._set_coordinates(subject, paint, model)
        self._upper = upper
        image = texture_image(subject, paint, model)
        self._set_image(faded(image) if stale else image)
        self._subject, self._painted = subject, (subject, paint, model, stale)

    def show_colors(self, subject: Subject, colors: Bytes) -> None:
        """Draw a surface in colours of its vertices, shape (V, 3), or (3,) for all."""
        self._draw(subject)
        assert self._data is not None
        vertices = subject.mesh.corner_normals.vertices
        shape = len(subject.mesh.vertices), 3
        self._data.point_data["rgb"] = np.broadcast_to(colors, shape)[vertices]
        self._front.SetTexture(None)
        show_scalars(self._front, "rgb", of_points=True)
        self._subject = subject

    def hide(self) -> None:
        """Show nothing but texts."""
        self.gripper.hide()
        self.marks.hide()
        for actor in (*self._surfaces, self._outline):
            actor.VisibilityOff()
        self._subject = self._painted = self._cut = None

    def cut(self, plane: tuple[Floats, Floats] | None) -> None:
        """Cut the surface open.

        Args:
            plane: A point of it and its normal toward the visible part; None: no section.
        """
        subject = self._subject
        assert subject is not None
        key = plane and (plane[0].tobytes(), plane[1].tobytes())
        self._back.SetVisibility(plane is not None or not subject.mesh.report.closed)
        self._outline.SetVisibility(plane is not None)
        if key == self._cut:
            return
        self._cut = key
        mappers = (*(actor.mapper for actor in self._surfaces), self.gripper.table_mapper)
        for mapper in mappers:
            mapper.RemoveAllClippingPlanes()
        if plane is not None:
            self._plane.SetOrigin(*plane[0])
            self._plane.SetNormal(*plane[1])
            for mapper in mappers:
                mapper.AddClippingPlane(self._plane)
            self._outline.mapper.dataset = _rectangle(subject, *plane)
            self._outline.prop.line_width = 1.5 * pixel_ratio(self.renderer)

    def hold(
        self,
        grasp: MarkedContacts | None,
        hand: Hand | None,
        table: Table | None,
        fixed: Floats = NO_POINTS,
    ) -> bool:
        """Draw a grasp: its contacts, with the gripper and its approach, or with friction cones.

        Args:
            grasp: The grasp; None: there is none.
            hand: The gripper.
            table: The table; None: it is not drawn.
            fixed: Contact points of fixed fingers, shape (n, 3).

        Returns:
            Whether another gripper is drawn than before.
        """
        subject = self._subject
        assert subject is not None
        self.marks.show(subject, grasp, fixed, hand)
        return self.gripper.show(subject, hand, grasp.held if grasp else None, table)

    @property
    def points(self) -> Floats:
        """Points of the object and the table, shape (n, 3)."""
        assert self._subject is not None
        mesh = self._subject.mesh
        used = mesh.vertices[mesh.corner_normals.vertices]
        return np.concatenate([used, self.gripper.table_points])

    @property
    def size(self) -> float:
        """Size of the object."""
        assert self._subject is not None
        return self._subject.mesh.size

    @property
    def beside(self) -> Floats:
        """Points of what is drawn beside the object: of a gripper or of arrows, (n, 3)."""
        return np.concatenate([self.gripper.points, self.marks.points])

    def _draw(self, subject: Subject) -> None:
        """Set the mesh; corners with different normals at a crease become separate points."""
        corners, faces = subject.mesh.corner_normals, subject.mesh.contact_faces
        allowed = np.isin(np.arange(len(corners.corners)), faces)
        points, every = subject.mesh.vertices[corners.vertices], slice(None)
        parts = [
            pyvista.PolyData.from_regular_faces(points, corners.corners[rows].astype(int))
            for rows in (allowed, ~allowed, every)
        ]
        for actor, data in zip(self._surfaces, parts, strict=True):
            data.point_data.active_normals = -corners.normals
            actor.mapper.dataset = data
        self._data = parts[0]
        self._excluded.SetVisibility(not allowed.all())
        self._front.VisibilityOn()
        self._cut = None

    def _set_coordinates(self, subject: Subject, paint: Paint, model: GraspModel) -> None:
        """Set the texture coordinates of the corners, in the same array if it has their size."""
        assert self._data is not None
        of_corners = corner_coordinates(subject, paint, model)
        coordinates = self._data.active_texture_coordinates
        if coordinates is None:
            self._data.active_texture_coordinates = of_corners  # type: ignore[assignment]
        else:
            np.asarray(coordinates)[:] = of_corners
            self._data.GetPointData().GetTCoords().Modified()

    def _set_image(self, image: Bytes) -> None:
        """Set the texture image (h, w, 3), in the same array if it has its size."""
        height, width = image.shape[:2]
        rows = image.reshape(-1, 3)
        if self._image.dimensions == (width, height, 1):
            self._rows[:] = rows
        else:
            self._image.dimensions = (width, height, 1)
            self._image.clear_data()
            self._image["rgb"] = rows
            self._image.set_active_scalars("rgb")
            self._rows = self._image.point_data["rgb"]
        self._image.Modified()


def _same_shape(one: Subject, other: Subject | None) -> bool:
    """Whether two subjects have the same geometry, with other numbers."""
    return (
        other is not None
        and one.mesh.vertices is other.mesh.vertices
        and one.mesh.corner_normals is other.mesh.corner_normals
        and one.mesh.region is other.mesh.region
    )


def _rectangle(subject: Subject, point: Floats, normal: Floats) -> pyvista.PolyData:
    """Outline of a section, somewhat larger than the bounding box of the surface."""
    axis = int(np.argmax(np.abs(normal)))
    margin = FRAME_MARGIN * subject.mesh.size
    low, high = subject.bounds[0] - margin, subject.bounds[1] + margin
    low[axis] = high[axis] = point[axis]
    u, v = (index for index in range(3) if index != axis)
    corners = np.tile(low, (5, 1))
    corners[1:3, u] = high[u]
    corners[2:4, v] = high[v]
    outline: pyvista.PolyData = pyvista.MultipleLines(corners)
    return outline
