"""Tests of contacts on a surface and the sets of normals that they may have."""

import math

import numpy as np
import pytest

from grasp3d import GraspModel, load_mesh
from grasp3d.errors import ContactError
from grasp3d.mesh import ObjectMesh
from grasp3d.mesh.surface_points import SurfacePoints
from grasp3d.surface.contacts import SurfaceContacts, vertex_surface_points
from tests.helpers import shapes


def box() -> ObjectMesh:
    return load_mesh(shapes.box((1.0, 1.5, 2.0)), max_edge=0.6)


def at_vertices(mesh: ObjectMesh, vertices: object) -> SurfaceContacts:
    return SurfaceContacts(mesh, vertex_surface_points(mesh, np.array(vertices)))


def normals_of(contacts: SurfaceContacts, contact: int) -> np.ndarray:
    first, end = contacts.sets.start[contact : contact + 2]
    return contacts.sets.normals[first:end]


@pytest.mark.parametrize("shape", [shapes.sphere(2), shapes.box(), shapes.cone(0.3, sections=16)])
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
        np.testing.assert_array_equal(normals_of(contacts, i), own)


def test_duplicates_have_the_surface_point_of_their_position_and_strays_none() -> None:
    vertices, faces = shapes.sphere(2)
    mesh = load_mesh((np.vstack([vertices, vertices[:5], [[9.0, 9.0, 9.0]]]), faces))
    count = len(vertices)
    points = vertex_surface_points(mesh, np.arange(count + 6))
    np.testing.assert_array_equal(points.faces[count : count + 5], points.faces[:5])
    np.testing.assert_array_equal(points.weights[count : count + 5], points.weights[:5])
    assert points.faces[-1] == -1
    assert (points.faces[:-1] >= 0).all()
    assert vertex_surface_points(mesh, [[0, 1], [2, 3]]).weights.shape == (2, 2, 3)


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
    flat = SurfaceContacts(box(), SurfacePoints(faces[:, :1] % 12, weights[:, :1]))
    assert np.sort(np.abs(flat.normals), axis=2) == pytest.approx(
        np.tile([0.0, 0.0, 1.0], (50, 1, 1))
    )


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
        assert {tuple(row + 0.0) for row in normals_of(contacts, 0)} == expected
        assert contacts.on_crease.all()
        assert contacts.normals[0, 0] == pytest.approx(
            np.sum(list(expected), axis=0) / math.sqrt(2.0)
        )
    assert edges == 2
    contacts = at_vertices(mesh, [[mesh.faces[face, 0]]])
    assert len(contacts.sets.normals) == 3
    assert contacts.normals[0, 0] == pytest.approx(-np.sign(corners[0]) / math.sqrt(3.0))


def test_an_edge_of_four_faces_may_have_any_normal() -> None:
    vertices, faces = shapes.box()
    both = np.vstack([vertices, vertices + [1.0, 1.0, 0.0]])
    mesh = load_mesh((both, np.vstack([faces, faces + 8])), max_edge=9.0)
    middle = np.array([0.5, 0.5, 0.0])
    shared = (mesh.vertices[mesh.faces] == [0.5, 0.5, 0.5]).all(axis=2) | (
        mesh.vertices[mesh.faces] == [0.5, 0.5, -0.5]
    ).all(axis=2)  # (F, 3)
    face = int(np.flatnonzero(shared.sum(axis=1) == 2)[0])
    weights = 0.5 * shared[face]
    contacts = SurfaceContacts(mesh, SurfacePoints(np.array([[face]]), weights[None, None]))
    assert contacts.points[0, 0] == pytest.approx(middle)
    assert (contacts.sets.counts == 0).all()
    assert contacts.on_crease.all()
    assert np.linalg.norm(contacts.normals) == pytest.approx(1.0)


def test_the_common_tip_of_two_pyramids_has_the_normals_of_all_faces() -> None:
    low = np.array([[-1.0, -1, -1], [1, -1, -1], [1, 1, -1], [-1, 1, -1], [0, 0, 0]])
    faces = np.array([[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4], [0, 2, 1], [0, 3, 2]])
    both = np.vstack([low, -low[:4]])
    upper = np.where(faces == 4, 4, faces + 5)[:, ::-1]
    mesh = load_mesh((both, np.vstack([faces, upper])), max_edge=9.0)
    contacts = at_vertices(mesh, [[4]])
    assert (contacts.sets.counts == 0).all()
    assert len(contacts.sets.normals) == 8


def test_contacts_are_relative_to_the_centre_of_mass_with_the_friction_of_the_model() -> None:
    mesh = load_mesh((shapes.sphere(2)[0] + [1.0, 2.0, 3.0], shapes.sphere(2)[1]))
    contacts = at_vertices(mesh, [[0, 1, 2], [3, 4, 5]])
    made = contacts.contacts(GraspModel(friction=0.3, torsion_radius=0.1))
    assert made.points == pytest.approx(mesh.vertices[[[0, 1, 2], [3, 4, 5]]] - [1.0, 2.0, 3.0])
    assert made.normals == pytest.approx(contacts.normals)
    assert (made.friction == 0.3).all()
    assert (made.torsion_radius == 0.1).all()
    assert (contacts.size, contacts.count) == (2, 3)


@pytest.mark.parametrize("which", [slice(1, 3), np.array([2, 0]), np.array([True, False, True])])
def test_take_returns_the_chosen_grasps(which: slice | np.ndarray) -> None:
    contacts = at_vertices(box(), [[0, 9], [3, 14], [20, 5]])
    taken = contacts.take(which)
    np.testing.assert_array_equal(taken.points, contacts.points[which])
    np.testing.assert_array_equal(taken.on_crease, contacts.on_crease[which])
    rows = [normals_of(contacts, i) for g in np.arange(3)[which] for i in (2 * g, 2 * g + 1)]
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
    assert normals_of(contacts, 0).tolist() == [[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]]
    assert (contacts.normals[0] == 0.0).all()
    with pytest.raises(ContactError, match="no direction"):
        contacts.contacts(GraspModel())
    assert contacts.take(slice(1, 2)).contacts(GraspModel()).normals[0, 0, 2] == -1.0
