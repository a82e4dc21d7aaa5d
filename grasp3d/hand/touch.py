"""Force and sensors of the fingertips of a hand."""

import math
from dataclasses import dataclass

from grasp3d.contact.sensor import Sensor
from grasp3d.errors import SettingError
from grasp3d.settings import GraspModel, Radians


@dataclass(frozen=True, kw_only=True)
class Touch:
    """Greatest force and sensor resolution of the fingertips.

    What each field means is in `ParallelGripper`.
    """

    max_force: float | None = None
    sensor_resolution: Radians | None = None
    receptive_field: float | None = None

    def check_touch(self, gripper: str, tip_radius: float) -> None:
        """Refuse forces and resolutions that are impossible.

        Args:
            gripper: Name of the gripper.
            tip_radius: Radius of its round tips [m]; 0: it has none.
        """
        if self.max_force is not None and not 0.0 < self.max_force < math.inf:
            raise SettingError(
                f"gripper {gripper!r}: max_force must be a finite force above 0 [N]; "
                f"got {self.max_force:g}"
            )
        if self.receptive_field is not None:
            if self.sensor_resolution is not None or tip_radius == 0.0:
                raise SettingError(
                    f"gripper {gripper!r}: a receptive_field needs round tips (tip_radius), and "
                    "replaces sensor_resolution"
                )
            Sensor(self.receptive_field, tip_radius)
        if self.sensor_resolution is not None:
            GraspModel(sensor_resolution=self.sensor_resolution)
