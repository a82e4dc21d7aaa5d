import math

import numpy as np
import pytest
from draw_uncertainties import (
    ErrorPanel,
    error_fractions_figure,
    over_errors,
    resolution_and_location,
    sampled_fractions,
    uncertainties,
)

from grasp3d import GraspModel
from grasp3d.paper.paper_settings import PaperSettings
from grasp3d.planar import Circle, circle_fractions
from grasp3d.surface.sweeps import sweep
from tests.helpers.figures import check_texts

PAPER = PaperSettings()


def percents(cell: str) -> float:
    return float(cell.removesuffix(" %"))


@pytest.mark.slow
def test_fractions_under_further_uncertainties_agree_with_random_errors() -> None:
    rows = [
        [cell.strip() for cell in line.strip("|").split("|")]
        for line in uncertainties(PAPER, []).splitlines()
        if line.startswith("| circle | 30")
    ]
    errors = [
        {}, {"location_error": 0.05}, {"location_error": 0.1}, {"friction_error": 0.2},
        {"normal_error": math.radians(3.0)},
        {"location_error": 0.1, "friction_error": 0.2, "normal_error": math.radians(3.0)},
    ]  # fmt: skip
    assert len(rows) == len(errors)
    for row, given in zip(rows, errors, strict=True):
        model = GraspModel(friction=1.0, sensor_resolution=math.radians(30.0), **given)
        stable, unstable = sampled_fractions(model)
        # All errors at their worst together are rarely drawn, so the upper limit is wide.
        assert percents(row[3]) - 0.4 <= 100.0 * stable <= percents(row[3]) + 2.0
        assert percents(row[5]) - 0.4 <= 100.0 * unstable <= percents(row[5]) + 2.0


def test_sampled_fractions_are_reproducible_and_without_errors_exact() -> None:
    model = GraspModel(friction=0.7, sensor_resolution=0.0)
    stable, unstable = sampled_fractions(model, true=3)
    assert stable == pytest.approx(2.0 * math.atan(0.7) / math.pi, abs=0.01)
    assert stable + unstable == pytest.approx(1.0)
    model = GraspModel(friction=0.7, location_error=0.3)
    assert sampled_fractions(model, true=50) == sampled_fractions(model, true=50)


@pytest.mark.slow
def test_fractions_over_errors_in_their_figure_are_those_of_random_errors() -> None:
    location, friction, normals = over_errors(PAPER).axes
    assert [axes.get_xlim()[1] for axes in (location, friction, normals)] == pytest.approx(
        [0.5, 0.5, 15.0]  # sin(45° - 15°), half of the friction, degrees
    )
    for axes in (location, friction, normals):
        stable = np.asarray(axes.collections[0].get_paths()[0].vertices)
        for line in axes.lines:
            (x, _), (low, high) = (np.asarray(data, float) for data in line.get_data())
            edge = stable[np.isclose(stable[:, 0], x, atol=1e-9), 1].max()
            assert edge - 0.4 <= low <= edge + 1.5
            assert low < high < 100.0


def test_the_map_has_the_fractions_of_the_circle() -> None:
    found = resolution_and_location(PAPER)
    for row, column in ((0, 0), (30, 60), (100, 10)):
        alpha, location = found.sensor_resolution[column], found.location_error[row]
        if found.rows != "location_error":
            alpha, location = found.sensor_resolution[row], found.location_error[column]
        exact = circle_fractions(
            friction=1.0, sensor_resolution=float(alpha), location_error=float(location)
        )
        assert found.stable[row, column] == pytest.approx(exact["S"], abs=1e-12)
        assert found.ambiguous[row, column] == pytest.approx(exact["M"], abs=1e-12)


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
