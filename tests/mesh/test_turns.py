"""How far surfaces turn near contacts: against known shapes and against places tried one by one."""

import math

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from grasp3d import load_mesh
from grasp3d._kernels.surface.surface_contacts import ContactNormals
from grasp3d.arrays import Floats, Ints, unit_rows
from grasp3d.mesh import ObjectMesh
from grasp3d.mesh.turns import located_surface, normal_turns, turns_beside
from tests.helpers import shapes

BEYOND = 1.2e-3
"""By how much an angle may be too large [rad], besides that of an error larger by 0.1 %."""


def faces_of(mesh: ObjectMesh) -> Ints:
    """A face of each vertex."""
    own = np.full(len(mesh.vertices), -1)
    own[mesh.faces] = np.arange(len(mesh.faces))[:, None]
    return own


def at_vertices(mesh: ObjectMesh, error: float) -> Floats:
    return normal_turns(mesh, mesh.vertices, faces_of(mesh), mesh.contact_normals, error)


def test_near_an_edge_of_a_box_normals_turn_by_90_degrees() -> None:
    mesh = load_mesh(shapes.box((0.08, 0.05, 0.03)), unit="m", max_edge=0.004)
    turns = at_vertices(mesh, 0.002)
    gaps = np.sort(np.abs(np.abs(mesh.vertices) - [0.04, 0.025, 0.015]), axis=1)
    to_edge, to_corner = gaps[:, 1], gaps[:, 2]
    on_edge = to_edge < 1e-9
    near = ~on_edge & (to_edge < 0.002)
    assert turns[near] == pytest.approx(math.pi / 2.0)
    assert (turns[to_edge > 0.0021] == 0.0).all()
    # Of an edge itself both faces are known, of a corner all three.
    assert (turns[on_edge & ((to_corner > 0.0021) | (to_corner < 1e-9))] == 0.0).all()
    assert near.sum() > 100


@pytest.mark.parametrize("part", [0.03, 0.2])
def test_a_ball_turns_by_the_chord(part: float) -> None:
    mesh = load_mesh(shapes.sphere(4), unit="m", crease_angle=math.radians(60.0))
    turns = at_vertices(mesh, part)
    assert turns == pytest.approx(2.0 * math.asin(0.5 * part), abs=0.01)


def test_only_what_is_connected_counts() -> None:
    plate = trimesh.creation.box([0.1, 0.1, 0.0005])
    near = trimesh.creation.box([0.1, 0.1, 0.01])
    near.apply_translation([0.0, 0.0, 0.006])
    mesh = load_mesh(trimesh.util.concatenate([plate, near]), unit="m", max_edge=0.005)
    middle = np.abs(mesh.vertices[:, :2]).max(axis=1) < 0.04
    assert (at_vertices(mesh, 0.003)[middle] == 0.0).all()


def test_at_a_needle_any_normal_may_be_true() -> None:
    mesh = load_mesh(shapes.cone(0.01, height=1.0, sections=12), max_edge=0.02)
    tip = mesh.vertices[:, 2].argmax()
    assert mesh.contact_normals.counts[tip] == 0
    near = np.linalg.norm(mesh.vertices - mesh.vertices[tip], axis=1)
    turns = at_vertices(mesh, 0.05)
    assert turns[tip] == 0.0  # which is so there already
    assert (turns[(near > 0.0) & (near < 0.05)] == math.pi).all()


def tried(mesh: ObjectMesh, vertex: int, error: float) -> float:
    """The largest angle at places of a fine subdivision that are connected within an error."""
    points, normals = mesh.vertices[mesh.faces], mesh.corner_normals
    corners = normals.normals[normals.corners]
    for _ in range(3):
        points, corners = (
            np.concatenate(
                [
                    np.stack([one[:, 0], ab, ca], axis=1),
                    np.stack([ab, one[:, 1], bc], axis=1),
                    np.stack([ca, bc, one[:, 2]], axis=1),
                    np.stack([ab, bc, ca], axis=1),
                ]
            )
            for one in (points, corners)
            for ab, bc, ca in [[(one[:, k] + one[:, (k + 1) % 3]) / 2.0 for k in range(3)]]
        )
    _, places = np.unique(np.rint(points.reshape(-1, 3) * 1e7), axis=0, return_inverse=True)
    rows = places.reshape(-1, 3)
    inside = (np.linalg.norm(points - mesh.vertices[vertex], axis=2) <= error).all(axis=1)
    ends = np.concatenate([rows[inside][:, [0, 1]], rows[inside][:, [1, 2]]])
    size = int(rows.max()) + 1
    graph = coo_array((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=(size, size))
    _, part = connected_components(graph, directed=False)
    start = rows[np.abs(points - mesh.vertices[vertex]).max(axis=2) < 1e-9]
    chosen = inside & np.isin(part[rows[:, 0]], part[start])
    found = unit_rows(corners[chosen].reshape(-1, 3))
    sets = mesh.contact_normals
    own = sets.normals[sets.start[vertex] : sets.start[vertex] + sets.counts[vertex]]
    assert len(own) == 1
    return float(np.arccos(np.clip(found @ own[0], -1.0, 1.0)).max(initial=0.0))


SURFACES = {
    "smooth": (shapes.lopsided(2), 9.0),
    "box": (shapes.box(), 0.3),
    "cone": (shapes.cone(0.35, sections=24), 0.3),
}


@pytest.mark.slow
@settings(max_examples=20, deadline=None)
@given(st.sampled_from(list(SURFACES)), st.integers(0, 1000), st.floats(0.04, 0.3))
def test_no_place_nearby_turns_more(shape: str, seed: int, error: float) -> None:
    surface, edge = SURFACES[shape]
    mesh = load_mesh(surface, max_edge=edge)
    turns, wider = at_vertices(mesh, error), at_vertices(mesh, 1.15 * error + 0.06)
    smooth = np.flatnonzero(mesh.contact_normals.counts == 1)
    for vertex in np.random.default_rng(seed).choice(smooth, 5):
        found = tried(mesh, int(vertex), error)
        assert turns[vertex] >= found - 1e-9
        assert found <= turns[vertex] <= wider[vertex] + BEYOND


def test_searches_know_the_turns_of_places() -> None:
    mesh, error = load_mesh(shapes.lopsided(3), max_edge=9.0), 0.05
    surface = located_surface(mesh, error, math.pi)
    turns = surface.turns
    assert turns.vertices == pytest.approx(at_vertices(mesh, error))
    parts, first = turns.levels[7], turns.start[7]
    values = turns.values[first : first + (parts + 1) * (parts + 2) // 2]
    assert turns.least[7] == values.min()
    normals = mesh.corner_normals.normals[mesh.corner_normals.corners[7]]
    one = np.arange(4)
    exact = normal_turns(
        mesh, mesh.vertices[mesh.faces[7]], np.full(3, 7),
        ContactNormals(one, np.ones(3, np.int64), normals), error,
    )  # fmt: skip
    assert values[[0, parts, -1]] == pytest.approx(exact, abs=1e-3)
    assert located_surface(mesh, 0.0, math.pi) is mesh.contact_surface


def test_contacts_beside_the_surface_are_those_of_the_nearest_place() -> None:
    mesh = load_mesh(shapes.box((0.08, 0.05, 0.03)), unit="m")
    points = np.array([[0.0, 0.0, 0.016], [0.0395, 0.0, 0.0155]])
    turns = turns_beside(mesh, points, np.array([[0.0, 0.0, -1.0]] * 2), 0.002)
    assert turns == pytest.approx([0.0, math.pi / 2.0])
