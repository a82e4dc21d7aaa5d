"""The results of a batch: its labelled meshes, as its files hold them."""

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
from grasp3d.surface.labels import Reason
from grasp3d.system.names import printable
from grasp3d.tables import read_columns
from grasp3d.viewer.subjects.file_settings import FileSettings
from grasp3d.viewer.subjects.labelled_file import settings_of_file
from grasp3d.viewer.subjects.subject import Subject, read_subject

REASONS = {reason.name.lower(): int(reason) for reason in Reason}


def labelled_rows(folder: Path) -> tuple[list[Row], int]:
    """Rows of the meshes that a batch has labelled, and how many it has not.

    Args:
        folder: Of the results.

    Raises:
        GraspError: It holds no results, they are damaged, or no mesh was labelled.
    """
    where = printable(str(folder))
    if not (folder / MARKER).is_file():
        raise MeshError(
            f"{where}: is a folder, but none that grasp3d batch has written; label its meshes "
            "with grasp3d batch, or name one of them"
        )
    rows = read_summary(folder)
    found = [row for row in rows if row.outcome is Outcome.LABELLED and row.labels]
    if not found:
        raise MeshError(
            f"{where}: none of its {len(rows)} meshes was labelled; report/index.html says why"
        )
    return found, len(rows) - len(found)


def settings_of_results(
    folder: Path, rows: Sequence[Row], max_memory: float
) -> FileSettings | None:
    """What the first mesh that can be read was labelled with; None: none can be."""
    for row in rows:
        try:
            return settings_of_file(folder / row.labels, max_memory)
        except GraspError:
            continue  # it is told when someone looks at that mesh
    return None


def read_result(folder: Path, row: Row, max_memory: float) -> Subject:
    """Take one mesh of a batch as its files hold it.

    Without the table of its vertices it is shown all the same, but its grasps are not known.

    Args:
        folder: Of the results.
        row: Of the mesh.
        max_memory: What reading it may take [GB].

    Raises:
        MeshError: Its labelled PLY is missing or damaged.
    """
    subject = replace(read_subject(folder / row.labels, max_memory), name=row.mesh)
    told = tuple(f"{text}" for text in row.warnings.split("; ") if text)
    subject = replace(subject, notes=tuple(dict.fromkeys((*told, *subject.notes))))
    path = folder / row.fields
    try:
        return _with_grasps(subject, read_columns(path))
    except (OSError, ValueError, MemoryError) as error:
        note = (
            f"the table of its vertices ({printable(str(path))}) cannot be read "
            f"({_line(error)}): grasps are searched anew when you click"
        )
        return replace(subject, notes=(*subject.notes, note))


def _with_grasps(subject: Subject, columns: Mapping[str, npt.NDArray[Any]]) -> Subject:
    """Add what a table of the vertices tells of their grasps.

    Raises:
        ValueError: It is of another surface, or damaged.
    """
    fingers = range(2, subject.model.fingers + 1)
    heads = [f"partner_{finger}_" for finger in fingers]
    partners = np.stack([_vectors(columns, head) for head in heads], axis=1)
    pushes = -np.stack([_vectors(columns, f"{head}n") for head in heads], axis=1)
    places, angles = _vectors(columns, ""), _numbers(columns, "critical_angle")
    same = np.array_equal(places, subject.vertices)
    if not (same and np.array_equal(angles, subject.critical_angle)):
        raise ValueError("it is of another surface than the labelled PLY")
    reasons = _column(columns, "reason")
    if not set(reasons.tolist()) <= set(REASONS):
        raise ValueError("its reasons are not known")
    return replace(
        subject,
        partners=locked(partners),
        partner_normals=locked(pushes),
        opening=locked(_numbers(columns, "opening")),
        grip=locked(_numbers(columns, "grip"), np.int8),
        reason=locked([REASONS[reason] for reason in reasons.tolist()], np.uint8),
    )


def _column(columns: Mapping[str, npt.NDArray[Any]], name: str) -> npt.NDArray[Any]:
    if name not in columns:
        raise ValueError(f"it has no column {name}")
    return columns[name]


def _numbers(columns: Mapping[str, npt.NDArray[Any]], name: str) -> Floats:
    values = _column(columns, name)
    if values.dtype.kind not in "fiu":
        raise ValueError(f"its column {name} holds no numbers")
    return values.astype(np.float64)


def _vectors(columns: Mapping[str, npt.NDArray[Any]], head: str) -> Floats:
    return np.stack([_numbers(columns, f"{head}{axis}") for axis in "xyz"], axis=1)


def _line(error: BaseException) -> str:
    told = getattr(error, "strerror", None) or " ".join(str(error).split())[:200]
    return told or type(error).__name__
