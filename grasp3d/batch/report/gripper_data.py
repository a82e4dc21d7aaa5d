"""Data of the object page that a gripper and a load add: shapes, openings of grasps, forces."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from grasp3d.arrays import Floats
from grasp3d.batch.row import BestGrasp
from grasp3d.grasps.verdict import HoldingVerdict
from grasp3d.hand.hand import Hand
from grasp3d.hand.shapes import hand_triangles, table_triangles
from grasp3d.hand.triangles import Part, Triangles
from grasp3d.settings.lengths import METRES, Unit
from grasp3d.surface.held_area import held_fractions

if TYPE_CHECKING:
    from grasp3d.surface.labels import SurfaceLabels

DIGITS = 6
"""Significant digits of coordinates, relative to the largest one."""


def gripper_data(labels: "SurfaceLabels") -> dict[str, Any] | None:
    """The shape of the gripper in its own frame, and the table; None: no gripper.

    Returns:
        `vertices` at an opening of 0, in the mesh's unit, and `shifts`, by which openings are
        multiplied and added to x: 0 for the palm, -0.5 and 0.5 for the fingers; `faces`, and
        `parts`, a name for each face; `fingers`, their length; `table`, with vertices and faces in
        the frame of the mesh, or None.
    """
    scene, unit = labels.scene, labels.mesh.unit
    if scene is None or unit is None:
        return None
    hand, table = scene.hand, scene.table
    closed = hand_triangles(hand, 0.0, unit=unit)
    opened = hand_triangles(hand, 1.0, unit=unit)
    names = [part.name.lower() for part in Part]
    return {
        "name": hand.name,
        "shifts": np.round((opened.vertices - closed.vertices)[:, 0], DIGITS).tolist(),
        "parts": [names[part] for part in closed.parts],
        "fingers": hand.finger_length / METRES[unit],
        "table": None if table is None else _shape(table_triangles(table, labels.mesh)),
        **_shape(closed),
    }


def drawn_openings(grasps: Sequence[BestGrasp], labels: "SurfaceLabels") -> list[float | None]:
    """Opening at which the gripper is drawn at each grasp [mesh unit]; None: it is not drawn."""
    scene, unit = labels.scene, labels.mesh.unit
    if scene is None or unit is None:
        return [None] * len(grasps)
    return [None if not grasp.pose else _drawn_opening(grasp, scene.hand, unit) for grasp in grasps]


def _drawn_opening(grasp: BestGrasp, hand: Hand, unit: Unit) -> float:
    """Opening at which the hand holds the contacts."""
    points, outward = np.array(grasp.points), np.array(grasp.normals)
    internal = np.array([float(outward[0] @ (points[1] - points[0])) > 0.0])
    return float(hand.opening_at(points[None], outward[None], internal, METRES[unit])[0])


def _shape(triangles: Triangles) -> dict[str, list[Any]]:
    """Coordinates and corners, one after the other."""
    return {
        "vertices": _rounded(triangles.vertices).ravel().tolist(),
        "faces": triangles.faces.ravel().tolist(),
    }


def _rounded(values: Floats) -> Floats:
    largest = float(np.abs(values).max(initial=0.0)) or 1.0
    return np.asarray(np.round(values, DIGITS - 1 - int(np.floor(np.log10(largest)))))


def load_data(labels: "SurfaceLabels") -> dict[str, Any] | None:
    """The load of a labelled surface; None: there is none.

    Returns:
        `text`, the verdict as a sentence; `mass` [kg] and `available` [N], None where not known;
        `held`, the area fractions of S, M and U with the force at hand, or None; `how` the forces
        are known; `remedy`, what would help where most grasps hold nothing, or empty.
    """
    holding = labels.holding
    if holding is None:
        return None
    return {
        "text": str(HoldingVerdict.of(holding)),
        "mass": holding.mass,
        "available": holding.available,
        "held": held_fractions(labels),
        "how": holding.how,
        "remedy": holding.remedy,
    }
