"""Pictures of labelled surfaces, and of surfaces in given colours."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from grasp3d import GraspModel, Label, load_mesh, scan_surface
from grasp3d.arrays import Bytes
from grasp3d.pictures.camera import MARGIN, View
from grasp3d.pictures.marks import MarkedContacts
from grasp3d.pictures.stills import draw_colors, draw_labels
from tests.helpers import shapes
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
