"""Writing of grasps, with labels and epsilon, to files."""

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from grasp3d.arrays import Floats
from grasp3d.errors import SettingError
from grasp3d.grasps.evaluated_poses import EvaluatedPoses
from grasp3d.grasps.pose_files import write_poses
from grasp3d.grasps.poses import GraspPoses
from grasp3d.quality.measures.measuring import MetricValues
from grasp3d.settings import PoseFormat
from grasp3d.surface.fields import columns_of
from grasp3d.surface.grasp_fields import FOUND_POSES
from grasp3d.surface.grasp_table import GraspTable
from grasp3d.system.files import atomic_write, check_suffix

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
        poses = replace(poses_of(grasps), settings=grasps.settings())
        if metrics is not None:
            poses = replace(poses, columns={**poses.columns, **metrics.columns()})
        write_poses(path, poses, format=format)
        return
    check_suffix(path, SUFFIXES, "table")
    if path.suffix.lower() == ".json":
        _write_json(path, grasps, metrics)
        return
    from grasp3d.system.tables import write_columns

    write_columns(path, grasps.table_columns(metrics), settings=grasps.settings())


def _write_json(path: Path, grasps: GraspTable, metrics: MetricValues | None) -> None:
    """Write the settings, then one line for each grasp."""
    columns = {name: values.tolist() for name, values in grasps.columns(metrics).items()}
    contacts = {field.name: values.tolist() for field, values in grasps.contact_values()}
    with atomic_write(path) as part, part.open("w", encoding="utf-8") as stream:
        stream.write(f'{{"grasp3d": {_json(grasps.settings())},\n"grasps": [')
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
