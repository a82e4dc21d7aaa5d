"""Summary of a labelled surface as an HTML table, for notebooks."""

import math
from collections.abc import Iterator, Mapping, Sequence
from html import escape

from grasp3d.arrays import Floats
from grasp3d.settings import GraspModel
from grasp3d.settings.model_text import model_line
from grasp3d.stability.label import COLORS, MEANING, Label, Mode

LEVELS = (0.1, 0.5, 0.9)
"""Area fractions at which quantiles are shown."""

_BAR = "display:flex;width:24em;max-width:100%;height:0.8em;margin:0.3em 0"
_CHIP = "display:inline-block;width:0.8em;height:0.8em;margin-right:0.4em"
_CELL = "text-align:left;padding:0.1em 1em 0.1em 0"


def label_table(
    *,
    source: str,
    model: GraspModel,
    mode: Mode,
    count: int,
    fractions: Mapping[str, float],
    angles: Floats,
    epsilons: Floats | None,
    warnings: Sequence[str],
) -> str:
    """Table of the settings, area fractions and quantiles of a labelled surface.

    Args:
        source: Name of the mesh.
        model: Friction, sensor resolution and number of fingers.
        mode: Whether grasps were searched for, or given.
        count: Number of vertices.
        fractions: Area fractions by the letter of the label; empty: not computed.
        angles: Quantiles of the critical angle at `LEVELS` [rad].
        epsilons: Quantiles of epsilon at `LEVELS`; None: not computed.
        warnings: Warnings about the mesh, a sentence each.

    Returns:
        An HTML element.
    """
    grasps = "scan" if mode == "scan" else f"{model.fingers} fingers"
    summary = f"{escape(model_line(model))}, {grasps}, {count:,} vertices"
    rows = "".join(
        f'<tr><th scope="row" style="{_CELL}">{name}</th><td style="{_CELL}">{value}</td></tr>'
        for name, value in (*_labels(fractions, mode), *_numbers(angles, epsilons))
    )
    notes = "".join(f"<li>{escape(text)}</li>" for text in warnings)
    return (
        f"<div><strong>{escape(source)}</strong> {summary}{_bar(fractions)}"
        f"<table>{rows}</table>{f'<ul>{notes}</ul>' if notes else ''}</div>"
    )


def _color(letter: str) -> str:
    return "#{:02X}{:02X}{:02X}".format(*COLORS[Label[letter]])


def _bar(fractions: Mapping[str, float]) -> str:
    """The area fractions as a bar in the colours of the labels."""
    if not fractions:
        return ""
    text = ", ".join(f"{letter} {fraction:.1%}" for letter, fraction in fractions.items())
    parts = "".join(
        f'<span style="width:{100.0 * fraction:.2f}%;background:{_color(letter)}"></span>'
        for letter, fraction in fractions.items()
    )
    return f'<div role="img" aria-label="{text}" style="{_BAR}">{parts}</div>'


def _labels(fractions: Mapping[str, float], mode: Mode) -> Iterator[tuple[str, str]]:
    for letter, fraction in fractions.items():
        chip = f'<span style="{_CHIP};background:{_color(letter)}"></span>'
        yield f"{chip}{letter}", f"{fraction:.1%} {escape(MEANING[mode][Label[letter]])}"


def _numbers(angles: Floats, epsilons: Floats | None) -> Iterator[tuple[str, str]]:
    levels = ", ".join(f"{level:.0%}" for level in LEVELS)
    yield f"β* at {levels} of the area", ", ".join(map(_angle, angles.tolist()))
    if epsilons is not None:
        yield f"ε at {levels}", ", ".join(f"{value:.3g}" for value in epsilons.tolist())


def _angle(radians: float) -> str:
    return f"{math.degrees(radians):.1f}°" if math.isfinite(radians) else "none"
