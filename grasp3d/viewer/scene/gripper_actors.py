"""A gripper at a grasp, its free approach angles, and the table."""

import numpy as np
import pyvista

from grasp3d.hand.gripper_pose import GripperPose
from grasp3d.hand.hand import Hand
from grasp3d.hand.shapes import (
    ARC_COLOR,
    TABLE_COLOR,
    approach_triangles,
    hand_triangles,
    table_triangles,
)
from grasp3d.hand.table import Table
from grasp3d.hand.triangles import COLORS, Part, Triangles
from grasp3d.settings.lengths import METRES
from grasp3d.viewer.scene.framing import pixel_ratio
from grasp3d.viewer.scene.marks import NO_POINTS, new_actor
from grasp3d.viewer.subjects.subject import Subject

ARC_OPACITY, TABLE_OPACITY = 0.4, 0.6
OPACITIES = {Part.PALM: 0.3, Part.FINGER: 0.7, Part.PAD: 0.9, Part.TIP: 0.9}
"""Opacities of the parts of a gripper: what it holds remains visible behind it."""

PALETTE = np.array(
    [(*COLORS[part], round(255.0 * OPACITIES[part])) for part in Part], dtype=np.uint8
)
"""Red, green, blue and opacity of the parts."""

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
        self._edges = new_actor(renderer, EDGE, lighting=False)
        mapper = self._gripper.mapper
        mapper.SetScalarVisibility(True)  # noqa: FBT003
        mapper.SetScalarModeToUseCellFieldData()
        mapper.SelectColorArray("color")  # red, green, blue, opacity
        mapper.SetColorModeToDirectScalars()
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
        self._show_gripper(subject, hand, pose)
        return len(self.points) > 0

    def hide(self) -> None:
        """Show nothing."""
        self._drawn = (None,) * 3
        self.points = self.table_points = NO_POINTS
        for actor in (self._table, self._arc, self._gripper, self._edges):
            actor.visibility = False

    def _show_table(self, subject: Subject, table: Table | None) -> None:
        self._table.visibility = table is not None
        self.table_points = NO_POINTS
        if table is not None:
            plate = table_triangles(table, subject.mesh)
            self._table.mapper.dataset = surface_of(plate)
            self.table_points = plate.vertices

    def _show_gripper(self, subject: Subject, hand: Hand | None, pose: GripperPose | None) -> None:
        for actor in (self._gripper, self._edges, self._arc):
            actor.visibility = False
        self.points = NO_POINTS
        if hand is None or pose is None or subject.mesh.unit is None:
            return
        solid = hand_triangles(hand, pose.opening, pose=pose.pose, unit=subject.mesh.unit)
        shape, parts = surface_of(solid), solid.parts
        shape.cell_data["color"] = PALETTE[parts]
        self._gripper.mapper.dataset = shape
        self._edges.mapper.dataset = shape.extract_feature_edges(
            feature_angle=EDGE_ANGLE, boundary_edges=False, manifold_edges=False
        )
        self._edges.prop.line_width = EDGE_WIDTH * pixel_ratio(self._renderer)
        self._gripper.visibility = self._edges.visibility = True
        self.points = solid.vertices[np.unique(solid.faces[parts <= Part.FINGER])]
        if pose.arcs:
            radius = ARC_RADIUS * hand.finger_length / METRES[subject.mesh.unit]
            arc = approach_triangles(pose.pose, pose.arcs, radius=radius, inner=ARC_INNER)
            self._arc.mapper.dataset = surface_of(arc)
            self._arc.visibility = True


def surface_of(triangles: Triangles) -> pyvista.PolyData:
    """Triangles as a surface of PyVista."""
    faces = triangles.faces.astype(int)
    surface: pyvista.PolyData = pyvista.PolyData.from_regular_faces(triangles.vertices, faces)
    return surface
