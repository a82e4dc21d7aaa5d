"""Meshes and labelled surfaces as objects of other libraries: Arrow, trimesh, PyVista.

The libraries are imported when they are used.
"""

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from grasp3d.arrays import Bytes, Floats, Ints
from grasp3d.hand.scene import Scene, scene_settings
from grasp3d.loads import load_settings
from grasp3d.mesh import ObjectMesh
from grasp3d.settings import GraspModel, Sampling
from grasp3d.settings.lengths import one_line
from grasp3d.settings.parsing import plain_values
from grasp3d.stability.label import COLORS, Label, Mode
from grasp3d.surface.epsilon import EPSILON_RTOL
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.surface.vertex_grasps import Reason
from grasp3d.system.versions import package_version

if TYPE_CHECKING:
    import pyvista
    import trimesh

Arrays = dict[str, npt.NDArray[Any]]

SETTING = "setting_"
"""Start of the names of settings beside arrays, some of which have the name of a setting."""

_REACH_FIELDS = ("approach", "tcp", "closing", "approach_margin", "depth", "pregrasp_opening")
"""Arrays of a gripper's poses, for labels with a gripper."""

LOCATED = ("located_angle", "located_angle_best")
"""Arrays of labels with uncertain contact locations or fingers that differ."""

_FIELDS = ("label", "critical_angle", "critical_angle_best", "max_resolution", "margin", "epsilon",
           "epsilon_min", "epsilon_max", "opening", "grip", "reason")  # fmt: skip


def mesh_to_trimesh(mesh: ObjectMesh) -> "trimesh.Trimesh":
    """The surface as a trimesh, with outward normals and its unit."""
    import trimesh

    made = trimesh.Trimesh(
        mesh.vertices, mesh.faces, vertex_normals=-mesh.normals, process=False, validate=False
    )
    if mesh.unit is not None:
        made.units = mesh.unit
    return made


def mesh_to_polydata(mesh: ObjectMesh) -> "pyvista.PolyData":
    """The surface as PyVista data, with outward normals as the array `normal`."""
    return _polydata(mesh.vertices, mesh.faces, {"normal": -mesh.normals})


def labels_to_table(labels: SurfaceLabels) -> Any:
    """Arrow table with a row for each vertex, as in the file that `write_fields` writes."""
    from grasp3d.tables import table_of_arrays

    arrays = vertex_arrays(labels)
    columns = _by_axis("", labels.mesh.vertices, "f8") | _by_axis("n", arrays["normal"], "f4")
    columns["area"] = labels.mesh.vertex_areas.astype("f4")
    for name in (*_FIELDS, *located_arrays(labels)):
        values = arrays[name]
        columns[name] = values.astype("f4") if values.dtype.kind == "f" else values
    for finger in range(labels.partners.shape[1]):
        head, normals = f"partner_{finger + 2}_", arrays["partner_normals"][:, finger]
        columns |= _by_axis(head, labels.partners[:, finger], "f8")
        columns |= _by_axis(f"{head}n", normals, "f4")
    for name in _REACH_FIELDS if labels.reach is not None else ():
        values = arrays[name]
        if values.ndim == 2:
            columns |= _by_axis(f"{name}_", values, "f8")
        else:
            columns[name] = values.astype("f4")
    for name, values in force_arrays(labels).items():
        columns[name] = values.astype("f4") if values.dtype.kind == "f" else values
    letters = [label.name for label in sorted(Label)]
    texts = {
        "label": letters,
        "label_with_force": letters,
        "reason": [reason.name.lower() for reason in sorted(Reason)],
    }
    return table_of_arrays(columns, texts, settings=settings_of(labels))


def labels_to_trimesh(labels: SurfaceLabels) -> "trimesh.Trimesh":
    """The surface as a trimesh, coloured by label, with every array as a vertex attribute."""
    from trimesh.visual import ColorVisuals

    made = mesh_to_trimesh(labels.mesh)
    arrays = by_finger(vertex_arrays(labels))
    made.visual = ColorVisuals(made, vertex_colors=arrays.pop("color"))
    made.vertex_attributes.update(arrays)
    made.metadata["grasp3d"] = settings_of(labels)
    return made


def labels_to_polydata(labels: SurfaceLabels) -> "pyvista.PolyData":
    """The surface as PyVista data, with the arrays of the file that `write_vtp` writes."""
    # An infinite value would stretch the colour map; nan has a separate colour.
    arrays = {
        name: np.where(np.isinf(values), math.nan, values) if values.dtype.kind == "f" else values
        for name, values in by_finger(vertex_arrays(labels)).items()
    }
    data = _polydata(labels.mesh.vertices, labels.mesh.faces, arrays)
    for key, value in settings_of(labels).items():
        data.field_data[f"{SETTING}{key}"] = [str(value)]
    return data


def label_colors(labels: SurfaceLabels) -> Bytes:
    """Colour of each vertex by its label, red, green, blue, shape (V, 3)."""
    table = np.array([COLORS[label] for label in sorted(COLORS)], dtype=np.uint8)
    return table[labels.label]


def vertex_arrays(labels: SurfaceLabels) -> Arrays:
    """Collect all arrays over the vertices by name; normals point outward, as in files.

    `partners` and `partner_normals` have a row for each of the other fingers, (V, n - 1, 3).
    """
    return {
        "normal": -labels.mesh.normals,
        "color": label_colors(labels),
        "label": labels.label,
        "critical_angle": labels.critical_angle,
        "critical_angle_best": labels.critical_angle_best,
        "max_resolution": labels.max_resolution,
        "margin": labels.margin,
        "epsilon": labels.epsilon,
        "epsilon_min": labels.epsilon_min,
        "epsilon_max": labels.epsilon_max,
        "partners": labels.partners,
        "partner_normals": -labels.partner_normals,
        "opening": labels.opening,
        "grip": labels.grip,
        "reason": labels.reason,
        **located_arrays(labels),
        **reach_arrays(labels),
        **force_arrays(labels),
    }


def located_arrays(labels: SurfaceLabels) -> Arrays:
    """Located angles over the vertices; none if labels follow from the critical angles."""
    return {} if labels.model.is_uniform else dict(zip(LOCATED, labels.located_angles, strict=True))


def force_arrays(labels: SurfaceLabels) -> Arrays:
    """Arrays over the vertices of forces and payloads, see `Holding.columns`; none: no load."""
    return {} if labels.holding is None else labels.holding.columns()


def reach_arrays(labels: SurfaceLabels) -> Arrays:
    """Arrays over the vertices of how a gripper reaches their grasps; none without a gripper.

    `approach` and `closing` are the z and x axes of the pose, `tcp` its origin, (V, 3); nan where
    there is no pose.
    """
    reach = labels.reach
    if reach is None:
        return {}
    return {
        "approach": reach.poses[:, :3, 2],
        "tcp": reach.poses[:, :3, 3],
        "closing": reach.poses[:, :3, 0],
        "approach_margin": reach.approach_margin,
        "depth": reach.depth,
        "pregrasp_opening": reach.pregrasp_opening,
    }


def by_finger(arrays: Arrays) -> Arrays:
    """Split arrays over fingers into one per finger, as VTK's point data are at most vectors."""
    split: Arrays = {}
    for name, values in arrays.items():
        if name == "partners":
            split.update({f"partner_{i}": row for i, row in enumerate(values.swapaxes(0, 1), 2)})
        elif name == "partner_normals":
            normals = enumerate(values.swapaxes(0, 1), 2)
            split.update({f"partner_{i}_normal": row for i, row in normals})
        else:
            split[name] = values
    return split


def settings_of(labels: SurfaceLabels) -> dict[str, str | float | int | None]:
    """Settings and versions that the labels were computed with; angles in radians."""
    mesh, search = labels.mesh, labels.search
    u_means = "no_grasp_found" if labels.mode == "label" else "surely_unstable"
    return {
        "version": package_version(),
        **chosen_settings(mesh, labels.model, labels.sampling, labels.mode, labels.scene),
        **({} if labels.load is None else load_settings(labels.load)),
        "search_angle": search.cone,
        "rays_traced": search.rays,
        "candidates_evaluated": search.evaluated,
        "file_vertices": mesh.file_vertices,
        "torque_scale": mesh.torque_scale,
        "epsilon_rank": labels.model.epsilon_rank,
        "epsilon_rtol": EPSILON_RTOL,
        "epsilon_min": labels.model.tilts,
        "epsilon_max": "sampled_tilts" if labels.model.method == "extremes" else "upper_bound",
        **({} if labels.holding is None else labels.holding.settings()),
        "label_codes": f"{Label.U:d}=U({u_means}) {Label.M:d}=M(cannot_tell) {Label.S:d}=S(stable)",
    }


def chosen_settings(
    mesh: ObjectMesh,
    model: GraspModel,
    sampling: Sampling | None,
    mode: Mode,
    scene: Scene | None = None,
) -> dict[str, str | float | int | None]:
    """Those of the settings that the user chooses, known before the mesh is labelled.

    Those of a load are `load_settings`.
    """
    return {
        # In a header it must be one line of ASCII characters.
        "source": mesh.report.source.encode("unicode_escape", "surrogateescape").decode("ascii"),
        "mode": mode,
        **plain_values(model),
        **({} if sampling is None else plain_values(sampling)),
        **plain_values(mesh.options),
        "center_of_mass": one_line(mesh.options.center_of_mass),
        "unit": mesh.unit or "unknown",
        **scene_settings(scene),
    }


def _by_axis(head: str, vectors: Floats, kind: str) -> Arrays:
    """Columns of vectors, shape (V, 3)."""
    return {f"{head}{axis}": vectors[:, k].astype(kind) for k, axis in enumerate("xyz")}


def _polydata(vertices: Floats, faces: Ints, arrays: Arrays) -> "pyvista.PolyData":
    import pyvista

    data: pyvista.PolyData = pyvista.PolyData.from_regular_faces(vertices, faces.astype(int))
    for name, values in arrays.items():
        data.point_data[name] = values
    return data
