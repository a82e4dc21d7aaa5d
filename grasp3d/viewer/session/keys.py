"""Keys, the same in a window and on a page."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import get_args

from grasp3d.errors import SettingError
from grasp3d.settings import DEGREE
from grasp3d.viewer.session.session import Session
from grasp3d.viewer.session.state import Axis, Section
from grasp3d.viewer.view_settings import Paint

FRICTION_STEP, RESOLUTION_STEP = 0.05, 2.0 * DEGREE
SECTION_STEP = 0.05
OTHER = 40.0 * DEGREE
"""Resolution that is compared with, before another is chosen."""


@dataclass(frozen=True)
class Key:
    """What a key does."""

    words: str
    do: Callable[[Session], None] | None = None
    """None: the window or page does it itself."""


def press(session: Session, key: str) -> bool:
    """Answer a key; tells whether the session has.

    Args:
        session: Who is looking.
        key: As in `KEYS`.
    """
    known = KEYS.get(key)
    if known is None or known.do is None:
        return False
    try:
        known.do(session)
    except SettingError as error:
        session.tell(str(error))
    return True


def _more_friction(by: float) -> Callable[[Session], None]:
    return lambda session: session.change(
        friction=round(max(FRICTION_STEP, session.shown.model.friction + by), 10)
    )


def _coarser(by: float) -> Callable[[Session], None]:
    return lambda session: session.change(
        sensor_resolution=max(0.0, session.shown.model.sensor_resolution + by)
    )


def _paint(paint: Paint) -> Callable[[Session], None]:
    return lambda session: session.change(paint=paint)


def _compare(session: Session) -> None:
    session.change(compare=OTHER if session.shown.compare is None else None)


def _cut(session: Session) -> None:
    """No section, across x, y, z, and none again."""
    axes = get_args(Axis)
    shown = session.shown.section
    after = 0 if shown is None else axes.index(shown.axis) + 1
    session.change(section=Section(axes[after]) if after < len(axes) else None)


def _move_cut(by: float) -> Callable[[Session], None]:
    def move(session: Session) -> None:
        section = session.shown.section
        if section is not None:
            share = min(1.0, max(0.0, section.share + by))
            session.change(section=replace(section, share=share))

    return move


def _flip_cut(session: Session) -> None:
    section = session.shown.section
    if section is not None:
        session.change(section=replace(section, flipped=not section.flipped))


def _fix(session: Session) -> None:
    session.change(click="inspect" if session.shown.click == "fix" else "fix")


MOUSE: tuple[tuple[str, str], ...] = (
    ("drag", "turn"),
    ("shift drag", "move"),
    ("wheel", "nearer, farther"),
    ("click", "inspect, or fix a finger"),
    ("shift click", "inspect in any case"),
)
"""What the mouse does on the scene."""

DRAWING: tuple[tuple[str, str], ...] = (
    ("white balls, 1, 2, …", "contacts of the best grasp; 1 is where you clicked"),
    ("rod between them", "line of the fingers; it shines through"),
    ("arrow", "outward normal: the finger pushes along it"),
    ("grey cone", "friction cone, half-angle β"),
    ("blue cone", "what is left of it for every normal within the resolution, β − α/2"),
    ("thin outlines", "friction cones of the extreme normals, α/2 to either side"),
    ("black balls", "fingers that are fixed"),
)
"""What is drawn on the scene, and what it means."""

KEYS: dict[str, Key] = {
    "Right": Key("more friction μ", _more_friction(FRICTION_STEP)),
    "Left": Key("less friction μ", _more_friction(-FRICTION_STEP)),
    "Up": Key("coarser sensor, larger α", _coarser(RESOLUTION_STEP)),
    "Down": Key("finer sensor, smaller α", _coarser(-RESOLUTION_STEP)),
    "1": Key("colours: S, M, U", _paint("label")),
    "2": Key("colours: β*, critical friction angle", _paint("critical_angle")),
    "3": Key("colours: α*, coarsest sensor that keeps it S", _paint("max_resolution")),
    "4": Key("colours: ε", _paint("epsilon")),
    "5": Key("colours: smallest ε over the tilts", _paint("epsilon_min")),
    "c": Key("compare with a second resolution", _compare),
    "x": Key("section across x, y, z, none", _cut),
    "[": Key("move the section down", _move_cut(-SECTION_STEP)),
    "]": Key("move the section up", _move_cut(SECTION_STEP)),
    "i": Key("show the other side of the section", _flip_cut),
    "f": Key("clicks inspect, or fix a finger", _fix),
    "u": Key("release fixed fingers", lambda session: session.change(fixed=())),
    "n": Key("next object", lambda session: session.step(1)),
    "p": Key("previous object", lambda session: session.step(-1)),
    "s": Key("save the labelled PLY"),
    "g": Key("save a picture"),
    "r": Key("reset the view"),
    "+": Key("nearer"),
    "-": Key("farther"),
    "z": Key("undo"),
    "h": Key("this help"),
    "q": Key("quit"),
}
