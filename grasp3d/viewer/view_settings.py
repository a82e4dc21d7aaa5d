"""What a viewer begins with, and what else can be set while it is open."""

import math
from dataclasses import dataclass
from typing import Literal, get_args

from grasp3d.errors import SettingError
from grasp3d.settings import DEGREE, Radians

Paint = Literal["label", "critical_angle", "max_resolution", "epsilon", "epsilon_min"]
LEAST_WIDTH, LEAST_HEIGHT, MOST_PIXELS = 320, 240, 7680


@dataclass(frozen=True)
class ViewSettings:
    """How an object is first shown."""

    paint: Paint = "label"
    """What colours show. label: S, M, U; critical_angle: beta*, of the best grasp; max_resolution:
    alpha*, the coarsest sensor that keeps it S; epsilon and epsilon_min: how firmly it holds."""

    compare: Radians | None = None
    """A second sensor resolution, shown beside the first; none: one alone."""

    azimuth: Radians = 75.0 * DEGREE
    """Direction of the eye about the z-axis, from the x-axis."""

    elevation: Radians = 35.0 * DEGREE
    """Its angle above the xy-plane, from -90 to 90 degrees."""

    width: int = 1280
    """Width of the window or picture [pixels]."""

    height: int = 800
    """Its height [pixels]."""

    def __post_init__(self) -> None:
        if self.paint not in get_args(Paint):
            known = ", ".join(get_args(Paint))
            raise SettingError(f"nothing is painted by {self.paint!r}; known: {known}")
        if self.compare is not None and not 0.0 <= self.compare < math.pi:
            degrees = math.degrees(self.compare)
            raise SettingError(
                f"compare must be at least 0 and below 180 degrees; got {degrees:g} degrees"
            )
        if not math.isfinite(self.azimuth) or not abs(self.elevation) <= math.pi / 2.0:
            raise SettingError(
                "azimuth must be finite and elevation from -90 to 90 degrees; got "
                f"{math.degrees(self.azimuth):g} and {math.degrees(self.elevation):g}"
            )
        if not (
            LEAST_WIDTH <= self.width <= MOST_PIXELS and LEAST_HEIGHT <= self.height <= MOST_PIXELS
        ):
            raise SettingError(
                f"width must be from {LEAST_WIDTH} to {MOST_PIXELS} pixels and height from "
                f"{LEAST_HEIGHT}; got {self.width} x {self.height}"
            )
