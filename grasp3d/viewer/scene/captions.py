"""What a picture says of itself: its title, what its colours mean, how large a pixel is."""

import math
from dataclasses import dataclass, field

from grasp3d.settings import GraspModel
from grasp3d.stability.label import MEANING, Label, Mode
from grasp3d.viewer.scene.layout import (
    EDGE,
    QUIET,
    Entry,
    Item,
    Legend,
    Paper,
    Patch,
    Words,
    bar_height,
    caption_at,
    heading,
    heading_height,
    legend,
    legend_height,
    legend_of,
    ramp_bar,
    scale_bar,
)
from grasp3d.viewer.scene.lettering import shortened, width_of
from grasp3d.viewer.session.explaining import PAIR
from grasp3d.viewer.session.painting import PALETTE, UNSEARCHED
from grasp3d.viewer.session.session import Session
from grasp3d.viewer.session.telling import Share, Told, tell

FINGERS = {1: "one finger", 2: "two fingers", 3: "three fingers", 4: "four fingers"}
GREY = "#{:02X}{:02X}{:02X}".format(*PALETTE[UNSEARCHED])


@dataclass(frozen=True, eq=False)
class Captions:
    """Words of a picture with one pane or two."""

    quiet: str = ""
    """A sentence in the middle, in place of an object; nothing where there is one."""
    title: str = ""
    captions: tuple[tuple[str, ...], ...] = ((),)
    """Of each pane, in parts."""
    told: Told | None = None
    """What colours mean; None: they are not explained."""
    mode: Mode = "label"
    unit: str | None = None
    _laid: dict[Paper, Legend] = field(default_factory=dict)

    @classmethod
    def of(cls, session: Session, *, legend: bool) -> "Captions":
        """Say what a session shows.

        Args:
            session: Who is looking.
            legend: Whether to tell more than the picture needs beside a panel.
        """
        subject, other = session.subject, session.other_model
        if subject is None:
            return cls(quiet=_quiet(session))
        models = [session.model] if other is None else [session.model, other]
        captions: list[tuple[str, ...]] = [
            _caption(session, model, full=legend) for model in models
        ]
        if not legend and other is None:
            captions = [()]
        told = tell(session) if legend else None
        return cls(
            title=told.title if told else "",
            captions=tuple(captions),
            told=told,
            mode=subject.mode,
            unit=subject.unit,
        )

    def taken(self, paper: Paper, number: int) -> tuple[float, float]:
        """What words take of a pane above and below the object [pixels]."""
        above = heading_height(paper, title=bool(self.title), caption=bool(self.captions[number]))
        below = bar_height(paper)
        if self.told is not None:
            below = max(below, legend_height(paper, self._legend(paper)))
        return above + 0.3 * paper.size, below + 0.7 * paper.size

    def items(self, paper: Paper, number: int, per_pixel: float | None) -> list[Item]:
        """All that is written on a pane.

        Args:
            paper: The pane.
            number: Which, from the left.
            per_pixel: Length of a pixel, where there is to be a scale bar.
        """
        if self.quiet:
            return _in_the_middle(paper, self.quiet)
        lower = number == 0 and bool(self.title)
        items = heading(paper, self.title if lower else "", self.captions[number])
        if self.title and not lower:  # on the line of the first pane's
            y = paper.height - 0.5 * paper.margin - 2.25 * paper.line
            items = [caption_at(paper, self.captions[number], y)]
        if per_pixel is not None and 0.0 < per_pixel < math.inf:
            items += scale_bar(paper, per_pixel, self.unit)
        if number > 0:
            items.append(Patch(0.0, 0.0, max(1.0, paper.size / 14.0), paper.height, EDGE))
        if self.told is not None:
            items += self._meanings(paper, number, self.told)
        return items

    def _meanings(self, paper: Paper, number: int, told: Told) -> list[Item]:
        laid = self._legend(paper)
        ramp = told.ramp
        if ramp is None:
            shares = told.other_shares if number else told.shares
            return legend(paper, laid, [_entry(share) for share in shares])
        grey = Entry(GREY, "", ramp.grey, "") if ramp.grey else None
        ends = f"0{ramp.unit}", f"{ramp.most:.3g}{ramp.unit}"
        return ramp_bar(paper, laid, ramp.words, ends, grey)

    def _legend(self, paper: Paper) -> Legend:
        """How labels are laid out here, whether or not they are what is painted."""
        if paper not in self._laid:
            entries = [Entry(GREY, label.name, MEANING[self.mode][label], "0") for label in Label]
            if self.told is not None and len(self.told.shares) > len(entries):
                entries.append(_entry(self.told.shares[-1]))
            self._laid[paper] = legend_of(paper, entries)
        return self._laid[paper]


def _quiet(session: Session) -> str:
    """What there is to say while there is no object."""
    working = session.working
    if working is not None:
        return f"{working[0]} …"
    return session.message or f"{session.name} cannot be shown"


def _caption(session: Session, model: GraspModel, *, full: bool) -> tuple[str, ...]:
    resolution = f"α {round(math.degrees(model.sensor_resolution), 2):g}°"
    if not full:
        return (resolution,)
    fingers = FINGERS.get(model.fingers, f"{model.fingers} fingers")
    return resolution, f"μ {round(model.friction, 4):g}", fingers, *_limit(session)


def _limit(session: Session) -> tuple[str, ...]:
    """How far apart contacts may be, where a search was limited so."""
    subject, most = session.subject, session.shown.max_opening
    if subject is None or subject.mode == "scan" or math.isinf(most):
        return ()
    name = "opening" if subject.model.fingers == PAIR else "reach"
    return (f"{name} ≤ {most:.4g} {subject.unit or ''}".rstrip(),)


def _entry(share: Share) -> Entry:
    return Entry(share.color, share.letter, share.words, f"{100.0 * share.share:.1f} %")


def _in_the_middle(paper: Paper, sentence: str) -> list[Item]:
    """A sentence, broken between words into as many lines as it needs."""
    room = paper.width - 2.0 * paper.margin
    lines = [""]
    for word in sentence.split():
        longer = f"{lines[-1]} {word}".strip()
        if lines[-1] and width_of(longer, paper.size) > room:
            lines.append(word)
        else:
            lines[-1] = longer
    top = 0.5 * (paper.height + len(lines) * paper.line)
    return [
        Words(
            shortened(line, paper.size, room),
            0.5 * (paper.width - min(room, width_of(line, paper.size))),
            top - (row + 1) * paper.line,
            paper.size,
            QUIET,
        )
        for row, line in enumerate(lines)
    ]
