"""Tests of three fingers and more on a surface: scans with several fixed fingers, and labels."""

import math
from functools import cache
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
)
from grasp3d.errors import SettingError
from grasp3d.mesh import ObjectMesh
from grasp3d.mesh.surface_points import SurfacePoints
from grasp3d.pictures.colors import corner_codes
from grasp3d.pictures.subject import subject_of
from grasp3d.stability.label import label_angles, unstable_from
from grasp3d.surface import Reason
from grasp3d.surface import labelling as search_module
from grasp3d.surface.antipodal import FoundGrasps
from grasp3d.surface.contacts import critical_angles, grasps_at
from grasp3d.surface.sweeps import mean_sweep, sweep
from tests.helpers import shapes

S, M, U = Label.S, Label.M, Label.U
degrees = math.radians


@cache
def ball() -> ObjectMesh:
    return load_mesh(shapes.sphere(3), max_edge=9.0)


@cache
def box() -> ObjectMesh:
    return load_mesh(shapes.box((1.0, 1.4, 2.0)), max_edge=0.3)


def on_equator(angle: float) -> tuple[float, float, float]:
    return (math.cos(degrees(angle)), math.sin(degrees(angle)), 0.0)


# Scans with several fixed fingers


def test_three_fingers_around_a_ball_are_force_closed_at_any_friction() -> None:
    mesh = load_mesh(shapes.sphere(4), max_edge=9.0)
    scan = scan_surface(
        mesh, GraspModel(friction=0.2), fixed=[on_equator(120.0), on_equator(240.0)]
    )
    assert scan.model.fingers == 3
    nearest = int(np.argmin(np.linalg.norm(mesh.vertices - on_equator(0.0), axis=1)))
    assert scan.critical_angle[nearest] < 0.02
    # On the side of the two fixed fingers grasps need friction.
    same_side = mesh.vertices[:, 0] < -0.9
    assert scan.critical_angle[same_side].min() > 0.5


@pytest.mark.slow
@pytest.mark.parametrize("count", [2, 3])
def test_labels_of_a_scan_are_those_of_classify(count: int) -> None:
    mesh = load_mesh(shapes.lopsided(), max_edge=9.0)
    corners = [(-0.6, 0.9, 0.0), (-0.6, -0.9, 0.1), (-0.5, -0.8, 0.3)][:count]
    fixed = mesh.vertices[[np.argmax(mesh.vertices @ corner) for corner in corners]]
    model = GraspModel(friction=0.5, sensor_resolution=0.3)
    scan = scan_surface(mesh, model, fixed=fixed)
    vertices = np.arange(0, len(mesh.vertices), 37)
    points = np.concatenate([mesh.vertices[vertices, None], scan.partners[vertices]], axis=1)
    normals = np.concatenate([mesh.normals[vertices, None], scan.partner_normals[vertices]], axis=1)
    label = classify(Contacts(points, normals, model.friction), model.sensor_resolution).label
    found = scan.reason[vertices] == Reason.FOUND
    np.testing.assert_array_equal(scan.label[vertices][found], label[found])
    assert set(label[found]) == {S, M, U}
    largest = np.linalg.norm(points[:, :, None] - points[:, None], axis=3).max(axis=(1, 2))
    assert scan.opening[vertices] == pytest.approx(largest)
    assert (scan.grip == 0).all()
    assert scan.partners.shape == (len(mesh.vertices), count, 3)
    assert scan.partners[0] == pytest.approx(fixed)


def test_a_finger_fixed_twice_equals_one_finger() -> None:
    pole = (0.0, 0.0, 1.0)
    one = scan_surface(ball(), fixed=pole)
    two = scan_surface(ball(), fixed=[pole, pole])
    np.testing.assert_array_equal(one.reason, two.reason)
    found = one.reason == Reason.FOUND
    expected = np.minimum(one.critical_angle[found], math.pi / 2.0)
    assert two.critical_angle[found] == pytest.approx(expected, abs=2e-4)


def test_vertices_at_a_fixed_finger_have_no_grasp() -> None:
    vertices, faces = shapes.sphere(2)
    mesh = load_mesh((np.vstack([vertices, vertices[:3], [[9.0, 9.0, 9.0]]]), faces), max_edge=9.0)
    scan = scan_surface(mesh, fixed=vertices[[0, 5]])
    count = len(vertices)
    same = np.flatnonzero(scan.reason == Reason.SAME_POINT)
    assert same.tolist() == [0, 5, count]
    assert scan.reason[-1] == Reason.OFF_SURFACE
    assert (scan.label[same] == U).all()
    assert np.isinf(scan.critical_angle[same]).all()
    assert np.isnan(scan.epsilon[same]).all()
    np.testing.assert_array_equal(scan.critical_angle[count:-1], scan.critical_angle[:3])


def test_scans_consider_all_normals_at_creases() -> None:
    mesh = box()
    scan = scan_surface(mesh, fixed=[[0.5, 0.2, 0.3], [-0.5, 0.7, 0.1]])  # the second on an edge
    found = np.flatnonzero(scan.reason == Reason.FOUND)
    grasps = grasps_at(mesh, scan.partner_points, found)
    assert grasps.on_crease[:, 2].all()
    worst, best = critical_angles(grasps)
    np.testing.assert_array_equal(scan.critical_angle[found], worst)
    np.testing.assert_array_equal(scan.critical_angle_best[found], best)
    assert (best < worst - 0.1).mean() > 0.5
    assert scan.partner_normals[0, 1] == pytest.approx([math.sqrt(0.5), -math.sqrt(0.5), 0.0])


@pytest.mark.slow
def test_extreme_normals_of_three_fingers_never_contradict_the_exact_labels() -> None:
    mesh = load_mesh(shapes.sphere(2), max_edge=9.0)
    fixed = [on_equator(60.0), on_equator(180.0)]
    settings: dict[str, Any] = {"friction": 0.5, "sensor_resolution": 0.2}
    model = GraspModel(**settings, method="extremes")
    sampled = scan_surface(mesh, model, fixed=fixed)
    exact = scan_surface(mesh, GraspModel(**settings), fixed=fixed)
    assert (sampled.label[exact.label == S] == S).all()
    assert (sampled.label[exact.label == U] == U).all()
    assert (sampled.label == exact.label).mean() > 0.8
    assert set(exact.label) == {S, M, U}
    found = exact.reason == Reason.FOUND
    assert (exact.epsilon_min[found] <= exact.epsilon[found]).all()
    assert (exact.epsilon[found] <= exact.epsilon_max[found]).all()
    assert ((sampled.epsilon_min > 0.0) == (sampled.label == S))[found].all()


def test_too_many_fixed_fingers_are_refused() -> None:
    with pytest.raises(SettingError, match="fingers must be"):
        scan_surface(ball(), fixed=ball().vertices[:40])
    with pytest.raises(SettingError, match="combinations"):
        scan_surface(ball(), GraspModel(method="extremes"), fixed=ball().vertices[:7])


# Labels from 90 degrees on


@cache
def on_one_face() -> SurfaceLabels:
    """Two fingers on the top of a box, and the third anywhere on it."""
    model = GraspModel(friction=math.tan(degrees(50.0)), sensor_resolution=degrees(60.0))
    return scan_surface(box(), model, fixed=[[0.2, 0.3, 1.0], [-0.2, -0.4, 1.0]])


def top() -> np.ndarray:
    return np.asarray((box().vertices[:, 2] == 1.0) & (box().contact_normals.counts == 1))


@pytest.mark.parametrize(("beta", "alpha"), [(5.0, 0.0), (50.0, 60.0), (60.0, 59.0), (89.0, 0.0)])
def test_three_fingers_on_one_face_are_u_below_90_degrees(beta: float, alpha: float) -> None:
    scan = on_one_face().relabel(friction=math.tan(degrees(beta)), sensor_resolution=degrees(alpha))
    assert top().sum() > 20
    assert (scan.critical_angle[top()] == math.pi / 2.0).all()
    assert (scan.label[top()] == U).all()


@pytest.mark.parametrize(("beta", "alpha"), [(50.0, 80.0), (50.0, 90.0), (60.0, 61.0), (10.0, 178)])
def test_no_grasp_of_three_fingers_is_u_from_90_degrees_on(beta: float, alpha: float) -> None:
    """At a friction angle of 50 degrees, tilts of 45 degrees inward are force-closed."""
    scan = on_one_face().relabel(friction=math.tan(degrees(beta)), sensor_resolution=degrees(alpha))
    found = scan.reason == Reason.FOUND
    assert (scan.label[found] != U).all()
    assert (scan.label[top()] == M).all()
    assert (scan.label[~found] == U).all()
    fractions = scan.angle_distribution().fractions(
        friction=scan.model.friction, sensor_resolution=scan.model.sensor_resolution
    )
    assert fractions == pytest.approx(scan.fractions())
    assert fractions["U"] == pytest.approx(scan.fractions()["U"])
    drawn = corner_codes(subject_of(scan))
    assert (drawn[found[scan.mesh.corner_normals.vertices]] != U).all()


def test_fractions_are_those_of_the_labels_at_any_setting() -> None:
    labels = on_one_face()
    distribution = labels.angle_distribution()
    for friction in (0.3, 1.0, 3.0):
        for alpha in (0.0, 0.4, 1.0, 2.0, 3.0):
            fractions = distribution.fractions(friction=friction, sensor_resolution=alpha)
            labelled = labels.relabel(friction=friction, sensor_resolution=alpha)
            assert fractions == pytest.approx(labelled.fractions())
    swept = sweep(distribution, friction=[0.3, 3.0], sensor_resolution=[0.0, 2.0])
    assert mean_sweep([swept, swept]).unstable == pytest.approx(swept.unstable)
    pairs = scan_surface(box(), fixed=(0.2, 0.3, 1.0)).angle_distribution()
    other = sweep(pairs, friction=[0.3, 3.0], sensor_resolution=[0.0, 2.0])
    with pytest.raises(SettingError, match="fingers"):
        mean_sweep([swept, other])


def test_two_fingers_keep_their_threshold_beyond_90_degrees() -> None:
    assert unstable_from(1.0, 0.8, 2) == pytest.approx(1.8)
    assert unstable_from(1.0, 0.5, 3) == pytest.approx(1.5)
    assert unstable_from([1.0, 0.5], 0.8, 3) == pytest.approx([math.inf, 1.3])
    angles = np.array([0.1, 1.5, 2.0, math.inf])
    for fingers, expected in ((2, [M, M, U, U]), (3, [M, M, M, U])):
        model = GraspModel(friction=math.tan(1.0), sensor_resolution=1.8, fingers=fingers)
        assert label_angles(angles, angles, model).tolist() == expected


# Labels of searched grasps


def grasps_with_partners(mesh: ObjectMesh, others: Any) -> FoundGrasps:
    """Result of a search with given opposing vertices, -1: no grasp."""
    from grasp3d.surface.contacts import vertex_surface_points

    numbers = np.asarray(others)  # (V, n - 1)
    points = vertex_surface_points(mesh, np.maximum(numbers, 0))
    faces = np.where(numbers >= 0, points.faces, -1)
    reason = np.where((numbers >= 0).all(axis=1), Reason.FOUND, Reason.NO_PARTNER)
    none = np.zeros(len(reason))
    return FoundGrasps(
        worst=none,
        best=none,
        grip=none.astype(np.int8),
        partner_points=SurfacePoints(faces, points.weights),
        reason=reason.astype(np.uint8),
        evaluated=1234,
    )


@pytest.mark.slow
def test_labels_evaluate_the_grasps_that_were_found(monkeypatch: pytest.MonkeyPatch) -> None:
    vertices, faces = shapes.box((1.0, 1.4, 2.0))
    mesh = load_mesh((np.vstack([vertices, vertices[:2]]), faces), max_edge=0.7)
    count, rng = len(mesh.vertices), np.random.default_rng(0)
    used = np.unique(mesh.faces)
    smooth = used[mesh.contact_normals.counts[used] == 1]
    others = rng.choice(smooth, (count, 2))
    others[3] = -1
    found = grasps_with_partners(mesh, others[mesh.canonical])
    arguments: list[Any] = []

    def search(*given: Any, **_: Any) -> FoundGrasps:
        arguments.extend(given)
        return found

    monkeypatch.setattr(search_module, "search", search)
    model = GraspModel(friction=0.8, fingers=3)
    labels = label_surface(mesh, model)
    assert arguments[1] == 3
    assert arguments[3] == pytest.approx(model.friction_angle + model.tilt)
    with_grasp = used[used != 3]
    worst, best = critical_angles(grasps_at(mesh, labels.partner_points, with_grasp))
    np.testing.assert_array_equal(labels.critical_angle[with_grasp], worst)
    np.testing.assert_array_equal(labels.critical_angle_best[with_grasp], best)
    assert (best < worst).any()
    assert labels.label[3] == U
    assert labels.reason[3] == Reason.NO_PARTNER
    assert math.isinf(labels.critical_angle[3])
    assert np.isnan(labels.partners[3]).all()
    assert labels.partners[4] == pytest.approx(mesh.vertices[others[4]])
    duplicates = np.arange(len(vertices), len(vertices) + 2)
    np.testing.assert_array_equal(labels.critical_angle[duplicates], labels.critical_angle[:2])
    np.testing.assert_array_equal(labels.partners[duplicates], labels.partners[:2])
    assert labels.search.evaluated == 1234
    assert labels.search.rays == 0
    assert (
        labels.label == label_angles(labels.critical_angle, labels.critical_angle_best, model)
    ).all()


@cache
def searched(fingers: int) -> SurfaceLabels:
    return label_surface(ball(), GraspModel(fingers=fingers), sampling=Sampling(candidates=16))


def test_a_ball_is_s_everywhere_for_three_fingers() -> None:
    labels = searched(3)
    assert (labels.label == S).all()
    assert labels.critical_angle.max() < 0.1
    assert labels.partners.shape == (len(ball().vertices), 2, 3)
    assert np.linalg.norm(labels.partners, axis=2) == pytest.approx(1.0, abs=0.02)
    assert labels.search.evaluated > 0
    found = Contacts(
        np.concatenate([ball().vertices[:, None], labels.partners], axis=1),
        np.concatenate([ball().normals[:, None], labels.partner_normals], axis=1),
        labels.model.friction,
    )
    label = classify(found, labels.model.sensor_resolution).label
    np.testing.assert_array_equal(label, labels.label)


def test_epsilon_of_three_fingers_is_in_all_six_dimensions() -> None:
    labels = searched(3)
    assert labels.model.epsilon_rank == 6
    assert (labels.epsilon > 0.0).all()
    assert (labels.epsilon_min <= labels.epsilon).all()
    assert (labels.epsilon <= labels.epsilon_max).all()
