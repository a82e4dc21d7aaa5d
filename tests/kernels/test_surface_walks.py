"""Straight walks over a surface."""

import math

import numpy as np
import pytest

from grasp3d import ObjectMesh, load_mesh
from grasp3d._kernels.surface.surface_contacts import walk
from grasp3d.mesh.measures import paired_edges
from tests.helpers import shapes
from tests.helpers.solids import sphere_mesh


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


@pytest.mark.slow
def test_a_walk_over_an_edge_of_a_box_is_straight_on_the_unfolded_faces() -> None:
    mesh = load_mesh(shapes.box((2.0, 2.0, 2.0)), max_edge=0.3)
    rng = np.random.default_rng(0)
    for face in rng.integers(0, len(mesh.faces), 40):
        start = mesh.vertices[mesh.faces[face]].mean(axis=0)
        end, other = walked(mesh, int(face), rng.uniform(0.0, 2.0 * math.pi), 0.8)
        box_faces = [np.flatnonzero(np.abs(np.abs(point) - 1.0) < 1e-9) for point in (start, end)]
        if set(box_faces[0]) == set(box_faces[1]):
            assert np.linalg.norm(end - start) == pytest.approx(0.8, abs=1e-3)
        elif len(box_faces[1]) == 1:  # unfold the second side about their edge
            one, two = int(box_faces[0][0]), int(box_faces[1][0])
            unfolded = end.copy()
            unfolded[two] = np.sign(end[two]) * (1.0 + abs(np.sign(start[one]) - end[one]))
            unfolded[one] = start[one]
            if np.linalg.norm(unfolded - start) < 0.8 - 2e-3:
                continue  # around a corner
            assert np.linalg.norm(unfolded - start) == pytest.approx(0.8, abs=1e-3)
        assert other >= 0


def test_a_walk_ends_at_the_border_of_the_surface() -> None:
    vertices, faces = shapes.box((2.0, 2.0, 2.0))
    top = np.flatnonzero((vertices[faces][:, :, 2] > 0.9).all(axis=1))
    mesh = load_mesh((vertices, faces[top]), max_edge=0.5)
    for angle in np.linspace(0.0, 6.0, 9):
        end, _ = walked(mesh, 0, float(angle), 10.0)
        assert np.abs(end[:2]).max() == pytest.approx(1.0, abs=1e-3)
        assert end[2] == pytest.approx(1.0)
