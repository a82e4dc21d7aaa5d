"""The plane that an object stands on, and the directions from which a gripper may approach."""

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Self, TypeAlias

import numpy as np

from grasp3d.arrays import ArrayLike, Floats, locked
from grasp3d.errors import SettingError
from grasp3d.hand.choices import AXES, Axis, Standing
from grasp3d.settings import check_choice
from grasp3d.settings.checks import check_range

if TYPE_CHECKING:
    from grasp3d.mesh import ObjectMesh


@dataclass(frozen=True, eq=False)
class Table:
    """A half-space in the frame of the mesh: the points p with normal . p < offset."""

    normal: Floats
    """Unit vector that points up, out of the table, shape (3,)."""
    offset: float
    """Height of the table's surface along the normal."""
    probability: float | None = None
    """Probability that the object, dropped, comes to rest like this; None: not computed."""

    def __post_init__(self) -> None:
        if not math.isfinite(self.offset):
            raise SettingError(f"a table's offset must be a finite length; got {self.offset:g}")
        object.__setattr__(self, "normal", _unit_vector(self.normal, "a table's normal"))
        object.__setattr__(self, "offset", float(self.offset))

    @classmethod
    def below(cls, mesh: "ObjectMesh", up: Axis | ArrayLike = "z") -> Self:
        """The table below an object that stands as it is, on its lowest points.

        Args:
            mesh: The object.
            up: Direction that points up: an axis of the mesh's frame, or three numbers.
        """
        if isinstance(up, str):
            check_choice("axis", up, Axis)
            up = AXES[up]
        table = cls(np.asarray(up, dtype=np.float64), 0.0)
        heights = mesh.vertices[mesh.on_surface] @ table.normal
        return cls(table.normal, float(heights.min()))

    @classmethod
    def resting(cls, mesh: "ObjectMesh", number: int = 1) -> Self:
        """The table below an object in one of its stable resting poses, on its convex hull.

        Args:
            mesh: The object.
            number: 1: the most probable pose, 2: the next one, and so on.

        Raises:
            SettingError: There are fewer resting poses.
        """
        import trimesh

        body = trimesh.Trimesh(mesh.normalized, mesh.faces, process=False)
        # Without noise in the centre of mass nothing in it is random.
        transforms, probabilities = trimesh.poses.compute_stable_poses(
            body.convex_hull,
            center_mass=(mesh.center_mass - mesh.center) / mesh.size,
            sigma=0.0,
            n_samples=1,
        )
        order = np.argsort(-probabilities, kind="stable")
        if not 1 <= number <= len(order):
            raise SettingError(
                f"resting pose must be from 1 to {len(order)}, the number of stable poses of "
                f"{mesh.report.source}; got {number}"
            )
        row = order[number - 1]
        table = cls.below(mesh, transforms[row][2, :3])
        return replace(table, probability=float(probabilities[row]))


GivenTable: TypeAlias = Table | Standing | None
"""A table as functions accept it: a `Table`, or what the object stands on, in words."""


def given_table(
    mesh: "ObjectMesh", table: GivenTable, up: Axis = "z", number: int = 1
) -> Table | None:
    """The table that is given as a `Table` or in words.

    Args:
        mesh: The object.
        table: The table; none, as-is (below the object as it is) or stable (below it in a resting
            pose).
        up: Axis that points up if the table is as-is.
        number: Which of the resting poses; 1: the most probable one.

    Raises:
        SettingError: It is none of these.
    """
    if table is None or isinstance(table, Table):
        return table
    if isinstance(table, str):
        check_choice("table", table, Standing)
        if table == "stable":
            return Table.resting(mesh, number)
        return Table.below(mesh, up) if table == "as-is" else None
    raise SettingError(f"table must be Table(...), or one of none, as-is, stable; got {table!r}")


def _unit_vector(value: Floats, what: str) -> Floats:
    """The unit vector of a direction. Raises SettingError."""
    vector = np.asarray(value, dtype=np.float64)
    length = float(np.linalg.norm(vector)) if vector.shape == (3,) else math.nan
    if not (math.isfinite(length) and length > 0.0):
        raise SettingError(f"{what} must be three finite numbers; got {value}")
    return locked(vector / length)


@dataclass(frozen=True, eq=False)
class Approach:
    """Approach directions: a cone about one direction, in the frame of the mesh."""

    direction: Floats | None = None
    """Preferred approach direction, shape (3,); None: into the table, or any without a table."""
    within: float = math.pi
    """Largest angle between this direction and the approach direction [rad]."""

    def __post_init__(self) -> None:
        if self.direction is not None:
            direction = _unit_vector(self.direction, "an approach direction")
            object.__setattr__(self, "direction", direction)
        check_range("approach_within", self.within, 0.0, math.pi, ends="(]", degrees=True)


def best_approach(table: Table | None, approach: Approach) -> Floats | None:
    """The preferred approach direction, shape (3,); None: all directions are equally good."""
    if approach.direction is None and table is not None:
        return -table.normal
    return approach.direction
