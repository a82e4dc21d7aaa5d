"""Columns of tables of simulated grasps."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from grasp3d.physics.drawing import DrawnGrasps
from grasp3d.physics.pulling import Outcome
from grasp3d.stability.label import Label

Columns = dict[str, npt.NDArray[Any]]


def label_columns(grasps: DrawnGrasps) -> Columns:
    """Labels, margins, critical friction angles [rad] and true friction."""
    return {
        "label": np.array([Label(code).name for code in grasps.label]),
        "critical_angle": grasps.critical_angle,
        "margin": grasps.margin,
        "friction1": grasps.friction[:, 0],
        "friction2": grasps.friction[:, 1],
    }


def outcome_columns(outcomes: Sequence[Outcome], metres: float) -> Columns:
    """How far objects moved; angles in radians.

    Args:
        outcomes: What became of each grasp.
        metres: Metres of the unit of lengths.
    """

    def values(name: str) -> npt.NDArray[Any]:
        return np.array([getattr(one, name) for one in outcomes], dtype=np.float64)

    lengths = {name: values(name) / metres for name in ("slip", "shift", "squeeze_shift")}
    angles = {name: values(name) for name in ("turn", "spin", "squeeze_turn")}
    pulls = np.array([one.pulls_held for one in outcomes], dtype=np.int64)
    return {**lengths, **angles, "pulls_held": pulls}


def contact_columns(grasps: DrawnGrasps) -> Columns:
    """True and perceived contacts, with inward normals."""
    columns: Columns = {}
    for prefix, points, normals in (
        ("", grasps.points, grasps.normals),
        ("perceived_", grasps.perceived_points, grasps.perceived_normals),
    ):
        for finger in range(2):
            for head, vectors in (("", points), ("n", normals)):
                for number, axis in enumerate("xyz"):
                    columns[f"{prefix}{head}{axis}{finger + 1}"] = vectors[:, finger, number]
    return columns
