"""What is said beside the picture, the same in a window and on a page."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

from grasp3d.settings import GraspModel
from grasp3d.stability.label import MEANING, Label
from grasp3d.stability.thresholds import unstable_from
from grasp3d.viewer.session.inspecting import Inspected
from grasp3d.viewer.session.painting import PALETTE, UNSEARCHED, Ramp, labels_at, ramp_of, shares_of
from grasp3d.viewer.session.session import Session
from grasp3d.viewer.subjects.subject import Subject


@dataclass(frozen=True)
class Share:
    """How much of the surface has a label."""

    letter: str
    words: str
    color: str
    """As #RRGGBB."""
    share: float
    """Of the area, from 0 to 1."""


@dataclass(frozen=True, eq=False)
class Told:
    """Words and numbers for one moment."""

    title: str
    """What the object is called, and which of how many it is."""
    facts: str
    """Its size and what it is made of."""
    rules: tuple[str, ...]
    """From where to where S and U reach; where two resolutions are compared, for either."""
    shares: tuple[Share, ...]
    """S, M, U, and where there is any what was not searched; none: nothing is ready or true."""
    other_shares: tuple[Share, ...]
    """The same at the resolution that is compared with; none: nothing is compared."""
    ramp: Ramp | None
    """What colours mean; None: labels."""
    inspected: Inspected | None
    """The vertex that is told of."""
    working: tuple[str, float] | None
    """What goes on in the background, and how much of it is done."""
    message: str
    """What was last said."""
    notes: tuple[str, ...]
    """What a user should know before trusting the labels."""
    stale: bool = False
    """Whether what is drawn belongs to other fingers or limits than are chosen; see `Session`."""


def tell(session: Session) -> Told:
    """Say what a viewer has to say now."""
    subject, model, other = session.subject, session.model, session.other_model
    count = len(session.album.exhibits)
    title = session.name if count == 1 else f"{session.name} ({session.number + 1} of {count})"
    stale = session.stale
    shown = None if stale else subject
    return Told(
        title=title,
        facts=_facts(subject, len(session.shown.fixed), stale=stale) if subject else "",
        rules=_rules(session),
        shares=_shares(shown, model) if shown else (),
        other_shares=_shares(shown, other) if shown and other else (),
        ramp=ramp_of(subject, session.shown.paint, model) if subject else None,
        inspected=session.inspected,
        working=session.working,
        message=session.message,
        notes=(*_notes(session), *(subject.notes if subject else ()), *session.album.notes),
        stale=stale,
    )


def _facts(subject: Subject, fixed: int, *, stale: bool) -> str:
    unit = subject.unit or "(unit not stated)"
    facts = (
        f"size {subject.size:.3g} {unit}, {len(subject.vertices):,} vertices, "
        f"{'closed' if subject.closed else 'open'}"
    )
    if subject.mode == "scan" and not stale:
        given = fixed or subject.model.fingers - 1
        facts += f", {_fingers(given)} fixed"
    return facts


def _fingers(count: int) -> str:
    return f"{count} {'finger' if count == 1 else 'fingers'}"


def _notes(session: Session) -> Iterator[str]:
    """What is special about this moment."""
    subject, shown = session.subject, session.shown
    if subject is None or session.stale:
        return
    missing = shown.model.fingers - 1 - len(shown.fixed)
    if shown.fixed and missing > 0:
        more = "finger" if missing == 1 else "fingers"
        yield f"fix {missing} more {more}: these labels are of {len(shown.fixed) + 1}"
    models = [session.model] + [session.other_model] * (session.other_model is not None)
    if any(model is not None and not subject.covers(model) for model in models):
        yield (
            f"grasps with β* up to {math.degrees(subject.cone):.1f}° were searched; what is grey "
            "needs more"
        )


def _rules(session: Session) -> tuple[str, ...]:
    """From where to where S and U reach, for what is chosen."""
    shown = session.shown
    fingers = len(shown.fixed) + 1 if shown.fixed else shown.model.fingers
    model = replace(shown.model, fingers=fingers)
    if shown.compare is None:
        return (f"β*: {_rule(model)}",)
    other = replace(model, sensor_resolution=shown.compare)
    return tuple(
        f"α {math.degrees(one.sensor_resolution):.4g}°: {_rule(one)}" for one in (model, other)
    )


def _rule(model: GraspModel) -> str:
    stable = math.degrees(model.friction_angle - model.tilt)
    limit = float(unstable_from(model.friction_angle, model.tilt, model.fingers))
    least = f"S below {stable:.1f}°" if stable > 0.0 else "no S"
    most = "no U" if math.isinf(limit) else f"U from {math.degrees(limit):.1f}° on"
    return f"{least}, {most}"


def _shares(subject: Subject, model: GraspModel) -> tuple[Share, ...]:
    found = shares_of(subject, labels_at(subject, model))
    told = [
        (label.name, MEANING[subject.mode][label], int(label))
        for label in sorted(Label, reverse=True)
    ]
    if found[UNSEARCHED] > 0.0:
        told.append(("–", "not searched", UNSEARCHED))
    return tuple(
        Share(letter, words, "#{:02X}{:02X}{:02X}".format(*PALETTE[code]), float(found[code]))
        for letter, words, code in told
    )
