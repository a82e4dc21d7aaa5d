"""The panel beside a scene: which rows it has, and what they do."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import get_args

from grasp3d.stability.label import MEANING, Label
from grasp3d.viewer.session.inspecting import UNKNOWN
from grasp3d.viewer.session.painting import PALETTE, UNSEARCHED
from grasp3d.viewer.session.session import Session
from grasp3d.viewer.session.state import Axis, Section
from grasp3d.viewer.session.telling import Told
from grasp3d.viewer.view_settings import Paint
from grasp3d.viewer.window.canvas import MORE, QUIET, WARNING, width_of
from grasp3d.viewer.window.rows import (
    Button,
    Choices,
    Gap,
    Pair,
    RampStrip,
    Row,
    ShareBar,
    ShareHead,
    ShareLine,
    Track,
    Words,
    WorkBar,
)
from grasp3d.viewer.window.sliders import Ranges, Slider, sliders_of

PAINTS: dict[Paint, str] = {
    "label": "S M U", "critical_angle": "β*", "max_resolution": "α*", "epsilon": "ε",
    "epsilon_min": "smallest ε",
}  # fmt: skip
FINGERS = (2, 3, 4, 5)
MOST_NOTES = 2

FEW = 4
"""How many numbers of the clicked place are kept before buttons."""

# What falls away first where the window is low, after rows have become flatter: empty room, notes,
# facts, most numbers of the clicked place from the last one up, the rule, buttons that keys do as
# well, the first numbers, the ramp, bars, other buttons. Never: title, shares, friction and
# resolution, what goes on.
GAPS, NOTES, FACTS, NUMBERS, RULE, KEYED, FIRST, RAMPS, BARS, EXTRA, PLACE, ALWAYS = range(12)

FLAT: dict[type, float] = {Track: 33.0, Choices: 27.0, ShareLine: 17.0}
"""Heights of rows where there is little room [pixels]."""


@dataclass(frozen=True, eq=False)
class Content:
    """What a panel shows at one moment."""

    upper: tuple[Row, ...]
    lower: tuple[Row, ...]
    """These stand at the bottom."""
    actions: dict[str, Callable[[], None]]
    """What buttons do."""
    sliders: dict[str, Slider]

    def fitted(self, room: float) -> tuple[tuple[Row, ...], tuple[Row, ...]]:
        """Upper and lower rows that have room, the lightest left out first [pixels]."""
        kept = [*((row, 0) for row in self.upper), *((row, 1) for row in self.lower)]
        if sum(row.height for row, _ in kept) > room:
            kept = [(_flat(row), part) for row, part in kept]
        while kept and sum(row.height for row, _ in kept) > room:
            least = min(row.weight for row, _ in kept)
            if least == ALWAYS:
                break
            last = max(at for at, (row, _) in enumerate(kept) if row.weight == least)
            del kept[last]
        return tuple(r for r, part in kept if part == 0), tuple(r for r, part in kept if part == 1)


def _flat(row: Row) -> Row:
    """The same row, less high."""
    if isinstance(row, Track | Choices | ShareLine):
        return replace(row, height=FLAT[type(row)])
    return row


def content_of(
    session: Session, told: Told, ranges: Ranges, width: float,
    *, press: Callable[[str], None], dragged: tuple[str, float] | None = None,
) -> Content:  # fmt: skip
    """Say what stands in the panel.

    Args:
        session: Who is looking.
        told: What there is to say.
        ranges: Of the sliders.
        width: Of the rows [pixels].
        press: Answers a key; most buttons do what a key does.
        dragged: A slider that acts only when it is released, and where it stands.
    """
    sliders = {slider.name: slider for slider in sliders_of(session, ranges)}
    keys = {f"key-{key}": partial(press, key) for key in "12345cifunpsgrhz"}
    upper = [
        *_head(session, told, width),
        *_shares(session, told, width),
        Gap(GAPS),
        *(_track(slider, dragged) for slider in sliders.values()),
        Gap(GAPS, 6),
        *_choices(session),
        Gap(GAPS, 6),
        *_status(told, width),
        *_ramp(told, width),
        Gap(GAPS, 14, ruled=True),
        *_place(session, told, width),
    ]
    return Content(tuple(upper), tuple(_notes(told, width)), {**keys, **_changes(session)}, sliders)


def _changes(session: Session) -> dict[str, Callable[[], None]]:
    """What buttons do that have no key of their own."""
    cuts = {f"section-{axis}": partial(_cut_across, session, axis) for axis in get_args(Axis)}
    return {
        **{f"fingers-{n}": partial(session.change, fingers=n) for n in FINGERS},
        **{f"click-{kind}": partial(session.change, click=kind) for kind in ("inspect", "fix")},
        "section-off": partial(session.change, section=None),
        **cuts,
    }


def _cut_across(session: Session, axis: Axis) -> None:
    shown = session.shown.section
    if shown is None or shown.axis != axis:
        session.change(section=Section(axis))


def _head(session: Session, told: Told, width: float) -> list[Row]:
    rows: list[Row] = [Words(ALWAYS, told.title, width, 16, bold=True)]
    if told.facts:
        rows.append(Words(FACTS, told.facts, width, color=QUIET, most=2))
    if len(session.album.exhibits) > 1:
        steps = (Button("key-p", "previous object"), Button("key-n", "next object"))
        rows.append(Choices(EXTRA, "", steps))
    return [*rows, Gap(GAPS)]


def _shares(session: Session, told: Told, width: float) -> list[Row]:
    """How much of the surface has which label; while that is searched its rows keep their place."""
    if not told.shares and not told.stale:
        return []
    both = [told.shares]
    heads: tuple[str, ...] = ("",)
    if session.other_model is not None:
        both.append(told.other_shares)
        angles = (session.shown.model.sensor_resolution, session.shown.compare or 0.0)
        heads = tuple(f"α {math.degrees(angle):.4g}°" for angle in angles)
    rows: list[Row] = []
    for head, shares in zip(heads, both, strict=True):
        parts = tuple((one.color, one.share) for one in shares)
        rows.append(ShareBar(BARS, parts, head))
    if told.stale and told.working is not None:
        rows[0] = _work(*told.working, ShareBar.height)
    if session.other_model is not None:
        rows.append(ShareHead(ALWAYS, heads))
    if told.stale:
        rows += _missing(session, told, len(both))
    kinds = {one.letter: one for shares in both for one in shares}
    for letter, kind in kinds.items():
        found = [next((s.share for s in shares if s.letter == letter), 0.0) for shares in both]
        told_shares = tuple(f"{100.0 * share:.1f} %" for share in found)
        rows.append(ShareLine(ALWAYS, kind.color, letter, kind.words, told_shares))
    return [*rows, *(_rule(rule, width) for rule in told.rules)]


def _missing(session: Session, told: Told, columns: int) -> list[Row]:
    """The labels without their shares."""
    meaning = MEANING["scan" if session.shown.fixed else "label"]
    share = MORE if told.working is not None else UNKNOWN
    return [
        ShareLine(ALWAYS, _color(label), label.name, meaning[label], (share,) * columns)
        for label in sorted(Label, reverse=True)
    ]


def _rule(rule: str, width: float) -> Row:
    """A rule, that it is of β* only where there is room."""
    longer = f"β* at {rule}"
    if rule.startswith("α") and width_of(longer) <= width:
        rule = longer
    return Words(RULE, rule, width, color=QUIET, most=2)


def _track(slider: Slider, dragged: tuple[str, float] | None) -> Row:
    share, value = slider.share, slider.value
    if dragged is not None and dragged[0] == slider.name:
        share = dragged[1]
        value = slider.said(share)
    weight = ALWAYS if slider.name in {"friction", "sensor_resolution"} else EXTRA
    return Track(weight, slider.name, slider.words, value, share)


def _choices(session: Session) -> list[Row]:
    shown = session.shown
    paints = tuple(
        Button(f"key-{number}", words, shown.paint == paint)
        for number, (paint, words) in enumerate(PAINTS.items(), start=1)
    )
    fingers = tuple(Button(f"fingers-{n}", str(n), shown.model.fingers == n) for n in FINGERS)
    clicks = [
        Button("click-inspect", "inspect", shown.click == "inspect"),
        Button("click-fix", "fix a finger", shown.click == "fix"),
    ]
    if shown.fixed:
        clicks.append(Button("key-u", f"release {len(shown.fixed)}"))
    cut = shown.section
    section = [Button("section-off", "off", cut is None)]
    section += [
        Button(f"section-{axis}", axis, cut is not None and cut.axis == axis)
        for axis in get_args(Axis)
    ]
    if cut is not None:
        section.append(Button("key-i", "flip", cut.flipped))
    words = "side by side" if shown.compare is not None else "with a second α"
    others = (
        Button("key-s", "save PLY"), Button("key-g", "picture"), Button("key-r", "reset view"),
        Button("key-z", "undo"), Button("key-h", "help"),
    )  # fmt: skip
    return [
        Choices(EXTRA, "fingers", fingers),
        Choices(EXTRA, "colour", paints),
        Choices(KEYED, "click", tuple(clicks)),
        Choices(KEYED, "section", tuple(section)),
        Choices(KEYED, "compare", (Button("key-c", words, shown.compare is not None),)),
        Choices(EXTRA, "", others),
    ]


def _ramp(told: Told, width: float) -> list[Row]:
    ramp = told.ramp
    if ramp is None:
        return []
    most = MORE if told.stale else f"{ramp.most:.3g}{ramp.unit}"
    strip = RampStrip(RAMPS, ramp.words, f"0{ramp.unit}", most, "" if told.stale else ramp.grey)
    note = [Words(NOTES, ramp.note, width, 11, color=QUIET, most=3)] if ramp.note else []
    return [strip, *note]


def _place(session: Session, told: Told, width: float) -> list[Row]:
    """The clicked vertex, or what a click would do."""
    if told.stale and session.shown.vertex is not None:
        return [Words(PLACE, _awaited(told), width, most=3)]
    found = told.inspected
    if found is None:
        return [Words(NOTES, _hint(session, told), width, color=QUIET, most=3)]
    letter = "–" if found.code == UNSEARCHED else Label(found.code).name
    meaning = next((one.words for one in told.shares if one.letter == letter), "not searched")
    return [
        Words(PLACE, meaning, width, 13, bold=True, dot=_color(found.code)),
        Gap(GAPS, 3),
        Words(PLACE, found.reason, width, most=6),
        Gap(GAPS, 4),
        *(Pair(FIRST, name, value) for name, value in found.numbers[:FEW]),
        *(Pair(NUMBERS, name, value) for name, value in found.numbers[FEW:]),
    ]


def _awaited(told: Told) -> str:
    """What is said of a vertex that was clicked before its grasp is known."""
    if told.working is None:
        return "The grasp here is not known for what is chosen."
    return f"{told.working[0]} {MORE} Then the grasp of the clicked place is shown."


def _color(code: int) -> str:
    return "#{:02X}{:02X}{:02X}".format(*PALETTE[code])


def _hint(session: Session, told: Told) -> str:
    count = len(session.shown.fixed)
    if count:
        fixed = "One finger is fixed" if count == 1 else f"{count} fingers are fixed"
        if told.stale:
            return f"{fixed}; how good each place is for the next one is not known yet."
        return f"{fixed}; colours tell how good each place is for the next one."
    if session.shown.click == "fix":
        return "Click the surface where a finger stands."
    return "Click the surface to see the best grasp there, and why it is S, M or U."


def _status(told: Told, width: float) -> list[Row]:
    """What was said and what goes on; the room of a line is kept free where there is nothing."""
    rows: list[Row] = []
    if told.message:
        rows.append(Words(ALWAYS, told.message, width, most=4))
    if told.working is not None and not told.stale:
        rows.append(_work(*told.working, WorkBar.height))
    return [*rows, Gap(GAPS, max(0.0, WorkBar.height - sum(row.height for row in rows)))]


def _work(words: str, share: float, height: float) -> Row:
    return WorkBar(ALWAYS, words, round(100.0 * share), height)


def _notes(told: Told, width: float) -> list[Row]:
    rows: list[Row] = [
        Words(NOTES, note, width, 11, color=WARNING, most=2) for note in told.notes[:MOST_NOTES]
    ]
    return [Gap(GAPS, 8), *rows] if rows else []
