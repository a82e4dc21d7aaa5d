"""The viewer's keys, shared by the window and the page."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import get_args

from grasp3d.errors import SettingError
from grasp3d.settings import DEGREE
from grasp3d.settings.model_text import EPSILON_MIN
from grasp3d.viewer.session.session import Session
from grasp3d.viewer.session.state import Axis, Section
from grasp3d.viewer.view_settings import Paint, check_comparison

FRICTION_STEP, RESOLUTION_STEP = 0.05, 2.0 * DEGREE
LEAST_FRICTION = 0.01
"""Smallest friction that can be true within the friction error that is chosen."""
SECTION_STEP = 0.05
DEFAULT_COMPARED = 40.0 * DEGREE
"""Initial second resolution of a comparison [rad]."""


@dataclass(frozen=True)
class Key:
    """Description and action of a key."""

    text: str
    action: Callable[[Session], None] | None = None
    """None: the window or the page handles the key itself."""


def handle_key(session: Session, key: str) -> bool:
    """Run the action of a key.

    Args:
        session: The session to change.
        key: A key of `KEYS`.

    Returns:
        Whether the key has an action here.
    """
    known = KEYS.get(key)
    if known is None or known.action is None:
        return False
    try:
        known.action(session)
    except SettingError as error:
        session.show_message(str(error))
    return True


def _change_friction(by: float) -> Callable[[Session], None]:
    def change(session: Session) -> None:
        model = session.state.model
        least = max(FRICTION_STEP, model.friction_error + LEAST_FRICTION)
        session.change(friction=round(max(least, model.friction + by), 10))

    return change


def _change_resolution(by: float) -> Callable[[Session], None]:
    return lambda session: session.change(
        sensor_resolution=max(0.0, session.state.model.sensor_resolution + by)
    )


def _set_paint(paint: Paint) -> Callable[[Session], None]:
    return lambda session: session.change(paint=paint)


def _toggle_compare(session: Session) -> None:
    check_comparison(session.state.paint)
    session.change(compare=DEFAULT_COMPARED if session.state.compare is None else None)


def _next_section(session: Session) -> None:
    """Step from no section to sections across x, y and z, and back to none."""
    axes = get_args(Axis)
    section = session.state.section
    after = 0 if section is None else axes.index(section.axis) + 1
    session.change(section=Section(axes[after]) if after < len(axes) else None)


def _move_section(by: float) -> Callable[[Session], None]:
    def move(session: Session) -> None:
        section = session.state.section
        if section is not None:
            position = min(1.0, max(0.0, section.position + by))
            session.change(section=replace(section, position=position))

    return move


def _flip_section(session: Session) -> None:
    section = session.state.section
    if section is not None:
        session.change(section=replace(section, flipped=not section.flipped))


def _step_grasp(by: int) -> Callable[[Session], None]:
    return lambda session: session.step_grasp(by)


def _step_best(by: int) -> Callable[[Session], None]:
    return lambda session: session.step_best(by)


def _toggle_gripper(session: Session) -> None:
    session.check_gripper()
    session.change(show_gripper=not session.state.show_gripper)


def _toggle_table(session: Session) -> None:
    session.check_gripper(table=True)
    session.change(show_table=not session.state.show_table)


def _toggle_errors(session: Session) -> None:
    session.change(show_errors=not session.state.show_errors)


def _toggle_click(session: Session) -> None:
    session.change(click="inspect" if session.state.click == "fix" else "fix")


MOUSE: tuple[tuple[str, str], ...] = (
    ("drag", "rotate"),
    ("shift drag", "pan"),
    ("wheel", "zoom"),
    ("click", "inspect, or fix a finger"),
    ("shift click", "always inspect"),
)
"""Mouse actions on the scene."""

DRAWING: tuple[tuple[str, str], ...] = (
    ("white balls, 1, 2, …", "contacts of the best grasp; 1 is where you clicked"),
    ("rod between them", "line through the contacts, visible through the object"),
    ("arrow", "inward contact normal, along which the finger pushes"),
    ("grey cone", "friction cone, half-angle β"),
    ("blue cone", "its part that is safe for all normals and frictions within their errors"),
    ("thin outlines", "friction cones of the extreme normals, tilted to either side"),
    ("black balls", "fixed fingers"),
    ("blue fan", "free approach angles of the gripper about its closing axis"),
)
"""Symbols in the scene and their meanings."""

KEYS: dict[str, Key] = {
    "Right": Key("more friction μ", _change_friction(FRICTION_STEP)),
    "Left": Key("less friction μ", _change_friction(-FRICTION_STEP)),
    "Up": Key("coarser sensor, larger α", _change_resolution(RESOLUTION_STEP)),
    "Down": Key("finer sensor, smaller α", _change_resolution(-RESOLUTION_STEP)),
    "1": Key("colours: S, M, U", _set_paint("label")),
    "2": Key("colours: β*, critical friction angle", _set_paint("critical_angle")),
    "3": Key("colours: α*, coarsest resolution at which it is S", _set_paint("max_resolution")),
    "4": Key("colours: ε", _set_paint("epsilon")),
    "5": Key(f"colours: {EPSILON_MIN}, over all uncertainties", _set_paint("epsilon_min")),
    "6": Key("colours: approach margin of a gripper", _set_paint("approach_margin")),
    "7": Key("colours: grip force under a load", _set_paint("grip_force")),
    "8": Key("colours: payload of the force at hand", _set_paint("payload")),
    "9": Key("colours: margin, by how much it is S", _set_paint("margin")),
    "e": Key("choose errors of friction, normals and locations", _toggle_errors),
    "c": Key("compare with a second resolution", _toggle_compare),
    "x": Key("section across x, y, z, none", _next_section),
    "[": Key("move the section down", _move_section(-SECTION_STEP)),
    "]": Key("move the section up", _move_section(SECTION_STEP)),
    "i": Key("show the other side of the section", _flip_section),
    "f": Key("clicks inspect, or fix a finger", _toggle_click),
    "u": Key("release fixed fingers", lambda session: session.change(fixed=())),
    "b": Key("next one of the best grasps", _step_best(1)),
    "v": Key("previous one of the best grasps", _step_best(-1)),
    ".": Key("next grasp at the vertex, with a gripper", _step_grasp(1)),
    ",": Key("previous grasp at the vertex", _step_grasp(-1)),
    "j": Key("show or hide the gripper", _toggle_gripper),
    "t": Key("show or hide the table", _toggle_table),
    "n": Key("next object", lambda session: session.step(1)),
    "p": Key("previous object", lambda session: session.step(-1)),
    "s": Key("save the labelled PLY"),
    "g": Key("save a picture"),
    "r": Key("reset the view"),
    "+": Key("zoom in"),
    "-": Key("zoom out"),
    "z": Key("undo"),
    "h": Key("show this help"),
    "q": Key("quit"),
}
