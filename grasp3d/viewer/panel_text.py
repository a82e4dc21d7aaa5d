"""Texts and numbers beside the picture, shared by the window and the page."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

from grasp3d.describe.explanations import UNSEARCHED
from grasp3d.hand.articulated_hand import ArticulatedHand
from grasp3d.pictures.colors import HEX_PALETTE, Ramp, area_fractions, labels_at, ramp_of
from grasp3d.pictures.subject import Subject
from grasp3d.settings.grasp_model import SAFE_LABELS
from grasp3d.stability.label import MEANING, Label
from grasp3d.system.names import counted, noun
from grasp3d.viewer.session import Session

NOTHING, EVERYTHING = "0.0 %", "100.0 %"
ROUNDING = 1e-9
"""Rounding error of sums of area fractions."""


@dataclass(frozen=True)
class LabelFraction:
    """Area fraction of one label."""

    letter: str
    text: str
    """Meaning of the label."""
    color: str
    """Colour as #RRGGBB."""
    fraction: float
    """Fraction of the area, from 0 to 1."""

    @property
    def percent(self) -> str:
        """The fraction as text; a bound where rounding would hide a label."""
        text = f"{100.0 * self.fraction:.1f} %"
        if text == NOTHING and self.fraction > 0.0:
            return "<0.1 %"
        if text == EVERYTHING and self.fraction <= 1.0 - ROUNDING:
            return ">99.9 %"
        return text


@dataclass(frozen=True, eq=False)
class PanelText:
    """Texts and numbers for the current state of a session."""

    title: str
    """Name of the object, and its number in the collection."""
    facts: str
    """Size and vertices of the object."""
    rule: str
    """Limits of the critical friction angle for S and U; empty for poses of a hand."""
    fractions: tuple[LabelFraction, ...]
    """S, M, U, and the unsearched part if any; empty: there are no valid labels at present."""
    ramp: Ramp | None
    """Legend of the colours; None: the colours show labels."""
    notes: tuple[str, ...]
    """Warnings about the labels."""
    hint: str
    """Effect of a click, or what is computed before clicks have an effect."""
    stale: bool = False
    """Whether the surface is for other fingers or fixed fingers than are chosen; see `Session`."""


def panel_text(session: Session) -> PanelText:
    """Return texts and numbers for the current state of a session."""
    subject = session.subject
    count = len(session.collection.items)
    title = session.name if count == 1 else f"{session.name} ({session.number + 1} of {count})"
    stale = session.stale
    posed = subject is not None and subject.poses is not None
    current = None if stale or posed else subject
    return PanelText(
        title=title,
        facts=_facts(subject, len(session.state.fixed), stale=stale) if subject else "",
        rule="" if posed else _rule(session),
        fractions=_fractions(current) if current else (),
        ramp=ramp_of(subject, session.state.paint) if subject else None,
        notes=(*_notes(session), *(subject.notes if subject else ()), *session.collection.notes),
        hint=_hint(session),
        stale=stale,
    )


def _hint(session: Session) -> str:
    if session.stale and session.working is not None:
        then = " Then the grasp of the clicked vertex is shown."
        return f"{session.working[0]} …{then if session.state.vertex is not None else ''}"
    if session.subject is not None and session.subject.poses is not None:
        return "Fingers that touch have the colour of the letter of the pose."
    count, hint = len(session.state.fixed), ""
    if count:
        fixed = counted(count, "fingers")
        hint = f"{fixed} fixed: the colours are for the contact point of the next one. "
    if session.state.click == "inspect":
        return f"{hint}Click the surface to see the best grasp there, and why it is S, M or U."
    if count == session.state.model.fingers - 1:
        return f"{hint}Click the surface to move the last one there."
    return f"{hint}Click the surface to fix a finger there."


def _facts(subject: Subject, fixed: int, *, stale: bool) -> str:
    mesh = subject.mesh
    stated = "" if mesh.unit else " (unit not stated)"
    state = "closed" if mesh.report.closed else "open"
    size = f"size {mesh.length_text(mesh.size, 3)}{stated}"
    facts = f"{size}, {len(mesh.vertices):,} vertices, {state}"
    if subject.labels.scene is not None:
        table = "" if subject.labels.scene.table is None else " and a table"
        hand = subject.labels.scene.hand
        kind = "hand" if isinstance(hand, ArticulatedHand) else "gripper"
        facts += f"; {kind} {hand.name}{table}"
    if subject.labels.load_case is not None:
        facts += f"; load {subject.labels.load_case}"
    if subject.labels.mode == "scan" and not stale and subject.poses is None:
        count = fixed or subject.labels.model.fingers - 1
        facts += f", {counted(count, 'fingers')} fixed"
    return facts


def _notes(session: Session) -> Iterator[str]:
    """Yield notes on the current choices."""
    subject, state = session.subject, session.state
    if subject is None or session.stale:
        return
    if state.fixed and session.scene is not None:
        yield "with fixed fingers the labels are those of ideal points: the gripper is not tested"
    missing = state.model.fingers - 1 - len(state.fixed)
    if state.fixed and missing > 0:
        more = f"{missing} more {noun(missing, 'fingers')}"
        yield f"fix {more}: these are labels for {len(state.fixed) + 1} fingers"
    if session.model.location_error != 0.0:
        yield f"labels are safe: {SAFE_LABELS}"
    if subject.poses is None and not subject.covers(session.model):
        yield (
            f"grasps were searched up to β* = {math.degrees(subject.cone):.1f}°; grey vertices "
            "need a wider search"
        )


def _rule(session: Session) -> str:
    """State the limits of S and U for the chosen friction and resolution."""
    model, fixed = session.state.model, len(session.state.fixed)
    if fixed:
        model = replace(model, fingers=fixed + 1)
    stable = math.degrees(model.sure_angle)
    limit = model.unstable_from
    below = f"S below {stable:.1f}°" if stable > 0.0 else "no S"
    above = "no U" if math.isinf(limit) else f"U from {math.degrees(limit):.1f}° on"
    return f"β*: {below}, {above}"


def _fractions(subject: Subject) -> tuple[LabelFraction, ...]:
    fractions = area_fractions(subject, labels_at(subject))
    meaning = MEANING[subject.labels.mode]
    labels = [(label.name, meaning[label], int(label)) for label in sorted(Label, reverse=True)]
    if fractions[UNSEARCHED] > 0.0:
        labels.append(("–", "not searched", UNSEARCHED))
    return tuple(
        LabelFraction(letter, text, HEX_PALETTE[code], float(fractions[code]))
        for letter, text, code in labels
    )
