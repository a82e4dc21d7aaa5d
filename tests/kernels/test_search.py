"""Kernels of the search: the best point of a face, and straight walks over a surface."""

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from grasp3d import ObjectMesh, load_mesh
from grasp3d._kernels.search.descent import best_of_face, make_scratch
from grasp3d._kernels.search.face_contacts import NONE, PairDomain, cosine_at
from grasp3d._kernels.surface.surface_contacts import walk
from grasp3d.arrays import Floats
from grasp3d.mesh.measures import paired_edges
from tests.helpers import shapes
from tests.helpers.pair_search import domain_of, own_normals, read
from tests.helpers.solids import sphere_mesh

SHAPES = {"blob": shapes.lopsided(), "box": shapes.box(), "cone": shapes.cone(0.3)}
MESHES: dict[str, ObjectMesh] = {}


def mesh_of(shape: str) -> ObjectMesh:
    return MESHES.setdefault(shape, load_mesh(SHAPES[shape]))


def sampled(
    rng: np.random.Generator, lines: Floats, normals: Floats, own: Floats, domain: PairDomain
) -> float:
    """Largest cosine at random points of a face, ever nearer to the best one."""
    best, centre, radius = NONE, np.full(3, 1.0 / 3.0), 1.0
    for _ in range(12):
        points = centre + radius * (rng.dirichlet(np.ones(3), 100) - centre)
        points = np.maximum(points, 2e-9)
        points /= points.sum(axis=1, keepdims=True)
        found = np.array(
            [cosine_at(tuple(w), 0, 0, lines, normals, own, domain) for w in points.tolist()]
        )
        if found.max() > best:
            best, centre = float(found.max()), points[found.argmax()]
        radius *= 0.5
    return best


def shortfall(rng: np.random.Generator, mesh: ObjectMesh, limit: str = "") -> float:
    """Angle by which the best of random points of a face is better than what is found [rad]."""
    surface, scratch, best = mesh.contact_surface, make_scratch(), NONE
    while best < 0.2:
        vertex, face = int(rng.integers(len(mesh.vertices))), int(rng.integers(len(surface.faces)))
        own, (lines, normals) = own_normals(mesh, vertex), read(mesh, face, vertex)
        middle = float(np.linalg.norm(lines.mean(axis=0)))
        domain = domain_of(mesh, **{limit: middle} if limit else {})
        best = sampled(rng, lines, normals, own, domain)
    found = best_of_face(face, vertex, 0.0, own, domain, scratch)
    if found == 0.0:  # no exit there: the line enters the object
        centre = surface.points[surface.faces[face]].mean(axis=0) - surface.points[vertex]
        one, two, three = surface.points[surface.faces[face]]
        assert np.cross(two - one, three - one) @ centre < 1e-9
        return 0.0
    angle = math.acos(min(found, 1.0))
    again = cosine_at(scratch[0], vertex, face, lines, normals, own, domain)
    assert again == pytest.approx(found, abs=1e-12)
    below = math.cos(max(angle - 1e-6, 0.0))
    assert best_of_face(face, vertex, below, own, domain, scratch) == below
    return angle - math.acos(min(best, 1.0))


@pytest.mark.slow
@settings(deadline=None, max_examples=20, derandomize=True)
@given(
    st.integers(0, 2**32 - 1), st.sampled_from(["box", "cone"]),
    st.sampled_from(["", "smallest", "largest"]),
)  # fmt: skip
@example(3426968002, "box", "smallest")
def test_no_point_of_a_face_is_better_than_the_best_one(seed: int, shape: str, limit: str) -> None:
    """Nor is the result worse than its own point, and with a limit below it nothing is found."""
    rng = np.random.default_rng(seed)
    assert max(shortfall(rng, mesh_of(shape), limit) for _ in range(3)) <= 5e-7


@pytest.mark.slow
def test_hardly_any_point_of_a_bent_face_is_better_than_the_best_one() -> None:
    """The corner below is one; faces beside that one have it too."""
    rng = np.random.default_rng(0)
    shortfalls = np.array([shortfall(rng, mesh_of("blob")) for _ in range(100)])
    assert np.mean(shortfalls > 5e-7) <= 0.02


@pytest.mark.xfail(strict=True, reason="of two corners that are best locally the worse is found")
def test_the_better_of_two_corners_is_found() -> None:
    mesh, vertex, face = mesh_of("blob"), 1606, 2342
    own, (lines, normals) = own_normals(mesh, vertex), read(mesh, face, vertex)
    found = best_of_face(face, vertex, 0.0, own, domain_of(mesh), make_scratch())
    corner = (2e-9, 2e-9, 1.0 - 4e-9)
    assert found >= cosine_at(corner, vertex, face, lines, normals, own, domain_of(mesh))


def adjacent_faces(mesh: ObjectMesh) -> np.ndarray:
    one, two = paired_edges(mesh.faces)
    found = np.full(3 * len(mesh.faces), -1, dtype=np.int64)
    found[one], found[two] = two // 3, one // 3
    return found.reshape(-1, 3)


def walked(mesh: ObjectMesh, face: int, angle: float, length: float) -> tuple[np.ndarray, int]:
    """(position, face) of the end of a walk from the centre of a face."""
    weights = np.full(3, 1.0 / 3.0)
    end = walk(face, weights, angle, length, mesh.vertices, mesh.faces, adjacent_faces(mesh))
    assert (weights > 0.0).all()
    assert weights.sum() == pytest.approx(1.0)
    return weights @ mesh.vertices[mesh.faces[end]], end


@pytest.mark.slow
@pytest.mark.parametrize("length", [0.01, 0.3, 1.0, 2.5])
def test_on_a_ball_a_walk_follows_a_great_circle(length: float) -> None:
    mesh = sphere_mesh(subdivisions=4)
    radius = np.linalg.norm(mesh.vertices, axis=1).mean()
    for face in range(0, len(mesh.faces), 611):
        middle = mesh.vertices[mesh.faces[face]].mean(axis=0)
        for angle in (0.3, 2.0, 4.4):
            end, _ = walked(mesh, face, angle, length * radius)
            turned = math.acos(np.dot(end, middle) / np.linalg.norm(end) / np.linalg.norm(middle))
            assert turned == pytest.approx(length, abs=0.02)


def test_a_walk_ends_at_the_border_of_the_surface() -> None:
    vertices, faces = shapes.box((2.0, 2.0, 2.0))
    top = np.flatnonzero((vertices[faces][:, :, 2] > 0.9).all(axis=1))
    mesh = load_mesh((vertices, faces[top]), max_edge=0.5)
    for angle in np.linspace(0.0, 6.0, 9):
        end, _ = walked(mesh, 0, float(angle), 10.0)
        assert np.abs(end[:2]).max() == pytest.approx(1.0, abs=1e-3)
        assert end[2] == pytest.approx(1.0)
