"""Scores of grasps that are held against their outcomes, with the direction in which each counts.

The directions follow from mechanics and are the same for all data; none is chosen from outcomes.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from operator import attrgetter
from typing import Any, Literal

import numpy as np

from grasp3d.arrays import Floats, angles_between
from grasp3d.grasps.evaluated_poses import EvaluatedPoses
from grasp3d.grasps.jaw_grasps import JawGrasps
from grasp3d.surface.fields import Array, under_load

Of = Callable[[EvaluatedPoses], Array | None]
"""The values of evaluated poses in SI units, shape (k,); None: they need what is not known, such as
a load."""


@dataclass(frozen=True)
class Score:
    """A number of each grasp that may predict whether it holds.

    Example:
        >>> from grasp3d.outcomes import SCORES
        >>> print(*(score.name for score in SCORES))
        quality score payload margin critical_angle label epsilon ...
    """

    name: str
    """The column of tables."""
    title: str
    better: Literal["larger", "smaller"]
    """Which values are better; fixed beforehand."""
    of: Of = field(repr=False)
    """Takes its values from evaluated poses."""
    always: bool = False
    """Whether it has a value where the hand does not close."""

    def ranked(self, values: Floats) -> Floats:
        """Turn values so that larger is better; -inf, the worst, where a value is missing (nan)."""
        signed = values if self.better == "larger" else -values
        return np.where(np.isnan(signed), -math.inf, signed)


def _of_jaws(of: Callable[[Any], Array]) -> Of:
    """What only the jaws of a gripper have; None of hands with joints."""
    return lambda poses: of(poses) if hasattr(poses, "jaws") else None


def _line(poses: JawGrasps) -> Floats:
    """Unit vectors from the first contact to the second, shape (k, 3)."""
    line = poses.jaws.points[:, 1] - poses.jaws.points[:, 0]
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(line / np.linalg.norm(line, axis=1, keepdims=True))


def _antipodal_angle(poses: JawGrasps) -> Floats:
    line, normals = _line(poses), poses.jaws.normals
    with np.errstate(invalid="ignore"):
        return np.maximum(angles_between(normals[:, 0], line), angles_between(normals[:, 1], -line))


def _normal_product(poses: JawGrasps) -> Floats:
    return np.asarray(poses.jaws.normals.prod(axis=1).sum(axis=1))


def _arm(poses: JawGrasps) -> Floats:
    away = np.cross(poses.mesh.center_mass - poses.jaws.points[:, 0], _line(poses))
    return np.asarray(np.linalg.norm(away, axis=1))


SCORES = (
    Score("quality", "quality", "larger", attrgetter("quality"), always=True),
    Score("score", "score", "larger", attrgetter("score"), always=True),
    Score("payload", "payload", "larger", under_load("payload")),
    Score("margin", "margin", "larger", attrgetter("margin")),
    Score("critical_angle", "β*", "smaller", attrgetter("critical_angle")),
    Score("label", "label", "larger", attrgetter("label"), always=True),
    Score("epsilon", "ε", "larger", attrgetter("epsilon")),
    Score("grip_force", "grip force", "smaller", under_load("grip_force")),
    Score("reachable", "reachable", "larger", attrgetter("reachable"), always=True),
    Score("antipodal_angle", "antipodal angle", "smaller", _of_jaws(_antipodal_angle)),
    Score("normal_product", "product of the normals", "smaller", _of_jaws(_normal_product)),
    Score("center_of_mass_distance", "distance of the COM", "smaller", _of_jaws(_arm)),
    # A narrower grasp leaves the fingers more clearance on their way.
    Score("opening", "opening", "smaller", _of_jaws(attrgetter("opening"))),
    Score(
        "contact_area",
        "contact area",
        "larger",
        _of_jaws(lambda poses: poses.jaws.area.min(axis=1)),
    ),
)
"""All scores, each with how it is computed."""


def scores_of(poses: EvaluatedPoses) -> dict[str, Floats]:
    """The scores of evaluated poses, shape (k,) each, in SI units and radians.

    Args:
        poses: Evaluated poses.

    Returns:
        By name of `SCORES`; nan where the hand does not close, but for labels and `reachable`,
        which are 0 there. Those that need a load, a force at hand or jaws are absent without it.
    """
    closed = poses.closed
    found = ((score, score.of(poses)) for score in SCORES)
    return {
        score.name: np.where(closed | score.always, values.astype(np.float64), math.nan)
        for score, values in found
        if values is not None
    }


def columns_of(poses: EvaluatedPoses) -> dict[str, Array]:
    """All results and scores of evaluated poses, as columns of shape (k,).

    Args:
        poses: Evaluated poses.
    """
    table, scores = poses.to_table(), scores_of(poses)
    results = zip(table.column_names, table.columns, strict=True)
    # The table's letters are texts, and whether a pose is reachable is true or false.
    own = {name: scores[name] for name in scores if name not in {"label", "reachable"}}
    return {name: column.to_numpy() for name, column in results} | own
