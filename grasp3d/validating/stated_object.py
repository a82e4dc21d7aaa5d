"""Objects of grasps: their mesh, with the scale, mass and centre of mass that a file states."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from grasp3d.arrays import Floats, locked
from grasp3d.errors import ContactError
from grasp3d.grasps.pose_evaluation import in_stated_scale
from grasp3d.grasps.poses import GraspPoses
from grasp3d.hand.metres import metres_per_unit
from grasp3d.loads import Load
from grasp3d.mesh import MeshSource, ObjectMesh, load_mesh
from grasp3d.mesh.masses import loaded_mesh, mass_of
from grasp3d.settings import MeshOptions

FAR = 2.0
"""Distance of a stated centre of mass from the object's centre, in object sizes, that cannot be
meant."""


@dataclass(frozen=True, eq=False)
class StatedObject:
    """An object as the grasps on it are evaluated."""

    mesh: ObjectMesh
    load: Load | None
    """What each grasp must hold; None: the mass is not known, and no load was given."""
    mass: float | None
    """[kg]; None: not known."""
    mass_from: str
    """given, file or empty."""
    center_from: str
    """given, file, or what the mesh's report says: volume or surface."""


def stated_object(
    source: MeshSource, poses: GraspPoses, options: MeshOptions | None, load: Load | None
) -> StatedObject:
    """Read the mesh of some poses, and take over what their file states of the object.

    What the options state is used first: a mass or density of `load`, a centre of mass of
    `options`.

    Args:
        source: The mesh.
        poses: Poses on it; `object_scale`, and `mass` [kg] and `com` [m] of their settings, as
            ACRONYM states them, in the frame of the scaled mesh.
        options: How the mesh is read.
        load: What each grasp must hold.

    Raises:
        MeshError: It is no mesh.
        SettingError: Its unit is not known, or the load needs what is not known.
        ContactError: The file states an impossible mass or centre of mass.
    """
    mesh = in_stated_scale(load_mesh(source, options), poses)
    metres_per_unit(mesh)
    given = mesh.report.center_mass_from == "given"
    mesh = mesh if given else _with_center(mesh, poses)
    center_from = mesh.report.center_mass_from
    mass, origin = _number(poses.settings.get("mass")), ""
    if load is not None and (load.mass is not None or load.density is not None):
        origin = "given"
    elif mass is not None and center_from != "surface":  # else it is not known what it pulls on
        load, origin = replace(load or Load(), mass=mass), "file"
    mesh, load = loaded_mesh(mesh, load)
    return StatedObject(
        mesh=mesh,
        load=load,
        mass=None if load is None else mass_of(mesh, load),
        mass_from=origin,
        center_from="file" if center_from == "given" and not given else center_from,
    )


def _with_center(mesh: ObjectMesh, poses: GraspPoses) -> ObjectMesh:
    """The mesh with the centre of mass that a file states."""
    stated = poses.settings.get("com")
    if stated is None:
        return mesh
    center = _point(stated) / metres_per_unit(mesh)
    away = float(np.linalg.norm(center - mesh.center)) / mesh.size
    if not away <= FAR:
        raise ContactError(
            f"the centre of mass that the grasps state (object/com) is {away:.3g} object sizes "
            f"away from {mesh.report.source}: is it the right mesh, in the right unit?"
        )
    x, y, z = center.tolist()
    return replace(
        mesh,
        center_mass=locked(center),
        options=replace(mesh.options, center_of_mass=(x, y, z)),
        report=replace(mesh.report, center_mass_from="given"),
    )


def _number(value: Any) -> float | None:
    """A mass above 0. Raises ContactError."""
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 < value < 1e9:
        raise ContactError(f"the mass that the grasps state must be above 0 kg; got {value!r}")
    return float(value)


def _point(value: Any) -> Floats:
    """Three finite numbers. Raises ContactError."""
    try:
        point = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        point = np.zeros(0)
    if point.shape != (3,) or not np.isfinite(point).all():
        raise ContactError("the centre of mass that the grasps state must be three numbers")
    return point
