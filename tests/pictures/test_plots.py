import math
from itertools import pairwise
from pathlib import Path
from xml.etree import ElementTree as ET

import matplotlib as mpl
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch, Wedge
from numpy.typing import NDArray
from PIL import Image

from grasp3d import GraspModel, Label, Sensor
from grasp3d.pictures.cones import (
    combinations_figure,
    cone_figure,
    cones_with_line,
    field_ends,
    tips_figure,
)
from grasp3d.pictures.curves import Over, axis_positions, curves_figure, label_runs
from grasp3d.pictures.figures import (
    DPI,
    LABEL_COLORS,
    LINES,
    label_patches,
    new_figure,
    save,
    styled,
)
from grasp3d.pictures.fractions import (
    ceiling_figure,
    fractions_figure,
)
from grasp3d.planar import Circle, PlanarScan, Square, scan
from grasp3d.surface.sweeps import sweep
from tests.helpers.figures import check_texts

MODEL = GraspModel(friction=1.0, sensor_resolution=math.radians(30.0))
SCANS: dict[str, tuple[PlanarScan, Over]] = {
    "circle": (scan(Circle(), MODEL, points=180), "angle"),
    "square": (scan(Square(), MODEL, points=160), "position"),
}


def drawable() -> st.SearchStrategy[GraspModel]:
    """Models whose extreme cones intersect and stay above the surface."""
    return st.tuples(st.floats(0.05, 1.5), st.floats(0.02, 0.98)).map(
        lambda drawn: GraspModel(
            friction=math.tan(drawn[0]),
            sensor_resolution=2.0 * drawn[1] * min(drawn[0], math.pi / 2.0 - drawn[0]),
        )
    )


def wedges(figure: Figure) -> list[Wedge]:
    return [patch for patch in figure.findobj(Wedge) if patch.get_fill()]


@pytest.mark.slow
@settings(max_examples=10, deadline=None)
@given(drawable())
def test_the_effective_cone_is_the_intersection_of_the_extreme_cones(model: GraspModel) -> None:
    extreme, other, effective = wedges(cone_figure(model))
    assert effective.theta1 == pytest.approx(max(extreme.theta1, other.theta1))
    assert effective.theta2 == pytest.approx(min(extreme.theta2, other.theta2))
    half_angle = 0.5 * math.radians(effective.theta2 - effective.theta1)
    assert half_angle == pytest.approx(model.friction_angle - model.tilt)
    assert 0.5 * (effective.theta1 + effective.theta2) == pytest.approx(90.0)
    assert to_hex(effective.get_facecolor()).upper() == LABEL_COLORS[Label.S]


@settings(max_examples=10, deadline=None)
@given(drawable())
def test_extreme_normals_are_half_the_resolution_off(model: GraspModel) -> None:
    axes = cone_figure(model).axes[0]
    named = [text.get_position() for text in axes.texts if "\nnormal" in text.get_text()]
    angles = sorted(math.atan2(y, x) - math.pi / 2.0 for x, y in named)
    assert angles == pytest.approx([-model.tilt, 0.0, model.tilt])
    text = " ".join(part.get_text() for part in axes.texts)
    for angle in (model.tilt, model.friction_angle, model.friction_angle - model.tilt):
        assert f"{math.degrees(angle):.3g}°" in text


@pytest.mark.slow
@settings(max_examples=8, deadline=None)
@given(drawable())
def test_every_combination_shows_whether_the_line_is_in_both_cones(model: GraspModel) -> None:
    figure = combinations_figure(model)
    results = []
    for axes, signs in zip(
        figure.axes, [(1, 1), (1, -1), (-1, 1), (-1, -1)], strict=True
    ):  # fmt: skip
        cones = [patch for patch in axes.patches if isinstance(patch, Wedge) and patch.get_fill()]
        line = next(line for line in axes.lines if line.get_linewidth() == 1.8)
        first, second = np.transpose([line.get_xdata(), line.get_ydata()]).astype(float)
        inside = []
        for cone, contact, other, sign in zip(
            cones, (first, second), (second, first), signs, strict=True
        ):
            middle = math.radians(0.5 * (cone.theta1 + cone.theta2))
            axis = np.array([math.cos(middle), math.sin(middle)])
            along = (other - contact) / np.linalg.norm(other - contact)
            inside.append(math.acos(axis @ along) < model.friction_angle)
            turned = math.atan2(*(-contact[::-1])) + sign * model.tilt
            assert math.remainder(middle - turned, 2.0 * math.pi) == pytest.approx(0.0, abs=1e-9)
            assert contact == pytest.approx(np.asarray(cone.center))
        stable = all(inside)
        assert axes.get_title().endswith("\nstable") == stable
        assert to_hex(line.get_color()).upper() == LABEL_COLORS[Label.S if stable else Label.U]
        results.append(stable)
    assert results.count(True) == 1  # ambiguous: only when both tilt toward the line


@pytest.mark.slow
@given(st.floats(0.0, 7.0), st.floats(0.0, 7.0), st.floats(0.0, 7.0), st.floats(0.01, 1.5))
def test_the_line_is_in_a_cone_within_its_half_angle(
    line: float, first: float, second: float, beta: float
) -> None:
    along = np.array([math.cos(line), math.sin(line)])
    axes = np.array([[math.cos(turn), math.sin(turn)] for turn in (first, second)])
    off = np.arccos(np.clip(axes @ along * [1.0, -1.0], -1.0, 1.0))
    near = np.abs(off - beta) < 1e-6
    found = cones_with_line(
        np.array([[0.3, 0.1], [0.3, 0.1] + 2.0 * along]), np.array([first, second]), beta
    )
    assert ((found == (off < beta)) | near).all()


@pytest.mark.slow
@pytest.mark.parametrize("name", SCANS)
def test_curves_show_the_scan(name: str) -> None:
    found, over = SCANS[name]
    axes = curves_figure([found], over=over).axes[0]
    corners = found.at_corner
    lines = [line for line in axes.lines if len(line.get_xdata()) == len(found.position) + 1]
    expected = [found.epsilon_effective, *found.epsilon_extremes, found.epsilon]
    for line, epsilon in zip(lines, expected, strict=True):
        drawn = np.asarray(line.get_ydata())
        assert drawn[:-1][~corners] == pytest.approx(epsilon[~corners], abs=0.0)
        assert np.isnan(drawn[:-1][corners]).all()
        assert drawn[-1] == epsilon[0]
        if over == "angle":
            assert np.asarray(line.get_xdata())[:-1] == pytest.approx(np.degrees(found.angle))
        else:
            assert np.asarray(line.get_xdata())[:-1] == pytest.approx(found.position)
    dots = [line for line in axes.lines if line.get_marker() == "o"]
    if corners.any():
        for dot, epsilon in zip(dots, expected, strict=True):
            assert np.asarray(dot.get_ydata()) == pytest.approx(epsilon[corners], abs=0.0)
    else:
        assert not dots


@pytest.mark.parametrize("name", SCANS)
def test_bars_show_the_labels_along_the_outline(name: str) -> None:
    found, over = SCANS[name]
    axes = curves_figure([found], over=over).axes[1]
    x, corners = axis_positions(found, over), found.at_corner
    bars = [(patch.get_x(), patch.get_width(), patch.get_facecolor()) for patch in axes.patches]
    reached = 0.0
    for start, width, _ in bars:
        assert start == pytest.approx(reached)
        reached = start + width
    assert reached == pytest.approx(x[-1])
    for position, label in zip(x[:-1][~corners], found.label[~corners], strict=True):
        color = next(c for start, width, c in bars if start <= position <= start + width)
        assert to_hex(color).upper() == LABEL_COLORS[Label(label)]
    for text in axes.texts:
        position = text.get_position()[0]
        assert np.abs(x[:-1][corners] - position).min(initial=9.0) > 0.02 * x[-1]
        color = next(c for start, width, c in bars if start <= position <= start + width)
        assert to_hex(color).upper() == LABEL_COLORS[Label[text.get_text()]]
    marks = [
        (float(np.asarray(line.get_xdata())[0]), to_hex(line.get_markerfacecolor()).upper())
        for line in axes.lines
    ]
    assert marks == [
        (position, LABEL_COLORS[Label(label)])
        for position, label in zip(x[:-1][corners], found.label[corners], strict=True)
    ]


def test_bars_of_the_circle_end_at_the_bounds_of_the_closed_form() -> None:
    found = scan(Circle(), MODEL, points=1440)
    axes = curves_figure([found], over="angle").axes[1]
    ends = [patch.get_x() + patch.get_width() for patch in axes.patches]
    # Off both normals by (180 - theta) / 2: S within beta - alpha / 2, U from beta + alpha / 2 on.
    assert ends == pytest.approx([60.0, 120.0, 240.0, 300.0, 360.0], abs=0.13)


@given(hnp.arrays(np.uint8, st.integers(1, 30), elements=st.integers(0, 2)))
def test_runs_cover_every_label_without_gaps(labels: NDArray[np.uint8]) -> None:
    x = np.arange(len(labels)) + 0.25
    runs = label_runs(x, labels, float(len(labels)))
    assert runs[0].start == 0.0
    assert runs[-1].end == len(labels)
    for before, after in pairwise(runs):
        assert before.end == after.start
        assert before.label != after.label
    for position, label in zip(x, labels, strict=True):
        assert [run.label for run in runs if run.start <= position < run.end] == [label]


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
    found, over = SCANS[name]
    check_texts(curves_figure([found, found], over=over, unit="half sides"))


def example() -> Figure:
    figure = new_figure(3.5, 2.0)
    axes = figure.add_subplot()
    axes.plot([0.0, 1.0], [0.2, 0.8], **LINES[1])
    axes.fill_between([0.0, 1.0], [0.0, 0.1], color=LABEL_COLORS[Label.S])
    axes.set(xlabel=r"$\alpha$ [°]", title="both")
    figure.legend(handles=label_patches(), loc="outside lower center")
    return figure


def test_figures_are_the_same_bytes_every_time(tmp_path: Path) -> None:
    first = save(styled(example)(), tmp_path / "first")
    mpl.rcParams["font.size"] = 23.0  # settings of other code in the process
    mpl.rcParams["svg.hashsalt"] = "other"
    try:
        second = save(styled(example)(), tmp_path / "second.png")
    finally:
        mpl.rcdefaults()
    assert [path.name for path in second] == ["second.svg", "second.png"]
    for one, other in zip(first, second, strict=True):
        assert one.read_bytes() == other.read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "first.png", "first.svg", "second.png", "second.svg",
    ]  # fmt: skip


def test_vector_graphics_are_xml_and_pictures_have_their_size(tmp_path: Path) -> None:
    vector, picture = save(styled(example)(), tmp_path / "figure")
    root = ET.parse(vector).getroot()  # noqa: S314, our own file
    assert root.tag == "{http://www.w3.org/2000/svg}svg"
    assert not list(root.iter("{http://www.w3.org/2000/svg}text"))  # text is drawn as outlines
    assert "<!-- both -->" in vector.read_text()
    assert "dc:date" not in vector.read_text()
    with Image.open(picture) as image:
        assert image.size == (round(3.5 * DPI), round(2.0 * DPI))
        assert LABEL_COLORS[Label.S] in {
            "#{:02X}{:02X}{:02X}".format(*color[:3])
            for _, color in image.convert("RGB").getcolors(1 << 20) or []
        }


@pytest.mark.parametrize("radius", [math.inf, 3.0, 10.0, 1e6])
def test_ends_of_a_receptive_field_lie_on_the_tip(radius: float) -> None:
    sensor = Sensor(4.0, radius)
    points, normals = field_ends(sensor, 1.0)
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
        assert len(axes.findobj(FancyArrowPatch)) == 3
