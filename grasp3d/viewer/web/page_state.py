"""The displayed state of a session as plain values for the page."""

from typing import Any

from grasp3d.pictures.colors import HEX_PALETTE, PAINTS, Ramp
from grasp3d.stability.label import MEANING, Label
from grasp3d.viewer.session.controls import CONTROLS, KEYS, control_values
from grasp3d.viewer.session.inspection import Inspection
from grasp3d.viewer.session.panel_text import (
    HINTS,
    OF_POSES,
    PanelText,
    interval_text,
    panel_text,
)
from grasp3d.viewer.session.session import Session

STOPS = 16
"""Colour stops of a ramp's gradient."""

SHORT = 22
"""Letters of a number and its name that fit into half the panel's width."""

WINDOW_KEY, OBJECT_KEY = "q", "n"
"""A key that only a window has, and one that changes the object."""


def constant_state(session: Session) -> dict[str, Any]:
    """State that does not change while the page is open."""
    names = [item.name for item in session.collection.items]
    hidden = {WINDOW_KEY} if len(names) > 1 else {WINDOW_KEY, OBJECT_KEY}
    shown = [keys for keys in KEYS if not hidden & keys.actions.keys()]
    return {
        "names": names,
        "keys": [{"key": one.names, "text": one.text, "keys": list(one.actions)} for one in shown],
    }


def page_state(session: Session) -> dict[str, Any]:
    """State that depends on the session's choices and results."""
    text, subject, scene = panel_text(session), session.subject, session.scene
    inspection = session.inspection
    return {
        **control_values(session),
        "controls": _controls(session),
        "fixed_count": len(session.state.fixed),
        "paints": [
            {"name": name, "text": text}
            for name, text in PAINTS.items()
            if session.offers(name) or session.state.paint == name
        ],
        "gripper": "" if scene is None else scene.hand.name,
        "table": scene is not None and scene.table is not None,
        "title": text.title,
        "facts": text.facts,
        "rule": text.rule,
        "rows": _rows(session, text),
        "ramp": text.ramp and _ramp(text.ramp, stale=text.stale),
        "inspection": inspection and _inspection(inspection),
        "hint": click_hint(session),
        "stale": text.stale,
        "size": 0.0 if subject is None else subject.mesh.size,
        "message": session.message,
        "notes": list(text.notes),
        "ready": subject is not None,
        "labelled": subject is None or subject.poses is None,
        "unit": (subject and subject.mesh.unit) or "",
        "trame__title": f"{session.name} · grasp3d",
    }


def _controls(session: Session) -> list[dict[str, Any]]:
    """Sliders with numbers, and check boxes, that are declared with their controls."""
    mesh = None if session.subject is None else session.subject.mesh
    listed = []
    for name, control in CONTROLS.items():
        field = control.page
        if field is None or not field.shown(session) or (field.of_size and mesh is None):
            continue
        scale, unit = (mesh.size, mesh.unit or "") if field.of_size and mesh else (1.0, field.unit)
        least, most = field.limits(session)
        listed.append({
            "field": name,
            "id": name.replace("_", "-"),
            "text": _name(session, name, field.text),
            "name": field.name,
            "end": None if field.most is None else field.most * scale,
            "step": field.step * scale,
            "any_step": field.of_size,
            "unit": unit,
            "least": least,
            "most": most,
            "problem": field.problem(session),
        })  # fmt: skip
    return listed


def _name(session: Session, name: str, text: str) -> str:
    """Name of a control, with all friction that may be true if it is uncertain."""
    model = session.state.model
    smallest, largest = model.friction_interval
    uncertain = name == "friction" and smallest < largest
    return f"{text}, {interval_text(model)}" if uncertain else text


def click_hint(session: Session) -> str:
    """What a click does, or what is being computed before clicks have an effect."""
    if session.stale and session.working is not None:
        then = " Then the grasp of the clicked vertex is shown."
        return f"{session.working[0]} …{then if session.state.vertex is not None else ''}"
    if session.subject is not None and session.subject.poses is not None:
        return OF_POSES
    count, missing = len(session.state.fixed), session.state.model.fingers - 1
    if not count:
        return HINTS[session.state.click]
    fixed = "One finger is fixed" if count == 1 else f"{count} fingers are fixed"
    if session.state.click != "fix":
        action = "A click shows the best grasp there."
    elif count < missing:
        action = "A click fixes another one."
    else:
        action = "A click moves it." if count == 1 else "A click moves the last one."
    return f"{fixed}; the colours are for the contact point of the next one. {action}"


def _rows(session: Session, text: PanelText) -> list[dict[str, Any]]:
    """Rows of the area fractions; None: not known yet."""
    if text.fractions or not (text.stale or session.working is not None):
        return [
            {
                "letter": one.letter,
                "text": one.text,
                "color": one.color,
                "fraction": one.fraction,
                "percent": one.percent,
            }
            for one in text.fractions
        ]
    meaning = MEANING["scan" if session.state.fixed else "label"]
    return [
        {
            "letter": label.name,
            "text": meaning[label],
            "color": HEX_PALETTE[label],
            "fraction": None,
            "percent": "…",
        }
        for label in sorted(Label, reverse=True)
    ]


def progress_state(session: Session) -> dict[str, Any]:
    """State of the background job."""
    working = session.working
    return {
        "working": "" if working is None else working[0],
        "percent": 0 if working is None else round(100.0 * working[1]),
    }


def _ramp(ramp: Ramp, *, stale: bool) -> dict[str, Any]:
    steps = [int(k * (len(ramp.colors) - 1) / (STOPS - 1)) for k in range(STOPS)]
    colors = ", ".join("rgb({}, {}, {})".format(*ramp.colors[step]) for step in steps)
    return {
        "text": ramp.text,
        "minimum": ramp.start,
        "maximum": "…" if stale else ramp.end,
        "grey": "" if stale else ramp.grey,
        "note": ramp.note,
        "css": f"linear-gradient(to right, {colors})",
    }


def _inspection(inspection: Inspection) -> dict[str, Any]:
    return {
        "vertex": inspection.vertex,
        "color": HEX_PALETTE[inspection.code],
        "reason": inspection.reason,
        "numbers": [
            {"name": name, "value": value, "wide": len(name) + len(value) > SHORT}
            for name, value in inspection.numbers
        ],
    }
