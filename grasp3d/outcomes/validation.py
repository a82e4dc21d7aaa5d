"""Result of comparing labels and scores with outcomes, and its table."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from grasp3d.arrays import Bools, Floats, Ints, short_repr
from grasp3d.outcomes.scores import Score
from grasp3d.outcomes.success import SuccessRate, success_rate
from grasp3d.settings import GraspModel
from grasp3d.stability.label import Label


@dataclass(frozen=True)
class ValidatedFile:
    """What the grasps of one file were evaluated with."""

    name: str
    object_number: int
    """Number of its object, from 1; files with the same mesh and scale have one object."""
    model: GraspModel
    """Friction and resolution of labels, margins and epsilon: its gripper may state its own."""
    count: int
    """Grasps with an outcome."""
    not_tried: int
    """Grasps without an outcome, left out."""
    sources: str
    """Gripper, mass and centre of mass, and where they are from, in words."""


@dataclass(frozen=True)
class ScoreQuality:
    """How well one score ranks grasps that held above grasps that failed."""

    score: Score
    roc_auc: float
    """Probability that a held grasp ranks above a failed one; nan: all outcomes are the same."""
    low: float
    """Lower end of its interval at 95 %: for other objects if there are several, else for other
    grasps of this one."""
    high: float
    """Upper end."""


@dataclass(frozen=True, eq=False)
class Validation:
    """Labels and scores of n grasps, held against their outcomes.

    Grasps whose jaws do not close on the mesh take part: they are labelled U and have the worst
    value of every score, since that is a prediction too.
    """

    files: tuple[ValidatedFile, ...]
    columns: Mapping[str, npt.NDArray[Any]]
    """`file`, `object` (number, from 1), `grasp` (number in the file, from 1), `mass` [kg], all
    results as `EvaluatedPoses.to_table` has them, with `outcome`, and `SCORES`, in SI units and in
    the order of the files; shape (n,) each."""
    qualities: tuple[ScoreQuality, ...]
    """Of each score."""
    warnings: tuple[str, ...]
    """What may make the results wrong, one sentence each."""
    outcome: str | None = None
    """Name of the values of the files that are the outcomes; None: those of their formats."""

    __repr__ = short_repr

    @property
    def size(self) -> int:
        """Number of grasps with an outcome."""
        return len(self.held)

    @property
    def objects(self) -> int:
        """Number of objects."""
        return len({one.object_number for one in self.files})

    @property
    def held(self) -> Bools:
        """Whether each grasp held, shape (n,)."""
        return np.asarray(self.columns["outcome"] == 1.0)

    @property
    def rates(self) -> dict[Label, SuccessRate]:
        """How many grasps of each label held, S first."""
        return {
            label: success_rate(label.name, self.held[self.columns["label"] == label.name])
            for label in sorted(Label)[::-1]
        }

    @property
    def wrong(self) -> Ints:
        """Rows of S that failed, the best score first, then of U that held, the worst first."""
        label, score = self.columns["label"], self.columns["score"]
        failed = np.flatnonzero(~self.held & (label == "S"))
        held = np.flatnonzero(self.held & (label == "U"))
        return np.concatenate([failed[np.argsort(-score[failed])], held[np.argsort(score[held])]])

    def ranked(self, score: Score) -> Floats:
        """Values of a score, shape (n,), turned so that larger is better; -inf: there is none.

        Args:
            score: One that was computed.
        """
        values = self.columns[score.name]
        if score.name == "label":
            values = np.array([Label[letter] for letter in values.tolist()])
        return score.ranked(values.astype(np.float64))

    def quality(self, name: str) -> ScoreQuality:
        """How well a score predicts.

        Args:
            name: Name of the score.

        Raises:
            KeyError: It was not computed.
        """
        return {one.score.name: one for one in self.qualities}[name]


def write_validation(path: str | Path, result: Validation) -> None:
    """Write a table with a row for each grasp: outcome, scores, and all results.

    Angles are in radians, lengths in metres, areas in square metres, forces in newtons, masses in
    kilograms; nan leaves the cell empty.

    Args:
        path: Table to create or replace, .csv or .parquet.
        result: The outcome of `validate_grasps`.

    Raises:
        OutputError: The suffix is unknown, or the file cannot be written.

    Example:
        >>> from pathlib import Path
        >>> import numpy as np
        >>> import trimesh
        >>> import grasp3d
        >>> from grasp3d.formats import GraspPoses
        >>> from grasp3d.outcomes import write_validation
        >>> from grasp3d.formats import GraspPoses
        >>> from grasp3d.outcomes import write_validation
        >>> box = grasp3d.load_mesh(trimesh.creation.box([0.06, 0.04, 0.02]), unit="m")
        >>> poses = np.tile(np.diag([1.0, -1.0, -1.0, 1.0]), (2, 1, 1))
        >>> tried = GraspPoses(poses=poses, outcome=[1, 0], unit="m")
        >>> franka = grasp3d.ParallelGripper.preset("franka")
        >>> write_validation("out.csv", grasp3d.validate_grasps(tried, mesh=box, hand=franka))
        >>> print(Path("out.csv").read_text()[:23])
        "file","object","grasp"
    """
    from grasp3d.system.tables import write_columns

    write_columns(Path(path), result.columns, settings={})
