"""Settings of the command line and of batches: the gripper, and what the object stands on."""

import math
from dataclasses import dataclass, fields
from typing import Annotated

from grasp3d.errors import SettingError
from grasp3d.hand.choices import Axis, Standing
from grasp3d.hand.hand import Hand, touching
from grasp3d.settings import GraspModel, Radians, check_choice, whole_number
from grasp3d.settings.checks import check_range
from grasp3d.settings.parsing import IN_PYTHON, Settings
from grasp3d.settings.pose_error import PoseError, PoseErrorField


@dataclass(frozen=True)
class ReachSettings(Settings):
    """The gripper that must reach each grasp, and what the object stands on.

    Attributes:
        hand: Gripper or hand that must reach each grasp: the name of a preset, or a JSON file
            (which grasp3d hand makes from a URDF or MuJoCo model). Fingers and palm must touch
            neither the object nor the table on a straight approach. none: ideal point contacts.
        table: What the object stands on. none: nothing; as-is: a table below its lowest points;
            stable: a table in the most probable resting pose.
        up: Axis of the mesh's frame that points up. Not with table stable, which finds its own up
            direction.
        resting_pose: Table stable: which of the resting poses; 1: the most probable one.
        approach_within: Largest angle between the approach direction and straight down, above 0, up
            to 180 degrees; with a table at most 90: never from below.
        pose_error: Error of the gripper's pose: how far the true pose may be from the stated one,
            as the radius of a ball, the largest turn, or both: 5mm,3deg. The jaws are also closed
            at poses that are wrong by as much.
    """

    hand: Hand | None = None
    table: Standing = "none"
    up: Axis = "z"
    resting_pose: Annotated[int, IN_PYTHON] = 1
    approach_within: Radians = math.pi
    pose_error: PoseErrorField = PoseErrorField(PoseError())

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.hand is not None and not isinstance(self.hand, Hand):
            from grasp3d.hand.hand_files import given_hand

            object.__setattr__(self, "hand", given_hand(self.hand))
        check_choice("table", self.table, Standing)
        check_choice("axis", self.up, Axis)
        whole_number("resting pose", self.resting_pose, 1)
        check_range("approach_within", self.approach_within, 0.0, math.pi, ends="(]", degrees=True)
        changed = [
            one.name
            for one in fields(self)
            # Files of poses may state a gripper whose error is this.
            if one.name != "pose_error" and getattr(self, one.name) != one.default
        ]
        if self.hand is None and changed:
            raise SettingError(f"{changed[0]} needs a gripper (--hand, in Python hand=...)")
        if self.table != "stable" and "resting_pose" in changed:
            raise SettingError("resting_pose applies to table stable only")
        if self.table == "stable" and "up" in changed:
            raise SettingError("up does not apply to table stable, whose resting pose says it")

    def touching(self, model: GraspModel) -> GraspModel:
        """The model with the gripper's sensor resolution, unless the model changes the default."""
        if self.hand is None or model.sensor_resolution != GraspModel().sensor_resolution:
            return model
        return touching(self.hand, model)
