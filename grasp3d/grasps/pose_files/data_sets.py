"""Poses of data sets: GraspGen, graspnetAPI and its labels, InternData, Contact-GraspNet."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from grasp3d.arrays import Bools, Floats, Ints
from grasp3d.errors import ContactError
from grasp3d.grasps.pose_files.documents import (
    as_many,
    grasp_list,
    json_numbers,
    mapping,
    number_or_none,
    numbers,
    numbers_in,
    required,
    text_or_none,
    watched,
    write_json,
)
from grasp3d.grasps.pose_files.frames import Given, known_outcomes
from grasp3d.grasps.pose_files.outcomes import outcomes_of
from grasp3d.grasps.poses import GraspPoses
from grasp3d.hand.frames import FRAMES
from grasp3d.settings.outcome import Outcome
from grasp3d.system.files import atomic_write
from grasp3d.system.stored_arrays import Archive, StoredArray

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

NUMBERS = {"score": 0, "width": 1, "height": 2, "depth": 3, "object_id": 16}
"""Which of them have a name."""

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
    _write_rows(path, poses, _graspnet_scores(poses))


def write_interndata(path: Path, poses: GraspPoses) -> None:
    """Write the same rows, with coefficients of friction for scores."""
    _write_rows(path, poses, BEST_SCORE - _graspnet_scores(poses))


def _write_rows(path: Path, poses: GraspPoses, scores: Floats) -> None:
    rows = np.empty((poses.count, LENGTH))
    rows[:, 0] = scores
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
        poses=graspnet_poses(rows[:, 4:13].reshape(-1, 3, 3), rows[:, 13:16], rows[:, 3]),
        pregrasp_opening=rows[:, 1],
        scores=rows[:, 0],
        outcome=outcomes_of(given.outcome, len(rows), NUMBERS, lambda name: rows[:, NUMBERS[name]]),
        columns={"object_id": rows[:, 16]},
    )


def parse_interndata(content: npt.NDArray[Any], given: Given) -> GraspPoses:
    """Poses in the order of the rows; of their scores, smaller is better. As `parse_graspnet`."""
    poses = parse_graspnet(content, given)
    return replace(poses, scores=BEST_SCORE - poses.scores)


def graspnet_poses(rotations: Floats, points: Floats, depths: Floats) -> Floats:
    """Poses (k, 4, 4) of a depth of each, moved to the one of the frame."""
    poses = np.tile(np.eye(4), (len(points), 1, 1))
    poses[:, :3, :3] = rotations
    poses[:, :3, 3] = points + (depths[:, None] - DEPTH) * rotations[:, :, 0]
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


GRASPS = (300, 12, 4)
"""Views, angles and depths at each point of an object."""

SHAPES: dict[str, tuple[int, ...]] = {
    "points": (3,), "offsets": (*GRASPS, 3), "scores": GRASPS, "collision": GRASPS,
}  # fmt: skip
"""Arrays of labels, and their shapes at each point."""

MOST_POINTS = 10_000
"""Most points of an object."""

MOST_LABELS = 100_000
"""Most grasps of an object that are read; of more, as many evenly spread in the file."""

MOST_SEGMENTS = 2**53
"""All numbers of segments are below it."""

MOST_PREDICTED = 1_000_000
"""Most grasps of a scene that are read."""

POINTS = 64
"""Points that are read at a time."""

CAMERA = "camera"
"""Name of the frame of predictions: that of the camera, z forward, x right and y down."""


def read_labels(content: Archive, given: Given) -> GraspPoses:
    """The grasps that hold and touch nothing else, in the order of the file. Raises ContactError.

    Each is called by the numbers of its point, view, angle and depth, from 0.
    """
    count = _count(content)
    valid = np.concatenate(list(_valid(content)))
    total = int(np.count_nonzero(valid))
    if not total:
        raise ContactError("there are no grasps in it that hold without a collision")
    chosen = np.flatnonzero(valid)
    if total > MOST_LABELS:
        chosen = chosen[np.linspace(0, total - 1, MOST_LABELS).round().astype(np.int64)]
    numbers = np.unravel_index(chosen, (count, *GRASPS))
    points, views = _rows(content, "points", numbers[0]), view_directions(GRASPS[0])
    angles, depths, widths = _rows(content, "offsets", chosen, flat=True).T
    frictions = _rows(content, "scores", chosen, flat=True)
    return GraspPoses(
        poses=graspnet_poses(rotations(-views[numbers[1]], angles), points, depths),
        pregrasp_opening=widths,
        scores=BEST_SCORE - frictions,
        outcome=outcomes_of(given.outcome, len(chosen), ("scores",), lambda _: frictions),
        names=tuple("_".join(map(str, row)) for row in np.stack(numbers, axis=1).tolist()),
        settings={"grasps_in_file": total} if total > MOST_LABELS else {},
    )


def _count(content: Archive) -> int:
    """Number of points, the same in all arrays. Raises ContactError."""
    count = 0
    for name, at_point in SHAPES.items():
        shape = content.shape(name)
        count = count or shape[0]
        if shape != (count, *at_point) or not 0 < count <= MOST_POINTS:
            raise ContactError(
                f"{name} must have the shape {('points', *at_point)}, the same number of points in "
                f"all arrays and at most {MOST_POINTS:,}; got {shape}"
            )
    return count


def _valid(content: Archive) -> Iterator[Bools]:
    """Whether grasps hold without a collision, flat, for a few points at a time."""
    parts = (content.parts(name, POINTS) for name in ("scores", "collision"))
    for frictions, collides in zip(*parts, strict=True):
        yield ((frictions > 0.0) & ~collides.astype(bool)).ravel()


def _rows(content: Archive, name: str, indices: Ints, *, flat: bool = False) -> Floats:
    """Rows of an array of given ascending indices; flat: of its grasps rather than points."""
    each = int(np.prod(GRASPS)) if flat else 1
    starts = np.arange(0, MOST_POINTS + POINTS, POINTS) * each
    bounds = pairwise(np.searchsorted(indices, starts))
    found = []
    for part, start, (low, high) in zip(content.parts(name, POINTS), starts, bounds, strict=False):
        rows = part.reshape(len(part) * each, *part.shape[4 if flat else 1 :])
        found.append(rows[indices[low:high] - start].astype(np.float64))
    return np.concatenate(found)


def view_directions(count: int) -> Floats:
    """Directions from a point to where it is seen from, a spiral on a sphere, (count, 3)."""
    numbers = np.arange(count, dtype=np.float64)
    z = (2.0 * numbers + 1.0) / count - 1.0
    turn = np.pi * (np.sqrt(5.0) - 1.0) * numbers
    radius = np.sqrt(1.0 - z * z)
    return np.stack([radius * np.cos(turn), radius * np.sin(turn), z], axis=1)


def rotations(approaches: Floats, angles: Floats) -> Floats:
    """Frames whose x is an approach direction, and y a level axis turned about it, (k, 3, 3)."""
    level = np.stack([-approaches[:, 1], approaches[:, 0], np.zeros(len(approaches))], axis=1)
    level[~level.any(axis=1)] = (0.0, 1.0, 0.0)
    level /= np.linalg.norm(level, axis=1, keepdims=True)
    side = np.cross(approaches, level)
    cos, sin = np.cos(angles)[:, None], np.sin(angles)[:, None]
    return np.stack([approaches, cos * level + sin * side, cos * side - sin * level], axis=2)


def read_contact(content: Archive, given: Given) -> GraspPoses:
    """Grasps of all segments in the order of the file. Raises ContactError."""
    assert isinstance(content.file, Path)
    return watched(read_segments, content.file, given.outcome)


def read_segments(path: Path, outcome: Outcome | None) -> GraspPoses:
    """The same in a child process."""
    content = Archive(path)
    grasps, scores = (_segments(content, name) for name in ("pred_grasps_cam", "scores"))
    found, names = [], list[str]()
    for segment, poses in grasps.items():
        one = _segment(segment, poses, scores.get(segment), MOST_PREDICTED - len(names))
        names += [f"{segment}_{k}" for k in range(1, len(one[0]) + 1)]
        found.append((segment, *one))
    if not names:
        raise ContactError("there are no grasps in it")
    confidences = np.concatenate([values for *_, values in found])
    return GraspPoses(
        poses=np.concatenate([poses for _, poses, _ in found]),
        scores=confidences,
        outcome=outcomes_of(outcome, len(names), ("scores",), lambda _: confidences),
        names=tuple(names),
        columns={"segment": np.repeat([s for s, *_ in found], [len(p) for _, p, _ in found])},
        settings={"frame_id": CAMERA},
    )


def _segments(content: Archive, name: str) -> dict[int, Any]:
    """Arrays by the number of their segment; one array is that of all, -1. Raises ContactError."""
    stored = content.load(name)
    if not isinstance(stored, StoredArray):
        return {-1: stored}
    values = stored.values
    segments = values[0] if isinstance(values, list) and len(values) == 1 else None
    if not isinstance(segments, dict) or not all(map(_is_whole, segments)):
        raise ContactError(f"{name} must be a dictionary of segments, by their whole numbers")
    return {int(number): one for number, one in segments.items()}


def _is_whole(key: object) -> bool:
    """Whether a key is a whole number, also as the float that a map of segments may have."""
    if isinstance(key, bool) or not isinstance(key, int | float):
        return False
    return abs(key) < MOST_SEGMENTS and key == int(key)


def _segment(number: int, poses: Any, scores: Any, most: int) -> tuple[Floats, Floats]:
    """Poses (k, 4, 4) and scores (k,) of a segment, at most so many."""
    transforms = numbers_in(poses, f"pred_grasps_cam of segment {number}")
    confidences = numbers_in([] if scores is None else scores, f"scores of segment {number}")
    count = len(transforms) if transforms.size else 0
    if count and (transforms.shape != (count, 4, 4) or confidences.size != count):
        raise ContactError(
            f"segment {number} must have grasps of shape (k, 4, 4) and as many scores; got "
            f"{transforms.shape} and {confidences.shape}"
        )
    if count > most:
        raise ContactError(f"it has more than {MOST_PREDICTED:,} grasps")
    return (
        transforms.reshape(count, 4, 4).astype(np.float64),
        confidences.ravel()[:count].astype(np.float64),
    )
