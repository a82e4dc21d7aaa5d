"""Drawings of fingertips and friction cones; curves of epsilon, bars of labels, fractions."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.axes import Axes
from matplotlib.collections import PathCollection, PolyCollection
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.patches import Wedge
from matplotlib.text import Annotation

from grasp3d import GraspModel, Label, Sensor
from grasp3d.paper.curves import (
    abscissas,
    combinations_figure,
    cone_figure,
    curves_figure,
    tip_at,
    tips_figure,
)
from grasp3d.pictures.figures import LABEL_COLORS
from grasp3d.planar import Circle, PlanarScan, Square, scan
from tests.helpers.figures import check_texts


def drawable() -> st.SearchStrategy[GraspModel]:
    """Models whose extreme cones intersect and stay above the surface."""

    def made(beta: float, part: float) -> GraspModel:
        return GraspModel(math.tan(beta), 2.0 * part * min(beta, math.pi / 2.0 - beta))

    return st.builds(made, st.floats(0.05, 1.5), st.floats(0.02, 0.98))


def wedges(figure: Figure | Axes) -> list[Wedge]:
    return [patch for patch in figure.findobj(Wedge) if patch.get_fill()]


@settings(max_examples=10, deadline=None)
@given(drawable())
def test_the_effective_cone_is_the_intersection_of_the_extreme_cones(model: GraspModel) -> None:
    figure = cone_figure(model)
    extreme, other, effective = wedges(figure)
    assert effective.theta1 == pytest.approx(max(extreme.theta1, other.theta1))
    assert effective.theta2 == pytest.approx(min(extreme.theta2, other.theta2))
    half_angle = math.degrees(model.friction_angle - model.tilt)
    assert 0.5 * (effective.theta2 - effective.theta1) == pytest.approx(half_angle)
    assert 0.5 * (effective.theta1 + effective.theta2) == pytest.approx(90.0)
    assert to_hex(effective.get_facecolor()).upper() == LABEL_COLORS[Label.S]
    texts = figure.axes[0].texts
    named = [text.get_position() for text in texts if "\nnormal" in text.get_text()]
    angles = sorted(math.atan2(y, x) - math.pi / 2.0 for x, y in named)
    assert angles == pytest.approx([-model.tilt, 0.0, model.tilt])
    said = " ".join(part.get_text() for part in (*texts, *figure.legends[0].get_texts()))
    for angle in (model.tilt, model.friction_angle, model.friction_angle - model.tilt):
        assert f"{math.degrees(angle):.3g}°" in said


@settings(max_examples=5, deadline=None)
@given(drawable())
def test_every_combination_shows_whether_the_line_is_in_both_cones(model: GraspModel) -> None:
    results = []
    for axes in combinations_figure(model).axes:
        line = next(line for line in axes.lines if line.get_linewidth() == 1.8)
        first, second = np.transpose([line.get_xdata(), line.get_ydata()]).astype(float)
        ends = ((first, second), (second, first))
        inside, tilts = [], []
        for cone, (contact, other) in zip(wedges(axes), ends, strict=True):
            assert contact == pytest.approx(np.asarray(cone.center))
            middle = math.radians(0.5 * (cone.theta1 + cone.theta2))
            tilts.append(math.remainder(middle - math.atan2(*-contact[::-1]), 2.0 * math.pi))
            along = math.atan2(*(other - contact)[::-1])
            inside.append(abs(math.remainder(middle - along, 2.0 * math.pi)) < model.friction_angle)
        assert np.abs(tilts) == pytest.approx(model.tilt)
        assert axes.get_title().endswith("\nstable") == all(inside)
        assert to_hex(line.get_color()).upper() == LABEL_COLORS[Label.S if all(inside) else Label.U]
        results.append((np.sign(tilts).tolist(), all(inside)))
    assert [tilts for tilts, _ in results] == [[1, 1], [1, -1], [-1, 1], [-1, -1]]
    assert [stable for _, stable in results].count(True) == 1  # only if both tilt toward the line


@pytest.mark.parametrize("radius", [math.inf, 3.0, 10.0, 1e6])
def test_ends_of_a_receptive_field_lie_on_the_tip(radius: float) -> None:
    sensor = Sensor(4.0, radius)
    points, normals = tip_at(sensor, [-2.0, 2.0])
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0)
    between = math.acos(min(1.0, float(normals[0] @ normals[1])))
    assert between == pytest.approx(sensor.resolution, abs=1e-6)
    if math.isinf(radius):
        np.testing.assert_allclose(points, [[-2.0, 0.0], [2.0, 0.0]])
    else:
        centre = np.array([0.0, -radius])
        np.testing.assert_allclose(points, centre + radius * normals, atol=1e-6)
    assert points[0, 0] == pytest.approx(-points[1, 0])


def test_tips_are_drawn_with_their_normals_and_numbers() -> None:
    figure = tips_figure(Sensor(4.0, 10.0))
    check_texts(figure)
    flat, round_ = figure.axes
    for axes, alpha in ((flat, 0.0), (round_, math.degrees(0.4))):
        assert "location ± 2 mm" in axes.get_title()
        assert f"= {alpha:.3g}°" in axes.get_title()
        assert len(axes.findobj(Annotation)) == 3


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


@pytest.mark.parametrize("name", SCANS)
def test_curves_show_the_scan_and_hide_no_text(name: str) -> None:
    found, figure = SCANS[name], curves_figure([SCANS[name]] * 2)
    check_texts(figure)
    axes, corners = figure.axes[0], found.at_corner
    lines = [line for line in axes.lines if len(line.get_xdata()) == len(found.position) + 1]
    dots = [line for line in axes.lines if line.get_marker() == "o"]
    expected = [found.epsilon_effective, *found.epsilon_extremes, found.epsilon]
    for line, epsilon in zip(lines, expected, strict=True):
        x, drawn = np.asarray(line.get_xdata()), np.asarray(line.get_ydata())
        assert drawn == pytest.approx(
            [*np.where(corners, np.nan, epsilon), epsilon[0]], nan_ok=True
        )
        assert x[:-1] == pytest.approx(abscissas(found)[0])
    for dot, epsilon in zip(dots, expected, strict=True):
        assert np.asarray(dot.get_ydata()) == pytest.approx(epsilon[corners])


@pytest.mark.parametrize("name", SCANS)
def test_bars_show_the_labels_along_the_outline(name: str) -> None:
    found = SCANS[name]
    (x, end), corners, bars = abscissas(found), found.at_corner, bars_of(found)
    starts, ends = [start for start, _, _ in bars], [stop for _, stop, _ in bars]
    assert starts == pytest.approx([0.0, *ends[:-1]])
    assert ends[-1] == pytest.approx(end)
    for position, label in zip(x[~corners], found.label[~corners], strict=True):
        color = next(color for start, stop, color in bars if start <= position <= stop)
        assert color == LABEL_COLORS[Label(label)]
    drawn = curves_figure([found]).axes[1].collections
    marks = [one for one in drawn if isinstance(one, PathCollection)]
    assert len(marks) == corners.any()
    for mark in marks:
        assert np.asarray(mark.get_offsets())[:, 0] == pytest.approx(x[corners])
        colors = [to_hex(color).upper() for color in mark.get_facecolor()]
        assert colors == [LABEL_COLORS[Label(label)] for label in found.label[corners]]


def test_bars_of_the_circle_end_at_the_bounds_of_the_closed_form() -> None:
    ends = [end for _, end, _ in bars_of(scan(Circle(), MODEL, points=1440))]
    # Off both normals by (180 - theta) / 2: S within beta - alpha / 2, U from beta + alpha / 2 on.
    assert ends == pytest.approx([60.0, 120.0, 240.0, 300.0, 360.0], abs=0.13)
