"""Drawings of grippers, and their shapes for pictures."""

import re

import numpy as np
import pytest
from matplotlib.patches import Rectangle

from grasp3d.hand.parallel_gripper import PRESETS, ParallelGripper
from grasp3d.pictures.grippers import frames_figure, gripper_figure


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
        assert top < bottom
        scales.append((right - x, bottom - top))
    assert np.allclose(scales, scales[0][0], rtol=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("name", PRESETS)
def test_nothing_is_drawn_outside_the_figure(name: str) -> None:
    figure = gripper_figure(ParallelGripper.preset(name))
    figure.draw_without_rendering()
    for axes in figure.axes:
        for artist in (*axes.texts, *axes.patches):
            box = artist.get_window_extent()
            assert box.x0 >= figure.bbox.x0
            assert box.x1 <= figure.bbox.x1
            assert box.y0 >= figure.bbox.y0


def test_fingers_are_drawn_open_and_dashed_when_closed() -> None:
    front = gripper_figure(ParallelGripper.preset("wsg50")).axes[0]
    boxes = [patch for patch in front.patches if isinstance(patch, Rectangle)]
    inner = sorted(
        (patch.get_linestyle(), round(patch.get_x(), 3)) for patch in boxes if patch.get_x() > 0.0
    )
    assert inner == [("--", 2.7), ("solid", 55.0), ("solid", 55.0)]  # closed; finger and pad, open


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
