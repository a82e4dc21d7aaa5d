"""Result of simulated grasps: outcomes, rates of success, and the table of all grasps."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from grasp3d.arrays import ArrayLike, Bools, Floats, short_repr
from grasp3d.contact.contacts import Contacts
from grasp3d.mesh import ObjectMesh
from grasp3d.physics.drawing import DrawnGrasps
from grasp3d.physics.pulling import Fate, Outcome
from grasp3d.physics.simulation_settings import SimulationSettings
from grasp3d.quality.critical_angle import critical_friction_angle
from grasp3d.settings import GraspModel
from grasp3d.settings.parsing import plain_values
from grasp3d.stability.label import Label
from grasp3d.surface.label_settings import chosen_settings
from grasp3d.system.versions import package_version
from grasp3d.validating.success import SuccessRate, success_rate

if TYPE_CHECKING:
    import pandas as pd

MARGINS = (-math.inf, -30.0, -20.0, -10.0, 0.0, 10.0, 20.0, math.inf)
"""Borders of the bins of the margin [degrees]."""

Columns = dict[str, npt.NDArray[Any]]


def _contact_columns(grasps: DrawnGrasps) -> Columns:
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


def rates_by(values: Floats, success: Bools, edges: ArrayLike) -> Iterator[SuccessRate]:
    """Rates in bins of a number, such as the margin in degrees.

    Args:
        values: The number of each grasp, shape (k,).
        success: Whether each succeeded, shape (k,).
        edges: Borders of the bins, in increasing order; the outer ones may be infinite.
    """
    borders = np.asarray(edges, dtype=np.float64)
    for low, high in pairwise(borders.tolist()):
        name = f"from {low:g}" if math.isinf(high) else f"{low:g} to {high:g}"
        inside = (values >= low) & (values < high)
        yield success_rate(f"below {high:g}" if math.isinf(low) else name, success[inside])


@dataclass(frozen=True, eq=False)
class Simulation:
    """Grasps of an object, and what became of them in a simulation; arrays over the grasps."""

    mesh: ObjectMesh
    model: GraspModel
    """Friction, and what is uncertain."""
    settings: SimulationSettings
    grasps: DrawnGrasps
    """True and perceived contacts [m], and labels."""
    poses: Floats
    """Matrices that take the gripper's coordinates to the mesh's frame, shape (k, 4, 4);
    translations [m]."""
    openings: Floats
    """Distance of the nearest points of the tips at the contacts [m], shape (k,)."""
    outcomes: tuple[Outcome, ...]
    """What became of each grasp; lengths in metres."""
    parts: int
    """Number of convex parts of the simulated object."""
    part_depth: Floats
    """Distance of the mesh from the parts' surface at the contacts [m], shape (k, 2)."""
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
            held: Whether an object that is held in another than the labelled grasp counts.
        """
        success, labels = (self.held if held else self.success), self.grasps.label
        return {
            one.name: success_rate(one.name, success[(labels == one) & self.simulated])
            for one in (Label.S, Label.M, Label.U)
        }

    def rates_by_margin(self, *, held: bool = False) -> tuple[SuccessRate, ...]:
        """Success in bins of the margin, in degrees, from the smallest.

        Args:
            held: As in `rates`.
        """
        success = (self.held if held else self.success)[self.simulated]
        margin = np.degrees(self.grasps.margin[self.simulated])
        return tuple(rates_by(margin, success, MARGINS))

    def columns(self) -> Mapping[str, npt.NDArray[Any]]:
        """The columns of the table; angles in radians, lengths in metres.

        `grasp` (its number from 1), `success`, `held`, `fate`; `label`, `critical_angle`, `margin`,
        `friction1`, `friction2`, `true_critical_angle`; `slip`, `shift`, `squeeze_shift`, `turn`,
        `spin`, `squeeze_turn`, `pulls_held`; `opening`; true contacts `x1` `y1` `z1` with inward
        normals `nx1` `ny1` `nz1` ..., perceived ones with `perceived_` before their names;
        `part_depth1`, `part_angle1`, ...; `unit`, that of the lengths, m.
        """
        grasps = self.grasps
        moved = {
            name: np.array([getattr(one, name) for one in self.outcomes], dtype=np.float64)
            for name in ("slip", "shift", "squeeze_shift", "turn", "spin", "squeeze_turn")
        }
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
            "label": np.array([Label(code).name for code in grasps.label]),
            "critical_angle": grasps.critical_angle,
            "margin": grasps.margin,
            "friction1": grasps.friction[:, 0],
            "friction2": grasps.friction[:, 1],
            "true_critical_angle": self.true_critical_angle,
            **moved,
            "pulls_held": np.array([one.pulls_held for one in self.outcomes], dtype=np.int64),
            "opening": self.openings,
            **_contact_columns(grasps),
            **parts,
            "unit": np.full(self.size, "m"),
        }

    def to_dataframe(self) -> "pd.DataFrame":
        """The table as a data frame of pandas.

        Raises:
            OutputError: pandas is not installed.
        """
        from grasp3d.system.tables import data_frame, table_of_columns

        return data_frame(table_of_columns(self.columns(), settings=plain_values(self.settings)))


def write_simulation(path: str | Path, simulation: Simulation) -> None:
    """Write a row for each simulated grasp: outcome, label, margin and contacts.

    The columns are those of `Simulation.columns`.

    Args:
        path: File to make or replace: .csv or .parquet, which stores the settings too.
        simulation: The simulated grasps.

    Raises:
        OutputError: The suffix is unknown, or the file cannot be written.

    Example:
        >>> from pathlib import Path
        >>> import trimesh
        >>> import grasp3d
        >>> from grasp3d.batch import ClusterSettings
        >>> from grasp3d.physics import SimulationSettings, write_simulation
        >>> box = grasp3d.load_mesh(trimesh.creation.box([0.04, 0.06, 0.1]), unit="m")
        >>> settings = SimulationSettings(count=3, pull_time=0.1)
        >>> simulation = grasp3d.simulate_grasps(
        ...     box, simulation=settings, cluster=ClusterSettings(workers=0)
        ... )
        >>> write_simulation("simulated.csv", simulation)
        >>> len(Path("simulated.csv").read_text().splitlines())
        4
    """
    from grasp3d.system.tables import write_columns

    write_columns(Path(path), dict(simulation.columns()), settings=settings_of(simulation))


def settings_of(simulation: Simulation) -> dict[str, Any]:
    """The settings that a table stores; angles in radians."""
    stored = plain_values(simulation.settings)
    return {
        "version": package_version(),
        **chosen_settings(simulation.mesh, simulation.model, None, "scan"),
        "unit": "m",
        **{name: value for name, value in stored.items() if name != "seed"},
        "simulation_seed": simulation.settings.seed,
        "parts": simulation.parts,
    }
