"""Settings of the viewer's initial view."""

import math
from dataclasses import dataclass
from typing import Literal

from grasp3d.errors import SettingError
from grasp3d.settings import Radians, check_choice, whole_number

Paint = Literal[
    "label", "critical_angle", "max_resolution", "epsilon", "epsilon_min", "approach_margin",
    "grip_force", "payload", "margin",
]  # fmt: skip
MIN_WIDTH, MIN_HEIGHT, MAX_PIXELS = 320, 240, 7680


@dataclass(frozen=True)
class ViewSettings:
    """Initial view of an object.

    Attributes:
        paint: Quantity that colours show. label: S, M, U; critical_angle: beta* of the best grasp;
            max_resolution: alpha*, the coarsest resolution at which it is S; epsilon and
            epsilon_min: Ferrari-Canny epsilon, and its smallest value over all uncertainties;
            approach_margin: half-width of the free approach angles of a gripper; grip_force: force
            that each finger needs under a load; payload: mass that the available force holds at all
            normals within the resolution; margin: friction angle to spare, above 0 where it is S.
        vertex: Index of the vertex whose grasp is shown first. none: no grasp; a picture with a
            gripper then shows the best grasp that it reaches.
        azimuth: Azimuth of the camera about the z-axis, from the x-axis; about the table's normal
            if there is one. none: 75 degrees; if elevation is none, too, across the closing axis of
            the shown grasp.
        elevation: Elevation of the camera above the xy-plane, from -90 to 90 degrees. none: 35
            degrees.
        width: Width of the window or picture [pixels].
        height: Height of the window or picture [pixels].
    """

    paint: Paint = "label"
    vertex: int | None = None
    azimuth: Radians | None = None
    elevation: Radians | None = None
    width: int = 1280
    height: int = 800

    def __post_init__(self) -> None:
        check_choice("paint", self.paint, Paint)
        if self.vertex is not None:
            whole_number("vertex", self.vertex, 0)
        azimuth, elevation = self.azimuth or 0.0, self.elevation or 0.0
        if not math.isfinite(azimuth) or not abs(elevation) <= math.pi / 2.0:
            raise SettingError(
                "azimuth must be finite and elevation from -90 to 90 degrees; got "
                f"{math.degrees(azimuth):g} and {math.degrees(elevation):g}"
            )
        if not (MIN_WIDTH <= self.width <= MAX_PIXELS and MIN_HEIGHT <= self.height <= MAX_PIXELS):
            raise SettingError(
                f"width must be from {MIN_WIDTH} to {MAX_PIXELS} pixels and height from "
                f"{MIN_HEIGHT}; got {self.width} x {self.height}"
            )
