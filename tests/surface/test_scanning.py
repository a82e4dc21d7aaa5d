"""Three fingers and more on a surface: scans with several fixed fingers, and the search."""

import math
from functools import cache
from itertools import pairwise
from typing import Any

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
    scan_surface,
)
from grasp3d.errors import SettingError
from grasp3d.pictures.colors import corner_codes
from grasp3d.pictures.subject import subject_of
from grasp3d.surface import Reason
from grasp3d.surface.contacts import critical_angles, grasps_at
from grasp3d.surface.multifinger import search
from grasp3d.surface.sweeps import mean_sweep, sweep
from grasp3d.system.context import running
from tests.helpers import shapes
from tests.helpers.solids import box_mesh, sphere_mesh

S, M, U = Label.S, Label.M, Label.U
degrees = math.radians


@cache
def ball() -> ObjectMesh:
    return load_mesh(shapes.sphere(3), max_edge=9.0)


@cache
def box() -> ObjectMesh:
    return load_mesh(shapes.box((1.0, 1.4, 2.0)), max_edge=0.3)


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


def test_too_many_fixed_fingers_are_refused() -> None:
    with pytest.raises(SettingError, match="fingers must be"):
        scan_surface(ball(), fixed=ball().vertices[:40])
    with pytest.raises(SettingError, match="combinations"):
        scan_surface(ball(), GraspModel(method="extremes"), fixed=ball().vertices[:7])


@cache
def on_one_face() -> SurfaceLabels:
    """Two fingers on the top of a box, and the third anywhere on it."""
    model = GraspModel(friction=math.tan(degrees(50.0)), sensor_resolution=degrees(60.0))
    return scan_surface(box(), model, fixed=[[0.2, 0.3, 1.0], [-0.2, -0.4, 1.0]])


def top() -> np.ndarray:
    return np.asarray((box().vertices[:, 2] == 1.0) & (box().contact_normals.counts == 1))


@pytest.mark.parametrize(("beta", "alpha"), [(50.0, 60.0), (60.0, 59.0), (89.0, 0.0)])
def test_three_fingers_on_one_face_are_u_below_90_degrees(beta: float, alpha: float) -> None:
    scan = on_one_face().relabel(friction=math.tan(degrees(beta)), sensor_resolution=degrees(alpha))
    assert top().sum() > 20
    assert (scan.critical_angle[top()] == math.pi / 2.0).all()
    assert (scan.label[top()] == U).all()


@pytest.mark.parametrize(("beta", "alpha"), [(50.0, 90.0), (60.0, 61.0), (10.0, 178)])
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


def test_a_ball_is_s_everywhere_for_three_fingers() -> None:
    labels = label_surface(ball(), GraspModel(fingers=3), sampling=Sampling(candidates=16))
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
    assert labels.model.epsilon_rank == 6
    assert (labels.epsilon > 0.0).all()
    assert (labels.epsilon_min <= labels.epsilon).all()
    assert (labels.epsilon <= labels.epsilon_max).all()


SEARCH_ANGLE = math.radians(80.0)
ROUNDING = 2e-4
"""Brackets of critical angles are 1e-4 wide [rad]."""


@cache
def wedge() -> ObjectMesh:
    """A prism over an isosceles triangle: most points have no opposite face."""
    corners = np.array([[-1.0, -0.6], [1.0, -0.6], [0.0, 1.1]])
    vertices = np.concatenate([np.c_[corners, np.full(3, h)] for h in (-0.7, 0.7)])
    faces = [[0, 2, 1], [3, 4, 5]]
    for i in range(3):
        j = (i + 1) % 3
        faces += [[i, j, j + 3], [i, j + 3, i + 3]]
    return load_mesh((vertices, np.array(faces)), max_edge=0.22)


@cache
def tapered() -> ObjectMesh:
    """A cone."""
    return load_mesh(shapes.cone(math.radians(25.0), sections=24), max_edge=0.4)


@cache
def labelled(shape: str, fingers: int, **sampling: Any) -> SurfaceLabels:
    mesh = {
        "wedge": wedge,
        "tapered": tapered,
        "box": lambda: box_mesh((2.0, 1.5, 1.0), max_edge=0.45),
    }[shape]()
    settings = Sampling(**{"search_angle": SEARCH_ANGLE, "candidates": 32, **sampling})
    return label_surface(mesh, GraspModel(fingers=fingers), sampling=settings)


def contacts_of(labels: SurfaceLabels, vertices: np.ndarray) -> np.ndarray:
    """All contacts of the vertices' best grasps, (k, n, 3)."""
    first = labels.mesh.vertices[vertices]
    return np.concatenate([first[:, None], labels.partners[vertices]], axis=1)


@pytest.mark.slow
def test_the_result_does_not_depend_on_threads_and_only_the_seed_changes_it() -> None:
    mesh = wedge()
    sampling = Sampling(candidates=16)
    found = [running(threads=threads)(search)(mesh, 4, sampling, 0.7) for threads in (1, 3)]
    for other in found[1:]:
        assert np.array_equal(found[0].partner_points.faces, other.partner_points.faces)
        assert np.array_equal(found[0].partner_points.weights, other.partner_points.weights)
        assert found[0].evaluated == other.evaluated
    another = search(mesh, 4, Sampling(candidates=16, seed=7), 0.7)
    assert not np.array_equal(found[0].partner_points.weights, another.partner_points.weights)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("shape", "factor"), [("wedge", 1000.0), ("tapered", 7.3), ("box", 0.0254)]
)
def test_the_unit_of_lengths_changes_no_letter(shape: str, factor: float) -> None:
    """On regular shapes many grasps are equally good, and rounding errors must not choose."""
    mesh = labelled(shape, 3).mesh
    both = [load_mesh((f * mesh.vertices, mesh.faces), max_edge=10.0 * f) for f in (1.0, factor)]
    sampling = Sampling(search_angle=SEARCH_ANGLE, candidates=32)
    for fingers in (3, 4):
        model = GraspModel(fingers=fingers)
        one, other = (label_surface(of, model, sampling=sampling) for of in both)
        moved = other.partners / both[1].size - one.partners / both[0].size
        assert np.abs(np.nan_to_num(moved)).max() < 1e-6
        assert np.array_equal(one.label, other.label)


@pytest.mark.slow
@pytest.mark.parametrize(("shape", "fingers"), [("wedge", 3), ("wedge", 4), ("tapered", 5)])
def test_every_grasp_has_the_angle_of_its_label(shape: str, fingers: int) -> None:
    """Contacts lie on the surface; normals and angles are those of the grasp itself."""
    labels = labelled(shape, fingers)
    mesh = labels.mesh
    vertices = np.flatnonzero(np.isfinite(labels.critical_angle))
    assert len(vertices) > 0.8 * mesh.on_surface.sum()
    smooth = vertices[mesh.contact_normals.counts[mesh.canonical[vertices]] == 1][::7]
    grasps = grasps_at(mesh, labels.partner_points, smooth)
    assert not grasps.on_crease.any()
    assert grasps.points == pytest.approx(contacts_of(labels, smooth), abs=1e-12)
    model = GraspModel(friction=1.0, fingers=fingers)
    outcome = classify(grasps.contacts(model), 0.0)
    assert labels.critical_angle[smooth] == pytest.approx(
        outcome.critical_friction_angle, abs=ROUNDING
    )


@pytest.mark.slow
@pytest.mark.parametrize("shape", ["wedge", "tapered", "box"])
def test_more_fingers_never_make_a_vertex_worse(shape: str) -> None:
    """Each finger is added to the best grasp of one finger less."""
    angles = [labelled(shape, n).critical_angle for n in (3, 4, 5)]
    for fewer, more in pairwise(angles):
        # Nearly rays make a thin hull, which is surely closed at a slightly larger angle.
        assert (more <= fewer + 3.0 * ROUNDING).all()
    # On the others three fingers are as good as any number.
    assert (angles[1] < angles[0] - 0.01).any() or shape != "tapered"


@pytest.mark.slow
def test_contacts_keep_the_limits_of_distances() -> None:
    low, high = 0.4, 1.5
    labels = labelled("wedge", 4, min_opening=low, max_opening=high)
    vertices = np.flatnonzero(np.isfinite(labels.critical_angle))
    assert len(vertices) > 100
    contacts = contacts_of(labels, vertices)
    distances = np.linalg.norm(contacts[:, :, None] - contacts[:, None], axis=-1)
    distances_of_pairs = distances[:, *np.triu_indices(4, 1)]
    assert distances_of_pairs.min() >= low - 1e-9
    assert distances_of_pairs.max() <= high + 1e-9
    assert labels.opening[vertices] == pytest.approx(distances_of_pairs.max(axis=1))


@pytest.mark.slow
def test_a_ball_is_force_closed_with_any_friction() -> None:
    mesh = sphere_mesh(subdivisions=2)
    model = GraspModel(friction=0.02, sensor_resolution=0.0, fingers=4)
    labels = label_surface(mesh, model)
    assert (labels.label == Label.S).all()
    assert (labels.epsilon > 0.0).all()
