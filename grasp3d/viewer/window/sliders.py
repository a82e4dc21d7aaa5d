"""The sliders of the panel: ranges, displayed values and actions."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

from grasp3d.settings import DEGREE, sampling_kind
from grasp3d.viewer.session.keys import LEAST_FRICTION
from grasp3d.viewer.session.panel_text import interval_text
from grasp3d.viewer.session.session import Session

MIN_FRICTION, MAX_FRICTION = 0.01, 1.5
MAX_RESOLUTION, END = 90.0, 179.9
"""Default end of the resolution's slider, and its largest possible end [degrees]."""
MOST_FRICTION_ERROR = 0.5
MAX_NORMAL_ERROR, END_OF_NORMALS = 20.0, 89.9
"""Default end of the slider of the normal error, and its largest possible end [degrees]."""
MAX_LOCATION_ERROR = 0.05
"""Default end of the slider of the location error, relative to the object's size."""
MIN_SPAN = 0.02
"""Smallest limit of the distance between contacts, relative to the object's size."""
NO_LIMIT = 0.99
"""Position of that slider above which there is no limit."""
ROUNDING = 1e-6


@dataclass(frozen=True, eq=False)
class Slider:
    """One slider."""

    name: str
    text: str
    position: float
    """Position of its thumb, from 0 to 1."""
    value: str
    """Current value."""
    value_at: Callable[[float], str]
    """Value at a position of the thumb."""
    set: Callable[[float], None]
    live: bool = True
    """Whether it acts while it is dragged, or only when it is released."""


@dataclass
class Ranges:
    """Upper ends of the sliders; they grow with larger values and never shrink."""

    friction: float = MAX_FRICTION
    resolution: float = MAX_RESOLUTION
    normal: float = MAX_NORMAL_ERROR
    location: float = MAX_LOCATION_ERROR

    def include(self, session: Session) -> None:
        """Extend the ranges to the current values."""
        model, other = session.state.model, session.state.compared or 0.0
        self.friction = max(self.friction, model.friction)
        coarsest = math.degrees(max(model.sensor_resolution, other))
        if coarsest > self.resolution:
            self.resolution = END
        if math.degrees(model.normal_error) > self.normal:
            self.normal = END_OF_NORMALS
        if session.subject is not None:
            self.location = max(self.location, model.location_error / session.subject.mesh.size)


def sliders_of(session: Session, ranges: Ranges) -> tuple[Slider, ...]:
    """All sliders for the current state."""
    ranges.include(session)
    state = session.state
    found = [_friction(session, ranges), _resolution(session, ranges, "sensor_resolution")]
    if state.compared is not None:
        found.append(_resolution(session, ranges, "compare"))
    if state.show_errors:
        found += [_friction_error(session), _normal_error(session, ranges)]
        if session.subject is not None:
            found.append(_location_error(session, ranges, session.subject.mesh.size))
    if state.section is not None:
        found.append(_section(session))
    if session.subject is not None:
        found.append(_opening(session, session.subject.mesh.size))
    return tuple(found)


def _friction(session: Session, ranges: Ranges) -> Slider:
    model = session.state.model
    friction, error = model.friction, model.friction_error
    low, span = MIN_FRICTION, ranges.friction - MIN_FRICTION

    def value(position: float) -> float:
        return max(round(low + position * span, 2), error + LEAST_FRICTION)

    name = "friction μ" if error == 0.0 else f"friction μ, {interval_text(model)}"
    return Slider(
        "friction", name, _clipped((friction - low) / span), _digits(friction, 2),
        lambda position: f"{value(position):.2f}",
        lambda position: session.change(friction=value(position)),
    )  # fmt: skip


def _resolution(session: Session, ranges: Ranges, name: str) -> Slider:
    state = session.state
    second = name == "compare"
    now = (state.compare or 0.0) if second else state.model.sensor_resolution
    degrees = math.degrees(now)

    def value(position: float) -> float:
        return round(position * ranges.resolution, 1)

    return Slider(
        name, "second resolution α" if second else "sensor resolution α",
        _clipped(degrees / ranges.resolution), f"{_digits(degrees, 1)}°",
        lambda position: f"{value(position):.1f}°",
        lambda position: session.change(**{name: value(position) * DEGREE}),
    )  # fmt: skip


def _friction_error(session: Session) -> Slider:
    model = session.state.model

    def value(position: float) -> float:
        return round(min(position * MOST_FRICTION_ERROR, model.friction - LEAST_FRICTION), 2)

    return Slider(
        "friction_error", "friction error", _clipped(model.friction_error / MOST_FRICTION_ERROR),
        f"± {_digits(model.friction_error, 2)}", lambda position: f"± {value(position):.2f}",
        lambda position: session.change(friction_error=value(position)),
    )  # fmt: skip


def _normal_error(session: Session, ranges: Ranges) -> Slider:
    degrees = math.degrees(session.state.model.normal_error)

    def value(position: float) -> float:
        return round(position * ranges.normal, 1)

    return Slider(
        "normal_error", "normal error", _clipped(degrees / ranges.normal),
        f"{_digits(degrees, 1)}°", lambda position: f"{value(position):.1f}°",
        lambda position: session.change(normal_error=value(position) * DEGREE),
    )  # fmt: skip


def _location_error(session: Session, ranges: Ranges, size: float) -> Slider:
    """The slider, which raises the reason where no location error can be chosen."""
    unit = session.subject.mesh.unit if session.subject else None
    error, most = session.state.model.location_error, ranges.location * size

    def value(position: float) -> float:
        return float(f"{position * most:.3g}")

    def text(length: float) -> str:
        return f"{length:.4g} {unit or ''}".rstrip()

    shown = text(error)
    if session.location_problem and error == 0.0:
        shown = "not available"
    return Slider(
        "location_error", "location error", _clipped(error / most), shown,
        lambda position: text(value(position)),
        lambda position: session.change(location_error=value(position)),
    )  # fmt: skip


def _section(session: Session) -> Slider:
    section = session.state.section
    assert section is not None
    return Slider(
        "section", f"section across {section.axis}", section.position,
        f"{100.0 * section.position:.0f} %",
        lambda position: f"{100.0 * position:.0f} %",
        lambda position: session.change(section=replace(section, position=position)),
    )  # fmt: skip


def _opening(session: Session, size: float) -> Slider:
    state = session.state
    unit = session.subject.mesh.unit if session.subject else None

    def value(position: float) -> float:
        low = MIN_SPAN * size
        return math.inf if position > NO_LIMIT else float(f"{low + position * (size - low):.3g}")

    def text(limit: float) -> str:
        return "no limit" if math.isinf(limit) else f"{limit:.4g} {unit or ''}".rstrip()

    position = (state.max_opening / size - MIN_SPAN) / (1.0 - MIN_SPAN)
    return Slider(
        "opening", f"largest {sampling_kind(state.model.fingers).span}",
        1.0 if math.isinf(state.max_opening) else _clipped(min(position, NO_LIMIT)),
        text(state.max_opening), lambda position: text(value(position)),
        lambda position: session.change(max_opening=value(position)), live=False,
    )  # fmt: skip


def _clipped(value: float) -> float:
    return min(1.0, max(0.0, value))


def _digits(value: float, usual: int) -> str:
    """A number with the usual number of decimals, or with more digits if it needs them."""
    return f"{value:.{usual}f}" if abs(value - round(value, usual)) < ROUNDING else f"{value:.4g}"
