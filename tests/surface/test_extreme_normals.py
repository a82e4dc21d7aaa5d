"""Tests of labels from wrench hulls at extreme normals, compared with exact ones."""

import math
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
import trimesh

from grasp3d import (
    Contacts,
    GraspModel,
    Label,
    ObjectMesh,
    Sampling,
    SurfaceLabels,
    classify,
    force_closure,
    label_surface,
    load_mesh,
    scan_surface,
)
from grasp3d.contact.contacts import tilted_normals
from grasp3d.errors import SettingError
from grasp3d.quality.wrenches import EpsilonOptions
from grasp3d.surface.contacts import grasps_at
from grasp3d.surface.grasp_numbers import hull_labels
from grasp3d.surface.vertex_fields import Reason
from grasp3d.system.context import running
from tests.helpers import shapes
from tests.helpers.tilts import all_combinations

degrees = math.radians

S, M, U = Label.S, Label.M, Label.U


@cache
def surface(name: str) -> ObjectMesh:
    if name == "mug":
        return load_mesh(shapes.LIBRARY / "mug.glb", max_edge=9.0)
    arrays, max_edge = {
        "ball": (shapes.sphere(2), 9.0),
        "box": (shapes.box((1.0, 1.5, 2.0)), 0.25),
        "coarse box": (shapes.box((1.0, 1.5, 2.0)), 0.5),
        "blob": (shapes.lopsided(3), 9.0),
    }[name]
    return load_mesh(arrays, max_edge=max_edge)


@cache
def labelled(name: str) -> SurfaceLabels:
    return label_surface(surface(name), GraspModel(method="extremes"))


def with_exact_labels(labels: SurfaceLabels) -> SurfaceLabels:
    """The same grasps with exact labels."""
    return labels.using(model=replace(labels.model, method="exact"))


def label_counts(labels: SurfaceLabels) -> np.ndarray:
    """Numbers of vertices by exact and sampled label."""
    counts = np.zeros((3, 3), dtype=np.int64)
    np.add.at(counts, (with_exact_labels(labels).label, labels.label), 1)
    return counts


def differing_area(labels: SurfaceLabels) -> float:
    areas = labels.mesh.vertex_areas / labels.mesh.vertex_areas.sum()
    return float(areas[with_exact_labels(labels).label != labels.label].sum())


def differs_as_allowed(labels: SurfaceLabels) -> bool:
    """Whether sampled labels differ from exact ones only as sampling can cause."""
    counts = label_counts(labels)
    return bool(counts[[U, U, S, S], [M, S, M, U]].sum() == 0)


def contacts_at(labels: SurfaceLabels, vertex: int) -> Contacts:
    """The grasp of a smooth vertex whose opposing contact is smooth as well."""
    mesh = labels.mesh
    return Contacts(
        [mesh.vertices[vertex] - mesh.center_mass, labels.partners[vertex, 0] - mesh.center_mass],
        [mesh.normals[vertex], labels.partner_normals[vertex, 0]],
        labels.model.friction,
    )


# Compared with the exact labels


@pytest.mark.slow
@pytest.mark.parametrize("name", ["ball", "box", "blob", "mug"])
def test_labels_differ_from_exact_ones_little_and_only_as_allowed(name: str) -> None:
    labels = labelled(name)
    plain = label_surface(surface(name))
    np.testing.assert_array_equal(plain.critical_angle, labels.critical_angle)
    np.testing.assert_array_equal(plain.label, with_exact_labels(labels).label)
    assert differs_as_allowed(labels)
    assert differing_area(labels) < 0.01
    if name == "blob":
        assert label_counts(labels).trace() < len(labels.label)
    for code, fraction in labels.fractions().items():
        areas = labels.mesh.vertex_areas
        assert fraction == pytest.approx(areas[labels.label == Label[code]].sum() / areas.sum())


@pytest.mark.slow
@pytest.mark.parametrize("resolution", [22.6, 60.0])
@pytest.mark.parametrize(
    ("name", "fixed"),
    [
        ("blob", (0.0, 0.0, -9.0)),
        ("box", (0.1, 0.2, -1.0)),
        ("box", (-0.5, 0.2, -1.0)),
        ("box", (-0.5, -0.75, -1.0)),
    ],
    ids=["blob", "face", "edge", "corner"],
)
def test_scans_differ_from_exact_ones_little_and_only_as_allowed(
    name: str, fixed: Any, resolution: float
) -> None:
    model = GraspModel(method="extremes", sensor_resolution=degrees(resolution))
    labels = scan_surface(surface(name), model, fixed=fixed)
    plain = scan_surface(surface(name), replace(model, method="exact"), fixed=fixed)
    np.testing.assert_array_equal(plain.label, with_exact_labels(labels).label)
    assert differs_as_allowed(labels)
    assert differing_area(labels) < 0.06
    assert len(set(labels.label)) > 1


@pytest.mark.slow
def test_more_normals_on_the_rims_approach_the_exact_labels() -> None:
    labels = with_exact_labels(labelled("blob"))
    contacts, alpha = labels.contacts.contacts(labels.model), labels.model.sensor_resolution
    wrong = []
    for count in (3, 6, 12, 24):
        found = classify(contacts, alpha, method="extremes", extreme_normals=count)
        wrong.append(int((found.label != labels.label).sum()))
    assert wrong == sorted(wrong, reverse=True)
    assert wrong[-1] < 0.2 * wrong[0]


# Compared with all combinations, one by one


@pytest.mark.slow
def test_labels_are_those_of_all_combinations_of_extreme_normals() -> None:
    labels = labelled("blob")
    seen = set()
    for vertex in range(0, len(labels.label), 15):
        contacts = contacts_at(labels, vertex)
        tested = list(tilted_normals(contacts.normals, labels.model.tilt, count=8))
        closed = force_closure(all_combinations(contacts, tested)).closed
        expected = S if closed.all() else M if closed.any() else U
        assert labels.label[vertex] == expected
        seen.add(expected)
    assert seen == {S, M}


@pytest.mark.slow
@pytest.mark.parametrize("torsion", [0.0, 0.1])
def test_epsilons_are_those_of_the_enumeration(torsion: float) -> None:
    model = GraspModel(method="extremes", torsion_radius=torsion)
    blob = load_mesh(shapes.sphere(1), max_edge=9.0)
    lopsided = load_mesh((blob.vertices * [1.0, 0.8, 1.3], blob.faces), max_edge=9.0)
    labels = label_surface(lopsided, model)
    for vertex in range(0, len(labels.label), 9):
        hard = contacts_at(labels, vertex)
        contacts = Contacts(hard.points, hard.normals, hard.friction, torsion)
        found = classify(
            contacts,
            model.sensor_resolution,
            method="extremes",
            options=EpsilonOptions(torque_scale=labels.mesh.torque_scale, rtol=1e-3),
        )
        assert labels.label[vertex] == found.label
        assert labels.epsilon_min[vertex] == pytest.approx(found.epsilon_min, rel=0.011)
        assert labels.epsilon_max[vertex] == pytest.approx(found.epsilon_max, rel=0.011)
        assert labels.epsilon[vertex] == pytest.approx(found.epsilon, rel=0.011)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["blob", "coarse box"])
def test_the_smallest_epsilon_is_above_zero_exactly_where_the_label_is_s(name: str) -> None:
    labels = labelled(name)
    smooth = labels.mesh.contact_normals.counts == 1
    positive = labels.epsilon_min > 0.0
    np.testing.assert_array_equal(positive[smooth], (labels.label == S)[smooth])
    assert (labels.label[positive] == S).all()
    assert (labels.epsilon_min <= 1.02 * labels.epsilon)[smooth].all()
    assert (labels.epsilon <= 1.02 * labels.epsilon_max)[smooth].all()
    assert (labels.epsilon_max[labels.label == U] == 0.0).all()
    assert {S, U if name != "blob" else M} <= set(labels.label)


def test_epsilon_of_exact_labels_bounds_that_of_method_extremes() -> None:
    labels = labelled("coarse box")
    plain = with_exact_labels(labels)
    smooth = labels.mesh.contact_normals.counts == 1
    assert (labels.epsilon_min >= 0.98 * plain.epsilon_min)[smooth].all()
    assert (labels.epsilon_max <= 1.02 * plain.epsilon_max)[smooth].all()
    np.testing.assert_array_equal(labels.epsilon, plain.epsilon)
    assert labels.model.tilts == "sampled_tilts"


# Creases


@pytest.mark.parametrize("friction", [0.3, 0.5, 0.9])
def test_edges_and_corners_of_a_box_are_not_stable(friction: float) -> None:
    model = GraspModel(method="extremes", friction=friction, sensor_resolution=degrees(10.0))
    labels = label_surface(surface("coarse box"), model)
    on_face = surface("coarse box").contact_normals.counts == 1
    assert (labels.label[on_face] == S).all()
    assert (labels.label[~on_face] != S).all()
    assert differs_as_allowed(labels)


def test_a_vertex_that_may_have_any_normal_is_not_stable() -> None:
    """The common tip of two pyramids may have any normal."""
    low = np.array([[-1.0, -1, -1], [1, -1, -1], [1, 1, -1], [-1, 1, -1], [0, 0, 0]])
    faces = np.array([[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4], [0, 2, 1], [0, 3, 2]])
    twice = trimesh.util.concatenate(
        [trimesh.Trimesh(side * low, faces[:, ::step], process=False)
         for side, step in ((1.0, 1), (-1.0, -1))]
    )  # fmt: skip
    mesh = load_mesh((np.asarray(twice.vertices), np.asarray(twice.faces)), max_edge=9.0)
    tips = np.flatnonzero((mesh.vertices == 0.0).all(axis=1))
    assert (mesh.contact_normals.counts[mesh.canonical[tips]] == 0).all()
    labels = label_surface(mesh, GraspModel(friction=1.0, method="extremes"))
    assert (labels.label[tips] != S).all()
    assert differs_as_allowed(labels)
    finer = load_mesh((np.asarray(twice.vertices), np.asarray(twice.faces)), max_edge=0.5)
    perfect = GraspModel(friction=1.0, sensor_resolution=0.0, method="extremes")
    scan = scan_surface(finer, perfect, fixed=(0, 0, 0))
    assert set(scan.label) == {U, M}


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
def test_duplicates_have_the_label_of_their_position() -> None:
    vertices, faces = shapes.box((1.0, 1.5, 2.0))
    soup = load_mesh((vertices[faces].reshape(-1, 3), np.arange(faces.size).reshape(-1, 3)))
    labels = label_surface(soup, GraspModel(method="extremes"))
    assert (soup.canonical != np.arange(len(soup.canonical))).any()
    np.testing.assert_array_equal(labels.label, labels.label[soup.canonical])
    np.testing.assert_array_equal(labels.epsilon_min, labels.epsilon_min[soup.canonical])
    assert (labels.label == S).any()


# Other models, threads, progress


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


@pytest.mark.parametrize("opening", [math.inf, 1e-3])
def test_progress_ends_at_1_with_and_without_grasps(opening: float) -> None:
    model = GraspModel(method="extremes")
    fractions: list[float] = []
    with running(progress=fractions.append):
        labels = label_surface(surface("box"), model, sampling=Sampling(max_opening=opening))
    assert labels.computed("label") is not None
    assert fractions == sorted(fractions)
    assert 0.0 <= fractions[0] < 0.3
    assert fractions[-1] == 1.0
    if opening < 1.0:
        assert (labels.label == U).all()
        assert np.isnan(labels.epsilon_max).all()
        return
    fractions.clear()
    with running(progress=fractions.append):
        _ = labels.epsilon_range
    assert fractions == sorted(fractions)
    assert fractions[-1] == 1.0


def test_exact_labels_need_no_enumeration() -> None:
    labels = label_surface(surface("ball"))
    fractions: list[float] = []
    with running(progress=fractions.append):
        labels.compute_labels()
    assert fractions == []


# Extreme settings


def test_tiny_friction_needs_the_exact_method() -> None:
    narrow = GraspModel(friction=1e-6, sensor_resolution=0.3, method="extremes")
    with pytest.raises(SettingError, match=r"narrow against the sensor's resolution.*'exact'"):
        label_surface(surface("ball"), narrow)
    assert (label_surface(surface("ball"), replace(narrow, method="exact")).label == M).all()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("friction", "resolution", "code"),
    [
        (0.5, 0.0, S),
        (0.5, 2.0 * math.atan(0.5), M),
        (0.5, 1.2, M),
        (10.0, 0.0, S),
        (10.0, 1.0, S),
        (10.0, 2.0 * math.atan(10.0), M),
    ],
)
def test_a_ball_with_extreme_settings(friction: float, resolution: float, code: Label) -> None:
    model = GraspModel(friction=friction, sensor_resolution=resolution, method="extremes")
    labels = label_surface(load_mesh(shapes.sphere(2), max_edge=9.0), model)
    assert set(labels.label) == set(with_exact_labels(labels).label) == {code}
