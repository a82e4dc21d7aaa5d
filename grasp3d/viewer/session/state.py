"""The user's choices in a viewer, as an immutable value."""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, Literal

import numpy as np

from grasp3d.arrays import Floats
from grasp3d.errors import SettingError
from grasp3d.pictures.view_settings import Paint
from grasp3d.settings import GraspModel, check_choice

Axis = Literal["x", "y", "z"]
Click = Literal["inspect", "fix"]
OF_MODEL: dict[str, type] = {"friction": float, "sensor_resolution": float, "fingers": int}
"""Fields of the model that a user changes one by one, and their types."""
FixedPoints = tuple[tuple[float, float, float], ...]
"""Contact points of fixed fingers, in the mesh's frame."""


@dataclass(frozen=True)
class Section:
    """A plane that cuts the object open; the part in front of it is hidden."""

    axis: Axis = "x"
    """Axis of the mesh's frame that is normal to the plane."""
    position: float = 0.5
    """Position along the object, from 0 to 1."""
    flipped: bool = False
    """Show the upper part. By default the lower part is shown, as the initial camera is on the side
    of positive x, y and z and looks into the cut."""

    def __post_init__(self) -> None:
        check_choice("axis of a section", self.axis, Axis)
        if not 0.0 <= self.position <= 1.0:
            raise SettingError(f"section position must be from 0 to 1; got {self.position}")

    def plane(self, bounds: Floats) -> tuple[Floats, Floats]:
        """A point of the plane, and its normal toward the visible part, shape (3,) each.

        Args:
            bounds: Lowest and highest corner of the object, shape (2, 3).
        """
        low, high = bounds
        normal = np.zeros(3)
        normal["xyz".index(self.axis)] = 1.0 if self.flipped else -1.0
        return low + self.position * (high - low), normal


@dataclass(frozen=True)
class ViewState:
    """All choices of the user for the current object."""

    model: GraspModel
    """Chosen friction, resolution and number of fingers."""
    paint: Paint = "label"
    section: Section | None = None
    click: Click = "inspect"
    """Action of a click on the surface: inspect a vertex, or fix a finger there."""
    vertex: int | None = None
    """The inspected vertex."""
    grasp: int | None = None
    """Number of the best pose of a gripper that is shown, from 0."""
    show_gripper: bool = True
    """Whether the gripper is drawn at the inspected grasp, if there is one."""
    show_table: bool = True
    """Whether the table is drawn, if there is one."""
    fixed: FixedPoints = ()
    """Contact points of the fixed fingers; none: every vertex has its best grasp."""

    def __post_init__(self) -> None:
        check_choice("paint", self.paint, Paint)
        check_choice("click action", self.click, Click)
        points = np.asarray(self.fixed or np.zeros((1, 3)), dtype=np.float64)
        if points.ndim != 2 or points.shape[1] != 3 or not np.isfinite(points).all():
            raise SettingError("fixed fingers must be points of three finite coordinates each")


def changed_state(state: ViewState, changes: Mapping[str, Any]) -> ViewState:
    """A state with some choices changed.

    Args:
        state: The state before.
        changes: Fields of `ViewState`, and those of its model in `OF_MODEL`. If there are now fewer
            fingers, the last fixed fingers are released.

    Raises:
        SettingError: A value is outside its range, or there is no such field.
    """
    unknown = set(changes) - set(OF_MODEL) - {field.name for field in fields(ViewState)}
    if unknown:
        raise SettingError(f"the viewer has no setting {min(unknown)!r}")
    try:
        of_model = {name: kind(changes[name]) for name, kind in OF_MODEL.items() if name in changes}
        others = {name: value for name, value in changes.items() if name not in OF_MODEL}
        changed = replace(state, **others)
    except (TypeError, ValueError) as error:
        raise SettingError(f"a value has the wrong type: {error}") from error
    model = replace(changed.model, **of_model)
    most = max(0, model.fingers - 1)
    if "fixed" in changes and len(changed.fixed) > most:
        raise SettingError(
            f"of {model.fingers} fingers at most {most} can be fixed; got {len(changed.fixed)}"
        )
    return replace(changed, model=model, fixed=changed.fixed[:most])
