"""The figure of the best grasps: its text fits."""

import math
from functools import cache

import numpy as np
import pytest

from grasp3d import GraspModel, Sampling, SurfaceLabels, label_surface, load_mesh
from grasp3d.grasps.best import best_grasps
from grasp3d.pictures.stills import MOST_PICTURES, grasp_figure
from grasp3d.surface.grasp_table import GraspTable
from tests.helpers import shapes
from tests.helpers.figures import check_texts, drawn_texts

BLANK = np.full((8, 8, 3), 255, dtype=np.uint8)


@cache
def labels() -> SurfaceLabels:
    mesh = load_mesh(shapes.box((1.0, 0.7, 0.5)), unit="m", max_edge=0.2)
    return label_surface(mesh, GraspModel(), sampling=Sampling(rays=16))


@cache
def grasps() -> GraspTable:
    return best_grasps(labels(), MOST_PICTURES)


@pytest.mark.slow
@pytest.mark.parametrize("count", [1, 7])
def test_text_fits_and_vertex_graspsare_numbered(count: int) -> None:
    figure = grasp_figure(grasps(), [BLANK] * count)
    check_texts(figure)
    texts = [text for text, _ in drawn_texts(figure)]
    titles = [text for text in texts if r"\bf" in text]
    lines = [text for text in texts if "varepsilon" in text]
    assert len(titles) == len(lines) == count
    for number, (head, title) in enumerate(zip(titles, lines, strict=True)):
        assert rf"\bf{{{number + 1}}}" in head
        assert f"{grasps().score[number]:.3f}" in head
        angle = math.degrees(grasps().critical_angle[number])
        assert f"{angle:.1f}°" in title
        assert f"{grasps().epsilon[number]:.3f}" in title
    assert any("2 fingers" in text for text in texts)
    assert any("surely unstable" in text for text in texts)
