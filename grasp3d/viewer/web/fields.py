"""The input fields of the page: their values, and how they change the session."""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from grasp3d.errors import SettingError
from grasp3d.settings import DEGREE
from grasp3d.settings.model_text import EPSILON_MIN
from grasp3d.viewer.session.keys import DEFAULT_COMPARED
from grasp3d.viewer.session.session import Session
from grasp3d.viewer.session.state import Section
from grasp3d.viewer.view_settings import Paint, check_comparison

PAINTS: dict[Paint, str] = {
    "label": "S, M, U",
    "critical_angle": "β*, critical friction angle",
    "max_resolution": "α*, coarsest resolution at which it is S",
    "epsilon": "ε",
    "epsilon_min": f"{EPSILON_MIN}, over all uncertainties",
    "approach_margin": "approach margin of the gripper",
    "grip_force": "grip force of each finger",
    "payload": "payload",
    "margin": "margin: how far it is S, or fails to be",
}
"""Quantities that colours can show, and their names in the list."""

COARSEST = 180.0
"""Upper limit of resolutions [degrees]."""

MOST_NORMAL_ERROR = 90.0
"""Upper limit of normal errors [degrees]."""


def field_values(session: Session) -> dict[str, Any]:
    """Values of all fields; angles are in degrees."""
    state, section = session.state, session.state.section
    return {
        "friction": state.model.friction,
        "resolution": _degrees(state.model.sensor_resolution),
        "show_errors": state.show_errors,
        "friction_error": state.model.friction_error,
        "normal_error": _degrees(state.model.normal_error),
        "location_error": state.model.location_error,
        "comparing": state.compare is not None,
        "compare": _degrees(DEFAULT_COMPARED if state.compare is None else state.compare),
        "paint": state.paint,
        "axis": "off" if section is None else section.axis,
        "position": 0.5 if section is None else section.position,
        "flipped": section is not None and section.flipped,
        "fingers": state.model.fingers,
        "opening": state.max_opening if math.isfinite(state.max_opening) else None,
        "click": state.click,
        "fixed_count": len(state.fixed),
        "number": session.number,
        "show_gripper": state.show_gripper,
        "show_table": state.show_table,
    }


def set_field(session: Session, name: str, value: Any) -> None:
    """Change the session to the new value of a field.

    Raises:
        SettingError: The value is invalid; the message is shown to the visitor.
    """
    try:
        _SETTERS[name](session, value)
    except (TypeError, ValueError, OverflowError):
        raise SettingError(_VALID.get(name, f"{name}: invalid value")) from None


_VALID = {
    "friction": "friction must be a number above 0",
    "resolution": "sensor resolution must be from 0 to below 180 degrees",
    "compare": "the second resolution must be from 0 to below 180 degrees",
    "friction_error": "friction error must be a number of at least 0 and below the friction",
    "normal_error": "normal error must be from 0 to below 90 degrees",
    "location_error": "location error must be a number of at least 0",
    "opening": "the largest opening must be a number above 0",
}
"""Messages for invalid numbers."""


def _friction(session: Session, value: Any) -> None:
    session.change(friction=_number(value, inclusive=False))


def _resolution(session: Session, value: Any) -> None:
    session.change(sensor_resolution=_number(value, below=COARSEST) * DEGREE)


def _normal_error(session: Session, value: Any) -> None:
    session.change(normal_error=_number(value, below=MOST_NORMAL_ERROR) * DEGREE)


def _comparing(session: Session, value: Any) -> None:
    if value:
        check_comparison(session.state.paint)
    session.change(compare=DEFAULT_COMPARED if value else None)


def _compare(session: Session, value: Any) -> None:
    if session.state.compare is not None:
        session.change(compare=_number(value, below=COARSEST) * DEGREE)


def _number(
    value: Any,
    *,
    below: float = math.inf,
    inclusive: bool = True,
) -> float:
    """A number that is at least 0, or above 0, and below a limit.

    Raises:
        ValueError: The value is not such a number.
    """
    number = float(value)
    if not 0.0 <= number < below or (number == 0.0 and not inclusive):
        raise ValueError
    return number


def _opening(session: Session, value: Any) -> None:
    session.change(max_opening=math.inf if value in {None, ""} else _number(value, inclusive=False))


def _change_section(session: Session, **changes: Any) -> None:
    session.change(section=replace(session.state.section or Section(), **changes))


def _axis(session: Session, value: Any) -> None:
    if value == "off":
        session.change(section=None)
    else:
        _change_section(session, axis=value)


def _position(session: Session, value: Any) -> None:
    if session.state.section is not None:
        _change_section(session, position=float(value))


def _flipped(session: Session, value: Any) -> None:
    if session.state.section is not None:
        _change_section(session, flipped=bool(value))


_SETTERS: dict[str, Callable[[Session, Any], None]] = {
    "friction": _friction,
    "resolution": _resolution,
    "show_errors": lambda session, value: session.change(show_errors=bool(value)),
    "friction_error": lambda session, value: session.change(friction_error=_number(value)),
    "normal_error": _normal_error,
    "location_error": lambda session, value: session.change(location_error=_number(value)),
    "comparing": _comparing,
    "compare": _compare,
    "paint": lambda session, value: session.change(paint=value),
    "axis": _axis,
    "position": _position,
    "flipped": _flipped,
    "fingers": lambda session, value: session.change(fingers=int(value)),
    "opening": _opening,
    "click": lambda session, value: session.change(click=value),
    "number": lambda session, value: session.step(int(value) - session.number),
    "show_gripper": lambda session, value: session.change(show_gripper=bool(value)),
    "show_table": lambda session, value: session.change(show_table=bool(value)),
}
FIELDS = tuple(_SETTERS)
"""Names of the fields that a visitor can change."""


def _degrees(radians: float) -> float:
    return round(math.degrees(radians), 6)
