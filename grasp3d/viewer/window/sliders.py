"""The sliders beside a scene: what they set, from where to where, and how it is said."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

from grasp3d.settings import DEGREE
from grasp3d.viewer.session.session import Session

LEAST_FRICTION, MOST_FRICTION = 0.01, 1.5
MOST_RESOLUTION, END = 90.0, 179.9
"""Usual end of the slider and the last possible value [degrees]."""
LEAST_REACH = 0.02
"""Least opening, as a share of the object's size."""
NO_LIMIT = 0.99
"""From where on the slider of the opening says that there is none."""
PAIR = 2
ROUNDING = 1e-6


@dataclass(frozen=True, eq=False)
class Slider:
    """Something that is chosen along a track."""

    name: str
    words: str
    share: float
    """Where it stands, from 0 to 1."""
    value: str
    """What is chosen now."""
    said: Callable[[float], str]
    """What a place of the thumb means."""
    set: Callable[[float], None]
    live: bool = True
    """Whether it acts while it is dragged, or only when it is released."""


@dataclass
class Ranges:
    """How far tracks reach; they grow where more is asked for and do not shrink again."""

    friction: float = MOST_FRICTION
    resolution: float = MOST_RESOLUTION

    def hold(self, session: Session) -> None:
        """Grow to what is asked for."""
        model, other = session.shown.model, session.shown.compare or 0.0
        self.friction = max(self.friction, model.friction)
        coarsest = math.degrees(max(model.sensor_resolution, other))
        if coarsest > self.resolution:
            self.resolution = END


def sliders_of(session: Session, ranges: Ranges) -> tuple[Slider, ...]:
    """All that there are now."""
    ranges.hold(session)
    shown = session.shown
    found = [_friction(session, ranges), _resolution(session, ranges, "sensor_resolution")]
    if shown.compare is not None:
        found.append(_resolution(session, ranges, "compare"))
    if shown.section is not None:
        found.append(_section(session))
    if session.subject is not None:
        found.append(_opening(session, session.subject.size))
    return tuple(found)


def _friction(session: Session, ranges: Ranges) -> Slider:
    friction = session.shown.model.friction
    least, span = LEAST_FRICTION, ranges.friction - LEAST_FRICTION

    def value(share: float) -> float:
        return round(least + share * span, 2)

    return Slider(
        "friction", "friction μ", _share((friction - least) / span), _digits(friction, 2),
        lambda share: f"{value(share):.2f}",
        lambda share: session.change(friction=value(share)),
    )  # fmt: skip


def _resolution(session: Session, ranges: Ranges, name: str) -> Slider:
    shown = session.shown
    second = name == "compare"
    now = (shown.compare or 0.0) if second else shown.model.sensor_resolution
    degrees = math.degrees(now)

    def value(share: float) -> float:
        return round(share * ranges.resolution, 1)

    return Slider(
        name, "compared with α" if second else "sensor resolution α",
        _share(degrees / ranges.resolution), f"{_digits(degrees, 1)}°",
        lambda share: f"{value(share):.1f}°",
        lambda share: session.change(**{name: value(share) * DEGREE}),
    )  # fmt: skip


def _section(session: Session) -> Slider:
    section = session.shown.section
    assert section is not None
    return Slider(
        "section", f"section across {section.axis}", section.share,
        f"{100.0 * section.share:.0f} %",
        lambda share: f"{100.0 * share:.0f} %",
        lambda share: session.change(section=replace(section, share=share)),
    )  # fmt: skip


def _opening(session: Session, size: float) -> Slider:
    shown = session.shown
    unit = session.subject.unit if session.subject else None

    def value(share: float) -> float:
        least = LEAST_REACH * size
        return math.inf if share > NO_LIMIT else float(f"{least + share * (size - least):.3g}")

    def said(reach: float) -> str:
        return "no limit" if math.isinf(reach) else f"{reach:.4g} {unit or ''}".rstrip()

    now = (shown.max_opening / size - LEAST_REACH) / (1.0 - LEAST_REACH)
    return Slider(
        "opening", "largest opening" if shown.model.fingers == PAIR else "reach of the hand",
        1.0 if math.isinf(shown.max_opening) else _share(min(now, NO_LIMIT)),
        said(shown.max_opening), lambda share: said(value(share)),
        lambda share: session.change(max_opening=value(share)), live=False,
    )  # fmt: skip


def _share(value: float) -> float:
    return min(1.0, max(0.0, value))


def _digits(value: float, usual: int) -> str:
    """A number with its usual digits, or with more where it has more."""
    return f"{value:.{usual}f}" if abs(value - round(value, usual)) < ROUNDING else f"{value:.4g}"
