"""Result of simulated grasps."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from grasp3d.arrays import Bools, Floats, short_repr
from grasp3d.contact.contacts import Contacts
from grasp3d.mesh import ObjectMesh
from grasp3d.physics.drawing import DrawnGrasps
from grasp3d.physics.pulling import Fate, Outcome
from grasp3d.physics.simulation_settings import SimulationSettings
from grasp3d.physics.success import SuccessRate, rates_by, success_rate
from grasp3d.physics.table_columns import contact_columns, label_columns, outcome_columns
from grasp3d.quality.critical_angle import critical_friction_angle
from grasp3d.settings import GraspModel
from grasp3d.settings.lengths import METRES
from grasp3d.settings.parsing import plain_values
from grasp3d.stability.label import Label

if TYPE_CHECKING:
    import pandas as pd

MARGINS = (-math.inf, -30.0, -20.0, -10.0, 0.0, 10.0, 20.0, math.inf)
"""Borders of the bins of the margin [degrees]."""


@dataclass(frozen=True, eq=False)
class Simulation:
    """Grasps of an object, and what became of them in a simulation; arrays over the grasps."""

    mesh: ObjectMesh
    model: GraspModel
    """Friction, and what is uncertain."""
    settings: SimulationSettings
    grasps: DrawnGrasps
    """True and perceived contacts, in the mesh's unit, and labels."""
    poses: Floats
    """Matrices that take the gripper's coordinates to the mesh's frame, shape (k, 4, 4);
    translations in the mesh's unit."""
    openings: Floats
    """Distance of the nearest points of the tips at the contacts [mesh unit], shape (k,)."""
    outcomes: tuple[Outcome, ...]
    """What became of each grasp; lengths in metres."""
    parts: int
    """Number of convex parts of the simulated object."""
    part_depth: Floats
    """Distance of the mesh from the parts' surface at the contacts [mesh unit], shape (k, 2)."""
    part_angle: Floats
    """Angle between the normals of mesh and parts there [rad], shape (k, 2)."""
    warnings: tuple[str, ...] = ()
    """What limits the result, one sentence each."""

    __repr__ = short_repr

    @property
    def size(self) -> int:
        """Number of grasps."""
        return len(self.outcomes)

    @cached_property
    def fates(self) -> tuple[Fate, ...]:
        """How each ended."""
        return tuple(one.fate for one in self.outcomes)

    @cached_property
    def simulated(self) -> Bools:
        """Whether the simulation of each says anything, shape (k,)."""
        return np.array([fate is not Fate.BROKEN for fate in self.fates], dtype=bool)

    @cached_property
    def success(self) -> Bools:
        """Whether each grasp held: all pulls, at the contacts that were labelled, shape (k,)."""
        return np.array([fate is Fate.HELD for fate in self.fates], dtype=bool)

    @cached_property
    def held(self) -> Bools:
        """Whether the object was held, perhaps after it had turned into another grasp, (k,)."""
        return np.array([one.held for one in self.outcomes], dtype=bool)

    @cached_property
    def true_critical_angle(self) -> Floats:
        """Critical friction angle of the true contacts [rad], shape (k,)."""
        contacts = Contacts(self.grasps.points, self.grasps.normals, self.grasps.friction)
        return np.asarray(critical_friction_angle(contacts))

    def rates(self, *, held: bool = False) -> dict[str, SuccessRate]:
        """Success of the labels S, M and U.

        Args:
            held: Whether an object that is held in another grasp than the labelled one counts.
        """
        success = self.held if held else self.success
        return {
            label.name: success_rate(
                label.name, success[(self.grasps.label == label) & self.simulated]
            )
            for label in (Label.S, Label.M, Label.U)
        }

    def rates_by_margin(self, *, held: bool = False) -> tuple[SuccessRate, ...]:
        """Success in bins of the margin, in degrees, from the smallest.

        Args:
            held: As in `rates`.
        """
        success = self.held if held else self.success
        chosen = self.simulated
        margin = np.degrees(self.grasps.margin[chosen])
        return tuple(rates_by(margin, success[chosen], MARGINS))

    def columns(self) -> Mapping[str, npt.NDArray[Any]]:
        """The columns of the table; angles in radians, lengths in the mesh's unit.

        `grasp` (its number from 1), `success`, `held`, `fate`; `label`, `critical_angle`, `margin`,
        `friction1`, `friction2`, `true_critical_angle`; `slip`, `shift`, `squeeze_shift`, `turn`,
        `spin`, `squeeze_turn`, `pulls_held`; `opening`; true contacts `x1` `y1` `z1` with inward
        normals `nx1` `ny1` `nz1` ..., perceived ones with `perceived_` before their names;
        `part_depth1`, `part_angle1`, ...
        """
        assert self.mesh.unit is not None  # grasps of a mesh without one are not simulated
        parts = {
            f"part_{name}{finger + 1}": values[:, finger]
            for finger in range(2)
            for name, values in (("depth", self.part_depth), ("angle", self.part_angle))
        }
        return {
            "grasp": np.arange(1, self.size + 1),
            "success": self.success,
            "held": self.held,
            "fate": np.array([str(one) for one in self.fates]),
            **label_columns(self.grasps),
            "true_critical_angle": self.true_critical_angle,
            **outcome_columns(self.outcomes, METRES[self.mesh.unit]),
            "opening": self.openings,
            **contact_columns(self.grasps),
            **parts,
        }

    def to_dataframe(self) -> "pd.DataFrame":
        """The table as a data frame of pandas.

        Raises:
            OutputError: pandas is not installed.
        """
        from grasp3d.tables.columns import data_frame, table_of_columns

        return data_frame(table_of_columns(self.columns(), settings=plain_values(self.settings)))
