"""Scores of grasps that are held against their outcomes, with the direction in which each counts.

The directions follow from mechanics and are the same for all data; none is chosen from outcomes.
"""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from grasp3d.arrays import Floats, angles_between
from grasp3d.grasps.evaluated_poses import EvaluatedPoses
from grasp3d.settings.lengths import METRES

Better = Literal["larger", "smaller"]
Quantity = Literal["angle", "length", "area", "force", "number"]


@dataclass(frozen=True)
class Score:
    """A number of each grasp that may predict whether it holds.

    Example:
        >>> from grasp3d.validating import SCORES
        >>> print(*(score.name for score in SCORES))
        margin critical_angle label epsilon grip_force reachable antipodal_angle normal_product ...
    """

    name: str
    title: str
    better: Better
    """Which values are better; fixed beforehand."""
    quantity: Quantity
    """What it measures: angles are in radians, lengths in metres, areas in square metres."""
    meaning: str

    def ranked(self, values: Floats) -> Floats:
        """Turn values so that larger is better; -inf, the worst, where a value is missing (nan)."""
        signed = values if self.better == "larger" else -values
        return np.where(np.isnan(signed), -math.inf, signed)


SCORES = (
    Score("margin", "margin", "larger", "angle",
          "β - α/2 - β* less all other uncertainties; S above 0"),
    Score("critical_angle", "β*", "smaller", "angle",
          "critical friction angle: friction must exceed it"),
    Score("label", "label", "larger", "number", "2: S, 1: M, 0: U, at the friction and resolution"),
    Score("epsilon", "ε", "larger", "number", "Ferrari & Canny 1992, at the nominal normals"),
    Score("grip_force", "grip force", "smaller", "force",
          "force that each finger needs to hold the load; inf: none suffices"),
    Score("reachable", "reachable", "larger", "number",
          "1: the jaws close, within the stroke, without collision"),
    Score("antipodal_angle", "antipodal angle", "smaller", "angle",
          "larger angle between the line of the contacts and their normals"),
    Score("normal_product", "product of the normals", "smaller", "number",
          "inner product of the unit normals, -1 where they are opposed"),
    Score("center_of_mass_distance", "distance of the COM", "smaller", "length",
          "from the line of the contacts: the arm of the weight"),
    Score("opening", "opening", "smaller", "length",
          "a narrower grasp leaves the fingers more clearance on their way"),
    Score("contact_area", "contact area", "larger", "area",
          "the smaller of the two touched patches"),
)  # fmt: skip
"""All scores; `grip_force` is computed where there is a load."""


def scores_of(poses: EvaluatedPoses) -> dict[str, Floats]:
    """The scores of evaluated poses, shape (k,) each, in SI units and radians.

    Args:
        poses: Evaluated poses.

    Returns:
        By name of `SCORES`; nan where the jaws do not close, but for `label` and `reachable`,
        which are 0 there. Without a load there is no `grip_force`.
    """
    assert poses.mesh.unit is not None  # evaluated poses have a unit
    metres = METRES[poses.mesh.unit]
    values = {
        "margin": poses.margin,
        "critical_angle": poses.critical_angle,
        "label": poses.label.astype(np.float64),
        "epsilon": poses.epsilon,
        "reachable": poses.reachable.astype(np.float64),
        **_of_contacts(poses, metres),
        "opening": poses.opening * metres,
        "contact_area": poses.jaws.area.min(axis=1) * metres**2,
    }
    if poses.holding is not None:
        values["grip_force"] = poses.holding.grip_force
    closed = poses.jaws.closed
    return {
        score.name: np.where(closed | (score.name in _ALWAYS), values[score.name], math.nan)
        for score in SCORES
        if score.name in values
    }


_ALWAYS = ("label", "reachable")
"""Scores that poses have whose jaws do not close."""


def _of_contacts(poses: EvaluatedPoses, metres: float) -> dict[str, Floats]:
    """Scores of two contacts without friction: angles, normals, distance of the COM."""
    points, normals = poses.jaws.points, poses.jaws.normals
    with np.errstate(invalid="ignore", divide="ignore"):
        line = points[:, 1] - points[:, 0]
        line = line / np.linalg.norm(line, axis=1, keepdims=True)  # (k, 3)
        angles = np.maximum(
            angles_between(normals[:, 0], line), angles_between(normals[:, 1], -line)
        )
        arm = np.cross(poses.mesh.center_mass - points[:, 0], line)
    return {
        "antipodal_angle": angles,
        "normal_product": (normals[:, 0] * normals[:, 1]).sum(axis=1),
        "center_of_mass_distance": np.linalg.norm(arm, axis=1) * metres,
    }
