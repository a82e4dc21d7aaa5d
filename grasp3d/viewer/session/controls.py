"""The user's controls, each declared once: fields and sliders of the page, and all keys."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from operator import attrgetter, not_
from typing import Any, get_args

from grasp3d.errors import SettingError
from grasp3d.pictures.view_settings import Paint
from grasp3d.quality.wrenches import MAX_FRICTION
from grasp3d.settings import DEGREE
from grasp3d.settings.model_text import EPSILON_MIN
from grasp3d.viewer.session.session import Session
from grasp3d.viewer.session.state import OF_MODEL, Axis, Section

LEAST_FRICTION = 0.01
"""Smallest friction that can be true within the friction error that is chosen."""
FRICTION_STEP, RESOLUTION_STEP, SECTION_STEP = 0.05, 2.0, 0.05
"""Changes by a key; resolutions are in degrees."""

ARROWS = {"Left": "←", "Right": "→", "Up": "↑", "Down": "↓"}


@dataclass(frozen=True)
class Keys:
    """Keys that belong together, and what they do."""

    text: str
    actions: Mapping[str, Callable[[Session], None] | None]
    """The action of each; None: the window or the page handles the key itself."""

    @property
    def names(self) -> str:
        """What is printed on them; the first and the last one of many."""
        names = [ARROWS.get(key, key) for key in self.actions]
        return " ".join(names) if len(names) <= 2 else f"{names[0]} … {names[-1]}"


@dataclass(frozen=True)
class Field:
    """How the page shows a control: a slider with a number, or a check box."""

    text: str
    name: str = ""
    """Spoken name of a number, with its unit."""
    most: float | None = None
    """Value at the right end, unless the present one is larger; None: a check box."""
    step: float = 0.01
    unit: str = ""
    of_size: bool = False
    """Whether `most` and `step` are relative to the object's size, and the unit is the mesh's."""
    limits: Callable[[Session], tuple[float, float | None]] = lambda _: (0.0, None)
    """Smallest and largest value that a drag sets; None: unlimited."""
    problem: Callable[[Session], str] = lambda _: ""
    """Why it cannot be changed; empty if it can."""
    shown: Callable[[Session], bool] = lambda _: True


@dataclass(frozen=True)
class Control:
    """One choice of the user."""

    read: Callable[[Session], Any]
    """The present value; angles are in degrees."""
    write: Callable[[Session, Any], None]
    """Changes it; raises SettingError, or a ValueError or TypeError that `valid` explains."""
    valid: str = ""
    """What is valid, as the message for a value that is not."""
    keys: Mapping[str, Callable[[Any], Any]] = field(default_factory=dict)
    """For each key the next value for the present one."""
    of_keys: str = ""
    """What the keys do."""
    page: Field | None = None
    """None: the page has markup of its own for it."""

    def change(self, session: Session, value: Any) -> None:
        """Change the session to a new value.

        Raises:
            SettingError: The value is invalid; the message is meant for the user.
        """
        try:
            self.write(session, value)
        except (TypeError, ValueError, OverflowError):
            raise SettingError(self.valid or f"invalid value: {value}") from None

    def step(self, session: Session, following: Callable[[Any], Any]) -> None:
        """Change it to the value that follows the present one."""
        value = following(self.read(session))
        if self.page is not None and self.page.most is not None:
            value = max(value, self.page.limits(session)[0])
        self.change(session, value)


def control_values(session: Session) -> dict[str, Any]:
    """The present values of all controls."""
    return {name: control.read(session) for name, control in CONTROLS.items()}


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


def _number(value: Any, *, below: float = math.inf, above: float = -math.inf) -> float:
    """A number that is at least 0, and between limits.

    Raises:
        ValueError: The value is not such a number.
    """
    number = float(value)
    if not (0.0 <= number < below and number > above):
        raise ValueError
    return number


def _chosen(name: str, kind: Callable[[Any], Any], **options: Any) -> Control:
    """Control of a field of the state, or of its model."""

    def read(session: Session) -> Any:
        return getattr(session.state.model if name in OF_MODEL else session.state, name)

    return Control(read, lambda session, value: session.change(**{name: kind(value)}), **options)


def _of_section(name: str, kind: Callable[[Any], Any], **options: Any) -> Control:
    """Control of a field of the section, if there is one."""

    def write(session: Session, value: Any) -> None:
        section = session.state.section
        if section is not None:
            session.change(section=replace(section, **{name: kind(value)}))

    return Control(
        lambda session: getattr(session.state.section or Section(), name), write, **options
    )


def _drawn(name: str, check: Callable[[Session], None], **options: Any) -> Control:
    """Control of whether something is drawn, if the object has it."""

    def write(session: Session, value: Any) -> None:
        check(session)
        session.change(**{name: bool(value)})

    return Control(lambda session: getattr(session.state, name), write, **options)


def _write_axis(session: Session, value: Any) -> None:
    section = session.state.section or Section()
    session.change(section=None if value == "off" else replace(section, axis=value))


def _degrees(angle: float) -> float:
    return round(math.degrees(angle), 9)


AXES = ("off", *get_args(Axis))

PAINTS: dict[Paint, str] = {
    "label": "S, M, U of the contacts",
    "critical_angle": "β*, critical friction angle",
    "max_resolution": "α*, coarsest resolution at which it is S",
    "epsilon": "ε",
    "epsilon_min": f"{EPSILON_MIN}, over all uncertainties",
    "approach_margin": "approach margin of the gripper",
    "grip_force": "grip force of each contact",
    "payload": "payload of the contacts",
    "margin": "margin: how far it is S, or fails to be",
}
"""Quantities that colours can show, as they are listed."""

CONTROLS: dict[str, Control] = {
    "friction": Control(
        attrgetter("state.model.nominal_friction"),
        lambda session, value: session.change(
            friction=_number(value, above=0.0, below=MAX_FRICTION)
        ),
        valid=f"friction must be a number above 0 and below {MAX_FRICTION:,.0f}",
        keys={
            "Left": lambda now: max(FRICTION_STEP, round(now - FRICTION_STEP, 10)),
            "Right": lambda now: round(now + FRICTION_STEP, 10),
        },
        of_keys="friction μ",
        page=Field(
            "friction μ", "Friction coefficient μ", 1.5,
            limits=lambda _: (LEAST_FRICTION, None),
        ),
    ),
    "resolution": Control(
        lambda session: _degrees(session.state.model.sensor_resolution),
        lambda session, value: session.change(
            sensor_resolution=_number(value, below=180.0) * DEGREE
        ),
        valid="sensor resolution must be from 0 to below 180 degrees",
        keys={
            "Down": lambda now: max(0.0, now - RESOLUTION_STEP),
            "Up": lambda now: now + RESOLUTION_STEP,
        },
        of_keys="sensor resolution α",
        page=Field("sensor resolution α", "Sensor resolution α in degrees", 90.0, 0.1, "°"),
    ),
    "paint": _chosen(
        "paint", str,
        keys={
            str(number): lambda _, paint=paint: paint
            for number, paint in enumerate(PAINTS, start=1)
        },
        of_keys="colours: S M U, β*, α*, ε, ε_min, approach, grip force, payload, margin",
    ),
    "axis": Control(
        lambda session: "off" if session.state.section is None else session.state.section.axis,
        _write_axis,
        keys={"x": lambda now: AXES[(AXES.index(now) + 1) % len(AXES)]},
        of_keys="section across x, y, z, none",
    ),
    "position": _of_section(
        "position", float,
        keys={
            "[": lambda now: max(0.0, now - SECTION_STEP),
            "]": lambda now: min(1.0, now + SECTION_STEP),
        },
        of_keys="move the section",
    ),
    "flipped": _of_section(
        "flipped", bool, keys={"i": not_}, of_keys="show the other side of the section"
    ),
    "click": _chosen(
        "click", str,
        keys={"f": lambda now: "inspect" if now == "fix" else "fix"},
        of_keys="clicks inspect, or fix a finger",
    ),
    "show_gripper": _drawn(
        "show_gripper", Session.check_gripper, keys={"j": not_}, of_keys="show or hide the gripper"
    ),
    "show_table": _drawn(
        "show_table", lambda session: session.check_gripper(table=True),
        keys={"t": not_}, of_keys="show or hide the table",
    ),
    "fingers": _chosen("fingers", int),
    "number": Control(
        lambda session: session.number,
        lambda session, value: session.step(int(value) - session.number),
    ),
}  # fmt: skip
"""The user's choices by the name of their field."""

STEPS = (
    ("b", "v", Session.step_best, "one of the best grasps"),
    ("n", "p", Session.step, "object"),
)
"""Keys that lead forward and back, and to what."""

OWN = {
    "sg": "save the labelled PLY, a picture", "r": "reset the view", "+-": "zoom in, out",
    "h": "show or hide this help", "q": "quit",
}  # fmt: skip
"""Keys that the window or the page handles itself."""

KEYS: tuple[Keys, ...] = (
    *(
        Keys(one.of_keys, {key: partial(one.step, following=to) for key, to in one.keys.items()})
        for one in CONTROLS.values()
        if one.keys
    ),
    Keys("release fixed fingers", {"u": lambda session: session.change(fixed=())}),
    *(
        Keys(f"next, previous {what}", {on: partial(step, by=1), back: partial(step, by=-1)})
        for on, back, step, what in STEPS
    ),
    *(Keys(text, dict.fromkeys(keys)) for keys, text in OWN.items()),
)

ACTIONS = {key: action for keys in KEYS for key, action in keys.actions.items()}
"""The action of each key."""
