"""Arrays of graspnetAPI: (k, 17), float64.

Arrays of any number type are read, but never Python objects.

| numbers | written | read |
|---|---|---|
| 0 score | `scores`, else 1.1 − tan(`critical_angle`), at least −1; nan: not known | `scores` |
| 1 width | `pregrasp_opening`, else `opening` | `pregrasp_opening`: jaws close from it |
| 2 height | 0.02 | ignored |
| 3 depth | 0.02 | distance of the fingers' ends from the origin along x; the TCP is half a pad (`pad_height`/2) before the ends, with round tips at the ends |
| 4–12 rotation | row by row; columns approach, closing, their product | |
| 13–15 translation | [m] | |
| 16 object | column `object_id`, else −1 | column `object_id` |
"""

from pathlib import Path
from typing import Any

import numpy as np

from grasp3d.arrays import Floats
from grasp3d.errors import ContactError
from grasp3d.formats.checks import outcomes_of, write_array
from grasp3d.formats.format import Format, Given, register
from grasp3d.formats.poses import GraspPoses
from grasp3d.hand.frames import FRAMES

LENGTH = 17
"""Numbers of a row: score, width, height, depth, rotation (9), translation (3), object."""

DEPTH = FRAMES["graspnetapi"].ahead
"""Distance from the frame's origin to the ends of the fingers, in written files [m]."""

HEIGHT = 0.02
"""Height of the fingers that graspnetAPI assumes [m]."""

NO_OBJECT = -1.0
"""Number of an object that is not known."""

BEST_SCORE = 1.1
"""Scores of the data set are 1.1 minus the smallest coefficient of friction that holds."""


def sniff(content: Any) -> bool:
    """Whether content is an array of such rows, at least one."""
    is_array = isinstance(content, np.ndarray) and content.dtype.kind in "fiu"
    return is_array and content.shape[1:] == (LENGTH,) and len(content) > 0


def write(path: Path, poses: GraspPoses) -> None:
    """Write a row for each grasp."""
    rows = np.empty((poses.count, LENGTH))
    rows[:, 0] = _scores(poses)
    has_pregrasp = np.isfinite(poses.pregrasp_opening)
    rows[:, 1] = np.where(has_pregrasp, poses.pregrasp_opening, poses.opening)
    rows[:, 2:4] = HEIGHT, DEPTH
    rows[:, 4:13] = poses.poses[:, :3, :3].reshape(-1, 9)
    rows[:, 13:16] = poses.poses[:, :3, 3]
    rows[:, 16] = poses.columns.get("object_id", NO_OBJECT)
    write_array(path, rows)


def _scores(poses: GraspPoses) -> Floats:
    """Scores, or those that the critical friction angles imply."""
    if "critical_angle" not in poses.columns:
        return poses.scores
    angles = np.asarray(poses.columns["critical_angle"], dtype=np.float64)
    implied = BEST_SCORE - np.tan(np.minimum(angles, 0.5 * np.pi))
    return np.where(np.isnan(poses.scores), np.maximum(implied, NO_OBJECT), poses.scores)


def read(content: Any, given: Given) -> GraspPoses:
    """Poses in the order of the rows. Raises ContactError."""
    rows = np.array(content, dtype=np.float64)
    if len(bad := np.flatnonzero(~np.isfinite(rows[:, 3:]).all(axis=1))):
        raise ContactError(f"grasp {bad[0] + 1} has numbers that are not finite")
    poses = np.tile(np.eye(4), (len(rows), 1, 1))
    poses[:, :3, :3] = rows[:, 4:13].reshape(-1, 3, 3)
    poses[:, :3, 3] = rows[:, 13:16] + (rows[:, 3:4] - DEPTH) * poses[:, :3, 0]
    return GraspPoses(
        poses=poses,
        pregrasp_opening=rows[:, 1],
        scores=rows[:, 0],
        outcome=outcomes_of(given.outcome, len(rows), ("score",), lambda _: rows[:, 0]),
        columns={"object_id": rows[:, 16]},
    )


register(Format(
    name="graspnet", title="graspnetAPI", suffixes=(".npy",), frame="graspnetapi", main=True,
    sniff=sniff, read=read, write=write, holds="an array with 17 numbers in each row",
    about=__doc__ or "",
))  # fmt: skip
