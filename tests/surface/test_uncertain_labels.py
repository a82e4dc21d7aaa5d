"""Labels of surfaces with uncertain friction, normals and contact locations."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from grasp3d import (
    Contacts,
    GraspModel,
    Label,
    Load,
    Sampling,
    SurfaceLabels,
    classify,
    evaluate_grasps,
    label_surface,
    load_mesh,
    scan_surface,
)
from grasp3d.errors import SettingError
from grasp3d.surface.vertex_grasps import Reason, grasps_at
from grasp3d.uncertainty import Uncertainty
from tests.helpers import shapes

MESHES = Path(__file__).parents[2] / "meshes"
WIDE = Sampling(search_angle=1.2)
ERRORS = {"friction_error": 0.15, "normal_error": 0.08, "location_error": 0.1}


@pytest.fixture(scope="module")
def labels() -> SurfaceLabels:
    """A lopsided shape with smooth parts and creases, searched widely."""
    return label_surface(load_mesh(shapes.lopsided()), sampling=WIDE)


def test_zero_errors_change_nothing(labels: SurfaceLabels) -> None:
    model = GraspModel(friction_error=0.0, normal_error=0.0, location_error=0.0, per_finger="")
    again = label_surface(labels.mesh, model, sampling=WIDE)
    assert again.label.tolist() == labels.label.tolist()
    assert again.critical_angle.tolist() == labels.critical_angle.tolist()
    assert again.located_angles[0].tolist() == labels.critical_angle.tolist()
    relabelled = labels.relabel(friction_error=0.0, normal_error=0.0, location_error=0.0)
    assert relabelled.label.tolist() == labels.label.tolist()


@pytest.mark.parametrize("name", list(ERRORS))
def test_less_knowledge_turns_labels_to_m_only(labels: SurfaceLabels, name: str) -> None:
    before = labels
    for part in (0.25, 0.5, 1.0):
        after = labels.relabel(**{name: part * ERRORS[name]})  # type: ignore[arg-type]
        same = after.label == before.label
        assert (same | (after.label == Label.M)).all()
        assert (after.margin <= before.margin).all()
        before = after
    assert (before.label != labels.label).any()


def test_labels_are_those_of_the_same_grasps_as_contacts(labels: SurfaceLabels) -> None:
    """Smooth contacts: `classify` with each finger's own errors."""
    fingers = (
        Uncertainty(normal_error=0.05, location_error=0.05),
        Uncertainty(location_error=0.02, friction=(0.3, 0.7)),
    )
    found = labels.relabel(friction=(0.4, 0.6), location_error=0.03, per_finger=fingers)
    vertices = np.flatnonzero(found.reason == Reason.FOUND)
    grasps = grasps_at(found.mesh, found.partner_points, vertices, 0)
    smooth = np.asarray(~grasps.on_crease.any(axis=1))
    assert smooth.sum() > 50
    chosen = grasps.take(smooth)
    expected = classify(
        chosen.contacts(found.model),
        found.model.sensor_resolution,
        friction_interval=([0.4, 0.3], [0.6, 0.7]),
        normal_error=[0.05, 0.0],
        location_error=[0.08, 0.05],
    )
    assert found.label[vertices[smooth]].tolist() == expected.label.tolist()
    assert len(np.unique(expected.label)) > 1
    assert found.margin[vertices[smooth]] == pytest.approx(expected.margin, abs=1e-9)


def test_fingers_that_are_alike_are_one_uncertainty(labels: SurfaceLabels) -> None:
    own = Uncertainty(sensor_resolution=0.05, normal_error=0.03, location_error=0.04)
    common = labels.relabel(
        sensor_resolution=labels.model.sensor_resolution + 0.05, normal_error=0.03,
        location_error=0.04,
    )  # fmt: skip
    each = labels.relabel(per_finger=(own, own))
    assert each.label.tolist() == common.label.tolist()
    assert each.margin == pytest.approx(common.margin, abs=1e-12)


def test_the_search_prefers_wide_grasps() -> None:
    """A plate with a rim: pinching the rim is best for known locations, not for uncertain ones."""
    mesh = load_mesh(MESHES / "mug.glb")
    known = label_surface(mesh)
    model = replace(known.model, location_error="2mm")
    searched = label_surface(mesh, model)
    kept = known.relabel(location_error="2mm")
    found = np.isfinite(kept.margin) & np.isfinite(searched.margin)
    assert (searched.margin[found] > kept.margin[found] + 0.1).mean() > 0.1
    assert (searched.margin[found] < kept.margin[found] - math.radians(0.5)).mean() < 0.01
    assert searched.fractions()["S"] > 1.5 * kept.fractions()["S"]
    assert np.median(searched.opening[found]) > np.median(known.opening[found])


def test_the_margin_of_a_box() -> None:
    """Opposite sides of a box, L apart: beta - alpha/2 - asin(2 d / L)."""
    mesh = load_mesh(shapes.box((0.08, 0.05, 0.03)), unit="m", max_edge=0.01)
    labels = label_surface(mesh, GraspModel(location_error="1mm"))
    middle = np.flatnonzero((np.abs(mesh.vertices) < 1e-9).sum(axis=1) == 2)
    expected = math.atan(0.5) - labels.model.tilt - np.arcsin(0.002 / labels.opening[middle])
    assert len(middle) >= 2
    assert labels.margin[middle] == pytest.approx(expected, abs=1e-6)


def test_max_resolution_is_where_the_label_changes(labels: SurfaceLabels) -> None:
    model = replace(labels.model, friction_error=0.1, normal_error=0.05, location_error=0.03)
    found = replace(labels, model=model)
    limit = found.max_resolution
    chosen = np.flatnonzero(limit > 0.1)[:: max(1, (limit > 0.1).sum() // 5)]
    for vertex in chosen:
        finer = found.relabel(sensor_resolution=float(limit[vertex]) - 1e-9)
        coarser = found.relabel(sensor_resolution=float(limit[vertex]) + 1e-9)
        assert finer.label[vertex] == Label.S
        assert coarser.label[vertex] != Label.S


def test_distributions_have_the_fractions_of_the_labels(labels: SurfaceLabels) -> None:
    found = labels.relabel(location_error=0.05)
    distribution = labels.angle_distribution(location_error=0.05)
    model = found.model
    expected = distribution.fractions(
        friction=model.friction, sensor_resolution=model.sensor_resolution
    )
    assert found.fractions() == pytest.approx(expected)
    assert expected["S"] < labels.fractions()["S"]


def test_epsilon_covers_all_errors(labels: SurfaceLabels) -> None:
    found = labels.relabel(friction_error=0.1, location_error=0.02)
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
    assert given.margin == pytest.approx(scan.margin[vertices], abs=1e-6)
    clear = np.abs(given.margin) > 1e-4
    assert given.label[clear].tolist() == scan.label[vertices][clear].tolist()


def test_three_fingers_are_safe() -> None:
    mesh = load_mesh(shapes.sphere(2))
    known = label_surface(mesh, GraspModel(fingers=3), sampling=Sampling(candidates=8))
    unsure = known.relabel(location_error=0.02 * mesh.size)
    assert ((unsure.label == known.label) | (unsure.label == Label.M)).all()
    assert (unsure.label == Label.S).any()
    assert (unsure.margin < known.margin)[np.isfinite(known.margin)].all()
    vertices = np.flatnonzero(unsure.label == Label.S)[:20]
    rng = np.random.default_rng(0)
    contacts = grasps_at(mesh, unsure.partner_points, vertices, 0).contacts(unsure.model)
    shift = rng.normal(size=contacts.points.shape)
    shift *= 0.02 * mesh.size / np.linalg.norm(shift, axis=2, keepdims=True)
    moved = Contacts(contacts.points + shift, contacts.normals, contacts.friction)
    assert (classify(moved, unsure.model.sensor_resolution).label == Label.S).all()


def test_the_centre_of_mass_changes_the_bounds_of_epsilon(labels: SurfaceLabels) -> None:
    known = replace(labels, load=Load(mass=1.0))
    unsure = replace(labels, load=Load(mass=1.0, center_of_mass_radius=0.1 * labels.mesh.size))
    chosen = np.flatnonzero(known.epsilon_min > 0.0)
    assert (unsure.epsilon_min[chosen] < known.epsilon_min[chosen]).all()
    assert (unsure.epsilon_max[chosen] > known.epsilon_max[chosen]).all()
    assert unsure.label.tolist() == known.label.tolist()


class TestErrors:
    def test_a_unit_needs_a_mesh_with_one(self, labels: SurfaceLabels) -> None:
        with pytest.raises(SettingError, match="location_error is 2 mm, but the unit"):
            label_surface(labels.mesh, GraspModel(location_error="2mm"))

    def test_a_number_of_fingers_that_does_not_match(self, labels: SurfaceLabels) -> None:
        with pytest.raises(SettingError, match="3 fingers, but a grasp has 2"):
            label_surface(labels.mesh, GraspModel(per_finger="normal_error=1;;"))

    def test_extreme_normals_have_no_locations(self) -> None:
        with pytest.raises(SettingError, match="need the method exact"):
            GraspModel(method="extremes", location_error=1.0)
