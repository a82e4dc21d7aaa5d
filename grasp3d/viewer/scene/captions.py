"""Captions of a picture: title, settings, legend of the colours, scale bar."""

import math
from dataclasses import dataclass, field

from grasp3d.settings import GraspModel, sampling_kind
from grasp3d.stability.label import MEANING, Label, Mode
from grasp3d.viewer.scene.layout import (
    EDGE,
    QUIET,
    LegendEntry,
    LegendLayout,
    OverlayItem,
    Rectangle,
    TextArea,
    TextLine,
    bar_height,
    caption_at,
    heading,
    heading_height,
    layout_legend,
    legend_height,
    legend_items,
    ramp_items,
    scale_bar,
)
from grasp3d.viewer.scene.text_layout import shortened, text_width
from grasp3d.viewer.session.painting import PALETTE, UNSEARCHED
from grasp3d.viewer.session.panel_text import LabelFraction, PanelText, panel_text
from grasp3d.viewer.session.session import Session

FINGERS = {1: "one finger", 2: "two fingers", 3: "three fingers", 4: "four fingers"}
GREY = "#{:02X}{:02X}{:02X}".format(*PALETTE[UNSEARCHED])


@dataclass(frozen=True, eq=False)
class Captions:
    """Texts of a picture with one pane or two."""

    placeholder: str = ""
    """Sentence in the middle if there is no object; empty if there is one."""
    title: str = ""
    captions: tuple[tuple[str, ...], ...] = ((),)
    """Settings of each pane, in parts."""
    text: PanelText | None = None
    """Text for the legend; None: no legend."""
    mode: Mode = "label"
    unit: str | None = None
    _legends: dict[TextArea, LegendLayout] = field(default_factory=dict)

    @classmethod
    def of(cls, session: Session, *, legend: bool) -> "Captions":
        """Captions for the current state of a session.

        Args:
            session: The session.
            legend: Whether to add title, legend and all settings, as needed without a panel.
        """
        subject, other = session.subject, session.other_model
        if subject is None:
            return cls(placeholder=_placeholder(session))
        models = [session.model] if other is None else [session.model, other]
        captions: list[tuple[str, ...]] = [
            _caption(session, model, full=legend) for model in models
        ]
        if not legend and other is None:
            captions = [()]
        text = panel_text(session) if legend else None
        return cls(
            title=text.title if text else "",
            captions=tuple(captions),
            text=text,
            mode=subject.labels.mode,
            unit=subject.mesh.unit,
        )

    def margins(self, area: TextArea, number: int) -> tuple[float, float]:
        """Heights of the texts of a pane above and below the object [pixels]."""
        above = heading_height(area, title=bool(self.title), caption=bool(self.captions[number]))
        below = bar_height(area)
        if self.text is not None:
            below = max(below, legend_height(area, self._layout(area)))
        return above + 0.3 * area.size, below + 0.7 * area.size

    def items(self, area: TextArea, number: int, per_pixel: float | None) -> list[OverlayItem]:
        """All texts and rectangles of a pane.

        Args:
            area: Size of the pane.
            number: Index of the pane, from the left.
            per_pixel: Length of a pixel, for a scale bar; None: no scale bar.
        """
        if self.placeholder:
            return _centred(area, self.placeholder)
        below_title = number == 0 and bool(self.title)
        items = heading(area, self.title if below_title else "", self.captions[number])
        if self.title and not below_title:  # at the height of the first pane's caption
            y = area.height - 0.5 * area.margin - 2.25 * area.line
            items = [caption_at(area, self.captions[number], y)]
        if per_pixel is not None and 0.0 < per_pixel < math.inf:
            items += scale_bar(area, per_pixel, self.unit)
        if number > 0:
            items.append(Rectangle(0.0, 0.0, max(1.0, area.size / 14.0), area.height, EDGE))
        if self.text is not None:
            items += self._legend(area, number, self.text)
        return items

    def _legend(self, area: TextArea, number: int, text: PanelText) -> list[OverlayItem]:
        layout = self._layout(area)
        ramp = text.ramp
        if ramp is None:
            fractions = text.other_fractions if number else text.fractions
            return legend_items(area, layout, [_entry(fraction) for fraction in fractions])
        grey = LegendEntry(GREY, "", ramp.grey, "") if ramp.grey else None
        ends = ramp.start, ramp.end
        return ramp_items(area, layout, ramp.text, ends, grey, ramp.colors)

    def _layout(self, area: TextArea) -> LegendLayout:
        """Layout of the label legend, which also determines the height of a ramp's legend."""
        if area not in self._legends:
            entries = [
                LegendEntry(GREY, label.name, MEANING[self.mode][label], "0") for label in Label
            ]
            if self.text is not None and len(self.text.fractions) > len(entries):
                entries.append(_entry(self.text.fractions[-1]))
            self._legends[area] = layout_legend(area, entries)
        return self._legends[area]


def _placeholder(session: Session) -> str:
    """Text in place of an object that is not displayed."""
    working = session.working
    if working is not None:
        return f"{working[0]} …"
    return session.message or f"{session.name} cannot be shown"


def _caption(session: Session, model: GraspModel, *, full: bool) -> tuple[str, ...]:
    resolution = f"α {round(math.degrees(model.sensor_resolution), 2):g}°"
    if not full:
        return (resolution,)
    fingers = FINGERS.get(model.fingers, f"{model.fingers} fingers")
    friction = f"μ {round(model.friction, 4):g}"
    if model.friction_error > 0.0:
        friction += f" ± {round(model.friction_error, 4):g}"
    errors = _errors(session, model)
    return resolution, friction, *errors, fingers, *_limit(session), *_gripper(session)


def _errors(session: Session, model: GraspModel) -> tuple[str, ...]:
    """The errors of normals and contact locations."""
    parts = []
    if model.normal_error > 0.0:
        parts.append(f"normals ± {round(math.degrees(model.normal_error), 2):g}°")
    if model.location_error > 0.0:
        unit = session.subject.mesh.unit if session.subject else None
        parts.append(f"locations ± {model.location_error:.4g} {unit or ''}".rstrip())
    if model.per_finger:
        parts.append("errors of each finger")
    return tuple(parts)


def _gripper(session: Session) -> tuple[str, ...]:
    """Name of the gripper that must reach each grasp."""
    scene = session.scene
    return () if scene is None else (f"gripper {scene.hand.name}",)


def _limit(session: Session) -> tuple[str, ...]:
    """Limit of the distance between contacts, if the search had one."""
    subject, limit = session.subject, session.state.max_opening
    if subject is None or subject.labels.mode == "scan" or math.isinf(limit):
        return ()
    name = sampling_kind(subject.labels.model.fingers).span
    return (f"{name} ≤ {limit:.4g} {subject.mesh.unit or ''}".rstrip(),)


def _entry(fraction: LabelFraction) -> LegendEntry:
    return LegendEntry(fraction.color, fraction.letter, fraction.text, fraction.percent)


def _centred(area: TextArea, sentence: str) -> list[OverlayItem]:
    """A sentence in the middle, broken between words into lines."""
    width = area.width - 2.0 * area.margin
    lines = [""]
    for word in sentence.split():
        longer = f"{lines[-1]} {word}".strip()
        if lines[-1] and text_width(longer, area.size) > width:
            lines.append(word)
        else:
            lines[-1] = longer
    top = 0.5 * (area.height + len(lines) * area.line)
    return [
        TextLine(
            shortened(line, width, area.size),
            0.5 * (area.width - min(width, text_width(line, area.size))),
            top - (row + 1) * area.line,
            area.size,
            QUIET,
        )
        for row, line in enumerate(lines)
    ]
