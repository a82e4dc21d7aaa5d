import math
from pathlib import Path

import numpy as np
import pytest

import grasp3d
from grasp3d.contact import JointEncoders, MarginBudget
from grasp3d.contact.budget import PARTS
from grasp3d.errors import SettingError
from grasp3d.plots.budgets import COLORS, NEGATIVE, budget_figure
from grasp3d.plots.figures import save_as
from grasp3d.settings.uncertainty import Uncertainty
from tests.helpers.figures import check_texts

SENSOR = grasp3d.Sensor(receptive_field=4.0, fingertip_radius=10.0)


def budget(critical: float) -> MarginBudget:
    return MarginBudget.of(
        critical, friction=(0.4, 0.6), sensor=SENSOR, encoders=JointEncoders(200, (50.0,)),
        other=Uncertainty(normal_error=0.01), opening=50.0,
    )  # fmt: skip


def test_the_bars_have_the_lengths_of_the_parts(tmp_path: Path) -> None:
    budgets = {"pinch": budget(0.02), "cap": budget(0.3)}
    figure = budget_figure(budgets)
    check_texts(figure)
    (axes,) = figure.axes
    bars = [(bar.get_x(), bar.get_width()) for group in axes.containers for bar in group]
    expected = []
    for one in budgets.values():
        start = 0.0
        for value in one.stack.values():
            if (angle := math.degrees(float(value))) > 0.0:
                expected.append((start, angle))
                start += angle
    excess = start - math.degrees(math.atan(0.5))
    expected.append((start - excess, excess))  # what passes the friction angle
    np.testing.assert_allclose(bars, expected)
    limits = [float(np.asarray(line.get_xdata())[0]) for line in axes.lines]
    assert limits == pytest.approx([math.degrees(math.atan(0.5))] * 2)
    assert start > limits[1]  # no margin: the bar passes the friction angle
    assert [label.get_text() for label in axes.get_yticklabels()] == ["pinch", "cap"]
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == [*COLORS, NEGATIVE]
    assert axes.containers[-1][0].get_hatch()
    margins = [math.degrees(float(one.margin)) for one in budgets.values()]
    assert margins[0] > 0.0 > margins[1]
    shown = [text.get_text() for text in axes.texts]
    assert shown == [f"+{margins[0]:.1f}°", f"\N{MINUS SIGN}{-margins[1]:.1f}°"]
    save_as(figure, tmp_path / "budgets.svg")
    assert (tmp_path / "budgets.svg").stat().st_size > 1000


def test_every_part_has_a_colour_of_its_own() -> None:
    assert set(PARTS.values()) < set(COLORS)
    assert len(set(COLORS.values())) == len(COLORS)


def test_budgets_of_several_grasps_are_refused() -> None:
    several = MarginBudget.of([0.1, 0.2], friction=0.5)
    for budgets in ({}, {"all": several}):
        with pytest.raises(SettingError, match="budgets of one grasp each, such as means"):
            budget_figure(budgets)
