"""Labels of surfaces with uncertain friction, normals and contact locations."""

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
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
    evaluate_grasps,
    label_surface,
    load_mesh,
    scan_surface,
    sweep,
)
from grasp3d.errors import SettingError
from grasp3d.surface.contacts import SurfaceContacts, grasps_at, vertex_surface_points
from grasp3d.surface.vertex_fields import Reason
from tests.helpers import shapes

MESHES = Path(__file__).parents[2] / "meshes"
WIDE = Sampling(search_angle=1.2)
ERROR = 0.03
ERRORS: dict[str, Callable[[float], Any]] = {
    "friction": lambda part: (0.5 - 0.15 * part, 0.5 + 0.15 * part),
    "sensor_resolution": lambda part: GraspModel().sensor_resolution + 0.16 * part,
}


@pytest.fixture(scope="module")
def labels() -> SurfaceLabels:
    """A lopsided shape with smooth parts and creases, searched widely."""
    return label_surface(load_mesh(shapes.lopsided()), sampling=WIDE)


@pytest.fixture(scope="module")
def located(labels: SurfaceLabels) -> SurfaceLabels:
    """The same with a location error."""
    return label_surface(labels.mesh, GraspModel(location_error=ERROR), sampling=WIDE)


@pytest.mark.slow
def test_zero_errors_change_nothing(labels: SurfaceLabels) -> None:
    model = GraspModel(friction=(0.5, 0.5), location_error=0.0)
    again = label_surface(labels.mesh, model, sampling=WIDE)
    assert again.label.tolist() == labels.label.tolist()
    assert again.critical_angle.tolist() == labels.critical_angle.tolist()
    relabelled = labels.relabel(friction=(0.5, 0.5))
    assert relabelled.label.tolist() == labels.label.tolist()


@pytest.mark.slow
@pytest.mark.parametrize("name", list(ERRORS))
def test_less_knowledge_turns_labels_to_m_only(labels: SurfaceLabels, name: str) -> None:
    before = labels
    for part in (0.25, 0.5, 1.0):
        after = labels.relabel(**{name: ERRORS[name](part)})
        same = after.label == before.label
        assert (same | (after.label == Label.M)).all()
        assert (after.margin <= before.margin).all()
        before = after
    assert (before.label != labels.label).any()


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


def test_a_location_error_only_takes_away(labels: SurfaceLabels, located: SurfaceLabels) -> None:
    """The search finds no grasp that is better than the best one with exact locations."""
    assert (located.critical_angle >= labels.critical_angle - 1e-6).all()
    assert not ((located.label == Label.S) & (labels.label != Label.S)).any()
    assert (located.label == Label.S).any()


@pytest.mark.parametrize(
    ("surface", "edge", "error"),
    [(shapes.cone(0.2, sections=24), 0.08, 0.05), (shapes.frustum(), 0.1, 0.08)],
    ids=["cone", "frustum"],
)
def test_the_search_knows_what_location_errors_cost(
    surface: shapes.Surface, edge: float, error: float
) -> None:
    """No pair of smooth vertices is better by more than 1 degree, up to the search cone."""
    mesh = load_mesh(surface, max_edge=edge)
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


def test_another_friction_replaces_the_interval(labels: SurfaceLabels) -> None:
    before = labels.relabel(friction=(0.4, 0.6))
    assert before.model.friction_interval == (0.4, 0.6)
    assert "μ 0.4 to 0.6, α 22.6°" in repr(before)
    assert before.relabel(sensor_resolution=0.1).model.friction_interval == (0.4, 0.6)
    assert before.relabel(friction=0.6).model.friction_interval == (0.6, 0.6)


def test_the_margin_of_a_box() -> None:
    """Opposite sides of a box, L apart: beta - alpha/2 - asin(2 d / L)."""
    mesh = load_mesh(shapes.box((0.08, 0.05, 0.03)), unit="m", max_edge=0.01)
    labels = label_surface(mesh, GraspModel(location_error="1mm"))
    middle = np.flatnonzero((np.abs(mesh.vertices) < 1e-9).sum(axis=1) == 2)
    expected = math.atan(0.5) - labels.model.tilt - np.arcsin(0.002 / labels.opening[middle])
    assert len(middle) >= 2
    assert labels.margin[middle] == pytest.approx(expected, abs=1e-6)


def test_max_resolution_is_where_the_label_changes(located: SurfaceLabels) -> None:
    found = located.relabel(friction=(0.4, 0.6))
    limit = found.max_resolution
    chosen = np.flatnonzero(limit > 0.1)[:: max(1, (limit > 0.1).sum() // 5)]
    for vertex in chosen:
        finer = found.relabel(sensor_resolution=float(limit[vertex]) - 1e-9)
        coarser = found.relabel(sensor_resolution=float(limit[vertex]) + 1e-9)
        assert finer.label[vertex] == Label.S
        assert coarser.label[vertex] != Label.S


def test_distributions_have_the_fractions_of_the_labels(
    labels: SurfaceLabels, located: SurfaceLabels
) -> None:
    found = located
    distribution = found.angle_distribution()
    model = found.model
    expected = distribution.fractions(
        friction=model.friction, sensor_resolution=model.sensor_resolution
    )
    assert found.fractions() == pytest.approx(expected)
    assert expected["S"] < labels.fractions()["S"]


MODELS: tuple[dict[str, Any], ...] = (
    {},
    {"friction": (0.4, 0.6)},
    {"sensor_resolution": 0.3},
    {"friction": (0.3, 0.9)},
)


@pytest.mark.parametrize("changes", MODELS, ids=str)
def test_distributions_have_the_fractions_of_every_model(
    located: SurfaceLabels, changes: dict[str, Any]
) -> None:
    found = located.relabel(**changes)
    model, expected = found.model, found.fractions()
    assert 0.0 < expected["S"] < 1.0
    distribution = found.angle_distribution()
    fractions = distribution.fractions(
        friction=model.friction, sensor_resolution=model.sensor_resolution
    )
    assert fractions == pytest.approx(expected, abs=1e-12)
    needed = distribution.required_resolution(0.3, friction=model.friction)
    if needed > 0.0:
        below, above = (
            found.relabel(sensor_resolution=needed + change).fractions()["S"]
            for change in (-1e-9, 1e-9)
        )
        assert above <= 0.3 + 1e-12 <= below + 2e-12


def test_a_sweep_has_the_location_error_of_the_labels(located: SurfaceLabels) -> None:
    swept = sweep(located.angle_distribution(), friction=0.5, sensor_resolution=0.2)
    expected = located.relabel(sensor_resolution=0.2).fractions()
    assert swept.stable[0, 0] == pytest.approx(expected["S"], abs=1e-12)


def test_epsilon_covers_the_interval_of_friction(labels: SurfaceLabels) -> None:
    found = labels.relabel(friction=(0.4, 0.6))
    chosen = np.flatnonzero(np.isfinite(labels.epsilon))
    assert (found.epsilon[chosen] == labels.epsilon[chosen]).all()
    assert (found.epsilon_min[chosen] <= labels.epsilon_min[chosen] * 1.01).all()
    assert (found.epsilon_max[chosen] >= labels.epsilon_max[chosen] / 1.03).all()


def test_given_grasps_and_scans(labels: SurfaceLabels) -> None:
    model = replace(labels.model, location_error=0.05)
    scan = scan_surface(labels.mesh, model, fixed=labels.mesh.vertices[0])
    vertices = np.flatnonzero(scan.reason == Reason.FOUND)[:40]
    points = np.stack([scan.mesh.vertices[vertices], scan.partners[vertices, 0]], axis=1)
    given = evaluate_grasps(labels.mesh, points, model)
    assert given.margin == pytest.approx(scan.margin[vertices], abs=2e-3)
    clear = np.abs(given.margin) > 3e-3
    assert given.label[clear].tolist() == scan.label[vertices][clear].tolist()


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


class TestErrors:
    def test_a_unit_needs_a_mesh_with_one(self, labels: SurfaceLabels) -> None:
        with pytest.raises(SettingError, match="location_error is 2 mm, but the unit"):
            label_surface(labels.mesh, GraspModel(location_error="2mm"))

    def test_extreme_normals_have_no_locations(self) -> None:
        with pytest.raises(SettingError, match="needs the method exact"):
            GraspModel(method="extremes", location_error=1.0)


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
