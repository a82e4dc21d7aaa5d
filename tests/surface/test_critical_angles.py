"""Tests of critical angles over all normals that contacts on a surface may have."""

import math
from functools import cache

import numpy as np
import pytest

from grasp3d import (
    Contacts,
    GraspModel,
    Label,
    classify,
    critical_friction_angle,
    load_mesh,
    scan_surface,
)
from grasp3d.mesh import ObjectMesh
from grasp3d.mesh.surface_points import SurfacePoints
from grasp3d.quality.critical_angle import angle_brackets
from grasp3d.surface.contacts import SurfaceContacts, critical_angles, vertex_surface_points
from tests.helpers import oracles, shapes
from tests.helpers.tilts import within_sets

Floats = np.ndarray
TOLERANCE = 1e-4


@cache
def box() -> ObjectMesh:
    return load_mesh(shapes.box((1.0, 1.4, 2.0)), max_edge=0.5)


def random_grasps(count: int, size: int, seed: int, creased: int) -> SurfaceContacts:
    """Random grasps at a box's vertices, `creased` contacts of each on edges and corners."""
    mesh, rng = box(), np.random.default_rng(seed)
    smooth = mesh.contact_normals.counts == 1
    columns = [
        rng.choice(np.flatnonzero(~smooth if i < creased else smooth), size) for i in range(count)
    ]
    return SurfaceContacts(mesh, vertex_surface_points(mesh, np.stack(columns, axis=1)))


def set_of(contacts: SurfaceContacts, grasp: int, finger: int) -> Floats:
    number = grasp * contacts.count + finger
    return contacts.sets.normals[contacts.sets.start[number] : contacts.sets.start[number + 1]]


def angle_at(contacts: SurfaceContacts, grasp: int, normals: Floats) -> Floats:
    """Critical angles of one grasp at many choices of normals (k, n, 3)."""
    points = np.broadcast_to(contacts.points[grasp], normals.shape)
    return np.asarray(critical_friction_angle(Contacts(points, normals)))


# Two contacts


def test_two_contacts_agree_with_a_scan() -> None:
    mesh = box()
    vertices = np.unique(mesh.faces)
    for fixed in (np.array([0.1, 0.2, 1.0]), np.array([0.5, 0.7, 0.33]), mesh.vertices[0]):
        scan = scan_surface(mesh, fixed=fixed)
        first = vertex_surface_points(mesh, vertices[:, None])
        other = scan.distinct_contacts.take(np.zeros(len(vertices), dtype=np.int64)).surface_points
        pairs = SurfacePoints(
            np.concatenate([first.faces, other.faces[:, 1:]], axis=1),
            np.concatenate([first.weights, other.weights[:, 1:]], axis=1),
        )
        worst, best = critical_angles(SurfaceContacts(mesh, pairs))
        assert worst == pytest.approx(scan.critical_angle[vertices], abs=1e-9)
        # In a scan no finger fits where another one is, whatever their normals.
        apart = np.isfinite(worst)
        assert best[apart] == pytest.approx(scan.critical_angle_best[vertices][apart], abs=1e-9)
        assert np.isinf(scan.critical_angle_best[vertices][~apart]).all()
        assert (worst > best).any()


def test_two_contacts_bound_every_choice_of_normals() -> None:
    contacts = random_grasps(2, 40, 1, creased=2)
    worst, best = critical_angles(contacts)
    rng = np.random.default_rng(0)
    for g in range(contacts.size):
        if not np.isfinite(worst[g]):
            continue
        first, second = contacts.points[g]
        for _ in range(20):
            normals = [within_sets(set_of(contacts, g, i)[None], rng)[0] for i in (0, 1)]
            angle = oracles.critical_angle(first, normals[0], second, normals[1])
            assert best[g] - 1e-9 <= angle <= worst[g] + 1e-9


# Three and more


@pytest.mark.parametrize("count", [3, 4, 5])
def test_smooth_contacts_have_one_critical_angle(count: int) -> None:
    contacts = random_grasps(count, 30, 2, creased=0)
    worst, best = critical_angles(contacts)
    decided = worst > 1e-3  # with so little friction closure is as small as rounding errors
    np.testing.assert_array_equal(worst[decided], best[decided])
    assert (best <= worst).all()
    expected = critical_friction_angle(Contacts(contacts.points, contacts.normals))
    assert worst == pytest.approx(expected, abs=TOLERANCE)


@pytest.mark.parametrize(("count", "creased"), [(3, 1), (3, 2), (5, 1)])
def test_no_choice_of_normals_is_beyond_the_angles(count: int, creased: int) -> None:
    contacts = random_grasps(count, 12, 10 * count + creased, creased)
    worst, best = critical_angles(contacts)
    rng = np.random.default_rng(0)
    for g in range(contacts.size):
        sets = [set_of(contacts, g, i) for i in range(count)]
        normals = [
            np.concatenate([faces, *(within_sets(faces[None], rng) for _ in range(60))])
            for faces in sets
        ]
        tested = np.stack([rows[rng.integers(len(rows), size=200)] for rows in normals], axis=1)
        angles = angle_at(contacts, g, tested)
        assert angles.max() <= worst[g] + TOLERANCE
        assert angles.min() >= best[g] - TOLERANCE
    assert (worst > best).any()


@pytest.mark.parametrize("count", [3, 4])
def test_contacts_on_creases_have_the_caps_about_their_normals(count: int) -> None:
    contacts = random_grasps(count, 40, count, creased=2)
    worst, best = critical_angles(contacts)
    tilt = np.asarray(contacts.tilts(GraspModel(sensor_resolution=0.0)))
    assert (tilt[:, :2] > 0.5).all()
    points, normals = contacts.points, contacts.normals
    _, high = angle_brackets(points, normals, -tilt, tolerance=TOLERANCE)
    low, _ = angle_brackets(points, normals, tilt, tolerance=TOLERANCE)
    assert worst == pytest.approx(high, abs=TOLERANCE)
    assert best == pytest.approx(low, abs=TOLERANCE)


@pytest.mark.slow
def test_labels_are_those_of_classify() -> None:
    contacts = random_grasps(3, 60, 4, creased=1)
    worst, best = critical_angles(contacts)
    plain = contacts.contacts(GraspModel())
    seen = set()
    for g in range(contacts.size):
        grasp = Contacts(plain.points[g], plain.normals[g], 0.6)
        creases = {0: set_of(contacts, g, 0)}
        for friction, alpha in ((0.2, 0.1), (0.6, 0.4), (1.2, 0.2), (3.0, 0.1)):
            beta, tilt = math.atan(friction), alpha / 2.0
            if min(abs(worst[g] - beta + tilt), abs(best[g] - beta - tilt)) < 1e-3:
                continue
            label = Label.S if worst[g] < beta - tilt else Label.M
            label = Label.U if best[g] >= beta + tilt else label
            rough = grasp.with_friction(friction)
            assert classify(rough, alpha, creases=creases).label == label
            seen.add(label)
            if g < 12 and label != Label.M:
                sampled = classify(
                    rough, alpha, creases=creases, method="extremes", extreme_normals=4
                ).label
                assert sampled == label
    assert seen == {Label.S, Label.M, Label.U}


def test_a_location_error_widens_the_angles() -> None:
    for count in (2, 3, 4):
        contacts = random_grasps(count, 30, 6, creased=1)
        worst, best = critical_angles(contacts)
        unsure = critical_angles(contacts, location_error=0.02)
        assert (unsure[0] >= worst - TOLERANCE).all()
        assert (unsure[1] <= best + TOLERANCE).all()
        assert count == 2 or (unsure[1] == 0.0).all()


def test_contacts_with_any_normal_are_ambiguous() -> None:
    vertices, faces = shapes.box()
    both = np.vstack([vertices, vertices + [1.0, 1.0, 0.0]])
    mesh = load_mesh((both, np.vstack([faces, faces + 8])), max_edge=0.6)
    shared = (np.abs(mesh.vertices - [0.5, 0.5, 0.0]) < [1e-9, 1e-9, 0.4]).all(axis=1)
    edge = int(np.flatnonzero(shared)[0])
    smooth = np.flatnonzero(mesh.contact_normals.counts == 1)
    grasps = np.array([[edge, smooth[0], smooth[9]], [smooth[1], smooth[20], edge]])
    contacts = SurfaceContacts(mesh, vertex_surface_points(mesh, grasps))
    assert (contacts.sets.counts == 0).sum() == 2
    worst, best = critical_angles(contacts)
    assert (worst == math.pi / 2.0).all()
    assert best == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("count", [2, 3, 4])
def test_contacts_at_one_point_are_no_grasp(count: int) -> None:
    corner = int(np.flatnonzero(box().contact_normals.counts == 3)[0])
    smooth = int(np.flatnonzero(box().contact_normals.counts == 1)[0])
    grasps = np.array([[corner] * count, [smooth] * count])
    worst, best = critical_angles(SurfaceContacts(box(), vertex_surface_points(box(), grasps)))
    assert np.isinf(worst).all()
    # Friction may let them push against each other at a corner, where normals differ.
    assert best == pytest.approx([math.pi / 2.0 - math.acos(math.sqrt(1.0 / 3.0)), math.pi / 2.0])


def test_a_duplicated_contact_does_not_change_the_angle() -> None:
    """Three contacts, two of them at one point, equal the grasp of two."""
    mesh = load_mesh(shapes.sphere(2), max_edge=9.0)
    rng = np.random.default_rng(0)
    pairs = rng.integers(len(mesh.vertices), size=(60, 2))
    pairs = pairs[pairs[:, 0] != pairs[:, 1]]
    two, _ = critical_angles(SurfaceContacts(mesh, vertex_surface_points(mesh, pairs)))
    duplicated = SurfaceContacts(mesh, vertex_surface_points(mesh, pairs[:, [0, 1, 1]]))
    three, _ = critical_angles(duplicated)
    assert three == pytest.approx(np.minimum(two, math.pi / 2.0), abs=2.0 * TOLERANCE)
