"""Contacts on a surface, the normals that they may have, and critical angles over all of these."""

import math
from functools import cache

import numpy as np
import pytest

from grasp3d import Contacts, GraspModel, critical_friction_angle, load_mesh, scan_surface
from grasp3d.errors import ContactError
from grasp3d.mesh import ObjectMesh
from grasp3d.mesh.surface_points import SurfacePoints
from grasp3d.quality.critical_angle import angle_brackets
from grasp3d.surface.contacts import SurfaceContacts, critical_angles, vertex_surface_points
from tests.helpers import shapes
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


@pytest.mark.parametrize(("count", "creased"), [(3, 2), (5, 1)])
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
        points = np.broadcast_to(contacts.points[g], tested.shape)
        angles = np.asarray(critical_friction_angle(Contacts(points, tested)))
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


def at_vertices(mesh: ObjectMesh, vertices: object) -> SurfaceContacts:
    return SurfaceContacts(mesh, vertex_surface_points(mesh, np.array(vertices)))


@pytest.mark.parametrize("shape", [shapes.box(), shapes.cone(0.3, sections=16)])
def test_a_vertex_has_its_own_position_and_set_on_any_of_its_faces(shape: shapes.Surface) -> None:
    mesh = load_mesh(shape, max_edge=9.0)
    corners = np.eye(3)[np.tile(np.arange(3), (len(mesh.faces), 1))]
    points = SurfacePoints(np.repeat(np.arange(len(mesh.faces))[:, None], 3, axis=1), corners)
    contacts = SurfaceContacts(mesh, points)
    np.testing.assert_array_equal(contacts.points, mesh.vertices[mesh.faces])
    np.testing.assert_array_equal(contacts.normals, mesh.normals[mesh.faces])
    np.testing.assert_array_equal(contacts.on_crease, mesh.contact_normals.counts[mesh.faces] != 1)
    sets = mesh.contact_normals
    for i, v in enumerate(mesh.faces.ravel()):
        own = sets.normals[sets.start[v] : sets.start[v] + sets.counts[v]]
        np.testing.assert_array_equal(set_of(contacts, 0, i), own)


def test_inside_a_face_the_normal_is_interpolated_between_its_corners() -> None:
    mesh = load_mesh(shapes.sphere(2), max_edge=9.0)
    rng = np.random.default_rng(0)
    faces, weights = rng.integers(len(mesh.faces), size=(50, 3)), rng.dirichlet(np.ones(3), (50, 3))
    contacts = SurfaceContacts(mesh, SurfacePoints(faces, weights))
    expected = (weights[..., None] * mesh.normals[mesh.faces[faces]]).sum(axis=2)
    expected /= np.linalg.norm(expected, axis=2, keepdims=True)
    np.testing.assert_allclose(contacts.normals, expected, atol=1e-12)
    np.testing.assert_array_equal(contacts.sets.normals, contacts.normals.reshape(-1, 3))
    assert not contacts.on_crease.any()


def test_sets_of_normals_on_an_edge_and_at_a_corner() -> None:
    mesh = load_mesh(shapes.box(), max_edge=9.0)
    face = int(np.flatnonzero((mesh.vertices[mesh.faces][:, :, 2] == 0.5).all(axis=1))[0])
    corners = mesh.vertices[mesh.faces[face]]
    edges = 0
    for i in range(3):
        weights = np.full(3, 0.5)
        weights[i] = 0.0
        contacts = SurfaceContacts(mesh, SurfacePoints(np.array([[face]]), weights[None, None]))
        middle = contacts.points[0, 0]
        if (np.abs(middle) == 0.5).sum() < 2:
            assert not contacts.on_crease[0, 0]  # the diagonal of a side
            continue
        edges += 1
        inward = -np.eye(3) * np.sign(middle)
        expected = {tuple(inward[k] + 0.0) for k in np.flatnonzero(np.abs(middle) == 0.5)}
        assert {tuple(row + 0.0) for row in set_of(contacts, 0, 0)} == expected
        assert contacts.on_crease.all()
        assert contacts.normals[0, 0] == pytest.approx(
            np.sum(list(expected), axis=0) / math.sqrt(2.0)
        )
    assert edges == 2
    contacts = at_vertices(mesh, [[mesh.faces[face, 0]]])
    assert len(contacts.sets.normals) == 3
    assert contacts.normals[0, 0] == pytest.approx(-np.sign(corners[0]) / math.sqrt(3.0))


def test_contacts_are_relative_to_the_centre_of_mass_with_the_friction_of_the_model() -> None:
    mesh = load_mesh((shapes.sphere(2)[0] + [1.0, 2.0, 3.0], shapes.sphere(2)[1]))
    contacts = at_vertices(mesh, [[0, 1, 2], [3, 4, 5]])
    made = contacts.contacts(GraspModel(friction=0.3, torsion_radius=0.1))
    assert made.points == pytest.approx(mesh.vertices[[[0, 1, 2], [3, 4, 5]]] - [1.0, 2.0, 3.0])
    assert made.normals == pytest.approx(contacts.normals)
    assert (made.friction == 0.3).all()
    assert (made.torsion_radius == 0.1).all()
    assert (contacts.size, contacts.count) == (2, 3)


@pytest.mark.parametrize("which", [slice(1, 3), np.array([2, 0])])
def test_take_returns_the_chosen_grasps(which: slice | np.ndarray) -> None:
    contacts = at_vertices(box(), [[0, 9], [3, 14], [20, 5]])
    taken = contacts.take(which)
    np.testing.assert_array_equal(taken.points, contacts.points[which])
    np.testing.assert_array_equal(taken.on_crease, contacts.on_crease[which])
    rows = [set_of(contacts, 0, i) for g in np.arange(3)[which] for i in (2 * g, 2 * g + 1)]
    np.testing.assert_array_equal(taken.sets.normals, np.concatenate(rows))
    none = contacts.take(np.array([], dtype=np.int64))
    assert (none.size, none.points.shape, none.sets.normals.shape) == (0, (0, 2, 3), (0, 3))


def test_normals_that_cancel_out_are_refused_as_contacts() -> None:
    """A sheet of zero thickness with two sides: normals at the rim are opposite."""
    square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    mesh = load_mesh(
        (np.vstack([square, square]), np.vstack([faces, faces[:, ::-1] + 4])), max_edge=9.0
    )
    weights = np.array([[[0.5, 0.5, 0.0]], [[0.2, 0.3, 0.5]]])
    contacts = SurfaceContacts(mesh, SurfacePoints(np.zeros((2, 1), dtype=np.int64), weights))
    assert (contacts.sets.counts == 0).tolist() == [True, False]
    assert set_of(contacts, 0, 0).tolist() == [[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]]
    assert (contacts.normals[0] == 0.0).all()
    with pytest.raises(ContactError, match="has length 0"):
        contacts.contacts(GraspModel())
    assert contacts.take(slice(1, 2)).contacts(GraspModel()).normals[0, 0, 2] == -1.0
