"""Pictures of grasps: up is up, and the approach and the table are seen."""

import math
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import pyvista
import trimesh
from numpy.typing import NDArray

from grasp3d import GraspModel, Label, Sampling, SurfaceLabels, label_surface, load_mesh
from grasp3d.grasps.distinct import best_grasps
from grasp3d.grasps.evaluation import evaluate_grasps
from grasp3d.hand.parallel_gripper import preset
from grasp3d.hand.scene import Scene
from grasp3d.hand.shapes import ARC_COLOR
from grasp3d.hand.table import Table
from grasp3d.mesh import ObjectMesh
from grasp3d.plots.grasps import grasp_figure
from grasp3d.rendering.opengl import can_render, screenshot
from grasp3d.surface.grasp_table import GraspTable
from grasp3d.system.context import running
from grasp3d.viewer.scene import panes, stills
from grasp3d.viewer.scene.sheets import PIXELS, draw_grasps
from tests.helpers import shapes
from tests.helpers.figures import check_texts, drawn_texts
from tests.helpers.held_grasps import held_box, neighbours_grasps, reached
from tests.rendering.test_opengl import needs_opengl

MESHES = Path(__file__).parents[2] / "meshes"
COUNT = 2
MAGENTA = (255, 0, 255)


def boot() -> ObjectMesh:
    """A shaft on a foot [m], upside down: it rests on its shaft."""
    shaft = trimesh.creation.box(bounds=[[0.0, 0.0, 0.0], [0.05, 0.05, 0.11]])
    foot = trimesh.creation.box(bounds=[[0.0, 0.0, 0.11], [0.14, 0.05, 0.15]])
    return load_mesh(trimesh.boolean.union([shaft, foot]), unit="m", max_edge=0.012)


def mug() -> ObjectMesh:
    return load_mesh(MESHES / "mug.glb", unit="m")


def bottle() -> ObjectMesh:
    return load_mesh(MESHES / "bottle.off", unit="m")


def lying(mesh: ObjectMesh) -> Table:
    """The most probable table on which the object's longest side is level."""
    axis = np.linalg.svd(mesh.normalized[::7], full_matrices=False)[2][0]
    tables = (Table.resting(mesh, number) for number in range(1, 9))
    return next(table for table in tables if abs(table.normal @ axis) < 0.5)


def upside_down(mesh: ObjectMesh) -> Table:
    return Table.below(mesh, "-z")


CASES: dict[str, tuple[Callable[[], ObjectMesh], Callable[[ObjectMesh], Table]]] = {
    "mug": (mug, Table.resting), "boot": (boot, upside_down), "bottle": (bottle, lying)
}  # fmt: skip


@cache
def case(name: str, hand: str) -> tuple[SurfaceLabels, GraspTable]:
    """A labelled object on a table, and its best grasps."""
    make, stand = CASES[name]
    mesh = make()
    labels = label_surface(
        mesh, GraspModel(), sampling=Sampling(rays=8), hand=preset(hand), table=stand(mesh)
    )
    return labels, best_grasps(labels, COUNT)


@pytest.mark.slow
@needs_opengl
@pytest.mark.parametrize("name", CASES)
def test_the_table_is_below_the_object_and_the_approach_is_drawn(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    labels, grasps = case(name, "franka")
    scene = grasps.scene
    assert scene is not None
    assert scene.table is not None
    monkeypatch.setattr(panes, "TABLE_COLOR", MAGENTA)
    monkeypatch.setattr(panes, "TABLE_OPACITY", 1.0)
    for image in draw_grasps(labels, grasps):
        red, green, blue = np.moveaxis(image.astype(int), 2, 0)
        plate = (red - green > 60) & (blue - green > 60)
        painted = (red - blue > 60) | (green - blue > 60)
        rows = [np.nonzero(one)[0] for one in (plate, painted)]
        assert min(map(len, rows)) > 300
        assert rows[0].mean() > rows[1].mean() + 5.0
        assert rows[0].max() > rows[1].max()
        arrow = np.abs(image.astype(int) - ARC_COLOR).max(axis=2) < 40
        assert arrow.sum() > 20


# Without a gripper


@cache
def box_labels() -> SurfaceLabels:
    mesh = load_mesh(shapes.box((1.0, 0.7, 0.5)), unit="m", max_edge=0.2)
    return label_surface(mesh, GraspModel(), sampling=Sampling(rays=16))


@pytest.mark.slow
@needs_opengl
def test_pictures_of_a_sheet_have_one_scale(monkeypatch: pytest.MonkeyPatch) -> None:
    scales: list[float] = []

    def noted(plotter: pyvista.Plotter) -> NDArray[np.uint8]:
        scales.append(plotter.renderers[0].camera.parallel_scale)
        return screenshot(plotter)

    monkeypatch.setattr(stills, "screenshot", noted)
    points = [[[0.5, 0.0, 0.0], [-0.5, 0.0, 0.0]], [[0.0, 0.0, 0.25], [0.0, 0.0, -0.25]]]
    mesh = box_labels().mesh
    both = evaluate_grasps(mesh, points)
    draw_grasps(box_labels(), both)
    for row in range(2):
        draw_grasps(box_labels(), both.take(np.array([row])))
    assert scales[0] == scales[1] == max(scales[2:])
    assert scales[2] != scales[3]


@pytest.mark.slow
@needs_opengl
def test_every_grasp_is_drawn_with_its_contacts_and_cones() -> None:
    progress: list[float] = []
    few = best_grasps(box_labels(), 2)
    pictures = running(progress=progress.append)(draw_grasps)(box_labels(), few)
    assert can_render()
    assert progress == [0.5, 1.0]
    for image in pictures:
        assert image.shape == (PIXELS[1], PIXELS[0], 3)
        assert (image.max(axis=2) < 60).mean() > 0.0005  # the rims of arrows and contacts
        assert (image[..., 2].astype(int) - image[..., 0] > 40).sum() > 100  # the safe cones


# With one


@needs_opengl
@pytest.mark.slow
def test_the_gripper_is_drawn_at_each_grasp() -> None:
    labels = held_box()
    grasps = neighbours_grasps(labels, int(reached(labels)[7]), COUNT)
    pictures = draw_grasps(labels, grasps)
    assert len(pictures) == COUNT
    for image in pictures:
        assert image.shape == (*PIXELS, 3)
        assert (image[[0, -1]] == 255).all()
        assert (image[:, [0, -1]] == 255).all()
        grey = (np.ptp(image.astype(int), axis=2) < 25) & (image.mean(axis=2) < 230)
        assert grey.mean() > 0.05
        assert (np.ptp(image.astype(int), axis=2) > 60).mean() > 0.02
    figure = grasp_figure(labels, grasps, pictures)
    check_texts(figure)
    assert grasps.reach is not None
    texts = [text for text, _ in drawn_texts(figure)]
    assert grasps.closed is not None
    for margin, code in zip(grasps.reach.approach_margin, grasps.closed.label, strict=True):
        assert f"approach ±{math.degrees(margin):.0f}°, closed {Label(code).name}" in texts


def test_without_a_table_up_is_the_stated_axis() -> None:
    labels = held_box()
    scene = labels.scene
    assert scene is not None
    up = np.array([0.0, 1.0, 0.0])
    free = Scene(scene.hand, approach=replace(scene.approach, direction=-up))
    assert np.array_equal(free.up, up)
