"""The gripper in the figure of the best grasps."""

import math

import numpy as np
import pytest

from grasp3d import Label
from grasp3d.plots.grasps import PIXELS, draw_grasps, grasp_figure, views_of_gripper
from tests.helpers.figures import check_texts, drawn_texts
from tests.helpers.held_grasps import held_box, neighbours_grasps, reached
from tests.plots.test_rendering import needs_opengl

COUNT = 2


@needs_opengl
@pytest.mark.slow
def test_the_gripper_is_drawn_at_each_grasp() -> None:
    labels = held_box()
    grasps = neighbours_grasps(labels, int(reached(labels)[7]), COUNT)
    pictures = draw_grasps(labels, grasps)
    assert len(pictures) == COUNT
    for picture in pictures:
        assert picture.shape == (*PIXELS, 3)
        assert (picture[[0, -1]] == 255).all()
        assert (picture[:, [0, -1]] == 255).all()
        grey = (np.ptp(picture.astype(int), axis=2) < 25) & (picture.mean(axis=2) < 230)
        assert grey.mean() > 0.05
        assert (np.ptp(picture.astype(int), axis=2) > 60).mean() > 0.02
    figure = grasp_figure(labels, grasps, pictures)
    check_texts(figure)
    assert grasps.reach is not None
    texts = [text for text, _ in drawn_texts(figure)]
    assert grasps.closed is not None
    for margin, code in zip(grasps.reach.approach_margin, grasps.closed.label, strict=True):
        assert f"approach ±{math.degrees(margin):.0f}°, closed {Label(code).name}" in texts


@pytest.mark.slow
def test_the_views_show_the_closing_axis_and_the_approach_from_the_side() -> None:
    labels = held_box()
    grasps = neighbours_grasps(labels, int(reached(labels)[7]), COUNT)
    assert grasps.reach is not None
    views = views_of_gripper(grasps.contacts, grasps.reach.poses, 0.045)
    for view, pose in zip(views, grasps.reach.poses, strict=True):
        toward = view.axes[2]
        assert abs(toward @ pose[:3, 0]) < 0.75
        assert abs(toward @ pose[:3, 2]) < 0.9
