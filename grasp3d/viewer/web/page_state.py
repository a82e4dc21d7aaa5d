"""The displayed state of a session as plain values for the page."""

from dataclasses import asdict
from typing import Any

from grasp3d.pictures.colors import HEX_PALETTE, Ramp
from grasp3d.settings.model_text import friction_text
from grasp3d.stability.label import MEANING, Label
from grasp3d.viewer.session.controls import CONTROLS, KEYS, OF_WINDOW, is_labelled
from grasp3d.viewer.session.panel_text import PanelText, panel_text
from grasp3d.viewer.session.session import Session

STOPS = slice(None, None, 17)
"""The colours of a ramp that its gradient has."""

OF_SEVERAL = "n"
"""A key that needs several objects."""


def page_state(session: Session) -> dict[str, Any]:
    """State that depends on the session's choices and results."""
    text, inspection = panel_text(session), session.inspection
    hidden = {*OF_WINDOW, *(OF_SEVERAL if len(session.collection.items) == 1 else "")}
    controls = [_control(session, name) for name, one in CONTROLS.items() if one.shown(session)]
    first = [one["name"] for one in controls].index("resolution") + 1
    return {
        **{name: control.read(session) for name, control in CONTROLS.items()},
        "parts": [controls[:first], controls[first:]],
        "keys": [
            {"names": one.names, "text": one.text, "keys": list(one.actions)}
            for one in KEYS
            if not hidden & one.actions.keys()
        ],
        **{name: getattr(text, name) for name in ("title", "facts", "rule", "hint", "stale")},
        "rows": _rows(session, text),
        "ramp": text.ramp and _ramp(text.ramp, stale=text.stale),
        "inspection": inspection
        and {
            "vertex": inspection.vertex,
            "color": HEX_PALETTE[inspection.code],
            "reason": inspection.reason,
            "numbers": [list(number) for number in inspection.numbers],
        },
        "notes": list(text.notes),
        "fixed_count": len(session.state.fixed),
        "message": session.message,
        "ready": session.subject is not None,
        "labelled": is_labelled(session),
        "trame__title": f"{session.name} · grasp3d",
    }


def progress_state(session: Session) -> dict[str, Any]:
    """State of the background job."""
    text, fraction = session.working or ("", 0.0)
    return {"working": text, "percent": round(100.0 * fraction)}


def _control(session: Session, name: str) -> dict[str, Any]:
    """A slider with a number, a list, or a check box."""
    one, model = CONTROLS[name], session.state.model
    uncertain = name == "friction" and len(set(model.friction_interval)) > 1
    return {
        "name": name,
        "text": f"{one.text}, {friction_text(model)}" if uncertain else one.text,
        "options": one.options and [list(item) for item in one.options(session).items()],
        **{name: getattr(one, name) for name in ("least", "most", "step", "unit")},
    }


def _rows(session: Session, text: PanelText) -> list[dict[str, Any]]:
    """Rows of the area fractions; without a fraction while they are not known yet."""
    if text.fractions or not (text.stale or session.working is not None):
        return [{**asdict(one), "percent": one.percent} for one in text.fractions]
    meaning = MEANING["scan" if session.state.fixed else "label"]
    return [
        {"letter": one.name, "text": meaning[one], "color": HEX_PALETTE[one], "percent": "…"}
        for one in sorted(Label, reverse=True)
    ]


def _ramp(ramp: Ramp, *, stale: bool) -> dict[str, Any]:
    colors = ", ".join(f"rgb({r}, {g}, {b})" for r, g, b in ramp.colors[STOPS])
    return {
        "text": ramp.text,
        "minimum": ramp.start,
        "maximum": "…" if stale else ramp.end,
        "grey": "" if stale else ramp.grey,
        "note": ramp.note,
        "css": f"linear-gradient(to right, {colors})",
    }
