"""The user's controls, declared once for the page's panel, the window's sliders and all keys."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from operator import attrgetter, not_
from typing import Any, get_args

from grasp3d.errors import SettingError
from grasp3d.pictures.colors import PAINTS
from grasp3d.pictures.view_settings import Paint
from grasp3d.settings import DEGREE, MAX_SEARCHED_FINGERS
from grasp3d.viewer.collection import OF_MODEL, Axis, Section
from grasp3d.viewer.session import Session

LEAST_FRICTION = 0.01
"""Friction at the left end of its slider."""
ARROWS = {"Left": "←", "Right": "→", "Up": "↑", "Down": "↓"}


@dataclass(frozen=True)
class Keys:
    """Keys with related actions, and a description."""

    text: str
    actions: Mapping[str, Callable[[Session], None] | None]
    """Action of each key; None: the window or the page handles the key itself."""

    @property
    def names(self) -> str:
        """Labels of the keys; for more than two, those of the first and the last one."""
        names = [ARROWS.get(key, key) for key in self.actions]
        return " ".join(names) if len(names) <= 2 else f"{names[0]} … {names[-1]}"


@dataclass(frozen=True)
class Control:
    """One choice of the user: a slider with a number, a list, or a check box."""

    text: str
    """Name in the panel."""
    read: Callable[[Session], Any]
    """Function that returns the present value; angles are in degrees."""
    write: Callable[[Session, Any], None]
    """Function that sets the value; an invalid one raises SettingError, ValueError or TypeError."""
    keys: Mapping[str, Callable[[Any], Any]] = field(default_factory=dict)
    """For each key, a function from the present value to the next one."""
    of_keys: str = ""
    """Description of the keys' action; empty: they change the value."""
    least: float = 0.0
    """Value at the left end of a slider."""
    most: float | None = None
    """Value at the right end of a slider, unless the present one is larger; None: no slider."""
    step: float = 0.01
    unit: str = ""
    options: Callable[[Session], Mapping[Any, str]] | None = None
    """Function that returns the choices with their names; None: the control is not a list."""
    shown: Callable[[Session], bool] = lambda _: True
    """Whether the current object has the control."""

    def change(self, session: Session, value: Any) -> None:
        """Change the session to a new value.

        Raises:
            SettingError: The value is invalid; the message is meant for the user.
        """
        try:
            self.write(session, value)
        except (TypeError, ValueError, OverflowError):
            raise SettingError(f"{self.text}: {value!r} is not valid") from None


def handle_key(session: Session, key: str) -> bool:
    """Run the action of a key.

    Args:
        session: The session to change.
        key: A key of `KEYS`.

    Returns:
        Whether the key has an action here.
    """
    action = ACTIONS.get(key)
    if action is None:
        return False
    try:
        action(session)
    except SettingError as error:
        session.show_message(str(error))
    return True


def is_labelled(session: Session) -> bool:
    """Whether vertices have or will have labels; given poses of a hand have their own."""
    return session.subject is None or session.subject.poses is None


def _of_state(text: str, name: str, kind: Callable[[Any], Any], **options: Any) -> Control:
    """Return the control of a field of the state, or of its model."""

    def read(session: Session) -> Any:
        return getattr(session.state.model if name in OF_MODEL else session.state, name)

    def write(session: Session, value: Any) -> None:
        session.change(**{name: kind(value)})

    return Control(text, **{"read": read, "write": write, **options})


def _of_section(text: str, name: str, kind: Callable[[Any], Any], **options: Any) -> Control:
    """Return the control of a field of the section, shown if there is one."""

    def write(session: Session, value: Any) -> None:
        section = session.state.section
        if section is not None:
            session.change(section=replace(section, **{name: kind(value)}))

    return Control(
        text, lambda session: getattr(session.state.section or Section(), name), write,
        shown=lambda session: session.state.section is not None, **options,
    )  # fmt: skip


def _drawn(text: str, name: str, key: str, needs: str) -> Control:
    """Return the control that shows or hides the hand, or its table, if the object has one."""

    def write(session: Session, value: Any) -> None:
        session.check_gripper(table=needs == "table")
        session.change(**{name: bool(value)})

    return _of_state(
        f"show the {text}", name, bool, write=write, keys={key: not_},
        of_keys=f"show or hide the {text}",
        shown=lambda session: getattr(session.scene, needs, None) is not None,
    )  # fmt: skip


def _by(
    step: float, less: str, more: str, least: float = 0.0, most: float = math.inf
) -> dict[str, Callable[[float], float]]:
    """Return keys that change a number by a step, within limits."""
    return {
        less: lambda now: max(least, round(now - step, 10)),
        more: lambda now: min(most, round(now + step, 10)),
    }


def _step(session: Session, control: Control, following: Callable[[Any], Any]) -> None:
    """Change a control to the value that follows its present one."""
    control.change(session, following(control.read(session)))


def _write_axis(session: Session, value: Any) -> None:
    section = session.state.section or Section()
    session.change(section=None if value == "off" else replace(section, axis=value))


def offered_paints(session: Session) -> dict[Paint, str]:
    """Return the colourings that the current object offers."""
    chosen = session.state.paint
    return {one: text for one, text in PAINTS.items() if one == chosen or session.offers(one)}


AXES = {"off": "none", **{axis: f"across {axis}" for axis in get_args(Axis)}}
CLICKS = {"inspect": "inspects a vertex", "fix": "fixes a finger"}
FINGERS = {count: str(count) for count in range(2, MAX_SEARCHED_FINGERS + 1)}

CONTROLS: dict[str, Control] = {
    "number": Control(
        "object",
        lambda session: session.number,
        lambda session, value: session.step(int(value) - session.number),
        options=lambda session: dict(enumerate(item.name for item in session.collection.items)),
        shown=lambda session: len(session.collection.items) > 1,
    ),
    "friction": _of_state(
        "friction μ", "friction", float, least=LEAST_FRICTION, most=1.5,
        read=attrgetter("state.model.nominal_friction"),
        keys=_by(0.05, "Left", "Right", least=0.05),
    ),
    "resolution": Control(
        "sensor resolution α",
        lambda session: round(math.degrees(session.state.model.sensor_resolution), 9),
        lambda session, value: session.change(sensor_resolution=float(value) * DEGREE),
        most=90.0, step=0.1, unit="°",
        keys=_by(2.0, "Down", "Up"),
    ),
    "paint": _of_state(
        "colours", "paint", str, options=offered_paints, shown=is_labelled,
        keys={str(number): lambda _, paint=paint: paint for number, paint in enumerate(PAINTS, 1)},
        of_keys=f"colours: {', '.join(PAINTS).replace('_', ' ')}",
    ),
    "fingers": _of_state(
        "fingers", "fingers", int, options=lambda _: FINGERS, shown=is_labelled
    ),
    "click": _of_state(
        "a click", "click", str, options=lambda _: CLICKS, shown=is_labelled,
        keys={"f": lambda now: "inspect" if now == "fix" else "fix"},
        of_keys="clicks inspect, or fix a finger",
    ),
    "show_gripper": _drawn("hand", "show_gripper", "j", needs="hand"),
    "show_table": _drawn("table", "show_table", "t", needs="table"),
    "axis": Control(
        "section",
        lambda session: "off" if session.state.section is None else session.state.section.axis,
        _write_axis,
        options=lambda _: AXES,
        keys={"x": lambda now: list(AXES)[(list(AXES).index(now) + 1) % len(AXES)]},
        of_keys="section across x, y, z, none",
    ),
    "position": _of_section(
        "its position", "position", float, most=1.0,
        keys=_by(0.05, "[", "]", most=1.0), of_keys="move the section",
    ),
    "flipped": _of_section(
        "its other side", "flipped", bool, keys={"i": not_},
        of_keys="show the other side of the section",
    ),
}  # fmt: skip
"""The user's choices by the name of their field, in the order of the panel."""

OF_WINDOW = {"q": "quit"}
"""A key that only a window has."""

OWN = {
    "sg": "save the labelled PLY, a picture", "r": "reset the view", "+-": "zoom in, out",
    "h": "show or hide this help", **OF_WINDOW,
}  # fmt: skip
"""Keys that the window or the page handles itself."""

KEYS: tuple[Keys, ...] = (
    *(
        Keys(
            one.of_keys or one.text,
            {key: partial(_step, control=one, following=to) for key, to in one.keys.items()},
        )
        for one in CONTROLS.values()
        if one.keys
    ),
    Keys("release fixed fingers", {"u": lambda session: session.change(fixed=())}),
    Keys(
        "next, previous one of the best grasps",
        {"b": partial(Session.step_best, by=1), "v": partial(Session.step_best, by=-1)},
    ),
    Keys(
        "next, previous object",
        {"n": partial(Session.step, by=1), "p": partial(Session.step, by=-1)},
    ),
    *(Keys(text, dict.fromkeys(keys)) for keys, text in OWN.items()),
)

ACTIONS = {key: action for keys in KEYS for key, action in keys.actions.items()}
"""Action of each key."""
