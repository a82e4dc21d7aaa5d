"""Files of a validation: tables as CSV."""

from pathlib import Path
from typing import Any

from grasp3d.errors import OutputError
from grasp3d.stability.label import Label
from grasp3d.tables import write_columns, write_table
from grasp3d.validating.success import LabelSuccess
from grasp3d.validating.validation import Validation

GRASPS, SCORES, LABELS, CALIBRATION = "grasps.csv", "scores.csv", "labels.csv", "calibration.csv"
TABLES = (GRASPS, SCORES, LABELS, CALIBRATION)
"""Names of the tables in the folder."""


def write_validation(folder: str | Path, found: Validation) -> None:
    """Write the tables of a validation: grasps.csv, scores.csv, labels.csv and calibration.csv.

    Angles are in radians, lengths in metres, areas in square metres, forces in newtons; nan leaves
    the cell empty.

    Args:
        folder: Folder to make or to write to; tables that are in it are replaced.
        found: The result.

    Raises:
        OutputError: A file cannot be written.

    Example:
        >>> from pathlib import Path
        >>> import numpy as np
        >>> import trimesh
        >>> import grasp3d
        >>> from grasp3d.grasps import GraspPoses
        >>> from grasp3d.validating import write_validation
        >>> box = grasp3d.load_mesh(trimesh.creation.box([0.06, 0.04, 0.02]), unit="m")
        >>> poses = np.tile(np.diag([1.0, -1.0, -1.0, 1.0]), (2, 1, 1))
        >>> tried = GraspPoses(poses=poses, outcome=[1, 0], unit="m")
        >>> franka = grasp3d.ParallelGripper.preset("franka")
        >>> write_validation("out", grasp3d.validate_grasps(tried, mesh=box, hand=franka))
        >>> print(Path("out/scores.csv").read_text()[:23])
        "score","better","roc_a
    """
    folder = made_folder(folder)
    write_columns(folder / GRASPS, found.columns(), settings={})
    _write(folder / SCORES, _scores(found))
    _write(folder / LABELS, [_label_row(one, label) for one in found.labels for label in _ORDER])
    _write(folder / CALIBRATION, _bins(found))


_ORDER = sorted(Label, reverse=True)


def made_folder(folder: str | Path) -> Path:
    """Make a folder unless it is there.

    Raises:
        OutputError: It cannot be made.
    """
    folder = Path(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        problem = "is a file; name a folder" if folder.exists() else "cannot be made"
        raise OutputError(f"{folder}: {problem} ({error.strerror})") from error
    return folder


def _write(path: Path, rows: list[dict[str, Any]]) -> None:
    columns = {name: type(value) for name, value in rows[0].items()}
    known = [
        {name: value for name, value in row.items() if value == value}  # noqa: PLR0124, not nan
        for row in rows
    ]
    write_table(path, known, columns, settings={})


def _scores(found: Validation) -> list[dict[str, Any]]:
    return [
        {
            "score": one.score.name,
            "better": one.score.better,
            "roc_auc": one.roc_auc,
            "roc_auc_low": one.roc_auc_interval[0],
            "roc_auc_high": one.roc_auc_interval[1],
            "average_precision": one.average_precision,
            "average_precision_low": one.average_precision_interval[0],
            "average_precision_high": one.average_precision_interval[1],
        }
        for one in found.qualities
    ]


def _label_row(one: LabelSuccess, label: Label) -> dict[str, Any]:
    low, high = one.interval(label.name)
    return {
        "friction": float(one.friction),
        "sensor_resolution": float(one.sensor_resolution),
        "label": label.name,
        "grasps": one.counts[label],
        "held": one.held[label],
        "fraction": one.fraction(label.name),
        "fraction_low": low,
        "fraction_high": high,
    }


def _bins(found: Validation) -> list[dict[str, Any]]:
    return [
        {
            "margin_low": one.low,
            "margin_high": one.high,
            "margin_mean": one.mean,
            "grasps": one.count,
            "held": one.held,
            "fraction": one.fraction,
            "fraction_low": one.interval[0],
            "fraction_high": one.interval[1],
        }
        for one in found.calibration.bins
    ]
