"""Result of holding labels and scores against outcomes."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from grasp3d.arrays import Bools, Bytes, Floats, Ints, short_repr
from grasp3d.hand.closed_jaws import Closing
from grasp3d.settings import GraspModel
from grasp3d.stability.label import Label
from grasp3d.system.names import as_unicode
from grasp3d.validating.disagreements import Disagreement
from grasp3d.validating.scores import Score
from grasp3d.validating.success import Calibration, LabelSuccess
from grasp3d.validating.validation_settings import ValidationSettings


@dataclass(frozen=True)
class ValidatedFile:
    """What the grasps of one file were evaluated with."""

    name: str
    object_number: int
    """Number of its object, from 0; files with the same mesh, scale and mass have one object."""
    object_name: str
    count: int
    """Grasps with an outcome."""
    held: int
    not_tried: int
    """Grasps without an outcome, left out."""
    not_closed: int
    """Grasps whose jaws do not close on the mesh."""
    gripper: str
    gripper_from: str
    """In words."""
    mass: float | None
    """[kg]; None: not known, and no grip force is computed unless a load is given."""
    mass_from: str
    """given, file, or empty."""
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
    located_worst: Floats
    """Critical friction angle with all that is not known about the contacts [rad], by which S is
    decided; nan: the jaws do not close."""
    located_best: Floats
    """The same by which U is decided [rad]."""
    scores: Mapping[str, Floats]
    """By name of `SCORES`; nan: the jaws do not close."""

    __repr__ = short_repr

    @property
    def size(self) -> int:
        """Number of grasps."""
        return len(self.held)

    @property
    def closed(self) -> Bools:
        """Whether the jaws close on the mesh."""
        return np.asarray(self.state == Closing.CLOSED)

    def ranked(self, score: Score) -> Floats:
        """Values of a score of which larger ones are better; -inf where there is none."""
        return score.ranked(self.scores[score.name])


@dataclass(frozen=True)
class ScoreQuality:
    """How well one score predicts the outcomes; intervals at 95 %."""

    score: Score
    roc_auc: float
    """Probability that a held grasp ranks above a failed one; nan: all outcomes are the same."""
    roc_auc_interval: tuple[float, float]
    average_precision: float
    """nan: no grasp held."""
    average_precision_interval: tuple[float, float]


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
    by_object: bool
    """Whether intervals are of objects drawn anew; otherwise, with one object, of grasps."""
    resamples: int
    """Resamples of the intervals: those of the settings, fewer for more than 100,000 grasps."""
    labels: tuple[LabelSuccess, ...]
    """Success within S, M and U over the frictions and resolutions of the settings."""
    calibration: Calibration
    disagreements: tuple[Disagreement, ...]
    """Grasps that failed with the largest margins, and that held with the smallest."""
    warnings: tuple[str, ...]
    """What may make the results wrong, one sentence each."""

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

    def columns(self) -> dict[str, npt.NDArray[Any]]:
        """A table of the grasps, as `write_validation` writes it, shape (n,) each."""
        grasps = self.grasps
        states = np.array([state.name.lower() for state in sorted(Closing)])
        labels = np.array([label.name for label in sorted(Label)])
        own = {name: values for name, values in grasps.scores.items() if name not in _AS_TEXT}
        return {
            "file": np.array([as_unicode(one.name) for one in self.files])[grasps.file],
            "grasp": grasps.grasp,
            "object": grasps.object_number + 1,
            "success": grasps.held,
            "closing": states[grasps.state],
            "label": labels[grasps.label],
            "reachable": grasps.scores["reachable"] == 1.0,
            **own,
        }


_AS_TEXT = ("label", "reachable")
"""Scores that the table has as text and as true or false."""
