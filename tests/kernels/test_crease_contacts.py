import math

import numpy as np
import pytest
import trimesh

from grasp3d._kernels.search.crease_contacts import bound_creases, faces_of_corners
from grasp3d._kernels.search.descent import CREASE_GAIN
from grasp3d._kernels.surface.face_tree import face_tree
from grasp3d.arrays import Floats, angles_between, unit_rows
from grasp3d.mesh import ObjectMesh, load_mesh
from grasp3d.settings import Sampling
from grasp3d.surface.sampling.antipodal import best_pairs
from tests.helpers import shapes

CONE = math.radians(40.0)


def pyramid() -> ObjectMesh:
    """An oblique pyramid, all of whose edges are sharp; few of its grasps are perfect."""
    solid = trimesh.creation.cone(radius=1.0, height=1.2, sections=5)
    solid.vertices[:, 0] += 0.25 * solid.vertices[:, 2]
    return load_mesh((solid.vertices, solid.faces))


def creases(mesh: ObjectMesh) -> list[tuple[Floats, Floats]]:
    """Ends (2, 3) of each sharp edge of a polyhedron, and the inward normals there (k, 3)."""
    solid = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    found = []
    for edge, faces, angle in zip(
        solid.face_adjacency_edges, solid.face_adjacency, solid.face_adjacency_angles, strict=True
    ):
        if angle > math.radians(30.0):
            one, two = -solid.face_normals[faces]
            between = np.linspace(0.0, 1.0, 80)[:, None]
            found.append((solid.vertices[edge], unit_rows((1.0 - between) * one + between * two)))
    return found


def least_angle(point: Floats, normal: Floats, edges: list[tuple[Floats, Floats]]) -> float:
    """Smallest critical angle of a point with contacts on edges, at the best of their normals."""
    least = math.inf
    for (start, end), normals in edges:
        lines = unit_rows(start + np.linspace(0.0, 1.0, 60)[:, None] * (end - start) - point)
        here = angles_between(lines, np.broadcast_to(normal, lines.shape))
        there = np.arccos(np.clip((-lines @ normals.T).max(axis=1), -1.0, 1.0))
        least = min(least, float(np.maximum(here, there).min()))
    return least


@pytest.mark.slow
def test_no_contact_on_a_crease_is_clearly_better_than_the_best_grasp() -> None:
    mesh = pyramid()
    found = best_pairs(mesh, Sampling(), CONE)
    edges = creases(mesh)
    assert len(edges) > 20
    smooth = np.flatnonzero(mesh.contact_normals.counts == 1)
    chosen = np.random.default_rng(3).choice(smooth, 150, replace=False)
    angles = np.array([least_angle(mesh.vertices[v], mesh.normals[v], edges) for v in chosen])
    assert np.all(found.best[chosen] <= np.minimum(angles, CONE) + CREASE_GAIN + 1e-6)
    # Better ones than those on faces are exactly on a crease, where the oracle knows them, too, or
    # at a corner.
    better = found.best[chosen] < found.worst[chosen] - 0.01
    weights = np.sort(found.partner_points.weights[chosen, 1], axis=1)
    assert np.all(weights[better, 0] == 0.0)
    on_edge = better & (weights[:, 1] > 0.0)
    assert on_edge.sum() > 10
    assert np.all(angles[on_edge] <= found.best[chosen][on_edge] + 0.02)


def test_the_bounds_of_a_node_contain_those_below() -> None:
    mesh = load_mesh(shapes.cone(0.3))
    surface, sets = mesh.contact_surface, mesh.contact_normals
    owners = faces_of_corners(surface, sets)
    tree = face_tree(surface)
    bound_creases(tree, owners, surface, sets)
    assert np.array_equal(owners >= 0, sets.counts != 1)
    bounds = tree.bounds
    leaves = bounds[(1 << tree.depth) - 1 :, 3] >= 0.0
    assert 0 < leaves.sum() < len(leaves) / 2  # most of the cone is smooth
    for node in range((1 << tree.depth) - 1):
        for below in (bounds[2 * node + 1], bounds[2 * node + 2]):
            if below[3] < 0.0:
                continue
            here = bounds[node]
            assert np.linalg.norm(below[:3] - here[:3]) + below[3] <= here[3] + 1e-9
            if here[7] > 0.0:
                turn = math.acos(min(below[4:7] @ here[4:7], 1.0))
                assert turn + math.acos(below[7]) <= math.acos(here[7]) + 1e-7
