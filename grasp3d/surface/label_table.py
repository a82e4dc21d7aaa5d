"""Labels of a surface as a small table of HTML, for notebooks."""

import math
from collections.abc import Iterator, Mapping, Sequence
from html import escape

from grasp3d.arrays import Floats
from grasp3d.settings import GraspModel
from grasp3d.stability.label import COLORS, MEANING, Label, Mode

LEVELS = (0.1, 0.5, 0.9)
"""Shares of the area at which quantiles are told."""

_BAR = "display:flex;width:24em;max-width:100%;height:0.8em;margin:0.3em 0"
_CHIP = "display:inline-block;width:0.8em;height:0.8em;margin-right:0.4em"
_CELL = "text-align:left;padding:0.1em 1em 0.1em 0"


def label_table(
    *,
    source: str,
    model: GraspModel,
    mode: Mode,
    count: int,
    shares: Mapping[str, float],
    angles: Floats,
    epsilons: Floats | None,
    warnings: Sequence[str],
) -> str:
    """Tell what was asked, how much of a surface is S, M and U, and what its angles are.

    Args:
        source: Name of the mesh.
        model: What was asked.
        mode: Whether grasps were searched, or given.
        count: Vertices.
        shares: Of the area, by the letter of the label; empty: not known.
        angles: Quantiles of the critical angle at `LEVELS` [rad].
        epsilons: Of epsilon; None: not measured.
        warnings: What else to know, a sentence each.
    """
    alpha = math.degrees(model.sensor_resolution)
    how = "scan" if mode == "scan" else f"{model.fingers} fingers"
    asked = f"μ {model.friction:.3g}, α {alpha:.3g}°, {how}, {count:,} vertices"
    rows = "".join(
        f'<tr><th scope="row" style="{_CELL}">{name}</th><td style="{_CELL}">{value}</td></tr>'
        for name, value in (*_labels(shares, mode), *_numbers(angles, epsilons))
    )
    told = "".join(f"<li>{escape(text)}</li>" for text in warnings)
    return (
        f"<div><strong>{escape(source)}</strong> {asked}{_bar(shares)}"
        f"<table>{rows}</table>{f'<ul>{told}</ul>' if told else ''}</div>"
    )


def _color(letter: str) -> str:
    return "#{:02X}{:02X}{:02X}".format(*COLORS[Label[letter]])


def _bar(shares: Mapping[str, float]) -> str:
    """The shares side by side, in the colours of the labels."""
    if not shares:
        return ""
    told = ", ".join(f"{letter} {share:.1%}" for letter, share in shares.items())
    parts = "".join(
        f'<span style="width:{100.0 * share:.2f}%;background:{_color(letter)}"></span>'
        for letter, share in shares.items()
    )
    return f'<div role="img" aria-label="{told}" style="{_BAR}">{parts}</div>'


def _labels(shares: Mapping[str, float], mode: Mode) -> Iterator[tuple[str, str]]:
    for letter, share in shares.items():
        chip = f'<span style="{_CHIP};background:{_color(letter)}"></span>'
        yield f"{chip}{letter}", f"{share:.1%} {escape(MEANING[mode][Label[letter]])}"


def _numbers(angles: Floats, epsilons: Floats | None) -> Iterator[tuple[str, str]]:
    levels = ", ".join(f"{level:.0%}" for level in LEVELS)
    yield f"β* at {levels} of the area", ", ".join(map(_angle, angles.tolist()))
    if epsilons is not None:
        yield f"ε at {levels}", ", ".join(f"{value:.3g}" for value in epsilons.tolist())


def _angle(radians: float) -> str:
    return f"{math.degrees(radians):.1f}°" if math.isfinite(radians) else "none"
