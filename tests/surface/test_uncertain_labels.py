"""Labels of surfaces with uncertain friction, normals and contact locations."""

import math
from typing import Any

import numpy as np
import pytest

from grasp3d import (
    Contacts,
    GraspModel,
    Label,
    Sampling,
    SurfaceLabels,
    classify,
    label_surface,
    load_mesh,
    scan_surface,
    sweep,
)
from grasp3d.errors import SettingError
from grasp3d.surface.contacts import SurfaceContacts, grasps_at, vertex_surface_points
from grasp3d.surface.vertex_fields import Reason
from tests.helpers import shapes

WIDE = Sampling(search_angle=1.2)
ERROR = 0.03


@pytest.fixture(scope="module")
def labels() -> SurfaceLabels:
    """A lopsided shape with smooth parts and creases, searched widely."""
    return label_surface(load_mesh(shapes.lopsided()), sampling=WIDE)


@pytest.fixture(scope="module")
def located(labels: SurfaceLabels) -> SurfaceLabels:
    """The same with a location error."""
    return label_surface(labels.mesh, GraspModel(location_error=ERROR), sampling=WIDE)


@pytest.mark.slow
def test_labels_are_those_of_the_same_grasps_as_contacts(located: SurfaceLabels) -> None:
    """Smooth contacts: `classify` with the turns of the surface added to the resolution."""
    found = located.relabel(friction=(0.4, 0.6))
    vertices = np.flatnonzero(found.reason == Reason.FOUND)
    grasps = grasps_at(found.mesh, found.partner_points, vertices)
    turns = grasps.turns(ERROR)
    smooth = ~grasps.on_crease.any(axis=1) & (turns.max(axis=1) < 1.2)
    assert smooth.sum() > 50
    expected = classify(
        grasps.take(smooth).contacts(found.model),
        found.model.sensor_resolution + 2.0 * turns[smooth],
        friction_interval=(0.4, 0.6),
        location_error=ERROR,
    )
    assert found.label[vertices[smooth]].tolist() == expected.label.tolist()
    assert len(np.unique(expected.label)) > 1
    assert found.margin[vertices[smooth]] == pytest.approx(expected.margin, abs=1e-9)


@pytest.mark.slow
def test_a_location_error_only_takes_away(labels: SurfaceLabels, located: SurfaceLabels) -> None:
    """The search finds no grasp that is better than the best one with exact locations."""
    assert (located.critical_angle >= labels.critical_angle - 1e-6).all()
    assert not ((located.label == Label.S) & (labels.label != Label.S)).any()
    assert (located.label == Label.S).any()


@pytest.mark.slow
def test_the_search_knows_what_location_errors_cost() -> None:
    """No pair of smooth vertices is better by more than 1 degree, up to the search cone."""
    mesh, error = load_mesh(shapes.cone(0.2, sections=24), max_edge=0.08), 0.05
    found = label_surface(mesh, GraspModel(location_error=error), sampling=WIDE)
    smooth = np.flatnonzero(mesh.contact_normals.counts == 1)
    contacts = SurfaceContacts(mesh, vertex_surface_points(mesh, smooth[:, None]))
    turns, gains = contacts.turns(error)[:, 0], []
    for number in range(0, len(smooth), len(smooth) // 60):
        vertex = smooth[number]
        line = mesh.vertices[smooth] - mesh.vertices[vertex]
        length = np.maximum(np.linalg.norm(line, axis=1), 1e-12)
        own = np.arccos(np.clip(line @ mesh.normals[vertex] / length, -1.0, 1.0))
        other = np.arccos(np.clip(-(line * mesh.normals[smooth]).sum(axis=1) / length, -1.0, 1.0))
        worst = np.maximum(own + turns[number], other + turns)
        worst += np.arcsin(np.minimum(2.0 * error / length, 1.0))
        cone = found.search.cone
        gains.append(min(found.critical_angle[vertex], cone) - min(float(worst.min()), cone))
    assert max(gains) < math.radians(1.0)
    assert (found.critical_angle < found.search.cone).any()


def test_location_errors_that_make_no_sense_are_refused(labels: SurfaceLabels) -> None:
    with pytest.raises(SettingError, match="location_error is 2 mm, but the unit"):
        label_surface(labels.mesh, GraspModel(location_error="2mm"))
    with pytest.raises(SettingError, match="needs the method exact"):
        GraspModel(method="extremes", location_error=1.0)


def test_another_friction_replaces_the_interval(labels: SurfaceLabels) -> None:
    assert labels.relabel(friction=(0.5, 0.5)).label.tolist() == labels.label.tolist()
    before = labels.relabel(friction=(0.4, 0.6))
    assert before.model.friction_interval == (0.4, 0.6)
    assert "μ 0.4 to 0.6, α 22.6°" in repr(before)
    assert before.relabel(sensor_resolution=0.1).model.friction_interval == (0.4, 0.6)
    assert before.relabel(friction=0.6).model.friction_interval == (0.6, 0.6)


@pytest.mark.slow
@pytest.mark.parametrize("changes", [{}, {"friction": (0.3, 0.9)}], ids=str)
def test_distributions_have_the_fractions_of_every_model(
    located: SurfaceLabels, changes: dict[str, Any]
) -> None:
    """Sweeps have them as well."""
    found = located.relabel(**changes)
    model, expected = found.model, found.fractions()
    assert 0.0 < expected["S"] < 1.0
    distribution = found.angle_distribution()
    fractions = distribution.fractions(
        friction=model.friction, sensor_resolution=model.sensor_resolution
    )
    assert fractions == pytest.approx(expected, abs=1e-12)
    if not changes:
        alpha = model.sensor_resolution
        swept = sweep(distribution, friction=model.friction, sensor_resolution=alpha)
        assert swept.stable[0, 0] == pytest.approx(expected["S"], abs=1e-12)
    needed = distribution.required_resolution(0.3, friction=model.friction)
    if needed > 0.0:
        below, above = (
            found.relabel(sensor_resolution=needed + change).fractions()["S"]
            for change in (-1e-9, 1e-9)
        )
        assert above <= 0.3 + 1e-12 <= below + 2e-12


@pytest.mark.slow
def test_three_fingers_are_safe() -> None:
    mesh = load_mesh(shapes.sphere(2), max_edge=9.0)
    error = 0.02 * mesh.size
    model = GraspModel(fingers=3, friction=0.8, sensor_resolution=0.2, location_error=error)
    unsure = label_surface(mesh, model, sampling=Sampling(candidates=8))
    assert not (unsure.label == Label.U).any()
    vertices = np.flatnonzero(unsure.label == Label.S)[:20]
    assert len(vertices) == 20
    rng = np.random.default_rng(0)
    contacts = grasps_at(mesh, unsure.partner_points, vertices).contacts(unsure.model)
    shift = rng.normal(size=contacts.points.shape)
    shift *= error / np.linalg.norm(shift, axis=2, keepdims=True)
    places = contacts.points + shift
    places /= np.linalg.norm(places, axis=2, keepdims=True)  # on the sphere, nearer than before
    places *= np.linalg.norm(contacts.points, axis=2, keepdims=True)
    assert (np.linalg.norm(places - contacts.points, axis=2) <= 1.03 * error).all()
    moved = Contacts(places, -places, contacts.friction)
    assert (classify(moved, unsure.model.sensor_resolution).label == Label.S).all()


@pytest.mark.slow
def test_fractions_of_a_sphere_have_a_closed_form() -> None:
    """Lines at beta* = x turn by y = asin(d / (R cos x)), normals by z = 2 asin(d / 2 R).

    x + y + z decides on S, x - y - z on U.
    """
    mesh = load_mesh(shapes.sphere(5))
    radius, part = float(np.linalg.norm(mesh.vertices, axis=1).max()), 0.05
    model = GraspModel(friction=(0.5, 0.7), sensor_resolution=0.3, location_error=part * radius)
    found = scan_surface(mesh, model, fixed=(0.0, 0.0, radius)).fractions()
    turn = 2.0 * math.asin(0.5 * part)
    least, widest = math.atan(0.5) - 0.15 - turn, math.atan(0.7) + 0.15 + turn
    stable = math.sin(0.5 * (least + math.asin(math.sin(least) - 2.0 * part))) ** 2
    turned = math.asin(math.sin(widest) + 2.0 * part)
    nearest, farthest = 0.5 * (widest + turned), 0.5 * (widest + math.pi - turned)
    unstable = math.sin(farthest) ** 2 - math.sin(nearest) ** 2
    exact = {"S": stable, "M": 1.0 - stable - unstable, "U": unstable}
    assert found == pytest.approx(exact, abs=0.015)
