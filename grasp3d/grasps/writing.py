"""Writing of grasps, with labels and epsilon, to files."""

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from grasp3d.arrays import Floats
from grasp3d.errors import SettingError
from grasp3d.export.fields import Field, columns_of, present
from grasp3d.export.grasp_fields import CONTACTS, FOUND_POSES, GRASPS
from grasp3d.grasps.evaluated_poses import EvaluatedPoses
from grasp3d.grasps.pose_files import write_poses
from grasp3d.grasps.poses import GraspPoses
from grasp3d.hand.scene import scene_settings
from grasp3d.quality.loads import load_settings
from grasp3d.quality.measures.measuring import MetricValues
from grasp3d.settings import PoseFormat
from grasp3d.settings.lengths import one_line
from grasp3d.settings.parsing import plain_values
from grasp3d.stability.label import MEANING, Label
from grasp3d.surface.grasp_numbers import EPSILON_RTOL
from grasp3d.surface.grasp_table import GraspTable
from grasp3d.system.files import atomic_write, check_suffix
from grasp3d.system.versions import package_version

SUFFIXES = (".csv", ".parquet", ".json")


def write_grasps(
    path: str | Path,
    grasps: GraspTable | EvaluatedPoses | GraspPoses,
    *,
    format: PoseFormat | None = None,  # noqa: A002, what it is called everywhere
    metrics: MetricValues | None = None,
) -> None:
    """Write grasps with labels, critical angles and epsilon, in the format given by the suffix.

    Of grasps without poses: one row, in JSON one entry, for each grasp: `grasp` (its number from
    1), `label`, `critical_angle`, `critical_angle_best`, `max_resolution`, `margin` [rad],
    `epsilon`, `epsilon_min`, `epsilon_max`, `rank`, `opening`, `separation`; and for each contact
    its position on the surface `x1` `y1` `z1`, the outward normal there `nx1` `ny1` `nz1`,
    `distance1`, its distance from the surface before it was moved there, and `on_crease1`. nan is
    written as an empty cell, in JSON as null, where infinite numbers are null as well. JSON and
    Parquet contain the settings.

    With a gripper of two fingers also `closed_label` and `closed_margin`, label and margin at what
    the jaws touch when they close; empty and nan where it is not known, see `ClosedGrasps`.

    With a load also `grip_force`, `grip_force_least`, `grip_force_largest` [N], `payload` [kg] if a
    force is at hand, and `label_with_force` if the mass is known, too; see `Holding`.

    Grasps with a gripper, and poses, are written with their poses, also in formats of robots and
    simulators: isaac_grasp (.yaml), acronym (.h5), graspnet (.npy), graspgen or moveit (.json).
    These need the gripper and the unit.

    Args:
        path: File to make or replace; .csv, .parquet or .json, with poses also .yaml, .h5 or .npy.
        grasps: The grasps: with contacts, with poses that were evaluated, or poses alone.
        format: Of poses: json, csv, parquet, isaac_grasp, acronym, graspnet, graspgen or moveit;
            None: that of the suffix, json for .json.
        metrics: Quality measures of the grasps, which become columns, with `undefined_metrics`, the
            reasons why some are undefined.

    Raises:
        OutputError: No format has that suffix, it needs something that is not known, or the file
            cannot be written.
        SettingError: No format is called so, or a format of poses, but no gripper.

    Example:
        >>> import trimesh
        >>> import grasp3d
        >>> box = trimesh.creation.box([0.08, 0.05, 0.03])
        >>> labels = grasp3d.label_surface(grasp3d.load_mesh(box, unit="m", max_edge=0.02))
        >>> grasp3d.write_grasps("box.csv", grasp3d.best_grasps(labels, 3))
        >>> grasp3d.read_grasps("box.csv").shape
        (3, 2, 3)
    """
    path = Path(path)
    if isinstance(grasps, EvaluatedPoses):
        grasps = grasps.to_poses(metrics)
    if isinstance(grasps, GraspPoses):
        write_poses(path, grasps, format=format)
        return
    if format is not None or (grasps.has_poses and grasps.size):
        poses = replace(poses_of(grasps), settings=_settings(grasps))
        if metrics is not None:
            poses = replace(poses, columns={**poses.columns, **metrics.columns()})
        write_poses(path, poses, format=format)
        return
    check_suffix(path, SUFFIXES, "table")
    if path.suffix.lower() == ".json":
        _write_json(path, grasps, metrics)
        return
    from grasp3d.system.tables import write_columns

    write_columns(path, _columns(grasps, metrics), settings=_settings(grasps))


def grasps_to_table(grasps: GraspTable) -> Any:
    """Arrow table with a row for each grasp, as in the file that `write_grasps` writes."""
    from grasp3d.system.tables import table_of_columns

    return table_of_columns(_columns(grasps), settings=_settings(grasps))


def _columns(
    grasps: GraspTable, metrics: MetricValues | None = None
) -> dict[str, npt.NDArray[Any]]:
    """Columns of a table, shape (b,)."""
    columns = _grasp_columns(grasps, metrics)
    contacts = _contact_values(grasps)
    for number in range(grasps.contacts.count):
        for field, values in contacts:
            names = [f"{name}{number + 1}" for name in field.columns or (field.name,)]
            flat = values[:, number].reshape(len(values), len(names))
            columns |= dict(zip(names, flat.T, strict=True))
    return columns


def _contact_values(grasps: GraspTable) -> list[tuple[Field, npt.NDArray[Any]]]:
    """What is known of each contact, shape (b, n, ...), without negative zeros."""
    return [
        (field, values + 0.0 if field.outward else values)
        for field, values in present(CONTACTS, grasps)
    ]


def _grasp_columns(grasps: GraspTable, metrics: MetricValues | None) -> dict[str, npt.NDArray[Any]]:
    """Columns of each grasp as a whole, shape (b,)."""
    return {**columns_of(GRASPS, grasps), **({} if metrics is None else metrics.columns())}


def _settings(grasps: GraspTable) -> dict[str, Any]:
    """Settings of the evaluation; angles in radians."""
    mesh, model = grasps.mesh, grasps.model
    meaning = MEANING["scan"]
    return {
        "version": package_version(),
        "source": mesh.report.source,
        **plain_values(model),
        **plain_values(mesh.options),
        "center_of_mass": one_line(mesh.options.center_of_mass),
        "unit": mesh.unit or "unknown",
        "size": mesh.size,
        "center_mass": mesh.center_mass.tolist(),
        "torque_scale": mesh.torque_scale,
        "epsilon_rtol": EPSILON_RTOL,
        "epsilon_min": model.tilts,
        "epsilon_max": "sampled_tilts" if model.method == "extremes" else "upper_bound",
        "labels": {label.name: meaning[label] for label in sorted(Label)},
        **_surroundings(grasps),
        **_load(grasps),
    }


def _surroundings(grasps: GraspTable) -> dict[str, Any]:
    """The table and the allowed approach of a gripper; it is stated itself beside the poses."""
    if grasps.scene is None:
        return {}
    settings = scene_settings(grasps.scene)
    return {name: value for name, value in settings.items() if name != "gripper"}


def _load(grasps: GraspTable) -> dict[str, Any]:
    """What is known of the load."""
    if grasps.holding is None:
        return {}
    settings = {**load_settings(grasps.load), **grasps.holding.settings()}
    return {name: value for name, value in settings.items() if value is not None}


def _write_json(path: Path, grasps: GraspTable, metrics: MetricValues | None) -> None:
    """Write the settings, then one line for each grasp."""
    columns = {name: values.tolist() for name, values in _grasp_columns(grasps, metrics).items()}
    contacts = {field.name: values.tolist() for field, values in _contact_values(grasps)}
    with atomic_write(path) as part, part.open("w", encoding="utf-8") as stream:
        stream.write(f'{{"grasp3d": {_json(_settings(grasps))},\n"grasps": [')
        for row in range(grasps.size):
            entry = {name: values[row] for name, values in columns.items()}
            entry["contacts"] = [
                {name: values[row][number] for name, values in contacts.items()}
                for number in range(grasps.contacts.count)
            ]
            stream.write(("," if row else "") + "\n" + _json(entry))
        stream.write("\n]}\n")


def _json(values: dict[str, Any]) -> str:
    """JSON text; numbers that are not finite are null, since JSON cannot represent them."""
    finite = {
        name: None if isinstance(value, float) and not math.isfinite(value) else value
        for name, value in values.items()
    }
    return json.dumps(finite, allow_nan=False)


def poses_of(grasps: GraspTable) -> GraspPoses:
    """Poses of a gripper for grasps that it reaches, with all that is known of each.

    Args:
        grasps: Grasps with a hand that has poses for them, such as `best_grasps` returns.

    Returns:
        The poses in their order, in the unit of the mesh: openings, and as columns label, critical
        angle, alpha*, margin, epsilon, approach margin, depth, contacts and normals into the
        object, label and margin at what the closed jaws touch, with a load also grip forces and
        payload. The score is 1 - beta*/beta, from 1 where
        no friction is needed to 0 where no sensor makes the grasp S.

    Raises:
        SettingError: The grasps have no poses: there is no gripper, or one does not reach them.

    Example:
        >>> import trimesh
        >>> import grasp3d
        >>> from grasp3d.grasps import poses_of
        >>> box = trimesh.creation.box([0.08, 0.05, 0.03])
        >>> mesh = grasp3d.load_mesh(box, unit="m", max_edge=0.02)
        >>> hand = grasp3d.ParallelGripper.preset("franka")
        >>> labels = grasp3d.label_surface(mesh, hand=hand)
        >>> poses = poses_of(grasp3d.best_grasps(labels, 3))
        >>> poses.poses.shape, poses.unit, sorted(poses.columns)[:3]
        ((3, 4, 4), 'm', ['approach_margin', 'closed_label', 'closed_margin'])
    """
    reach, scene = grasps.reach, grasps.scene
    if reach is None or scene is None:
        raise SettingError(
            "the grasps have no poses: label the surface with a gripper (--hand, in Python "
            "hand=...)"
        )
    if not np.isfinite(reach.poses).all():
        raise SettingError(
            "grasps of three fingers and more, and those that are not reached, have no poses"
        )
    return GraspPoses(
        poses=reach.poses,
        opening=reach.opening,
        pregrasp_opening=reach.pregrasp_opening,
        posture=reach.posture,
        scores=_scores(grasps),
        unit=grasps.mesh.unit,
        hand=scene.hand,
        columns=columns_of(FOUND_POSES, grasps),
        object_file=grasps.mesh.report.source,
    )


def _scores(grasps: GraspTable) -> Floats:
    """Scores from 0 to 1, larger is better (k,)."""
    return np.clip(1.0 - grasps.critical_angle / grasps.model.friction_angle, 0.0, 1.0)
