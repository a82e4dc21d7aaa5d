"""Curves of epsilon, bars of labels, fractions and ceilings."""

import math

import numpy as np
import pytest
from matplotlib.collections import PathCollection, PolyCollection
from matplotlib.colors import to_hex

from grasp3d import GraspModel, Label
from grasp3d.paper.curves import abscissas, ceiling_figure, curves_figure, fractions_figure
from grasp3d.pictures.figures import LABEL_COLORS
from grasp3d.planar import Circle, PlanarScan, Square, scan
from grasp3d.surface.sweeps import sweep
from tests.helpers.figures import check_texts

MODEL = GraspModel(friction=1.0, sensor_resolution=math.radians(30.0))
SCANS: dict[str, PlanarScan] = {
    "circle": scan(Circle(), MODEL, points=180),
    "square": scan(Square(), MODEL, points=160),
}


def bars_of(found: PlanarScan) -> list[tuple[float, float, str]]:
    """Start, end and colour of each bar, in order."""
    (bars,) = (
        one for one in curves_figure([found]).axes[1].collections if isinstance(one, PolyCollection)
    )
    ends = [np.asarray(path.vertices)[:, 0] for path in bars.get_paths()]
    colors = [to_hex(color).upper() for color in bars.get_facecolor()]
    return [(x.min(), x.max(), color) for x, color in zip(ends, colors, strict=True)]


@pytest.mark.slow
@pytest.mark.parametrize("name", SCANS)
def test_curves_show_the_scan(name: str) -> None:
    found = SCANS[name]
    axes = curves_figure([found]).axes[0]
    corners = found.at_corner
    lines = [line for line in axes.lines if len(line.get_xdata()) == len(found.position) + 1]
    expected = [found.epsilon_effective, *found.epsilon_extremes, found.epsilon]
    for line, epsilon in zip(lines, expected, strict=True):
        drawn = np.asarray(line.get_ydata())
        assert drawn[:-1][~corners] == pytest.approx(epsilon[~corners], abs=0.0)
        assert np.isnan(drawn[:-1][corners]).all()
        assert drawn[-1] == epsilon[0]
        if name == "circle":
            assert np.asarray(line.get_xdata())[:-1] == pytest.approx(np.degrees(found.angle))
        else:
            assert np.asarray(line.get_xdata())[:-1] == pytest.approx(found.position)
    dots = [line for line in axes.lines if line.get_marker() == "o"]
    for dot, epsilon in zip(dots, expected, strict=True):
        assert np.asarray(dot.get_ydata()) == pytest.approx(epsilon[corners], abs=0.0)


@pytest.mark.parametrize("name", SCANS)
def test_bars_show_the_labels_along_the_outline(name: str) -> None:
    found = SCANS[name]
    (x, end), corners = abscissas(found), found.at_corner
    bars = bars_of(found)
    assert [start for start, _, _ in bars] == pytest.approx(
        [0.0, *(stop for _, stop, _ in bars)][:-1]
    )
    assert bars[-1][1] == pytest.approx(end)
    for position, label in zip(x[~corners], found.label[~corners], strict=True):
        color = next(color for start, stop, color in bars if start <= position <= stop)
        assert color == LABEL_COLORS[Label(label)]
    marks = [
        one for one in curves_figure([found]).axes[1].collections if isinstance(one, PathCollection)
    ]
    assert len(marks) == corners.any()
    for mark in marks:
        assert np.asarray(mark.get_offsets())[:, 0] == pytest.approx(x[corners])
        colors = [to_hex(color).upper() for color in mark.get_facecolor()]
        assert colors == [LABEL_COLORS[Label(label)] for label in found.label[corners]]


def test_bars_of_the_circle_end_at_the_bounds_of_the_closed_form() -> None:
    ends = [end for _, end, _ in bars_of(scan(Circle(), MODEL, points=1440))]
    # Off both normals by (180 - theta) / 2: S within beta - alpha / 2, U from beta + alpha / 2 on.
    assert ends == pytest.approx([60.0, 120.0, 240.0, 300.0, 360.0], abs=0.13)


def test_figures_show_the_fractions_and_ceilings_of_their_sweeps() -> None:
    sweeps = [
        sweep(outline, friction=1.0, sensor_resolution=np.radians([0, 30, 60]), name=outline.name)
        for outline in (Circle(), Square())
    ]
    axes = fractions_figure(sweeps[0]).axes[0]
    areas = [np.asarray(area.get_paths()[0].vertices) for area in axes.collections]
    at_30 = [np.sort(np.unique(area[np.isclose(area[:, 0], 30.0), 1])) for area in areas]
    assert np.concatenate([np.diff(edges) for edges in at_30]) == pytest.approx([100.0 / 3.0] * 3)
    lines = ceiling_figure(sweeps).axes[0].lines
    for line, one in zip(lines, sweeps, strict=True):
        assert line.get_label() == one.name
        assert np.asarray(line.get_ydata()) == pytest.approx(100.0 * one.accuracy_ceiling[0])


@pytest.mark.slow
@pytest.mark.parametrize("name", SCANS)
def test_no_text_of_the_curves_is_hidden(name: str) -> None:
    check_texts(curves_figure([SCANS[name]] * 2))
