"""Tests of labels from wrench hulls at extreme normals, compared with exact ones."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from grasp3d import (
    Contacts,
    GraspModel,
    Label,
    ObjectMesh,
    Sampling,
    SurfaceLabels,
    classify,
    label_surface,
    load_mesh,
)
from grasp3d.errors import SettingError
from grasp3d.quality.wrenches import EpsilonOptions
from grasp3d.surface.contacts import grasps_at
from grasp3d.surface.grasp_numbers import hull_labels
from grasp3d.surface.vertex_fields import Reason
from grasp3d.system.context import running
from tests.helpers import shapes

degrees = math.radians

S, M, U = Label.S, Label.M, Label.U


@cache
def surface(name: str) -> ObjectMesh:
    if name == "blob":
        return load_mesh(shapes.lopsided(3), max_edge=9.0)
    return load_mesh(shapes.box((1.0, 1.5, 2.0)), max_edge=0.25 if name == "box" else 0.5)


@cache
def labelled(name: str) -> SurfaceLabels:
    return label_surface(surface(name), GraspModel(method="extremes"))


def with_exact_labels(labels: SurfaceLabels) -> SurfaceLabels:
    """The same grasps with exact labels."""
    return labels.using(model=replace(labels.model, method="exact"))


def contacts_at(labels: SurfaceLabels, vertex: int) -> Contacts:
    """The grasp of a smooth vertex whose opposing contact is smooth as well."""
    mesh = labels.mesh
    return Contacts(
        [mesh.vertices[vertex] - mesh.center_mass, labels.partners[vertex, 0] - mesh.center_mass],
        [mesh.normals[vertex], labels.partner_normals[vertex, 0]],
        labels.model.friction,
    )


@pytest.mark.slow
@pytest.mark.parametrize("name", ["box", "blob"])
def test_labels_differ_from_exact_ones_little_and_only_as_allowed(name: str) -> None:
    labels = labelled(name)
    plain = label_surface(surface(name))
    np.testing.assert_array_equal(plain.critical_angle, labels.critical_angle)
    np.testing.assert_array_equal(plain.label, with_exact_labels(labels).label)
    differ = plain.label != labels.label
    assert (plain.label[differ] == M).all()
    areas = labels.mesh.vertex_areas / labels.mesh.vertex_areas.sum()
    assert areas[differ].sum() < 0.01
    assert differ.any() == (name == "blob")


@pytest.mark.slow
def test_epsilons_are_those_of_the_enumeration() -> None:
    model = GraspModel(method="extremes", torsion_radius=0.1)
    blob = load_mesh(shapes.sphere(1), max_edge=9.0)
    lopsided = load_mesh((blob.vertices * [1.0, 0.8, 1.3], blob.faces), max_edge=9.0)
    labels = label_surface(lopsided, model)
    for vertex in range(0, len(labels.label), 9):
        hard = contacts_at(labels, vertex)
        contacts = Contacts(hard.points, hard.normals, hard.friction, 0.1)
        options = EpsilonOptions(torque_scale=labels.mesh.torque_scale, rtol=1e-3)
        found = classify(contacts, model.sensor_resolution, method="extremes", options=options)
        assert labels.label[vertex] == found.label
        assert labels.epsilon_min[vertex] == pytest.approx(found.epsilon_min, rel=0.011)
        assert labels.epsilon_max[vertex] == pytest.approx(found.epsilon_max, rel=0.011)
        assert labels.epsilon[vertex] == pytest.approx(found.epsilon, rel=0.011)


def test_the_smallest_epsilon_is_above_zero_exactly_where_the_label_is_s() -> None:
    labels = labelled("coarse box")
    smooth = labels.mesh.contact_normals.counts == 1
    positive = labels.epsilon_min > 0.0
    np.testing.assert_array_equal(positive[smooth], (labels.label == S)[smooth])
    assert (labels.label[positive] == S).all()
    assert (labels.epsilon_min <= 1.02 * labels.epsilon)[smooth].all()
    assert (labels.epsilon <= 1.02 * labels.epsilon_max)[smooth].all()
    assert (labels.epsilon_max[labels.label == U] == 0.0).all()
    assert {S, U} <= set(labels.label)
    plain = with_exact_labels(labels)  # whose epsilon is over all tilts
    assert (labels.epsilon_min >= 0.98 * plain.epsilon_min)[smooth].all()
    assert (labels.epsilon_max <= 1.02 * plain.epsilon_max)[smooth].all()


def test_labels_at_creases_are_those_of_the_grasps() -> None:
    labels = labelled("coarse box")
    mesh = labels.mesh
    vertices = np.unique(mesh.canonical[labels.reason == Reason.FOUND])
    grasps = grasps_at(mesh, labels.partner_points, vertices)
    assert grasps.on_crease.any()
    np.testing.assert_array_equal(labels.label[vertices], hull_labels(grasps, labels.model))
    distances = np.linalg.norm(grasps.points[:, 1] - labels.partners[vertices, 0], axis=1)
    assert distances.max() <= 1e-6


@pytest.mark.slow
def test_relabelling_enumerates_when_the_label_is_read() -> None:
    labels = labelled("blob")
    finer = labels.relabel(friction=0.45, sensor_resolution=degrees(10.0))
    assert finer.model.method == "extremes"
    assert finer.computed("label") is None
    model = GraspModel(friction=0.45, sensor_resolution=degrees(10.0), method="extremes")
    wide = Sampling(search_angle=labels.search.cone)
    again = label_surface(surface("blob"), model, sampling=wide)
    np.testing.assert_array_equal(finer.label, again.label)
    assert (finer.label != labels.label).any()
    with pytest.raises(ValueError, match="read-only"):
        finer.label[0] = 0
    tiny = labels.relabel(friction=1e-6)
    with pytest.raises(SettingError, match="use method='exact'"):
        _ = tiny.label


def test_progress_ends_at_1_with_and_without_grasps() -> None:
    model = GraspModel(method="extremes")
    fractions: list[float] = []
    for opening in (1e-3, math.inf):
        fractions.clear()
        with running(progress=fractions.append):
            labels = label_surface(surface("box"), model, sampling=Sampling(max_opening=opening))
        assert labels.computed("label") is not None
        assert fractions == sorted(fractions)
        assert 0.0 <= fractions[0] < 0.3
        assert fractions[-1] == 1.0
        assert (labels.label == U).all() == (opening < 1.0)
    fractions.clear()
    with running(progress=fractions.append):
        _ = labels.epsilon_range
        label_surface(surface("coarse box")).compute_labels()  # exact ones need no enumeration
    assert fractions[-1] == 1.0
