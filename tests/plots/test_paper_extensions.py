"""Figures beside the paper's: receptive fields of tips, and fractions over uncertainties."""

import math

import numpy as np
import pytest
from matplotlib.patches import FancyArrowPatch

from grasp3d import Sensor
from grasp3d.planar import Circle
from grasp3d.plots.cones import field_ends, tips_figure
from grasp3d.plots.fractions import ErrorPanel, error_fractions_figure
from grasp3d.surface.sweeps import sweep
from tests.helpers.figures import check_texts


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


def test_fractions_are_stacked_over_each_error_with_their_samples() -> None:
    errors = np.linspace(0.0, 0.2, 11)
    located = sweep(Circle(), friction=1.0, sensor_resolution=0.3, location_error=errors)
    normals = sweep(Circle(), friction=1.0, sensor_resolution=0.3, normal_error=errors)
    figure = error_fractions_figure(
        [
            ErrorPanel(located, "location error", sampled=[(0.1, 0.3, 0.4)]),
            ErrorPanel(normals, "normals [°]"),
        ],
        title="circle",
        label="fraction",
    )
    check_texts(figure)
    first, second = figure.axes
    assert first.get_xlim() == (0.0, pytest.approx(0.2))
    assert second.get_xlim() == (0.0, pytest.approx(math.degrees(0.2)))
    (marks,) = first.lines
    np.testing.assert_allclose(np.asarray(marks.get_data()), [[0.1, 0.1], [30.0, 60.0]])
    assert not second.lines
    stable = np.asarray(first.collections[0].get_paths()[0].vertices)
    assert stable[np.isclose(stable[:, 0], 0.2), 1].max() == pytest.approx(
        100.0 * located.stable[0, -1]
    )
