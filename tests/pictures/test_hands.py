"""Drawings of grippers, and their shapes for pictures."""

import re

import numpy as np
import pytest
from matplotlib.collections import PolyCollection

from grasp3d.hand.parallel_gripper import PRESETS, ParallelGripper
from grasp3d.pictures.hands import frames_figure, gripper_figure
from tests.helpers.figures import check_texts


def numbers(texts: list[str]) -> set[float]:
    return {float(number) for text in texts for number in re.findall(r"\d+\.?\d*", text)}


@pytest.mark.parametrize("name", PRESETS)
def test_the_figure_states_every_length(name: str) -> None:
    gripper = ParallelGripper.preset(name)
    front, side = gripper_figure(gripper).axes
    texts = [[text.get_text() for text in axes.texts] for axes in (front, side)]
    names = "max_opening finger_thickness finger_length palm_thickness palm_length base_to_tcp"
    shown = {round(1e3 * getattr(gripper, one), 4) for one in names.split()}
    assert numbers(texts[0]) == shown
    names = "finger_width palm_width " + ("" if gripper.round_tips else "pad_width pad_height")
    shown = {round(1e3 * getattr(gripper, one), 4) for one in names.split()}
    tips = {2e3 * gripper.tip_radius} if gripper.round_tips else set()
    assert numbers(texts[1]) == shown | tips


def test_both_views_have_one_scale_and_z_points_down() -> None:
    figure = gripper_figure(ParallelGripper.preset("franka"))
    figure.draw_without_rendering()
    scales = []
    for axes in figure.axes:
        (x, bottom), (right, top) = axes.transData.transform([(0.0, 0.0), (1.0, 1.0)])
        scales.append((right - x, top - bottom))
        (z,) = (text for text in axes.texts if text.get_text() == "z")
        assert z.get_position()[1] < 0.0
    assert np.allclose(scales, scales[0][0], rtol=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("name", PRESETS)
def test_no_text_is_cut_off_or_hidden(name: str) -> None:
    check_texts(gripper_figure(ParallelGripper.preset(name)))


def test_fingers_are_drawn_open_and_dashed_when_closed() -> None:
    front = gripper_figure(ParallelGripper.preset("wsg50")).axes[0]
    dashed = [1e3 * np.asarray(line.get_xdata()) for line in front.lines if line.is_dashed()]
    assert sorted(float(x.min()) for x in dashed) == pytest.approx([-18.7, 2.7])
    (faces,) = (one for one in front.collections if isinstance(one, PolyCollection))
    x = 1e3 * np.concatenate([np.asarray(path.vertices)[:, 0] for path in faces.get_paths()])
    assert np.abs(x).min() == pytest.approx(55.0)  # nothing between the open fingers


@pytest.mark.parametrize("name", PRESETS)
def test_all_axes_of_frames_are_inside_their_drawing(name: str) -> None:
    for axes in frames_figure(ParallelGripper.preset(name)).axes:
        labels = [text for text in axes.texts if text.get_text()]
        assert {text.get_text() for text in labels} == set("xyz")
        for text in labels:
            (left, right), (low, high) = axes.get_xlim(), sorted(axes.get_ylim())
            x, y = text.get_position()
            assert left < x < right
            assert low < y < high
