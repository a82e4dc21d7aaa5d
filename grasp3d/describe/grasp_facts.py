"""The numbers of one grasp, in words: by the declarations of its columns."""

import math

import numpy as np

from grasp3d.arrays import Floats
from grasp3d.grasps.evaluated_poses import EvaluatedPoses
from grasp3d.mesh import ObjectMesh
from grasp3d.quality.grip_forces import Resistance
from grasp3d.surface.fields import CRITICAL_ANGLE_BEST, NONE, OF_ONE, REASON, STATED_LABEL
from grasp3d.surface.grasp_table import GraspTable
from grasp3d.surface.load_result import HARD_FINGERS, LoadResult

ROUNDING = 1e-9
"""Coordinates that are rounding errors of 0, relative to the object's size."""


def facts(grasps: GraspTable | EvaluatedPoses, row: int) -> dict[str, str]:
    """Names and values, with their units, of one grasp; those that are not known are left out.

    Args:
        grasps: Grasps, or poses.
        row: Number of the grasp.

    Example:
        >>> import trimesh
        >>> import grasp3d
        >>> from grasp3d.describe import facts
        >>> box = grasp3d.load_mesh(trimesh.creation.box([0.08, 0.05, 0.03]), unit="m")
        >>> grasps = grasp3d.best_grasps(grasp3d.label_surface(box), 1)
        >>> facts(grasps, 0)["opening"]
        '80 mm'
    """
    metres, found = grasps.mesh.unit is not None, dict[str, str]()
    one = grasps.take(np.array([row]))
    for field in OF_ONE if isinstance(one, GraspTable) else one.fields:
        name = field.listed or field.heading
        if not name or field in {STATED_LABEL, REASON}:
            continue
        values = field.values_of(one)
        text = NONE if values is None else field.text(values[0], metres=metres)
        unit = field.title(metres=metres).partition("\n")[2]
        same = field.name == CRITICAL_ANGLE_BEST.name and text in found.values()
        if text not in {NONE, ""} and not same:
            found[name] = f"{text} {unit}".strip()
    return found


def position_text(point: Floats, mesh: ObjectMesh) -> str:
    """Coordinates with four digits, and their unit; rounding errors of 0 are 0."""
    rounded = np.where(np.abs(point) < ROUNDING * mesh.size, 0.0, point)
    factor, unit = (1000.0, " mm") if mesh.unit else (1.0, "")
    return f"({', '.join(f'{factor * value:.4g}' for value in rounded)}){unit}"


def load_sentence(load_result: LoadResult, row: int) -> str:
    """Whether the force at hand holds the load, or why none does; empty: that is unknown.

    Args:
        load_result: What some grasps hold.
        row: Number of the grasp.
    """
    case, of = load_result.case, "at all normals within the sensor resolution"
    force, least, largest = (
        float(one[row])
        for one in (
            load_result.grip_force, load_result.grip_force_least, load_result.grip_force_largest,
        )
    )  # fmt: skip
    if math.isinf(force):
        where = "" if math.isinf(least) else " at the nominal normals"
        return f"No force holds it{where}: {_why_none(load_result, row)}."
    if math.isnan(force) or case.available is None or not case.decided:
        return ""
    mass = f" of {case.to_hold}" if case.by_mass else ""
    if largest > case.available:
        of = "at some of the normals within the sensor resolution only"
        if least > case.available:
            of = "at none of the normals within the sensor resolution"
    return f"With {case.at_hand} the load{mass} is held {of}."


def _why_none(load_result: LoadResult, row: int) -> str:
    codes = load_result.resistance
    if codes is not None and codes[row] == Resistance.NO_SUCH_WRENCH:
        return HARD_FINGERS if load_result.case.hard else "they resist no torque about one axis"
    return "the fingers can only push, and the contacts cannot push against all of the load"
