"""What a viewer shows: a value that is replaced, never changed."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, Literal, get_args

import numpy as np

from grasp3d.arrays import Floats
from grasp3d.errors import SettingError
from grasp3d.settings import GraspModel
from grasp3d.viewer.view_settings import Paint

Axis = Literal["x", "y", "z"]
Click = Literal["inspect", "fix"]
Places = tuple[tuple[float, float, float], ...]


@dataclass(frozen=True)
class Section:
    """A plane that cuts the object open; what is in front of it is not shown."""

    axis: Axis = "x"
    """Across which axis of the mesh's frame it lies."""
    share: float = 0.5
    """Where along the object, from 0 to 1."""
    flipped: bool = False
    """Show what is on the upper side of it. The lower one is shown otherwise, as the eye is at
    first where x, y and z are large, and looks into what is cut."""

    def __post_init__(self) -> None:
        if self.axis not in get_args(Axis) or not 0.0 <= self.share <= 1.0:
            raise SettingError(
                f"a section lies across x, y or z at a share from 0 to 1; got {self.axis!r}, "
                f"{self.share}"
            )

    def plane(self, bounds: Floats) -> tuple[Floats, Floats]:
        """A point of the plane, and its normal toward what is shown, shape (3,) each.

        Args:
            bounds: Lowest and highest corner of the object, shape (2, 3).
        """
        low, high = bounds
        normal = np.zeros(3)
        normal["xyz".index(self.axis)] = 1.0 if self.flipped else -1.0
        return low + self.share * (high - low), normal


@dataclass(frozen=True)
class Shown:
    """All that is chosen in a viewer, for whatever object."""

    model: GraspModel
    """Friction, resolution and fingers that are asked for."""
    max_opening: float
    """How far apart contacts may be, in the mesh's unit: the gripper's stroke for two fingers, the
    hand's reach for more."""
    paint: Paint = "label"
    compare: float | None = None
    """A second sensor resolution, shown beside the first [rad]."""
    section: Section | None = None
    click: Click = "inspect"
    """What a click on the surface does: tell of a vertex, or fix a finger there."""
    vertex: int | None = None
    """The one that is told of."""
    fixed: Places = ()
    """Fingers that are fixed, in the mesh's frame; none: every vertex has its best grasp."""

    def __post_init__(self) -> None:
        if self.paint not in get_args(Paint) or self.click not in get_args(Click):
            known = ", ".join((*get_args(Paint), *get_args(Click)))
            raise SettingError(
                f"nothing is painted by {self.paint!r}, or a click cannot {self.click!r}; "
                f"known: {known}"
            )
        if not self.max_opening > 0.0:
            raise SettingError(f"the opening must be above 0; got {self.max_opening:g}")
        if self.compare is not None and not 0.0 <= self.compare < math.pi:
            raise SettingError(
                "the resolution that is compared with must be at least 0 and below 180 degrees; "
                f"got {math.degrees(self.compare):g}"
            )
        places = np.asarray(self.fixed or np.zeros((1, 3)), dtype=np.float64)
        if places.ndim != 2 or places.shape[1] != 3 or not np.isfinite(places).all():
            raise SettingError("fixed fingers are places of three finite numbers each")


def choose(shown: Shown, choices: Mapping[str, Any]) -> Shown:
    """Change what is chosen.

    Args:
        shown: Before.
        choices: Fields of `Shown`, and friction, sensor_resolution and fingers of its model. With
            fewer fingers the last ones that are fixed are released.

    Raises:
        SettingError: A value is outside its range, or nothing is called so.
    """
    kinds: dict[str, type] = {"friction": float, "sensor_resolution": float, "fingers": int}
    unknown = set(choices) - set(kinds) - {field.name for field in fields(Shown)}
    if unknown:
        raise SettingError(f"nothing is called {min(unknown)!r} in a viewer")
    try:
        asked = {name: kind(choices[name]) for name, kind in kinds.items() if name in choices}
        others = {name: value for name, value in choices.items() if name not in kinds}
        changed = replace(shown, **others)
    except (TypeError, ValueError) as error:
        raise SettingError(f"a choice is of the wrong kind: {error}") from error
    model = replace(changed.model, **asked)
    room = max(0, model.fingers - 1)
    if "fixed" in choices and len(changed.fixed) > room:
        raise SettingError(
            f"of {model.fingers} fingers {room} can be fixed; got {len(changed.fixed)}"
        )
    return replace(changed, model=model, fixed=changed.fixed[:room])
