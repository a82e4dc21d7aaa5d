"""Scores of grasps that are held against their outcomes, with the direction in which each counts.

The directions follow from mechanics and are the same for all data; none is chosen from outcomes.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from operator import attrgetter
from typing import Literal

import numpy as np

from grasp3d.arrays import Floats, angles_between
from grasp3d.grasps.evaluated_poses import EvaluatedPoses
from grasp3d.surface.fields import Array, given_poses, present, under_load

Better = Literal["larger", "smaller"]
Quantity = Literal["angle", "length", "area", "force", "mass", "number"]
Of = Callable[[EvaluatedPoses], Array | None]
"""The values of evaluated poses in SI units, shape (k,); None: they need what is not known, such as
a load."""


@dataclass(frozen=True)
class Score:
    """A number of each grasp that may predict whether it holds.

    Example:
        >>> from grasp3d.validating import SCORES
        >>> print(*(score.name for score in SCORES))
        quality score payload margin critical_angle label epsilon ...
    """

    name: str
    title: str
    better: Better
    """Which values are better; fixed beforehand."""
    quantity: Quantity
    """What it measures: angles are in radians, lengths in metres, areas in square metres, forces in
    newtons, masses in kilograms."""
    meaning: str
    of: Of = field(repr=False)
    """Takes its values from evaluated poses."""
    always: bool = False
    """Whether it has a value where the jaws do not close."""

    def ranked(self, values: Floats) -> Floats:
        """Turn values so that larger is better; -inf, the worst, where a value is missing (nan)."""
        signed = values if self.better == "larger" else -values
        return np.where(np.isnan(signed), -math.inf, signed)


def _line(poses: EvaluatedPoses) -> Floats:
    """Unit vectors from the first contact to the second, shape (k, 3)."""
    line = poses.jaws.points[:, 1] - poses.jaws.points[:, 0]
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(line / np.linalg.norm(line, axis=1, keepdims=True))


def _antipodal_angle(poses: EvaluatedPoses) -> Floats:
    line, normals = _line(poses), poses.jaws.normals
    with np.errstate(invalid="ignore"):
        return np.maximum(angles_between(normals[:, 0], line), angles_between(normals[:, 1], -line))


def _normal_product(poses: EvaluatedPoses) -> Floats:
    normals = poses.jaws.normals
    return np.asarray((normals[:, 0] * normals[:, 1]).sum(axis=1))


def _arm(poses: EvaluatedPoses) -> Floats:
    away = np.cross(poses.mesh.center_mass - poses.jaws.points[:, 0], _line(poses))
    return np.asarray(np.linalg.norm(away, axis=1))


SCORES = (
    Score("quality", "quality", "larger", "number",
          "what the touched patches hold at the worst normals, over the mass, r / (1 + r), mean "
          "over the poses tried, whatever the approach; below 0 where they do not hold it, -1 "
          "where the jaws do not close",
          of=attrgetter("quality"), always=True),
    Score("score", "score", "larger", "number",
          "what files have: the letter, and within that the quality, less where the approach may "
          "hardly turn", of=attrgetter("score"),
          always=True),
    Score("payload", "payload", "larger", "mass",
          "mass that the force at hand holds at the worst normals", of=under_load("payload")),
    Score("margin", "margin", "larger", "angle",
          "β - α/2 - β* less all other uncertainties; S above 0",
          of=attrgetter("margin")),
    Score("critical_angle", "β*", "smaller", "angle",
          "critical friction angle: friction must exceed it",
          of=attrgetter("critical_angle")),
    Score("label", "label", "larger", "number",
          "2: S, 1: M, 0: U, of everything that is stated",
          of=attrgetter("label"), always=True),
    Score("epsilon", "ε", "larger", "number", "Ferrari & Canny 1992, at the nominal normals",
          of=attrgetter("epsilon")),
    Score("grip_force", "grip force", "smaller", "force",
          "force that each finger needs at the worst normals; inf: none suffices",
          of=under_load("grip_force")),
    Score("reachable", "reachable", "larger", "number",
          "1: the jaws close, within the stroke, without collision",
          of=attrgetter("reachable"), always=True),
    Score("antipodal_angle", "antipodal angle", "smaller", "angle",
          "larger angle between the line of the contacts and their normals", of=_antipodal_angle),
    Score("normal_product", "product of the normals", "smaller", "number",
          "inner product of the unit normals, -1 where they are opposed", of=_normal_product),
    Score("center_of_mass_distance", "distance of the COM", "smaller", "length",
          "from the line of the contacts: the arm of the weight", of=_arm),
    Score("opening", "opening", "smaller", "length",
          "a narrower grasp leaves the fingers more clearance on their way",
          of=lambda poses: poses.opening),
    Score("contact_area", "contact area", "larger", "area",
          "the smaller of the two touched patches",
          of=lambda poses: poses.jaws.area.min(axis=1)),
)  # fmt: skip
"""All scores, each with how it is computed; the first is compared with all others."""


def scores_of(poses: EvaluatedPoses) -> dict[str, Floats]:
    """The scores of evaluated poses, shape (k,) each, in SI units and radians.

    Args:
        poses: Evaluated poses.

    Returns:
        By name of `SCORES`; nan where the jaws do not close, but for labels and `reachable`, which
        are 0 there. Those that need a load or a force at hand are absent without it.
    """
    closed = poses.jaws.closed
    found = ((score, score.of(poses)) for score in SCORES)
    return {
        score.name: np.where(closed | score.always, values.astype(np.float64), math.nan)
        for score, values in found
        if values is not None
    }


def results_of(poses: EvaluatedPoses) -> dict[str, Array]:
    """All results of evaluated poses in SI units and radians, as columns of shape (k,).

    Args:
        poses: Evaluated poses.
    """
    fingers = poses.jaws.area.shape[1]
    columns: dict[str, Array] = {"name": np.array(poses.given.names)}
    for one, values in present(given_poses(fingers), poses):
        columns[one.name] = one.texts_of(values)
    columns["opening"] = poses.opening
    for jaw in range(fingers):
        for k, axis in enumerate("xyz"):
            columns[f"{axis}{jaw + 1}"] = poses.jaws.points[:, jaw, k]
            columns[f"n{axis}{jaw + 1}"] = 0.0 - poses.jaws.normals[:, jaw, k]
    return columns
