"""Pictures of labelled surfaces, and of surfaces in given colours."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from matplotlib.collections import PolyCollection
from numpy.typing import NDArray

from grasp3d import GraspModel, Label, Sampling, label_surface, load_mesh, scan_surface
from grasp3d.arrays import Bytes
from grasp3d.grasps.best import best_grasps
from grasp3d.hand.parallel_gripper import PRESETS, ParallelGripper
from grasp3d.hand.table import Table
from grasp3d.hand.triangles import ARC_COLOR
from grasp3d.mesh import ObjectMesh
from grasp3d.pictures import pane
from grasp3d.pictures.camera import MARGIN, View
from grasp3d.pictures.hands import frames_figure, gripper_figure
from grasp3d.pictures.marks import MarkedContacts
from grasp3d.pictures.stills import (
    MOST_PICTURES,
    PIXELS,
    draw_colors,
    draw_grasps,
    draw_labels,
    grasp_figure,
)
from tests.helpers import shapes
from tests.helpers.figures import check_texts, drawn_texts
from tests.helpers.held_grasps import held_box
from tests.helpers.solids import box_mesh, sphere_mesh
from tests.helpers.viewing import nearest_label
from tests.pictures.test_opengl import needs_opengl

FRONT = View(azimuth=0.0, elevation=0.0)
SIZE = 240


def seen(image: Bytes) -> NDArray[np.bool_]:
    return np.asarray((image < 250).any(axis=2))


@pytest.mark.slow
@needs_opengl
def test_right_and_up_of_pictures() -> None:
    mesh = load_mesh(shapes.sphere(3))
    red_right = np.where(mesh.vertices[:, 1:2] > 0.0, (255, 0, 0), (0, 0, 255))
    image = draw_colors(mesh, red_right, view=FRONT, size=(SIZE, SIZE))
    assert image[SIZE // 2, SIZE * 3 // 4].argmax() == 0
    assert image[SIZE // 2, SIZE // 4].argmax() == 2
    red_above = np.where(mesh.vertices[:, 2:] > 0.0, (255, 0, 0), (0, 0, 255))
    image = draw_colors(mesh, red_above, view=FRONT, size=(SIZE, SIZE))
    assert image[SIZE // 4, SIZE // 2].argmax() == 0
    assert image[SIZE * 3 // 4, SIZE // 2].argmax() == 2


@pytest.mark.slow
@needs_opengl
def test_contacts_are_visible_and_their_hidden_parts_are_faint() -> None:
    mesh, white = box_mesh((2.0, 2.0, 2.0)), np.full(3, 255)
    behind = MarkedContacts(np.array([[-1.0, 0.0, 0.0]]), np.array([[1.0, 0.0, 0.0]]))
    plain = draw_colors(mesh, white, view=FRONT, size=(SIZE, SIZE))
    hidden = draw_colors(mesh, white, view=FRONT, size=(SIZE, SIZE), grasp=behind)
    darker = plain.astype(int).min(axis=2) - hidden.min(axis=2)
    middle = slice(SIZE // 2 - 8, SIZE // 2 + 8)
    assert 60 < darker[middle, middle].max() < 200
    scanned = scan_surface(box_mesh(max_edge=0.5), GraspModel(friction=1.0), fixed=(0, 0, -1))
    below = np.array([[0.0, 0.0, -1.0]])
    shown = draw_labels(scanned, view=FRONT, size=(SIZE, SIZE), fixed=below)
    rows, columns = np.nonzero(shown.max(axis=2) < 60)
    assert len(rows) > 40
    assert columns.mean() == pytest.approx((SIZE - 1) / 2.0, abs=1.0)
    assert np.nonzero(seen(shown))[0].max() > 0.9 * SIZE  # its arrow is within the picture


@pytest.mark.slow
@needs_opengl
@pytest.mark.parametrize(("degrees", "location"), [(30.0, 0.0), (15.0, 0.06)])
def test_every_pixel_of_a_labelled_sphere_agrees_with_the_closed_form(
    degrees: float, location: float
) -> None:
    model = GraspModel(
        friction=1.0, sensor_resolution=math.radians(degrees), location_error=location
    )
    scanned = scan_surface(sphere_mesh(subdivisions=6), model, fixed=(0.0, 0.0, -1.0))
    image = draw_labels(scanned, view=FRONT, size=(SIZE, SIZE)).astype(float)
    pixel = (np.arange(SIZE) + 0.5 - SIZE / 2.0) * (2.0 * MARGIN / SIZE)
    y, z = np.meshgrid(pixel, -pixel)
    inside = np.hypot(y, z) < 0.98
    critical = np.arccos(np.clip(z, -1.0, 1.0)) / 2.0  # half the angle from the opposite pole
    turn = np.arcsin(np.minimum(location / np.cos(critical), 1.0))  # contacts 2 cos apart
    turn += 2.0 * np.arcsin(0.5 * location)  # of the normals
    expected = np.full(z.shape, int(Label.M))
    expected[critical + turn < model.friction_angle - model.tilt] = Label.S
    expected[critical - turn >= model.friction_angle + model.tilt] = Label.U
    found = nearest_label(image[inside])
    assert (found == expected[inside]).mean() > 0.985
    near = np.abs(critical + turn - model.friction_angle + model.tilt) < 0.02
    near |= np.abs(critical - turn - model.friction_angle - model.tilt) < 0.02
    assert (found == expected[inside])[~near[inside]].all()


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
