"""What the page shows of a session: plain values that a browser understands."""

import math
from collections.abc import Sequence
from typing import Any

from grasp3d.stability.label import MEANING, Label
from grasp3d.viewer.session.inspecting import Inspected
from grasp3d.viewer.session.keys import DRAWING, KEYS, MOUSE
from grasp3d.viewer.session.painting import PALETTE, RAMP, Ramp
from grasp3d.viewer.session.session import Session
from grasp3d.viewer.session.telling import Share, Told, tell
from grasp3d.viewer.web.fields import PAINTS, choices

STOPS = 16
"""Colours that draw a ramp."""

SHORT = 22
"""Letters of a number and its name that half a panel has room for."""

NOT_ON_A_PAGE = frozenset({"q"})
OF_MANY = frozenset({"n", "p"})
"""Keys that go from object to object."""


def fixed_part(session: Session) -> dict[str, Any]:
    """What stays as it is while a page is open."""
    names = [exhibit.name for exhibit in session.album.exhibits]
    left_out = NOT_ON_A_PAGE if len(names) > 1 else NOT_ON_A_PAGE | OF_MANY
    return {
        "paints": [{"name": name, "words": words} for name, words in PAINTS.items()],
        "names": names,
        "keys": [
            {"key": name, "words": key.words} for name, key in KEYS.items() if name not in left_out
        ],
        "mouse": [{"key": name, "words": words} for name, words in MOUSE],
        "drawing": [{"what": what, "words": words} for what, words in DRAWING],
    }


def mirrored(session: Session) -> dict[str, Any]:
    """What is chosen and told now."""
    told, subject = tell(session), session.subject
    return {
        **choices(session),
        "title": told.title,
        "facts": told.facts,
        "rules": list(told.rules),
        **_table(session, told),
        "ramp": told.ramp and _ramp(told.ramp),
        "inspected": told.inspected and _inspected(told.inspected),
        "hint": hint_of(session),
        "stale": told.stale,
        "message": told.message,
        "notes": list(told.notes),
        "ready": subject is not None,
        "unit": (subject and subject.unit) or "",
        "trame__title": f"{session.name} · grasp3d",
    }


def hint_of(session: Session) -> str:
    """What a click does now, or what must be done before it can be answered."""
    if session.stale and session.working is not None:
        return f"{session.working[0]} …"
    count, missing = len(session.shown.fixed), session.shown.model.fingers - 1
    fixes = session.shown.click == "fix"
    if not count:
        if fixes:
            return "Click the surface where a finger stands."
        return "Click the surface to see the best grasp there, and why it is S, M or U."
    fixed = "One finger is fixed" if count == 1 else f"{count} fingers are fixed"
    if not fixes:
        does = "A click shows the best grasp there."
    elif count < missing:
        does = "A click fixes another one."
    else:
        does = "A click moves it." if count == 1 else "A click moves the last one."
    return f"{fixed}; colours tell how good each place is for the next one. {does}"


def _table(session: Session, told: Told) -> dict[str, Any]:
    """Rows of the shares, with a column for each resolution that is shown."""
    heads = []
    if session.other_model is not None:
        angles = (session.shown.model.sensor_resolution, session.shown.compare or 0.0)
        heads = [f"α {math.degrees(angle):.4g}°" for angle in angles]
    columns = [told.shares, told.other_shares] if heads else [told.shares]
    kinds = {one.letter: (one.words, one.color) for shares in columns for one in shares}
    if not kinds and (told.stale or session.working is not None):
        kinds = _awaited(session)
    rows = [
        {
            "letter": letter,
            "words": words,
            "color": color,
            "shares": [_share(letter, shares) for shares in columns],
        }
        for letter, (words, color) in kinds.items()
    ]
    return {"rows": rows, "heads": heads, "columns": len(columns)}


def _awaited(session: Session) -> dict[str, tuple[str, str]]:
    """Words and colours of the labels whose shares are still to come."""
    meaning = MEANING["scan" if session.shown.fixed else "label"]
    return {
        label.name: (meaning[label], _hex(PALETTE[label])) for label in sorted(Label, reverse=True)
    }


def _share(letter: str, shares: Sequence[Share]) -> dict[str, Any]:
    """One number of the table; none while it is not known."""
    if not shares:
        return {"share": None, "percent": "…"}
    found = next((one.share for one in shares if one.letter == letter), 0.0)
    return {"share": found, "percent": f"{100.0 * found:.1f} %"}


def progress(session: Session) -> dict[str, Any]:
    """What goes on in the background."""
    working = session.working
    return {
        "working": "" if working is None else working[0],
        "percent": 0 if working is None else round(100.0 * working[1]),
    }


def _ramp(ramp: Ramp) -> dict[str, Any]:
    steps = [int(k * (len(RAMP) - 1) / (STOPS - 1)) for k in range(STOPS)]
    colors = ", ".join("rgb({}, {}, {})".format(*RAMP[step]) for step in steps)
    return {
        "words": ramp.words,
        "least": f"0{ramp.unit}",
        "most": f"{ramp.most:.3g}{ramp.unit}",
        "grey": ramp.grey,
        "note": ramp.note,
        "css": f"linear-gradient(to right, {colors})",
    }


def _inspected(inspected: Inspected) -> dict[str, Any]:
    return {
        "vertex": inspected.vertex,
        "color": _hex(PALETTE[inspected.code]),
        "reason": inspected.reason,
        "numbers": [
            {"name": name, "value": value, "wide": len(name) + len(value) > SHORT}
            for name, value in inspected.numbers
        ],
    }


def _hex(color: Sequence[int]) -> str:
    return "#{:02X}{:02X}{:02X}".format(*color)
