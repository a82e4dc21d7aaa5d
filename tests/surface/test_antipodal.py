import math

import numpy as np
import pytest

from grasp3d import ObjectMesh, Sampling, load_mesh, mesh_from_arrays
from grasp3d.surface.sampling import antipodal
from grasp3d.surface.sampling.antipodal import best_pairs, tangents
from tests.helpers import oracles, shapes


def exhaustive(mesh: ObjectMesh, vertex: int, cone: float) -> float:
    """Best critical angle of a smooth vertex over the centres of all faces, squeezing.

    A point whose normal is at less than 90 degrees to the closing line is an exit of that line, so
    no ray needs to be traced.
    """
    point, normal = mesh.vertices[vertex], mesh.normals[vertex]
    corners = mesh.corner_normals
    points = mesh.vertices[mesh.faces].mean(axis=1)
    normals = corners.normals[corners.corners].mean(axis=1)
    d = points - point
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    phi1 = np.arctan2(np.linalg.norm(np.cross(normal, d), axis=1), d @ normal)
    phi2 = np.arctan2(
        np.linalg.norm(np.cross(normals, -d), axis=1), np.einsum("ij,ij->i", normals, -d)
    )
    worst = np.maximum(phi1, phi2)
    worst[(phi1 > cone) | (phi2 > math.pi / 2.0)] = math.inf
    return float(worst.min())


@pytest.mark.slow
@pytest.mark.parametrize("shape", [shapes.lopsided(), shapes.torus(), shapes.cone(0.3)])
def test_the_search_finds_the_grasps_of_an_exhaustive_search(shape: shapes.Surface) -> None:
    mesh = mesh_from_arrays(*shape)
    cone = 1.0
    grasps = best_pairs(mesh, Sampling(), cone, threads=1)
    smooth = np.flatnonzero(mesh.normal_sets.counts == 1)
    chosen = np.random.default_rng(4).choice(smooth, 300, replace=False)
    shortfalls = []
    for vertex in chosen:
        oracle = exhaustive(mesh, vertex, cone)
        if oracle < cone:
            shortfalls.append(grasps.worst[vertex] - oracle)
    assert len(shortfalls) > 200
    assert np.mean(np.array(shortfalls) < 5e-3) >= 0.99
    assert np.median(shortfalls) <= 1e-4


@pytest.mark.slow
@pytest.mark.parametrize("grip", ["squeeze", "expand", "both"])
def test_the_grasp_found_is_real_and_its_angle_exact(grip: str) -> None:
    """The opposing contact lies on the surface and the critical angle equals the definition's."""
    mesh = mesh_from_arrays(*shapes.tube())
    grasps = best_pairs(mesh, Sampling(grip=grip), 0.8, threads=1)  # type: ignore[arg-type]
    smooth = np.flatnonzero((mesh.normal_sets.counts == 1) & (grasps.reason == 0))
    assert len(smooth) > 1000
    for vertex in smooth[::97]:
        q, n = grasps.partner[vertex], grasps.partner_normal[vertex]
        angle = oracles.critical_angle(
            mesh.vertices[vertex], mesh.normals[vertex], q, n, int(grasps.grip[vertex])
        )
        # On a crease the opposing contact has worse normals too.
        assert grasps.worst[vertex] >= angle - 1e-12
        radius, height = math.hypot(q[0], q[1]), abs(q[2])
        on_wall = min(abs(radius - 0.4), abs(radius - 0.5)) < 1e-3 or height == pytest.approx(0.5)
        assert on_wall
        assert np.linalg.norm(n) == pytest.approx(1.0)
    gaps = [
        grasps.worst[v]
        - oracles.critical_angle(
            mesh.vertices[v],
            mesh.normals[v],
            grasps.partner[v],
            grasps.partner_normal[v],
            int(grasps.grip[v]),
        )
        for v in smooth
    ]
    assert np.mean(np.array(gaps) < 1e-9) > 0.98


@pytest.mark.slow
def test_the_result_does_not_depend_on_the_number_of_threads() -> None:
    mesh = mesh_from_arrays(*shapes.lopsided())
    one = best_pairs(mesh, Sampling(), 0.7, threads=1)
    three = best_pairs(mesh, Sampling(), 0.7, threads=3)
    for name in ("worst", "best", "partner", "grip", "reason"):
        assert np.array_equal(getattr(one, name), getattr(three, name), equal_nan=True)
    assert one.rays == three.rays


@pytest.mark.slow
def test_more_rays_find_no_worse_grasps() -> None:
    mesh = mesh_from_arrays(*shapes.torus())
    few = best_pairs(mesh, Sampling(rays=16), 0.7, threads=1).worst
    many = best_pairs(mesh, Sampling(rays=256), 0.7, threads=1).worst
    assert np.mean(many) <= np.mean(few) + 1e-4
    assert np.mean(many > few + 2e-3) < 0.01


@pytest.mark.slow
def test_refining_several_grasps_finds_better_ones_than_refining_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    mesh = load_mesh(shapes.LIBRARY / "banana.ply")
    several = best_pairs(mesh, Sampling(), 0.66, threads=1)
    monkeypatch.setattr(antipodal, "EXPLORING_ROUNDS", 0)
    one = best_pairs(mesh, Sampling(), 0.66, threads=1)
    gain = np.minimum(one.worst, 2.0) - np.minimum(several.worst, 2.0)
    assert gain.mean() > 2e-4
    assert np.mean(gain > 0.01) > 2.0 * np.mean(gain < -0.01)


def test_search_directions_turn_with_the_object() -> None:
    vertices, faces = shapes.lopsided()
    turn = shapes.rotation(7)
    original, rotated = (
        mesh_from_arrays(vertices, faces),
        mesh_from_arrays(vertices @ turn.T, faces),
    )
    assert tangents(rotated) == pytest.approx(tangents(original) @ turn.T, abs=1e-9)
    assert np.einsum("ij,ij->i", tangents(original), original.normals) == pytest.approx(
        0.0, abs=1e-9
    )
    assert np.linalg.norm(tangents(original), axis=1) == pytest.approx(1.0)


def test_every_vertex_of_a_regular_ball_has_a_tangent() -> None:
    mesh = mesh_from_arrays(*shapes.sphere(3))
    assert np.linalg.norm(tangents(mesh), axis=1) == pytest.approx(1.0)


@pytest.mark.slow
def test_progress_increases_to_one() -> None:
    fractions: list[float] = []
    best_pairs(
        mesh_from_arrays(*shapes.lopsided()), Sampling(), 0.7, progress=fractions.append, threads=1
    )
    assert fractions == sorted(fractions)
    assert 0.0 < fractions[0] < fractions[-1] == 1.0
