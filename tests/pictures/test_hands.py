"""Drawings of grippers, and their shapes for pictures."""

import re

import numpy as np
import pytest
from matplotlib.collections import PolyCollection

from grasp3d.hand.parallel_gripper import PRESETS, ParallelGripper
from grasp3d.pictures.hands import frames_figure, gripper_figure
from tests.helpers.figures import check_texts


@pytest.mark.parametrize("name", PRESETS)
def test_the_figure_states_every_length_and_hides_no_text(name: str) -> None:
    gripper = ParallelGripper.preset(name)
    figure = gripper_figure(gripper)
    check_texts(figure)
    front = "max_opening finger_thickness finger_length palm_thickness palm_length base_to_tcp"
    side = "finger_width palm_width " + ("" if gripper.round_tips else "pad_width pad_height")
    for axes, names in zip(figure.axes, (front, side), strict=True):
        texts = " ".join(text.get_text() for text in axes.texts)
        expected = {round(1e3 * getattr(gripper, one), 4) for one in names.split()}
        if names == side and gripper.round_tips:
            expected.add(2e3 * gripper.tip_radius)
        assert {*map(float, re.findall(r"\d+\.?\d*", texts))} == expected


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
