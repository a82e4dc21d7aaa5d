"""Drawings of fingertips and friction cones."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.patches import Wedge
from matplotlib.text import Annotation

from grasp3d import GraspModel, Label, Sensor
from grasp3d.paper.curves import (
    combinations_figure,
    cone_figure,
    cones_with_line,
    tip_at,
    tips_figure,
)
from grasp3d.pictures.figures import LABEL_COLORS
from tests.helpers.figures import check_texts


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
    figure = cone_figure(model)
    axes = figure.axes[0]
    named = [text.get_position() for text in axes.texts if "\nnormal" in text.get_text()]
    angles = sorted(math.atan2(y, x) - math.pi / 2.0 for x, y in named)
    assert angles == pytest.approx([-model.tilt, 0.0, model.tilt])
    text = " ".join(part.get_text() for part in (*axes.texts, *figure.legends[0].get_texts()))
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
