"""Result of comparing labels and scores with outcomes, and its tables as CSV."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from grasp3d.arrays import Bools, Bytes, Floats, Ints, short_repr
from grasp3d.errors import OutputError
from grasp3d.hand.closed_jaws import Closing
from grasp3d.settings import GraspModel
from grasp3d.stability.label import Label
from grasp3d.system.names import as_unicode
from grasp3d.validating.disagreements import Disagreement, ReasonCount
from grasp3d.validating.qualities import ObjectQuality, ScoreDifference, ScoreQuality
from grasp3d.validating.scores import Score
from grasp3d.validating.success import Calibration, LabelSuccess, MarginBin
from grasp3d.validating.validation_settings import ValidationSettings

TABLES = ("grasps.csv", "scores.csv", "differences.csv", "objects.csv", "labels.csv",
          "calibration.csv", "reasons.csv")  # fmt: skip
"""Names of the tables in the folder."""


@dataclass(frozen=True)
class ValidatedFile:
    """What the grasps of one file were evaluated with."""

    name: str
    object_number: int
    """Number of its object, from 0; files with the same mesh and scale have one object."""
    object_name: str
    count: int
    """Grasps with an outcome."""
    held: int
    not_tried: int
    """Grasps without an outcome, left out."""
    not_closed: int
    """Grasps whose jaws do not close on the mesh."""
    hand: str
    """Its name."""
    hand_from: str
    """In words."""
    mass: tuple[float, float] | None
    """Smallest and largest [kg]; None: not known, so no forces are computed without a load."""
    mass_from: str
    """given, file, column NAME, empty, or 1 kg: not known, forces are for it."""
    center_from: str
    """Where the centre of mass is from: given, file, volume or surface."""


@dataclass(frozen=True, eq=False)
class ScoredGrasps:
    """The grasps with an outcome, in the order of the files, and their scores; (n,) each."""

    file: Ints
    """Number of the file, from 0."""
    grasp: Ints
    """Number of the grasp in its file, from 1."""
    object_number: Ints
    """Number of the object, from 0."""
    held: Bools
    """Whether the grasp held."""
    state: Bytes
    """`Closing` codes."""
    label: Bytes
    """`Label` codes at the model's friction and resolution."""
    angle_upper: Floats
    """Upper bound of the critical friction angle, over all that is not known about the contacts
    [rad], by which S is decided; nan: the jaws do not close."""
    angle_lower: Floats
    """Its lower bound, by which U is decided [rad]."""
    scores: Mapping[str, Floats]
    """By name of `SCORES`; nan: the jaws do not close."""
    columns: Mapping[str, npt.NDArray[Any]]
    """All results of the poses in SI units, as `EvaluatedPoses.to_table` has them, and `mass`."""

    __repr__ = short_repr

    @property
    def size(self) -> int:
        """Number of grasps."""
        return len(self.held)

    @property
    def closed(self) -> Bools:
        """Whether the jaws close on the mesh."""
        return np.asarray(self.state == Closing.CLOSED)

    @property
    def one_sided(self) -> bool:
        """Whether all outcomes are the same, so that there is nothing to rank."""
        return bool(self.held.all() or not self.held.any())

    def ranked(self, score: Score) -> Floats:
        """Values of a score, turned so that larger is better; -inf where a value is missing."""
        return score.ranked(self.scores[score.name])


@dataclass(frozen=True, eq=False)
class Validation:
    """Labels and scores of grasps, held against their outcomes.

    Grasps whose jaws do not close on the mesh take part: they are labelled U and have the worst
    value of every score, since that is a prediction too.
    """

    files: tuple[ValidatedFile, ...]
    grasps: ScoredGrasps
    model: GraspModel
    """Friction and resolution of labels, margins and epsilon; those of the first gripper, if
    grippers state their own resolution."""
    settings: ValidationSettings
    qualities: tuple[ScoreQuality, ...]
    """Of each score."""
    differences: tuple[ScoreDifference, ...]
    """Of every two scores, those of the first one first."""
    by_objects: tuple[ObjectQuality, ...]
    """Of each object."""
    by_object: bool
    """Whether intervals are of objects drawn anew; otherwise, with one object, of grasps."""
    resamples: int
    """Resamples of the intervals: those of the settings, fewer for more than 100,000 grasps."""
    labels: tuple[LabelSuccess, ...]
    """Success within S, M and U over the frictions and resolutions of the settings."""
    calibration: Calibration
    disagreements: tuple[Disagreement, ...]
    """S that failed with the largest margins, and U that held with the smallest."""
    reasons: tuple[ReasonCount, ...]
    """What may be the reason of how many of all such grasps."""
    warnings: tuple[str, ...]
    """What may make the results wrong, one sentence each."""
    outcome: str | None = None
    """Name of the values of the files that are the outcomes; None: those of their formats."""

    __repr__ = short_repr

    @property
    def objects(self) -> int:
        """Number of objects."""
        return len({one.object_number for one in self.files})

    @property
    def not_tried(self) -> int:
        """Grasps without an outcome, left out."""
        return sum(one.not_tried for one in self.files)

    def quality(self, name: str) -> ScoreQuality:
        """How well a score predicts.

        Args:
            name: Name of the score.

        Raises:
            KeyError: It was not computed.
        """
        return {one.score.name: one for one in self.qualities}[name]

    @property
    def object_names(self) -> tuple[str, ...]:
        """Names of the objects' meshes."""
        names = {one.object_number: one.object_name for one in self.files}
        return tuple(names[number] for number in range(self.objects))

    def columns(self) -> dict[str, npt.NDArray[Any]]:
        """A table of the grasps, as `write_validation` writes it, shape (n,) each."""
        grasps = self.grasps
        own = {name: values for name, values in grasps.scores.items() if name not in grasps.columns}
        return {
            "file": np.array([as_unicode(one.name) for one in self.files])[grasps.file],
            "grasp": grasps.grasp,
            "object": grasps.object_number + 1,
            "success": grasps.held,
            **grasps.columns,
            **own,
        }


def write_validation(folder: str | Path, result: Validation) -> None:
    """Write the tables of a validation, `grasps.csv`, `scores.csv` and others, as CSV.

    Angles are in radians, lengths in metres, areas in square metres, forces in newtons, masses in
    kilograms; nan leaves the cell empty.

    Args:
        folder: Folder to make or to write to; tables that are in it are replaced.
        result: The outcome of `validate_grasps`.

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
    from grasp3d.system.tables import write_columns

    folder = made_folder(folder)
    write_columns(folder / TABLES[0], result.columns(), settings={})
    tables: tuple[Iterable[dict[str, Any]], ...] = (
        map(_score_row, result.qualities),
        map(_difference_row, result.differences),
        (
            {"object": one.number + 1, "mesh": as_unicode(result.object_names[one.number]),
             "grasps": one.count, "held": one.held, **one.roc_auc}
            for one in result.by_objects
        ),
        (_label_row(one, code) for one in result.labels for code in sorted(Label)[::-1]),
        map(_bin_row, result.calibration.bins),
        (
            {"kind": one.reason.kind, "reason": one.reason.name, "meaning": one.reason.why,
             "grasps": one.count, "of": one.of}
            for one in result.reasons
        ),
    )  # fmt: skip
    for name, rows in zip(TABLES[1:], tables, strict=True):
        listed = list(rows)
        keys = listed[0] if listed else _EMPTY.get(name, ())
        columns = {key: np.array([row[key] for row in listed]) for key in keys}
        write_columns(folder / name, columns, settings={})


_EMPTY = {"reasons.csv": ("kind", "reason", "meaning", "grasps", "of")}
"""Columns of tables that may have no row."""


def _score_row(one: ScoreQuality) -> dict[str, Any]:
    return {
        "score": one.score.name,
        "better": one.score.better,
        **_with_ends("roc_auc", one.roc_auc, one.roc_auc_interval),
        **_with_ends("average_precision", one.average_precision, one.average_precision_interval),
    }


def _difference_row(one: ScoreDifference) -> dict[str, Any]:
    ends = _with_ends("difference", one.difference, one.interval)
    return {"score": one.score.name, "other": one.other.name, **ends, "p": one.p}


def _label_row(one: LabelSuccess, label: Label) -> dict[str, Any]:
    return {
        "friction": float(one.friction),
        "sensor_resolution": float(one.sensor_resolution),
        "label": label.name,
        "grasps": one.counts[label],
        "held": one.held[label],
        **_with_ends("fraction", one.fraction(label.name), one.interval(label.name)),
    }


def _bin_row(one: MarginBin) -> dict[str, Any]:
    return {
        "margin_low": one.low,
        "margin_high": one.high,
        "margin_mean": one.mean,
        "grasps": one.count,
        "held": one.held,
        **_with_ends("fraction", one.fraction, one.interval),
    }


def _with_ends(name: str, value: float, ends: tuple[float, float]) -> dict[str, float]:
    """Columns of a number and of the ends of its interval."""
    return {name: value, f"{name}_low": ends[0], f"{name}_high": ends[1]}


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
