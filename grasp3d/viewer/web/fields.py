"""What a visitor can set: the fields of the page, and how the session takes them over."""

import math
from collections.abc import Callable
from typing import Any

from grasp3d.errors import SettingError
from grasp3d.settings import DEGREE
from grasp3d.viewer.session.keys import OTHER
from grasp3d.viewer.session.session import Session
from grasp3d.viewer.session.state import Section

PAINTS = {
    "label": "S, M, U",
    "critical_angle": "β*, critical friction angle",
    "max_resolution": "α*, coarsest sensor that keeps it S",
    "epsilon": "ε",
    "epsilon_min": "smallest ε over the tilts",
}
"""What can be painted, and how it is called in a list."""

COARSEST = 180.0
"""Below which resolutions must be [degrees]."""


def choices(session: Session) -> dict[str, Any]:
    """What the visitor can set, as the page's fields hold it: angles in degrees."""
    shown, section = session.shown, session.shown.section
    return {
        "friction": shown.model.friction,
        "resolution": _degrees(shown.model.sensor_resolution),
        "comparing": shown.compare is not None,
        "compare": _degrees(OTHER if shown.compare is None else shown.compare),
        "paint": shown.paint,
        "axis": "off" if section is None else section.axis,
        "share": 0.5 if section is None else section.share,
        "flipped": section is not None and section.flipped,
        "fingers": shown.model.fingers,
        "opening": shown.max_opening if math.isfinite(shown.max_opening) else None,
        "click": shown.click,
        "held": len(shown.fixed),
        "number": session.number,
    }


def choose(session: Session, name: str, value: Any) -> None:  # noqa: ANN401
    """Take over what a visitor set in a field of `choices`.

    Raises:
        SettingError: It is outside its range, or no such value at all; the words are for visitors.
    """
    try:
        _CHOOSE[name](session, value)
    except (TypeError, ValueError, OverflowError):
        raise SettingError(_MUST_BE.get(name, f"{name}: there is no such choice")) from None


_MUST_BE = {
    "friction": "friction must be a number above 0",
    "resolution": "sensor resolution must be from 0 to below 180 degrees",
    "compare": "the resolution that is compared with must be from 0 to below 180 degrees",
    "opening": "the largest opening must be a number above 0",
}
"""What is said of a number that cannot be."""


def _friction(session: Session, value: Any) -> None:  # noqa: ANN401
    session.change(friction=_within(value, inclusive=False))


def _resolution(session: Session, value: Any) -> None:  # noqa: ANN401
    session.change(sensor_resolution=_within(value, below=COARSEST) * DEGREE)


def _compare(session: Session, value: Any) -> None:  # noqa: ANN401
    if session.shown.compare is not None:
        session.change(compare=_within(value, below=COARSEST) * DEGREE)


def _within(
    value: Any,  # noqa: ANN401
    *,
    below: float = math.inf,
    inclusive: bool = True,
) -> float:
    """A number from 0 on, or above 0, and below a limit.

    Raises:
        ValueError: It is none, or outside.
    """
    number = float(value)
    if not 0.0 <= number < below or (number == 0.0 and not inclusive):
        raise ValueError
    return number


def _opening(session: Session, value: Any) -> None:  # noqa: ANN401
    session.change(max_opening=math.inf if value in {None, ""} else _within(value, inclusive=False))


def _section(session: Session, **asked: Any) -> None:  # noqa: ANN401
    now = session.shown.section or Section()
    kept = {"axis": now.axis, "share": now.share, "flipped": now.flipped, **asked}
    session.change(section=Section(**kept))


def _axis(session: Session, value: Any) -> None:  # noqa: ANN401
    if value == "off":
        session.change(section=None)
    else:
        _section(session, axis=value)


def _share_of_section(session: Session, value: Any) -> None:  # noqa: ANN401
    if session.shown.section is not None:
        _section(session, share=float(value))


def _flipped(session: Session, value: Any) -> None:  # noqa: ANN401
    if session.shown.section is not None:
        _section(session, flipped=bool(value))


def _click(session: Session, value: Any) -> None:  # noqa: ANN401
    if value not in {"inspect", "fix"}:
        raise ValueError
    session.change(click=value)


def _paint(session: Session, value: Any) -> None:  # noqa: ANN401
    if value not in PAINTS:
        raise ValueError
    session.change(paint=value)


_CHOOSE: dict[str, Callable[[Session, Any], None]] = {
    "friction": _friction,
    "resolution": _resolution,
    "comparing": lambda session, value: session.change(compare=OTHER if value else None),
    "compare": _compare,
    "paint": _paint,
    "axis": _axis,
    "share": _share_of_section,
    "flipped": _flipped,
    "fingers": lambda session, value: session.change(fingers=int(value)),
    "opening": _opening,
    "click": _click,
    "number": lambda session, value: session.step(int(value) - session.number),
}
CHOICES = tuple(_CHOOSE)
"""Fields that a visitor can set."""


def _degrees(radians: float) -> float:
    return round(math.degrees(radians), 6)
