"""Data of the object page: surface, critical angles and grasps of one mesh."""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from grasp3d.batch.report.packing import STEPS, json_text, pack_arrays, quantised
from grasp3d.batch.row import BestGrasp
from grasp3d.settings import search_cone
from grasp3d.settings.model_text import SAFE_LABELS, error_texts

if TYPE_CHECKING:
    from grasp3d.surface.labels import SurfaceLabels

FORMAT = 1
"""Version of the script's format; the page refuses other versions."""

CALL = "grasp3dObject"
"""Name of the page's function that the script calls."""

_SMALL = 2**16


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
    # Imported here: the pages of a library need no meshes.
    from grasp3d.batch.report.gripper_data import drawn_openings, gripper_data, load_data

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
        "repairs": [str(step) for step in mesh.report.repairs],
        "warnings": list(mesh.report.warnings),
        "gripper": gripper_data(labels),
        "load": load_data(labels),
        "grasps": [
            vars(grasp) | {"drawn_opening": opening}
            for grasp, opening in zip(grasps, drawn_openings(grasps, labels), strict=True)
        ],
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
        "reason": labels.reason[vertices].astype(np.uint8),
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
