"""The results of a batch: labelled meshes, read from its files."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from grasp3d.arrays import Floats, locked
from grasp3d.batch.folders import MARKER
from grasp3d.batch.row import Outcome, Row
from grasp3d.batch.store import read_summary
from grasp3d.errors import GraspError, MeshError
from grasp3d.hand.reach import Reach, Reachability
from grasp3d.settings.lengths import METRES, Unit
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.surface.vertex_grasps import Reason
from grasp3d.system.names import printable
from grasp3d.tables import read_columns
from grasp3d.viewer.subjects.file_settings import FileSettings
from grasp3d.viewer.subjects.labelled_file import settings_of_file
from grasp3d.viewer.subjects.subject import Subject, read_subject

Columns = Mapping[str, npt.NDArray[Any]]
"""A table, by name of the column."""

ROUNDING = 1e-5
"""Tolerance of right angles."""

REASONS = {reason.name.lower(): int(reason) for reason in Reason}


def labelled_rows(folder: Path) -> tuple[list[Row], int]:
    """Rows of the meshes that a batch has labelled, and the number of other meshes.

    Args:
        folder: Folder of the results.

    Raises:
        GraspError: It contains no results, they are damaged, or no mesh was labelled.
    """
    where = printable(str(folder))
    if not (folder / MARKER).is_file():
        raise MeshError(
            f"{where}: is a folder, but was not written by grasp3d batch; label its meshes with "
            "grasp3d batch, or give the path of one mesh"
        )
    rows = read_summary(folder)
    found = [row for row in rows if row.outcome is Outcome.LABELLED and row.labels]
    if not found:
        raise MeshError(
            f"{where}: none of its {len(rows)} meshes was labelled; see report/index.html"
        )
    return found, len(rows) - len(found)


def settings_of_results(
    folder: Path, rows: Sequence[Row], max_memory: float
) -> FileSettings | None:
    """Settings of the first mesh whose file can be read; None: no file can be read."""
    for row in rows:
        try:
            return settings_of_file(folder / row.labels, max_memory)
        except GraspError:
            continue  # the error is reported when that mesh is opened
    return None


def read_result(folder: Path, row: Row, max_memory: float, *, unit: Unit | None = None) -> Subject:
    """Read one mesh of a batch.

    If the table of its vertices cannot be read, the mesh is returned without partners.

    Args:
        folder: Folder of the results.
        row: Row of the mesh.
        max_memory: Memory limit for reading [GB].
        unit: Unit of a file that states none.

    Raises:
        MeshError: Its labelled PLY is missing or damaged.
    """
    path, notes = folder / row.fields, [text for text in row.warnings.split("; ") if text]
    missing = []

    def values(labels: SurfaceLabels) -> Mapping[str, Any]:
        try:
            return _grasps(labels, read_columns(path))
        except (OSError, ValueError, MemoryError) as error:
            missing.append(
                f"the table of its vertices ({printable(str(path))}) cannot be read "
                f"({_reason(error)}): grasps are searched again when you click"
            )
            return {}

    subject = read_subject(folder / row.labels, max_memory, unit=unit, name=row.mesh, values=values)
    return replace(subject, notes=tuple(dict.fromkeys((*notes, *subject.notes, *missing))))


def _grasps(labels: SurfaceLabels, columns: Columns) -> Mapping[str, Any]:
    """The grasps in a table of the vertices.

    Raises:
        ValueError: The table is damaged, or belongs to another surface.
    """
    fingers = range(2, labels.model.fingers + 1)
    prefixes = [f"partner_{finger}_" for finger in fingers]
    partners = np.stack([_vectors(columns, prefix) for prefix in prefixes], axis=1)
    normals = -np.stack([_vectors(columns, f"{prefix}n") for prefix in prefixes], axis=1)
    positions, angles = _vectors(columns, ""), _numbers(columns, "critical_angle")
    stored = np.column_stack([positions, angles])
    shown = np.column_stack([labels.mesh.vertices, labels.critical_angle])
    if not np.array_equal(np.float32(stored), np.float32(shown)):
        raise ValueError("it belongs to another surface than the labelled PLY")
    reasons = _column(columns, "reason")
    if not set(reasons.tolist()) <= set(REASONS):
        raise ValueError("it contains unknown reasons")
    reach = _reach(labels, columns, partners, normals)
    return {
        "partners": locked(partners),
        "partner_normals": locked(normals),
        "opening": locked(_numbers(columns, "opening")),
        "grip": locked(_numbers(columns, "grip"), np.int8),
        "reason": locked([REASONS[reason] for reason in reasons.tolist()], np.uint8),
        "reach": reach,
        "approach_margin": None if reach is None else reach.approach_margin,
    }


def _reach(
    labels: SurfaceLabels,
    columns: Columns,
    partners: Floats,
    normals: Floats,
) -> Reach | None:
    """How the gripper reaches the grasps; None: no gripper.

    The table says neither why a grasp is not reached (these rows have the state blocked) nor which
    angles are free.

    Raises:
        ValueError: A column is missing, or axes are not at right angles.
    """
    if labels.scene is None:
        return None
    x, z = _vectors(columns, "closing_"), _vectors(columns, "approach_")
    poses = np.zeros((len(x), 4, 4))
    poses[:, :3] = np.stack([x, np.cross(z, x), z, _vectors(columns, "tcp_")], axis=2)
    poses[:, 3, 3] = 1.0
    reached = np.isfinite(poses).all(axis=(1, 2))
    turns = poses[reached, :3, :3]
    if not np.allclose(turns.swapaxes(1, 2) @ turns, np.eye(3), atol=ROUNDING):
        raise ValueError("its closing and approach axes are not at right angles")
    poses[~reached] = math.nan
    return Reach(
        state=locked(np.where(reached, Reachability.REACHED, Reachability.BLOCKED), np.uint8),
        poses=locked(poses),
        approach_margin=locked(np.where(reached, _numbers(columns, "approach_margin"), math.nan)),
        opening=locked(_gripper_openings(labels, columns, partners, normals)),
        pregrasp_opening=locked(_numbers(columns, "pregrasp_opening")),
        depth=locked(_numbers(columns, "depth")),
        posture=locked(np.zeros((len(x), 0))),
        free=locked(np.zeros((len(x), 0)), np.bool_),
    )


def _gripper_openings(
    labels: SurfaceLabels,
    columns: Columns,
    partners: Floats,
    normals: Floats,
) -> Floats:
    """Distances between the inner faces of fingers, or between the nearest points of round tips.

    Returns:
        In the mesh's unit, shape (V,).
    """
    assert labels.scene is not None
    metres = METRES[labels.mesh.unit] if labels.mesh.unit else math.nan
    points = np.stack([labels.mesh.vertices, partners[:, 0]], axis=1)
    outward = np.stack([labels.mesh.normals, -normals[:, 0]], axis=1)
    internal = _numbers(columns, "grip") < 0.0
    return labels.scene.hand.opening_at(points, outward, internal, metres)


def _column(columns: Columns, name: str) -> npt.NDArray[Any]:
    if name not in columns:
        raise ValueError(f"it has no column {name}")
    return columns[name]


def _numbers(columns: Columns, name: str) -> Floats:
    values = _column(columns, name)
    if values.dtype.kind not in "fiu":
        raise ValueError(f"its column {name} is not numeric")
    return values.astype(np.float64)


def _vectors(columns: Columns, prefix: str) -> Floats:
    return np.stack([_numbers(columns, f"{prefix}{axis}") for axis in "xyz"], axis=1)


def _reason(error: BaseException) -> str:
    reason = getattr(error, "strerror", None) or " ".join(str(error).split())[:200]
    return reason or type(error).__name__
