"""Contents of the panel beside the scene: rows and actions."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import get_args

from grasp3d.settings.model_text import EPSILON_MIN
from grasp3d.stability.label import MEANING, Label
from grasp3d.viewer.scene.text_layout import ELLIPSIS, text_width
from grasp3d.viewer.session.inspection import UNKNOWN, Inspection
from grasp3d.viewer.session.painting import FORCE_PAINTS, PALETTE, UNSEARCHED
from grasp3d.viewer.session.panel_text import NOTHING, PanelText, grasp_number
from grasp3d.viewer.session.session import Session
from grasp3d.viewer.session.state import Axis, Section
from grasp3d.viewer.view_settings import Paint, comparison_problem
from grasp3d.viewer.window.canvas import QUIET, WARNING
from grasp3d.viewer.window.rows import (
    Button,
    ButtonRow,
    FractionBar,
    FractionHeader,
    FractionRow,
    Gap,
    ProgressRow,
    RampRow,
    ReservedRow,
    Row,
    SliderRow,
    TextRow,
    ValueRow,
)
from grasp3d.viewer.window.sliders import Ranges, Slider, sliders_of

PAINTS: dict[Paint, str] = {
    "label": "S M U", "critical_angle": "β*", "max_resolution": "α*", "epsilon": "ε",
    "epsilon_min": EPSILON_MIN, "approach_margin": "approach",
    "grip_force": "grip force", "payload": "payload", "margin": "margin",
}  # fmt: skip
FINGERS = (2, 3, 4, 5)
ROWS = 4
"""Rows of area fractions for which there is always space: S, M, U, not searched."""
STATUS = 22.0
"""Height of the progress at the bottom [pixels]."""
WIDEST_RULE = "α 88.88°: S below 88.8°, U from 88.8° on"
"""As wide as the limits of S and U at any second resolution."""

LOW = 820.0
"""Height of a panel below which its rows are less high [pixels]."""

REDUCED: dict[type, float] = {
    SliderRow: 33.0, ButtonRow: 27.0, FractionRow: 17.0, ReservedRow: 17.0,
}  # fmt: skip
"""Reduced heights of rows [pixels]."""


@dataclass(frozen=True)
class Focus:
    """Rows that are to be visible when they are new."""

    key: int
    """Identifies what they show."""
    start: int
    """Index of the first row."""
    end: int
    """Index after the last row."""


@dataclass(frozen=True, eq=False)
class Content:
    """Contents of a panel for one state."""

    upper: tuple[Row, ...]
    """Rows that are scrolled if there is too little space."""
    lower: tuple[Row, ...]
    """Rows at the bottom of the panel, always visible: message and progress."""
    actions: dict[str, Callable[[], None]]
    """Actions of the buttons."""
    sliders: dict[str, Slider]
    focus: Focus | None = None
    """What a click has just shown."""

    def fitted(self, height: float) -> tuple[tuple[Row, ...], tuple[Row, ...]]:
        """Upper and lower rows for a panel's height [pixels].

        Heights do not depend on the content, so that rows stay in place while a slider is dragged.
        """
        if height >= LOW:
            return self.upper, self.lower
        return tuple(map(_reduced, self.upper)), self.lower


def _reduced(row: Row) -> Row:
    """The same row with less height."""
    if isinstance(row, SliderRow | ButtonRow | FractionRow | ReservedRow):
        return replace(row, height=REDUCED[type(row)])
    return row


def panel_content(
    session: Session, text: PanelText, ranges: Ranges, width: float,
    *, press: Callable[[str], None], dragged: tuple[str, float] | None = None,
) -> Content:  # fmt: skip
    """Contents of the panel for the current state of a session.

    Args:
        session: The session.
        text: Its texts.
        ranges: Ranges of the sliders.
        width: Width of the rows [pixels].
        press: Handles a key; most buttons have the action of a key.
        dragged: Name and position of a dragged slider that acts only when it is released.
    """
    sliders = {slider.name: slider for slider in sliders_of(session, ranges)}
    keys = {f"key-{key}": partial(press, key) for key in "123456789cifunpsgrhzjte,."}
    upper = [
        *_title(session, text, width),
        *_fractions(session, text, width),
        Gap(),
        *(_slider(slider, dragged) for slider in sliders.values()),
        Gap(6),
        *_buttons(session),
        Gap(6),
        *_ramp(text, width),
        Gap(14, ruled=True),
    ]
    vertex = _vertex(session, text, width)
    focus = None
    if session.state.vertex is not None:
        focus = Focus(session.state.vertex, len(upper), len(upper) + len(vertex))
    return Content(
        (*upper, *vertex, *_notes(text, width)),
        tuple(_status(text, width)),
        {**keys, **_actions(session)},
        sliders,
        focus,
    )


def _actions(session: Session) -> dict[str, Callable[[], None]]:
    """Actions of the buttons that have no key."""
    sections = {f"section-{axis}": partial(_cut_across, session, axis) for axis in get_args(Axis)}
    return {
        **{f"fingers-{n}": partial(session.change, fingers=n) for n in FINGERS},
        **{f"click-{kind}": partial(session.change, click=kind) for kind in ("inspect", "fix")},
        "section-off": partial(session.change, section=None),
        **sections,
    }


def _cut_across(session: Session, axis: Axis) -> None:
    section = session.state.section
    if section is None or section.axis != axis:
        session.change(section=Section(axis))


def _title(session: Session, text: PanelText, width: float) -> list[Row]:
    rows: list[Row] = [TextRow(text.title, width, 16, bold=True)]
    if text.facts:
        rows.append(TextRow(text.facts, width, color=QUIET, max_lines=2))
    if len(session.collection.items) > 1:
        steps = (Button("key-p", "previous object"), Button("key-n", "next object"))
        rows.append(ButtonRow("", steps))
    return [*rows, Gap()]


def _fractions(session: Session, text: PanelText, width: float) -> list[Row]:
    """Area fractions of the labels; the rows stay in place while grasps are searched."""
    if not text.fractions and not text.stale:
        return []
    both = [text.fractions]
    headers: tuple[str, ...] = ("",)
    if session.other_model is not None:
        both.append(text.other_fractions)
        angles = (session.state.model.sensor_resolution, session.state.compared or 0.0)
        headers = tuple(f"α {math.degrees(angle):.4g}°" for angle in angles)
    rows: list[Row] = []
    for header, fractions in zip(headers, both, strict=True):
        parts = tuple((one.color, one.fraction) for one in fractions)
        rows.append(FractionBar(parts, header))
    if text.stale and text.working is not None:
        rows[0] = _progress(*text.working, FractionBar.height)
    if session.other_model is not None:
        rows.append(FractionHeader(headers))
    if text.stale:
        rows += _pending_fractions(session, text, len(both))
    labels = {one.letter: one for fractions in both for one in fractions}
    for letter, label in labels.items():
        percents = tuple(
            next((one.percent for one in fractions if one.letter == letter), NOTHING)
            for fractions in both
        )
        rows.append(FractionRow(label.color, letter, label.text, percents))
    missing = ROWS - sum(isinstance(row, FractionRow) for row in rows)
    return [*rows, *[ReservedRow()] * missing, *(_rule(rule, width) for rule in text.rules)]


def _pending_fractions(session: Session, text: PanelText, columns: int) -> list[Row]:
    """The labels without their fractions."""
    meaning = MEANING["scan" if session.state.fixed else "label"]
    percent = ELLIPSIS if text.working is not None else UNKNOWN
    return [
        FractionRow(_color(label), label.name, meaning[label], (percent,) * columns)
        for label in sorted(Label, reverse=True)
    ]


def _rule(rule: str, width: float) -> Row:
    """The limits of S and U, with the symbol of their quantity if there is space."""
    several = rule.startswith("α")
    before = "β* at " if several and text_width(f"β* at {WIDEST_RULE}") <= width else ""
    widest = f"{before}{WIDEST_RULE}" if several else ""
    return TextRow(f"{before}{rule}", width, color=QUIET, max_lines=2, widest=widest)


def _slider(slider: Slider, dragged: tuple[str, float] | None) -> Row:
    position, value = slider.position, slider.value
    if dragged is not None and dragged[0] == slider.name:
        position = dragged[1]
        value = slider.value_at(position)
    return SliderRow(slider.name, slider.text, value, position)


def _buttons(session: Session) -> list[Row]:
    state = session.state
    fingers = tuple(Button(f"fingers-{n}", str(n), state.model.fingers == n) for n in FINGERS)
    clicks = [
        Button("click-inspect", "inspect", state.click == "inspect"),
        Button("click-fix", "fix a finger", state.click == "fix"),
    ]
    if state.fixed:
        clicks.append(Button("key-u", f"release {len(state.fixed)}"))
    section = state.section
    sections = [Button("section-off", "off", section is None)]
    sections += [
        Button(f"section-{axis}", axis, section is not None and section.axis == axis)
        for axis in get_args(Axis)
    ]
    if section is not None:
        sections.append(Button("key-i", "flip", section.flipped))
    compare = "side by side" if state.compared is not None else "with a second α"
    errors = Button("key-e", "of friction, normals, locations", state.show_errors)
    comparison = Button(
        "key-c", compare, state.compared is not None, muted=bool(comparison_problem(state.paint))
    )
    others = (
        Button("key-s", "save PLY"), Button("key-g", "picture"), Button("key-r", "reset view"),
        Button("key-z", "undo"), Button("key-h", "help"),
    )  # fmt: skip
    return [
        ButtonRow("fingers", fingers),
        *_paint_buttons(session),
        ButtonRow("click", tuple(clicks)),
        ButtonRow("section", tuple(sections)),
        ButtonRow("compare", (comparison,)),
        ButtonRow("errors", (errors,)),
        *_gripper_buttons(session),
        ButtonRow("", others),
    ]


def _paint_buttons(session: Session) -> list[Row]:
    """Colours; those of a load in a row of their own."""
    buttons = {
        paint: Button(f"key-{number}", text, session.state.paint == paint)
        for number, (paint, text) in enumerate(PAINTS.items(), start=1)
        if session.offers(paint)
    }
    forces = tuple(button for paint, button in buttons.items() if paint in FORCE_PAINTS)
    others = tuple(button for paint, button in buttons.items() if paint not in FORCE_PAINTS)
    return [ButtonRow("colour", others), *([ButtonRow("load", forces)] if forces else [])]


def _gripper_buttons(session: Session) -> list[Row]:
    """Switches for what a gripper adds to the picture."""
    scene, state = session.scene, session.state
    if scene is None:
        return []
    shown = [Button("key-j", "gripper", state.show_gripper)]
    if scene.table is not None:
        shown.append(Button("key-t", "table", state.show_table))
    return [ButtonRow("show", tuple(shown))]


def _grasp_buttons(found: Inspection) -> list[Row]:
    """Buttons that step through the grasps of a vertex that the gripper reaches."""
    if found.held is None or found.vertex is None:
        return []
    steps = (
        Button("key-,", "previous grasp", muted=found.count in {None, 1}),
        Button("key-.", "next grasp", muted=found.count in {None, 1}),
    )
    return [ButtonRow(grasp_number(found), steps), Gap(3)]


def _ramp(text: PanelText, width: float) -> list[Row]:
    ramp = text.ramp
    if ramp is None:
        return []
    maximum = ELLIPSIS if text.stale else ramp.end
    grey, two_sided = "" if text.stale else ramp.grey, ramp.minimum < 0.0
    row = RampRow(ramp.text, ramp.start, maximum, grey, two_sided)
    note = [TextRow(ramp.note, width, 11, color=QUIET, max_lines=3)] if ramp.note else []
    return [row, *note]


def _vertex(session: Session, text: PanelText, width: float) -> list[Row]:
    """The inspected vertex, or what a click would do."""
    if text.stale and session.state.vertex is not None:
        return [TextRow(_pending_vertex(text), width, max_lines=3)]
    found = text.inspection
    if found is None:
        return [TextRow(_hint(session, text), width, color=QUIET)]
    letter = "–" if found.code == UNSEARCHED else Label(found.code).name
    meaning = next((one.text for one in text.fractions if one.letter == letter), "not searched")
    before: list[Row] = []
    if found.vertex is None and session.state.fixed:
        before = [TextRow(_hint(session, text), width, color=QUIET), Gap(6)]
        meaning = f"best contact found: {meaning}"
    return [
        *before,
        *_grasp_buttons(found),
        TextRow(meaning, width, 13, bold=True, dot=_color(found.code)),
        Gap(3),
        TextRow(found.reason, width),
        Gap(4),
        *(ValueRow(name, value) for name, value in found.numbers),
        *_budget(found.budget, width),
    ]


def _budget(budget: str, width: float) -> list[Row]:
    return [Gap(3), TextRow(budget, width, color=QUIET)] if budget else []


def _pending_vertex(text: PanelText) -> str:
    """Text for a clicked vertex whose grasp is not known yet."""
    if text.working is None:
        return "The grasp at this vertex is not known for the current settings."
    return f"{text.working[0]} {ELLIPSIS} Then the grasp of the clicked vertex is shown."


def _color(code: int) -> str:
    return "#{:02X}{:02X}{:02X}".format(*PALETTE[code])


def _hint(session: Session, text: PanelText) -> str:
    count = len(session.state.fixed)
    if count:
        fixed = "One finger is fixed" if count == 1 else f"{count} fingers are fixed"
        if text.stale:
            return f"{fixed}; the labels for the next one are not known yet."
        return f"{fixed}; the colours are for the contact point of the next one."
    if session.state.click == "fix":
        return "Click the surface to fix a finger there."
    return "Click the surface to see the best grasp there, and why it is S, M or U."


def _status(text: PanelText, width: float) -> list[Row]:
    """Message and progress, with space for the progress if there is none."""
    rows: list[Row] = []
    if text.message:
        rows.append(TextRow(text.message, width, max_lines=4))
    if text.working is not None and not text.stale:
        rows.append(_progress(*text.working, STATUS))
    else:
        rows.append(Gap(STATUS))
    return [Gap(4), *rows]


def _progress(text: str, fraction: float, height: float) -> Row:
    return ProgressRow(text, round(100.0 * fraction), height)


def _notes(text: PanelText, width: float) -> list[Row]:
    rows: list[Row] = [TextRow(note, width, 11, color=WARNING) for note in text.notes]
    return [Gap(10), *rows] if rows else []
