"""A hand, a table and approach limits beside one object: what grasps are tested against."""

import math
from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import numpy as np

from grasp3d.arrays import Bools, Floats, angles_between
from grasp3d.errors import SettingError
from grasp3d.hand.choices import AXES
from grasp3d.hand.frames import ObjectPose
from grasp3d.hand.hand import Hand
from grasp3d.hand.hand_files import GivenHand, given_hand, hand_line
from grasp3d.hand.jaws import IN_METRES, Jaws
from grasp3d.hand.reach_settings import ReachSettings
from grasp3d.hand.table import Approach, GivenTable, Table, best_approach, given_table
from grasp3d.mesh import ObjectMesh
from grasp3d.settings import Sampling
from grasp3d.settings.pose_error import PoseError

LEVEL = math.pi / 2.0 + 1e-6
"""Largest angle from straight down at which a gripper approaches beside a table [rad]: level, but
for rounding. Beyond it the table would be behind the gripper, where no box is tested."""

ROUNDING = 1e-9
"""Angle by which an approach may be beyond the limit through rounding [rad]."""

TILTED = 5.0
"""Angle between the table's up and the robot's z beyond which a warning is given [degrees]."""


@dataclass(frozen=True, eq=False)
class Scene:
    """A hand beside one object: what its grasps are tested against."""

    hand: Hand
    """The hand [m]."""
    table: Table | None = None
    """Table in the frame of the mesh; None: only the object is in the way."""
    approach: Approach = field(default_factory=Approach)
    """Allowed approach directions, in the frame of the mesh."""
    pose_error: PoseError = field(default_factory=PoseError)
    """Error of the hand's poses."""

    @classmethod
    def of(cls, settings: ReachSettings, mesh: ObjectMesh) -> "Scene | None":
        """The hand and the table beside an object.

        Args:
            settings: The hand, and what the object stands on.
            mesh: The object.

        Returns:
            None without a hand.

        Raises:
            SettingError: There are fewer resting poses, the mesh has no unit, or there is a pose
                error but no hand.
        """
        if settings.hand is None:
            if settings.pose_error:
                raise SettingError("pose_error needs a gripper (--hand, in Python hand=...)")
            return None
        mesh.needs_metres(IN_METRES)
        table = given_table(mesh, settings.table, settings.up, settings.resting_pose)
        down = -np.array(AXES[settings.up]) if table is None else -table.normal
        within = settings.approach_within if table is None else min(settings.approach_within, LEVEL)
        return cls(settings.hand, table, Approach(down, within), settings.pose_error)

    @classmethod
    def given(
        cls,
        mesh: ObjectMesh,
        hand: GivenHand,
        table: GivenTable = None,
        approach: Approach | None = None,
        pose_error: PoseError | str | None = None,
    ) -> "Scene | None":
        """Make the scene that separate keyword arguments state beside an object.

        Returns:
            None without a hand.

        Raises:
            SettingError: A table, an approach or a pose error, but no hand; or an invalid value.
        """
        error, table = PoseError.of(pose_error or PoseError()), given_table(mesh, table)
        if (found := given_hand(hand)) is not None:
            return cls(found, table, approach or Approach(), error)
        if table is not None or approach is not None or error:
            raise SettingError(
                "a table, approach directions and pose errors apply to grippers only; give one"
            )
        return None

    @property
    def up(self) -> Floats:
        """The up direction: out of the table, else opposite to the best approach, else z."""
        if self.table is not None:
            return self.table.normal
        direction = self.approach.direction
        return np.array(AXES["z"]) if direction is None else -direction

    @property
    def jaws(self) -> Jaws | None:
        """The hand if it is a parallel gripper, for which kernels search pairs; else None."""
        return self.hand if isinstance(self.hand, Jaws) else None

    def directions(self, poses: Floats) -> Floats:
        """Approach directions of poses (k, 4, 4) in the frame of the mesh, shape (k, 3)."""
        toward: Floats | None = getattr(self.hand, "approach", None)
        return poses[:, :3, 2] if toward is None else np.asarray(poses[:, :3, :3] @ toward)

    def approach_angles(self, poses: Floats) -> Floats:
        """Angles of the approaches of poses (k, 4, 4) from the best direction [rad], shape (k,).

        0 if all directions are equally good.
        """
        direction = best_approach(self.table, self.approach)
        if direction is None:
            return np.zeros(len(poses))
        return np.arccos(np.clip(self.directions(poses) @ direction, -1.0, 1.0))

    def allows(self, poses: Floats) -> Bools:
        """Whether the approach of each pose (k, 4, 4) is allowed, shape (k,)."""
        return np.asarray(self.approach_angles(poses) <= self.approach.within + ROUNDING)

    @property
    def words(self) -> tuple[str, ...]:
        """Texts on the hand, the resting pose or up direction, and the pose error."""
        words = [f"gripper {self.hand.name}"]
        if self.table is not None and self.table.probability is not None:
            words.append(f"resting pose of probability {100.0 * self.table.probability:.0f} %")
        elif self.table is not None or self.approach.within < math.pi:
            names = [name for name, axis in AXES.items() if np.allclose(self.up, axis)]
            numbers = ", ".join(f"{number + 0.0:.3g}" for number in self.up)
            words.append(f"up is {names[0] if names else f'({numbers})'} (--up)")
        if self.pose_error:
            words.append(f"poses wrong by up to {str(self.pose_error).replace(',', ' and ')}")
        return tuple(words)

    def tilt_warning(self, object_pose: ObjectPose | None) -> str | None:
        """A warning if the table is not level in the robot's frame; None if it is."""
        if object_pose is None or self.table is None:
            return None
        tilt = math.degrees(float(angles_between(object_pose.matrix[2, :3], self.table.normal)))
        if tilt <= TILTED:
            return None
        text = "is this the pose of the object as it stands (--table, --up)?"
        return f"the table's up is {tilt:.0f}° from z of the robot's frame: {text}"

    def within_stroke(self, mesh: ObjectMesh, sampling: Sampling) -> Sampling:
        """Settings of the search with openings limited to those that the hand can reach.

        Args:
            mesh: The object.
            sampling: Settings of the search.
        """
        mesh.needs_metres(IN_METRES)
        least, most = self.hand.distances()
        low, high = max(sampling.min_opening, least), min(sampling.max_opening, most)
        try:
            return replace(sampling, min_opening=low, max_opening=high)
        except SettingError as error:
            raise SettingError(
                f"gripper {self.hand.name!r} opens from {least:.4g} to {most:.4g} m, "
                f"which contradicts the limits of openings: {error}"
            ) from error


def scene_settings(scene: Scene | None) -> dict[str, str | float | int | None]:
    """The hand, the table and the approach as settings of one line each."""
    if scene is None:
        return {"gripper": "none"}
    table, approach = scene.table, scene.approach
    direction = approach.direction
    return {
        "gripper": hand_line(scene.hand),
        "table": "none" if table is None else _line([*table.normal, table.offset]),
        "approach_direction": "none" if direction is None else _line(direction),
        "approach_within": approach.within,
        "pose_error": str(scene.pose_error),
    }


def _line(numbers: Iterable[float]) -> str:
    return " ".join(repr(float(number)) for number in numbers)
