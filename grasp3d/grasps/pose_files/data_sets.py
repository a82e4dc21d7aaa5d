"""Poses of data sets: GraspGen and graspnetAPI."""

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from grasp3d.arrays import Floats
from grasp3d.errors import ContactError
from grasp3d.grasps.pose_files.documents import (
    as_many,
    grasp_list,
    json_numbers,
    mapping,
    number_or_none,
    numbers,
    required,
    text_or_none,
    write_json,
)
from grasp3d.grasps.pose_files.frames import Given, known_outcomes
from grasp3d.grasps.pose_files.outcomes import outcomes_of
from grasp3d.grasps.poses import GraspPoses
from grasp3d.hand.frames import FRAMES
from grasp3d.system.files import atomic_write

GRASPGEN: str = "GraspGen"

OUTCOME = "object_in_gripper"

EXTRA = ("opening", "pregrasp_opening", "scores")
"""Further lists, which only files of this project have."""


def write_graspgen(path: Path, poses: GraspPoses) -> None:
    """Write the poses of the hand's base and the outcomes, which all grasps must have."""
    grasps = {
        "transforms": poses.poses.tolist(),
        OUTCOME: (known_outcomes(poses, GRASPGEN) == 1.0).tolist(),
        "names": list(poses.names),
        **{
            name: json_numbers(getattr(poses, name))
            for name in EXTRA
            if not np.isnan(getattr(poses, name)).all()
        },
    }
    about = {"file": poses.object_file or "", "scale": poses.object_scale}
    write_json(path, {"object": about, "grasps": grasps})


def parse_graspgen(content: object, given: Given) -> GraspPoses:
    """Poses of the content of a JSON file. Raises ContactError."""
    document = mapping(content, "the file")
    grasps = mapping(required(document, "grasps"), "grasps")
    transforms = grasp_list(required(grasps, "transforms", "grasps: "), "grasps.transforms")
    about = mapping(document.get("object", {}), "object")
    count = len(transforms)
    names = grasps.get("names")
    quantities: dict[str, Any] = {
        key: numbers(as_many(grasps[key], f"grasps.{key}", count), (), key)
        for key in EXTRA
        if grasps.get(key) is not None
    }
    return GraspPoses(
        poses=numbers(transforms, (4, 4), "transforms"),
        names=tuple(map(str, grasp_list(names, "grasps.names"))) if names is not None else (),
        outcome=outcomes_of(
            given.outcome,
            count,
            [key for key, values in grasps.items() if values is not None and key != "transforms"],
            lambda key: as_many(grasps[key], f"grasps.{key}", count),
            default=(OUTCOME,),
        ),
        object_file=text_or_none(about.get("file"), "object.file") or None,
        object_scale=number_or_none(about.get("scale"), "object.scale"),
        **quantities,
    )


LENGTH = 17
"""Numbers of a row: score, width, height, depth, rotation (9), translation (3), object."""

MOST_ROWS = 10_000_000
"""Most rows that are read."""

DEPTH = FRAMES["graspnetapi"].ahead
"""From the frame's origin to the ends of the fingers, in written files [m]."""

HEIGHT = 0.02
"""Height of the fingers that graspnetAPI assumes [m]."""

NO_OBJECT = -1.0
"""Number of an object that is not known."""

BEST_SCORE = 1.1
"""Scores of the data set are 1.1 minus the smallest coefficient of friction that holds."""


def write_graspnet(path: Path, poses: GraspPoses) -> None:
    """Write a row for each grasp, float64."""
    rows = np.empty((poses.count, LENGTH))
    rows[:, 0] = _graspnet_scores(poses)
    has_pregrasp = np.isfinite(poses.pregrasp_opening)
    rows[:, 1] = np.where(has_pregrasp, poses.pregrasp_opening, poses.opening)
    rows[:, 2], rows[:, 3] = HEIGHT, DEPTH
    rows[:, 4:13] = poses.poses[:, :3, :3].reshape(-1, 9)
    rows[:, 13:16] = poses.poses[:, :3, 3]
    rows[:, 16] = poses.columns.get("object_id", np.full(poses.count, NO_OBJECT))
    with atomic_write(path) as part, part.open("wb") as stream:
        np.save(stream, rows, allow_pickle=False)


def _graspnet_scores(poses: GraspPoses) -> Floats:
    """Scores, or those that the critical friction angles imply."""
    if "critical_angle" not in poses.columns:
        return poses.scores
    angles = np.asarray(poses.columns["critical_angle"], dtype=np.float64)
    implied = BEST_SCORE - np.tan(np.minimum(angles, 0.5 * np.pi))
    return np.where(np.isnan(poses.scores), np.maximum(implied, NO_OBJECT), poses.scores)


def parse_graspnet(content: npt.NDArray[Any], given: Given) -> GraspPoses:
    """Poses in the order of the rows. Raises ContactError."""
    rows = _graspnet_rows(content)
    if not np.isfinite(rows[:, 3:]).all():
        bad = np.flatnonzero(~np.isfinite(rows[:, 3:]).all(axis=1))
        raise ContactError(f"grasp {bad[0] + 1} has numbers that are not finite")
    return GraspPoses(
        poses=_graspnet_poses(rows),
        pregrasp_opening=rows[:, 1],
        scores=rows[:, 0],
        outcome=outcomes_of(given.outcome, len(rows), ("score",), lambda _: rows[:, 0]),
        columns={"object_id": rows[:, 16]},
    )


def _graspnet_poses(rows: Floats) -> Floats:
    """Poses (k, 4, 4) of a depth of each, moved to the one of the frame."""
    poses = np.tile(np.eye(4), (len(rows), 1, 1))
    poses[:, :3, :3] = rows[:, 4:13].reshape(-1, 3, 3)
    poses[:, :3, 3] = rows[:, 13:16] + (rows[:, 3:4] - DEPTH) * poses[:, :3, 0]
    return poses


def _graspnet_rows(array: npt.NDArray[Any]) -> Floats:
    """Rows of the array, whose shape and type are checked before they are loaded."""
    fits = array.ndim == 2 and array.shape[1] == LENGTH and array.dtype.kind in "fiu"
    if not fits or len(array) > MOST_ROWS:
        raise ContactError(
            f"it must have {LENGTH} numbers in each row, at most {MOST_ROWS} rows; got "
            f"{array.dtype} of shape {array.shape}"
        )
    if not len(array):
        raise ContactError("there are no grasps in it")
    return np.array(array, dtype=np.float64)
