"""A surface in colours, with its grasp, hand and table, in one renderer.

There is one actor for each appearance; actors are drawn in the order in which they cover.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pyvista
from vtkmodules.vtkCommonDataModel import vtkPlane
from vtkmodules.vtkRenderingCore import vtkMapper

from grasp3d.arrays import Bytes, Floats
from grasp3d.hand.articulated_hand import ArticulatedHand
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
from grasp3d.mesh import ObjectMesh
from grasp3d.pictures.camera import AMBIENT, LIGHT, pixel_ratio
from grasp3d.pictures.colors import (
    HEX_PALETTE,
    NEUTRAL,
    PALETTE,
    Ramp,
    corner_codes,
    corner_values,
    faded,
    ramp_of,
)
from grasp3d.pictures.marks import (
    NO_CONTACTS,
    NO_POINTS,
    MarkedContacts,
    approach_mark,
    cone_marks,
    contact_marks,
)
from grasp3d.pictures.subject import Subject
from grasp3d.pictures.view_settings import Paint

DEPTH_OFFSET = -60000.0
"""Depth offset that draws faint layers in front of the surface [units of depth]."""

FAINT = 0.4
"""Opacity of marks behind the surface."""

INK, GREY, BLUE = "#1A1A1A", "#4A5562", "#0072B2"
"""Colours of marks; blue is for the safe cone, as no label has it."""

INSIDE, EDGE, FRAME = "#8C857B", "#2B2F33", "#5B6470"
"""Colours of back faces, which are visible in a section or if a mesh is open; of edges of hands;
and of the outline of a section."""


@dataclass(frozen=True)
class Look:
    """Appearance of a layer."""

    color: str | tuple[int, int, int] = "white"
    opacity: float = 1.0
    lit: bool = False
    """Whether its brightness depends on its direction."""
    culled: str = "none"
    """Faces that are not drawn: 'front' for rims around smaller marks, 'back' or 'none'."""
    width: float = 0.0
    """Width of lines [pixels at 72 per inch]; 0: the layer consists of faces."""
    mark: bool = False
    """Whether it covers what was drawn before it, and is faintly visible where the surface is in
    front of it."""


LOOKS = {
    "surface": Look(lit=True, culled="back"),
    "excluded": Look(lit=True, culled="back"),
    "inside": Look(INSIDE, lit=True, culled="front"),
    "outline": Look(FRAME, width=1.5),
    "table": Look(TABLE_COLOR, 0.6, lit=True),
    "arc": Look(ARC_COLOR, 0.4),
    "gripper": Look(lit=True, culled="back"),
    "links": Look(lit=True, culled="back"),
    "edges": Look(EDGE, width=1.2),
    "halo": Look(width=4.0),
    "nominal rims": Look(GREY, width=2.0),
    "safe rims": Look(BLUE, width=2.5),
    "extreme cones": Look(INK, width=1.2),
    "cones": Look(GREY, 0.22, mark=True),
    "safe cones": Look(BLUE, 0.5, mark=True),
    "contacts rims": Look(INK, culled="front", mark=True),
    "contacts": Look(mark=True),
    "fixed rims": Look(culled="front", mark=True),
    "fixed": Look(INK, mark=True),
    "approach": Look(ARC_COLOR, mark=True),
}
"""All layers; later ones in the list cover earlier ones."""

SURFACES = ("surface", "excluded", "inside")
LINES = ("halo", "nominal rims", "safe rims", "extreme cones")
MARKS = (*LINES, *(name for name, look in LOOKS.items() if look.mark))
"""Layers of a grasp."""


class Layers:
    """The layers in one renderer."""

    def __init__(self, renderer: pyvista.Renderer) -> None:
        renderer.UseOITOff()  # marks cover those made before them
        self.renderer = renderer
        self.actors: dict[str, pyvista.Actor] = {}
        self._faint: dict[str, pyvista.Actor] = {}
        for name, look in LOOKS.items():
            if look.mark and not self._faint:
                marks = {other: one for other, one in LOOKS.items() if one.mark}
                self._faint = {other: self._actor(one, faint=True) for other, one in marks.items()}
            self.actors[name] = self._actor(look)
        for name in SURFACES:
            self.actors[name].prop.interpolation = "Phong"
            self.actors[name].PickableOn()
        renderer.background_color = pyvista.Color("white")
        renderer.remove_all_lights()
        renderer.add_light(pyvista.Light(position=LIGHT, light_type="camera light", intensity=1.0))

    def show(self, name: str, data: pyvista.PolyData | None) -> None:
        """Draw a layer, or hide it if there are no data."""
        for actor in filter(None, (self.actors[name], self._faint.get(name))):
            actor.visibility = data is not None
            if data is not None:
                actor.mapper.dataset = data
            if LOOKS[name].width:
                actor.prop.line_width = LOOKS[name].width * pixel_ratio(self.renderer)

    def hide(self) -> None:
        """Hide everything."""
        for name in LOOKS:
            self.show(name, None)

    def _actor(self, look: Look, *, faint: bool = False) -> pyvista.Actor:
        """Create an actor without content."""
        actor = pyvista.Actor(mapper=pyvista.DataSetMapper())
        actor.mapper.SetScalarVisibility(False)  # noqa: FBT003
        drawn = actor.prop
        drawn.color, drawn.lighting, drawn.culling = look.color, look.lit, look.culled
        drawn.opacity = look.opacity * (FAINT if faint else 1.0)
        drawn.ambient, drawn.diffuse = AMBIENT, 1.0 - AMBIENT
        if faint:
            vtkMapper.SetResolveCoincidentTopologyToPolygonOffset()
            actor.mapper.SetRelativeCoincidentTopologyPolygonOffsetParameters(0.0, DEPTH_OFFSET)
        if look.mark:
            actor.ForceTranslucentOn()  # drawn in the order of creation
        actor.PickableOff()
        actor.VisibilityOff()
        self.renderer.AddActor(actor)
        return actor


def show_colors(actor: pyvista.Actor, name: str, *, of_points: bool) -> None:
    """Colour an actor by an array of its data: red, green and blue of points or of cells."""
    mapper = actor.mapper
    mapper.SetScalarVisibility(True)  # noqa: FBT003
    if of_points:
        mapper.SetScalarModeToUsePointFieldData()
    else:
        mapper.SetScalarModeToUseCellFieldData()
    mapper.SelectColorArray(name)
    mapper.SetColorModeToDirectScalars()


OPACITIES = {Part.PALM: 0.3, Part.FINGER: 0.7, Part.PAD: 0.9, Part.TIP: 0.9}
"""Opacities of the parts of a gripper, behind which the object remains visible."""

PARTS = np.array([(*COLORS[part], round(255.0 * OPACITIES[part])) for part in Part], dtype=np.uint8)
"""Red, green, blue and opacity of each part."""

OPAQUE = 255
"""Opacity of the links of hands with joints, which overlap; the palm is translucent."""

EDGE_ANGLE = 40.0
"""Angle between faces above which the edges of a hand are drawn [degrees]."""

ARC_RADIUS, ARC_INNER = 0.95, 0.35
"""Outer radius of the approach arc relative to the fingers' length, and inner radius relative to
the outer one."""

FRAME_MARGIN = 0.04
"""Distance of a section's outline from the object, relative to its size."""

SAME = 1e-9
"""Distance below which two contacts count as one, relative to the object's size."""


def _most_of(size: int = 64) -> Bytes:
    """Codes of the nearest corner in a square with U, M, S and unknown at its corners, (s, s).

    U is never beside unknown, so two triangles with three codes each are enough.
    """
    u, v = np.meshgrid(*2 * [(np.arange(size) + 0.5) / size])
    below, none = u + v <= 1.0, np.zeros_like(u)
    parts = np.where(below, [1.0 - u - v, u, v, none], [none, 1.0 - v, 1.0 - u, u + v - 1.0])
    return np.asarray(parts.argmax(axis=0), dtype=np.uint8)


MOST_OF = _most_of()


class Pane:
    """A surface, whole or cut by a section, with everything that is drawn around it.

    Args:
        renderer: Renderer that draws it.
    """

    def __init__(self, renderer: pyvista.Renderer) -> None:
        self.renderer = renderer
        self._layers = Layers(renderer)
        self._mesh: ObjectMesh | None = None
        self._held: tuple[object, ...] = ()
        self._table_points = self._marked = self.hand_points = NO_POINTS

    def show(self, subject: Subject, paint: Paint, *, stale: bool = False) -> None:
        """Draw a surface.

        Args:
            subject: The surface.
            paint: Quantity that colours show.
            stale: Use pale colours, as the surface does not belong to the current choices.
        """
        self._draw(subject.mesh)
        shade, ramp = faded if stale else np.asarray, ramp_of(subject, paint)
        if ramp is not None:
            self._paint_numbers(corner_values(subject, paint), ramp, shade)
        elif subject.poses is not None:
            self.show_colors(subject.mesh, np.array(NEUTRAL, dtype=np.uint8))
        else:
            self._paint_labels(corner_codes(subject), shade(PALETTE))

    def show_colors(self, mesh: ObjectMesh, colors: Bytes) -> None:
        """Draw a surface in colours of its vertices, shape (V, 3), or (3,) for all."""
        self._draw(mesh)
        actor = self._layers.actors["surface"]
        actor.texture = None
        every = np.broadcast_to(colors, (len(mesh.vertices), 3))
        actor.mapper.dataset.point_data["rgb"] = every[mesh.corner_normals.vertices]
        show_colors(actor, "rgb", of_points=True)

    def hide(self) -> None:
        """Hide everything."""
        self._layers.hide()
        self._mesh, self._held = None, ()

    def cut(self, plane: tuple[Floats, Floats] | None) -> None:
        """Cut the surface open.

        Args:
            plane: A point of the plane and its normal toward the visible part; None: no section.
        """
        mesh, layers = self.mesh, self._layers
        layers.actors["inside"].visibility = plane is not None or not mesh.report.closed
        layers.show("outline", None if plane is None else _rectangle(mesh, *plane))
        for name in (*SURFACES, "table"):
            mapper = layers.actors[name].mapper
            mapper.RemoveAllClippingPlanes()
            if plane is not None:
                cutting = vtkPlane()
                cutting.SetOrigin(*plane[0])
                cutting.SetNormal(*plane[1])
                mapper.AddClippingPlane(cutting)

    def hold(
        self,
        grasp: MarkedContacts | None,
        hand: Hand | None,
        table: Table | None,
        fixed: Floats = NO_POINTS,
    ) -> None:
        """Draw a grasp: its contacts, with the hand and its approach, or with friction cones.

        Args:
            grasp: The grasp; None: there is none.
            hand: The hand.
            table: The table; None: it is not drawn.
            fixed: Contact points of fixed fingers, shape (n, 3).
        """
        grasp = grasp or NO_CONTACTS
        before, self._held = self._held, (self.mesh, grasp.drawn, hand, table, fixed.tobytes())
        if before != self._held:
            self._show_table(table)
            self._show_hand(hand, grasp.held)
            self._show_marks(grasp, hand, fixed)

    @property
    def mesh(self) -> ObjectMesh:
        """The displayed mesh."""
        assert self._mesh is not None
        return self._mesh

    @property
    def points(self) -> Floats:
        """Points of the object and the table, shape (n, 3)."""
        return np.concatenate([_drawn(self.mesh), self._table_points])

    @property
    def beside(self) -> Floats:
        """Points that are drawn beside the object, of a hand or of arrows, shape (n, 3)."""
        return np.concatenate([self.hand_points, self._marked])

    def _draw(self, mesh: ObjectMesh) -> None:
        """Set the mesh; corners with different normals at a crease become separate points."""
        if mesh is self._mesh:
            return
        self._mesh, corners = mesh, mesh.corner_normals
        allowed = np.isin(np.arange(len(corners.corners)), mesh.contact_faces)
        for name, rows in zip(SURFACES, (allowed, ~allowed, allowed | True), strict=True):
            data = pyvista.PolyData.from_regular_faces(
                _drawn(mesh), corners.corners[rows].astype(int)
            )
            data.point_data.active_normals = -corners.normals
            self._layers.show(name, data if name != "excluded" or not allowed.all() else None)
        self._layers.actors["excluded"].prop.color = HEX_PALETTE[-1]

    def _paint_labels(self, codes: Bytes, palette: Bytes) -> None:
        """Colour each point of a face by the code of its nearest corner."""
        actor = self._layers.actors["surface"]
        actor.mapper.dataset.active_texture_coordinates = np.column_stack([codes % 2, codes // 2])
        actor.texture = pyvista.Texture(palette[MOST_OF][::-1].copy())
        actor.texture.interpolate = actor.texture.repeat = False
        actor.mapper.SetScalarVisibility(False)  # noqa: FBT003

    def _paint_numbers(self, values: Floats, ramp: Ramp, shade: Callable[[Bytes], Bytes]) -> None:
        """Colour the surface by numbers at its corners, interpolated before they become colours."""
        actor = self._layers.actors["surface"]
        actor.texture, mapper, colors = None, actor.mapper, shade(ramp.colors)
        mapper.dataset.point_data["value"] = values
        table = pyvista.LookupTable(n_values=len(colors))
        table.values = np.column_stack([colors, np.full(len(colors), OPAQUE, dtype=np.uint8)])
        table.nan_color = shade(PALETTE)[-1] / 255.0
        table.scalar_range = ramp.minimum, ramp.maximum
        mapper.lookup_table = table
        mapper.SetScalarVisibility(True)  # noqa: FBT003
        mapper.SetScalarModeToUsePointFieldData()
        mapper.SelectColorArray("value")
        mapper.SetColorModeToMapScalars()
        mapper.SetUseLookupTableScalarRange(True)  # noqa: FBT003
        mapper.SetInterpolateScalarsBeforeMapping(True)  # noqa: FBT003

    def _show_table(self, table: Table | None) -> None:
        plate = None if table is None else table_triangles(table, self.mesh)
        self._layers.show("table", None if plate is None else surface_of(plate))
        self._table_points = plate.vertices if plate else NO_POINTS

    def _show_hand(self, hand: Hand | None, pose: GripperPose | None) -> None:
        layers, self.hand_points = self._layers, NO_POINTS
        for name in ("gripper", "links", "edges", "arc"):
            layers.show(name, None)
        if hand is None or pose is None:
            return
        solid = pose.triangles(hand)
        parts = solid.parts
        colors = PARTS[parts]
        if pose.has_joints:
            colors[parts != Part.PALM, 3] = OPAQUE
        for link, color in pose.colors.items():
            if pose.has_joints:
                colors[solid.links == link] = (*color, OPAQUE)
            else:
                colors[parts != Part.PALM, :3] = color
        opaque = colors[:, 3] == OPAQUE
        for name, chosen in (("gripper", ~opaque), ("links", opaque)):
            if chosen.any():
                some = surface_of(replace(solid, faces=solid.faces[chosen]))
                some.cell_data["color"] = colors[chosen]
                layers.show(name, some)
                show_colors(layers.actors[name], "color", of_points=False)
        layers.show("edges", surface_of(solid).clean().extract_feature_edges(
            feature_angle=EDGE_ANGLE, boundary_edges=False, manifold_edges=False
        ))  # fmt: skip
        framed = np.isin(parts, (Part.PALM, Part.FINGER))
        if isinstance(hand, ArticulatedHand):  # a forearm would make the fingers look small
            palm = hand.link_names.index(hand.palm)
            framed = (parts != Part.PALM) | (solid.links == palm)
        self.hand_points = solid.vertices[np.unique(solid.faces[framed])]
        if pose.approach_margin > 0.0:
            radius, margin = ARC_RADIUS * hand.finger_length, pose.approach_margin
            arc = approach_triangles(pose.pose, margin, radius=radius, inner=ARC_INNER)
            layers.show("arc", surface_of(arc))

    def _show_marks(self, grasp: MarkedContacts, hand: Hand | None, fixed: Floats) -> None:
        """Mark contacts, and the approach of a gripper or, without a gripper, friction cones."""
        size, held, several = self.mesh.size, hand and grasp.held, len(grasp.points) > 1
        gaps = np.linalg.norm(grasp.points[:, None] - fixed, axis=2)
        apart = (gaps > SAME * size).all(axis=1)
        free = MarkedContacts(grasp.points[apart], grasp.normals[apart])
        gaps = np.linalg.norm(self.mesh.vertices - fixed[:, None], axis=2)
        fingers = MarkedContacts(fixed, self.mesh.normals[gaps.argmin(axis=1)])
        lines = len(free.points) > 1 and not (held and held.has_joints)
        cones = NO_CONTACTS if held else grasp
        drawn = cone_marks(cones, size) | contact_marks("fixed", fingers, size, wide=1.15)
        drawn |= contact_marks("contacts", free, size, arrows=several, lines=lines)
        if held and hand:
            drawn |= approach_mark(held, hand.finger_length)
        for name in MARKS:
            self._layers.show(name, drawn.get(name))
        outside = cones if several else NO_CONTACTS
        self._marked = np.concatenate([outside.tails(size), fingers.tails(size)])


def surface_of(triangles: Triangles) -> pyvista.PolyData:
    """Return triangles as a PyVista surface."""
    faces = triangles.faces.astype(int)
    surface: pyvista.PolyData = pyvista.PolyData.from_regular_faces(triangles.vertices, faces)
    return surface


def _drawn(mesh: ObjectMesh) -> Floats:
    """Vertices of the corners, shape (C, 3)."""
    return mesh.vertices[mesh.corner_normals.vertices]


def _rectangle(mesh: ObjectMesh, point: Floats, normal: Floats) -> pyvista.PolyData:
    """Outline of a section, slightly larger than the bounding box of the surface."""
    axis, points = int(np.argmax(np.abs(normal))), _drawn(mesh)
    margin = FRAME_MARGIN * mesh.size
    low, high = points.min(axis=0) - margin, points.max(axis=0) + margin
    low[axis] = high[axis] = point[axis]
    u, v = (index for index in range(3) if index != axis)
    corners = np.tile(low, (5, 1))
    corners[1:3, u] = high[u]
    corners[2:4, v] = high[v]
    outline: pyvista.PolyData = pyvista.MultipleLines(corners)
    return outline
