"""A hand, a table and approach limits beside one object: what grasps are tested against."""

import json
import math
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field, replace

from grasp3d.errors import SettingError
from grasp3d.hand.approach import Approach
from grasp3d.hand.metres import metres_per_unit
from grasp3d.hand.parallel_gripper import ParallelGripper
from grasp3d.hand.reach_settings import ReachSettings
from grasp3d.hand.table import Table, axis_vector
from grasp3d.mesh import ObjectMesh
from grasp3d.settings import GraspModel, Sampling

LEVEL = math.pi / 2.0 + 1e-6
"""Largest angle from straight down at which a gripper beside a table comes [rad]: level, with a
tolerance for rounding. Farther back, where no box of the gripper is tested, is the table."""


@dataclass(frozen=True, eq=False)
class Scene:
    """A hand beside one object: what its grasps are tested against."""

    hand: ParallelGripper
    """The hand [m]."""
    table: Table | None = None
    """In the frame and unit of the mesh; None: nothing is in the way but the object."""
    approach: Approach = field(default_factory=Approach)
    """Allowed approach directions, in the frame of the mesh."""

    @classmethod
    def of(cls, settings: ReachSettings, mesh: ObjectMesh) -> "Scene | None":
        """The hand and the table beside an object.

        Args:
            settings: The hand, and what the object stands on.
            mesh: The object.

        Returns:
            None without a hand.

        Raises:
            SettingError: There are not so many resting poses, or the mesh has no unit.
        """
        if settings.hand is None:
            return None
        metres_per_unit(mesh)
        table: Table | None
        if settings.table == "stable":
            table = Table.resting(mesh, settings.resting_pose)
        else:
            table = Table.below(mesh, settings.up) if settings.table == "as-is" else None
        down = -axis_vector(settings.up) if table is None else -table.normal
        within = settings.approach_within if table is None else min(settings.approach_within, LEVEL)
        approach = Approach(down, within=within, angles=settings.approach_angles)
        return cls(settings.hand, table, approach)

    @classmethod
    def given(
        cls,
        hand: ParallelGripper | None,
        table: Table | None = None,
        approach: Approach | None = None,
    ) -> "Scene | None":
        """What keywords of one name each state.

        Returns:
            None without a hand.

        Raises:
            SettingError: A table or an approach, but no hand.
        """
        if hand is not None:
            return cls(hand, table, approach or Approach())
        if table is not None or approach is not None:
            raise SettingError("a table and approach directions apply to grippers only; give one")
        return None

    def check_model(self, model: GraspModel) -> None:
        """Refuse models of grasps that the hand cannot make.

        Raises:
            SettingError: Three fingers and more with flat pads.
        """
        if model.fingers > 2 and not self.hand.round_tips:
            raise SettingError(
                f"gripper {self.hand.name!r} has two fingers with flat pads; for "
                f"{model.fingers} fingers only round tips (tip_radius) can be tested"
            )

    def within_stroke(self, mesh: ObjectMesh, sampling: Sampling) -> Sampling:
        """Settings of the search with openings limited to what the hand may reach.

        These are distances of contacts, of which the stroke allows no others; round tips that touch
        at an angle are nearer to each other, and those of internal grasps have the fingers between
        them.

        Args:
            mesh: The object.
            sampling: Settings with lengths in the unit of the mesh.
        """
        metres = metres_per_unit(mesh)
        inside = 0.0 if sampling.grip == "squeeze" else 2.0 * self.hand.finger_thickness
        least, most = self.hand.limits
        least, most = least / metres, (most + inside + 2.0 * self.hand.tip_radius) / metres
        try:
            return replace(
                sampling,
                min_opening=max(sampling.min_opening, least),
                max_opening=min(sampling.max_opening, most),
            )
        except SettingError as error:
            raise SettingError(
                f"gripper {self.hand.name!r} opens from {least:.4g} to {most:.4g} {mesh.unit}, "
                f"which contradicts the limits of openings: {error}"
            ) from error


def scene_settings(scene: Scene | None) -> dict[str, str | float | int | None]:
    """The hand, the table and the approach as settings of one line each."""
    if scene is None:
        return {"gripper": "none"}
    table, approach = scene.table, scene.approach
    direction = approach.direction
    return {
        "gripper": json.dumps(asdict(scene.hand)),
        "table": "none" if table is None else _line([*table.normal, table.offset]),
        "approach_direction": "none" if direction is None else _line(direction),
        "approach_within": approach.within,
        "approach_angles": approach.angles,
    }


def _line(numbers: Iterable[float]) -> str:
    return " ".join(repr(float(number)) for number in numbers)
