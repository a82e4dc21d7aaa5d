"""Pictures and figures of grasps: up is up, approach and table are seen, texts fit."""

import math
from dataclasses import replace

import numpy as np
import pytest
import trimesh

from grasp3d import GraspModel, Label, Sampling, label_surface, load_mesh
from grasp3d.grasps.best import best_grasps
from grasp3d.hand.parallel_gripper import ParallelGripper
from grasp3d.hand.table import Table
from grasp3d.hand.triangles import ARC_COLOR
from grasp3d.mesh import ObjectMesh
from grasp3d.pictures import pane
from grasp3d.pictures.stills import MOST_PICTURES, PIXELS, draw_grasps, grasp_figure
from tests.helpers import shapes
from tests.helpers.figures import check_texts, drawn_texts
from tests.helpers.held_grasps import held_box
from tests.pictures.test_opengl import needs_opengl

COUNT = 2
MAGENTA = (255, 0, 255)


def boot() -> ObjectMesh:
    """A shaft on a foot [m], upside down: it rests on its shaft."""
    shaft = trimesh.creation.box(bounds=[[0.0, 0.0, 0.0], [0.05, 0.05, 0.11]])
    foot = trimesh.creation.box(bounds=[[0.0, 0.0, 0.11], [0.14, 0.05, 0.15]])
    return load_mesh(trimesh.boolean.union([shaft, foot]), unit="m", max_edge=0.012)


@pytest.mark.slow
@needs_opengl
def test_the_table_is_below_the_object_and_the_approach_is_drawn(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    mesh = boot()
    labels = label_surface(
        mesh, GraspModel(), sampling=Sampling(rays=8), hand=ParallelGripper.preset("franka"),
        table=Table.below(mesh, "-z"),
    )  # fmt: skip
    grasps = best_grasps(labels, COUNT)
    look = replace(pane.LOOKS["table"], color=MAGENTA, opacity=1.0)
    monkeypatch.setitem(pane.LOOKS, "table", look)
    for image in draw_grasps(grasps, labels):
        red, green, blue = np.moveaxis(image.astype(int), 2, 0)
        plate = (red - green > 60) & (blue - green > 60)
        painted = (red - blue > 60) | (green - blue > 60)
        rows = [np.nonzero(one)[0] for one in (plate, painted)]
        assert min(map(len, rows)) > 300
        assert rows[0].mean() > rows[1].mean() + 5.0
        assert rows[0].max() > rows[1].max()
        arrow = np.abs(image.astype(int) - ARC_COLOR).max(axis=2) < 40
        assert arrow.sum() > 20


@needs_opengl
@pytest.mark.slow
def test_the_gripper_is_drawn_at_each_grasp() -> None:
    labels = held_box()
    grasps = best_grasps(labels, COUNT)
    pictures = draw_grasps(grasps, labels)
    assert len(pictures) == COUNT
    for image in pictures:
        assert image.shape == (*PIXELS, 3)
        assert (image[[0, -1]] == 255).all()
        assert (image[:, [0, -1]] == 255).all()
        grey = (np.ptp(image.astype(int), axis=2) < 25) & (image.mean(axis=2) < 230)
        assert grey.mean() > 0.05
        assert (np.ptp(image.astype(int), axis=2) > 60).mean() > 0.02
    figure = grasp_figure(grasps, pictures)
    check_texts(figure)
    texts = " ".join(text for text, _ in drawn_texts(figure))
    for row in range(COUNT):
        assert f"{Label(int(grasps.letter[row])).name}   {grasps.score[row]:.3f}" in texts
        assert f"approach ±{math.degrees(grasps.approach_margin[row]):.0f}°" in texts


def test_text_fits_and_grasps_are_numbered() -> None:
    mesh = load_mesh(shapes.box((1.0, 0.7, 0.5)), unit="m", max_edge=0.2)
    grasps = best_grasps(label_surface(mesh, sampling=Sampling(rays=16)), MOST_PICTURES)
    figure = grasp_figure(grasps, [np.full((8, 8, 3), 255, dtype=np.uint8)] * 7)
    check_texts(figure)
    texts = [text for text, _ in drawn_texts(figure)]
    heads = [text for text in texts if r"\bf" in text]
    lines = [text for text in texts if "varepsilon" in text]
    assert len(heads) == len(lines) == 7
    for row, (head, line) in enumerate(zip(heads, lines, strict=True)):
        assert rf"\bf{{{row + 1}}}" in head
        assert f"{grasps.score[row]:.3f}" in head
        assert f"{math.degrees(grasps.critical_angle[row]):.1f}°" in line
        assert f"{grasps.epsilon[row]:.3f}" in line
    for words in ("2 fingers", "surely unstable"):
        assert any(words in text for text in texts)
