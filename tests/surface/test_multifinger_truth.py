"""The search for grasps of three fingers, compared with all triples of vertices."""

import math
from functools import cache

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from grasp3d import GraspModel, ObjectMesh, Sampling, SurfaceLabels, label_surface, load_mesh
from grasp3d.settings.sampling import CandidatePoints
from tests.helpers import coplanar, shapes
from tests.helpers.solids import box_mesh, sphere_mesh

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

pytestmark = pytest.mark.slow

LIMIT = math.radians(80.0)
TOLERANCE = 2e-4
"""Largest amount by which the exhaustive angles may be too large [rad]."""

CLOSE = 0.02
UNDIVIDED = 1e3
"""Edge length up to which no edge is divided."""


def cylinder() -> ObjectMesh:
    """A cylinder of 16 sides, with rings of vertices along it and on its ends."""
    profile = [(0, -1.5), (0.5, -1.5), (1, -1.5), (1, -0.75), (1, 0), (1, 0.75)]
    profile += [(1, 1.5), (0.5, 1.5), (0, 1.5)]
    turned = trimesh.creation.revolve(np.array(profile, dtype=np.float64), sections=16)
    return load_mesh(shapes.arrays(turned), max_edge=UNDIVIDED)


def mug(sections: int) -> ObjectMesh:
    """A cup with a handle that a finger fits through; half of its vertices are on creases."""
    shapes.reader("manifold3d")
    outside = [(0, 0), (22, 0), (40, 0), (40, 30), (40, 64), (40, 95), (0, 95)]
    inside = [(0, 5), (20, 5), (36, 5), (36, 32), (36, 64), (36, 95), (36, 120), (0, 120)]
    body, hollow = (
        trimesh.creation.revolve(np.array(profile, dtype=np.float64), sections=sections)
        for profile in (outside, inside)
    )
    handle = trimesh.creation.torus(28.0, 7.0, major_sections=10, minor_sections=6)
    upright = trimesh.transformations.rotation_matrix(math.pi / 2.0, (1.0, 0.0, 0.0))
    handle.apply_transform(upright)
    handle.apply_translation((44.0, 0.0, 47.5))
    filled = trimesh.boolean.union([body, handle], engine="manifold")
    made = trimesh.boolean.difference([filled, hollow], engine="manifold")
    return load_mesh(shapes.arrays(made), max_edge=UNDIVIDED)


SHAPES = {
    "sphere": lambda: sphere_mesh(subdivisions=2),
    "box": lambda: box_mesh((2.0, 1.5, 1.0), max_edge=0.6),
    "cylinder": cylinder,
    "mug": lambda: mug(11),
}


@cache
def truth(name: str) -> tuple[ObjectMesh, Ints, Floats]:
    """A mesh, its vertices, and the best critical angle of three vertices through each."""
    mesh = SHAPES[name]()
    assert 100 < len(np.unique(mesh.faces)) <= 200
    search = coplanar.Exhaustive(mesh, LIMIT, TOLERANCE)
    angles = search.run()
    assert np.isfinite(angles).mean() > 0.95  # nearly all vertices can be compared
    return mesh, search.vertices, angles


def searched(mesh: ObjectMesh, candidate_points: CandidatePoints, seed: int = 0) -> SurfaceLabels:
    """Grasps that the search finds at every vertex."""
    sampling = Sampling(candidate_points=candidate_points, search_angle=LIMIT, seed=seed)
    return label_surface(mesh, GraspModel(fingers=3), sampling=sampling)


@pytest.mark.parametrize("name", SHAPES)
def test_with_contacts_on_vertices_the_search_is_never_better_and_rarely_worse(name: str) -> None:
    mesh, vertices, best = truth(name)
    best, labels = np.minimum(best, LIMIT), searched(mesh, "vertices")
    found = np.minimum(labels.critical_angle[vertices], LIMIT)
    smooth = labels.distinct[~labels.distinct_contacts.on_crease.any(axis=1)]
    never_better = np.isin(vertices, smooth)
    assert never_better.sum() > 20
    assert (found >= best - TOLERANCE - 1e-6)[never_better].all()
    assert np.mean(found <= best + CLOSE) >= 0.95


@pytest.mark.parametrize("name", SHAPES)
def test_with_contacts_on_the_surface_the_search_is_rarely_worse(name: str) -> None:
    """It may be better, as contacts may be anywhere on the surface."""
    mesh, vertices, best = truth(name)
    found = np.minimum(searched(mesh, "surface").critical_angle[vertices], LIMIT)
    assert np.mean(found <= np.minimum(best, LIMIT) + CLOSE) >= 0.95
