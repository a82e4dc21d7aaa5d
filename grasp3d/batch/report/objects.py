"""Data of the object page: surface, critical angles, grasps, gripper and load of one mesh."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from grasp3d.arrays import Floats
from grasp3d.batch.report.packing import STEPS, json_text, pack_arrays, quantised
from grasp3d.batch.row import BestGrasp
from grasp3d.grasps.causes import Cause, cause_codes
from grasp3d.grasps.verdict import verdict_of
from grasp3d.hand.gripper_pose import GripperPose
from grasp3d.hand.hand import Hand
from grasp3d.hand.shapes import hand_triangles, table_triangles
from grasp3d.hand.triangles import Part, Triangles
from grasp3d.rendering.opengl import UPRIGHT, view_axes
from grasp3d.settings import search_cone
from grasp3d.settings.lengths import METRES, Unit
from grasp3d.settings.model_text import SAFE_LABELS, error_texts
from grasp3d.surface.area_statistics import held_fractions

if TYPE_CHECKING:
    from grasp3d.surface.labels import SurfaceLabels

FORMAT = 2
"""Version of the script's format; the page refuses other versions."""

CALL = "grasp3dObject"
"""Name of the page's function that the script calls."""

_SMALL = 2**16

DIGITS = 6
"""Significant digits of coordinates, relative to the largest one."""


def object_script(labels: "SurfaceLabels", name: str, grasps: Sequence[BestGrasp]) -> bytes:
    """Write the page's data of a labelled surface, as a script with one function call.

    Vertices without faces are left out. Positions are quantised to 16 bits over the surface's
    bounding box; angles, epsilon, openings and area weights are floats of 32 bits; where contact
    locations are uncertain, the angles include them at the labels' location error. With a gripper
    its shape and that of the table are added, and the pose of each of the best grasps; with a load
    its numbers, and the grip force and payload at each vertex.

    Args:
        labels: The labelled surface.
        name: Name of the mesh.
        grasps: Best grasps of the mesh, the best first.

    Returns:
        JavaScript in ASCII; equal labels give equal scripts.
    """
    mesh, model = labels.mesh, labels.model
    vertices = np.unique(mesh.faces)
    low = mesh.vertices[vertices].min(axis=0)
    step = np.maximum(np.ptp(mesh.vertices[vertices], axis=0), np.finfo(np.float64).tiny) / STEPS
    only_fingers = replace(model, normal_error=0.0, location_error=0.0)
    arrays, data = pack_arrays(_arrays(labels, vertices, low, step))
    header = {
        "format": FORMAT,
        "name": name,
        "unit": mesh.unit,
        "size": mesh.size,
        "low": low.tolist(),
        "step": step.tolist(),
        "friction": model.friction,
        "resolution": model.sensor_resolution,
        "frictionError": model.friction_error,
        "normalError": model.normal_error,
        "locationError": model.location_error,
        "perFinger": "; ".join(error_texts(only_fingers, mesh.unit)),
        "limits": {
            "stable": model.effective_friction_angle,
            "widest": model.widest_friction_angle,
        },
        "fingers": model.fingers,
        "method": model.method,
        "certainty": SAFE_LABELS if model.certainty == "safe" else "",
        "cone": max(labels.search.cone, search_cone(model)),
        "creaseAngle": mesh.options.crease_angle,
        "closed": mesh.report.closed,
        "causes": list(Cause),
        "repairs": [str(step) for step in mesh.report.repairs],
        "warnings": list(mesh.report.warnings),
        "gripper": gripper_data(labels),
        "load": _load_data(labels),
        "up": (UPRIGHT if labels.scene is None else labels.scene.up).tolist(),
        "grasps": _grasp_data(grasps, labels),
        "arrays": arrays,
    }
    return f'{CALL}({json_text(header)},"{data}");\n'.encode("ascii")


def _arrays(
    labels: "SurfaceLabels",
    vertices: npt.NDArray[np.int64],
    low: npt.NDArray[np.float64],
    step: npt.NDArray[np.float64],
) -> dict[str, npt.NDArray[Any]]:
    """Values at the vertices with faces, in the order of the mesh."""
    mesh, model = labels.mesh, labels.model
    count = len(mesh.vertices)
    row = np.zeros(count, dtype=np.uint16 if len(vertices) <= _SMALL else np.uint32)
    row[vertices] = np.arange(len(vertices))
    areas = mesh.vertex_areas
    arrays: dict[str, npt.NDArray[Any]] = {
        "positions": quantised(mesh.vertices[vertices], low, step),
        "faces": row[mesh.faces],
        "weights": (areas / areas.sum())[vertices].astype(np.float32),
        "worst": labels.critical_angle[vertices].astype(np.float32),
        "epsilon": labels.epsilon[vertices].astype(np.float32),
        "opening": labels.opening[vertices].astype(np.float32),
        "partners": quantised(labels.partners[vertices], low, step),
        "cause": cause_codes(labels)[vertices],
    }
    holding = labels.holding
    if holding is not None:
        arrays["force"] = holding.grip_force_largest[vertices].astype(np.float32)
        if holding.has_payload:
            arrays["payload"] = holding.payload[vertices].astype(np.float32)
    if labels.reach is not None:
        arrays["margin"] = labels.reach.approach_margin[vertices].astype(np.float32)
    if not np.array_equal(labels.critical_angle[vertices], labels.critical_angle_best[vertices]):
        arrays["best"] = labels.critical_angle_best[vertices].astype(np.float32)
    if not model.is_uniform:
        worst, best = labels.located_angles
        arrays["locatedWorst"] = worst[vertices].astype(np.float32)
        if not np.array_equal(worst[vertices], best[vertices]):
            arrays["locatedBest"] = best[vertices].astype(np.float32)
    if len(vertices) < count:
        arrays["numbers"] = vertices.astype(np.uint32)
    return arrays


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


def _grasp_data(grasps: Sequence[BestGrasp], labels: "SurfaceLabels") -> list[dict[str, Any]]:
    """The grasps, with the opening at which each is drawn, and the direction toward the camera."""
    from grasp3d.rendering.grasp_views import (
        GraspViews,  # imported here: writing pages needs no compiler
    )

    views, data = GraspViews(labels.mesh, labels.scene) if grasps else None, []
    for grasp, opening in zip(grasps, drawn_openings(grasps, labels), strict=True):
        assert views is not None
        held = None
        if opening is not None:
            pose = np.reshape(grasp.pose, (4, 4))
            held = GripperPose(pose, opening, math.nan, math.nan, math.nan)
        view = views.best(np.array(grasp.points), -np.array(grasp.normals), held)
        toward = view_axes(view, views.up)[2].round(DIGITS).tolist()
        data.append(vars(grasp) | {"drawn_opening": opening, "toward": toward})
    return data


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


def _load_data(labels: "SurfaceLabels") -> dict[str, Any] | None:
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
        "text": str(verdict_of(labels)),
        "mass": holding.mass,
        "available": holding.available,
        "held": held_fractions(labels),
        "how": holding.how,
        "remedy": holding.remedy,
    }
