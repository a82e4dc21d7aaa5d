"""Tests that equivalent representations of an object have the same labels.

Vertices whose critical angle lies within 1e-6 rad of a threshold may differ.
"""

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import trimesh

from grasp3d import GraspModel, ObjectMesh, SurfaceLabels, label_surface, load_mesh
from tests.helpers import shapes
from tests.helpers.shapes import Surface

MODEL = GraspModel()


def representations(
    vertices: np.ndarray, faces: np.ndarray
) -> Iterator[tuple[str, Surface, np.ndarray]]:
    """(name, equivalent surface, new index of each vertex)."""
    rng = np.random.default_rng(3)
    own = np.arange(len(vertices))
    order = rng.permutation(len(vertices))
    index = np.argsort(order)
    far = 1e6 * np.ptp(vertices) * np.array([1.0, -0.5, 0.3])
    rolled = np.stack([np.roll(face, number % 3) for number, face in enumerate(faces)])
    yield "rotated", (vertices @ shapes.rotation(5).T, faces), own
    yield "far away", (vertices + far, faces), own
    yield "tiny", (vertices * 1e-6, faces), own
    yield "huge", (vertices * 1e6, faces), own
    yield "in inches", (vertices / 25.4, faces), own
    yield "permuted vertices", (vertices[order], index[faces]), index
    yield "permuted faces", (vertices, faces[rng.permutation(len(faces))]), own
    yield "other first corners of faces", (vertices, rolled), own


def assert_same(expected: SurfaceLabels, found: SurfaceLabels, index: np.ndarray) -> None:
    count = len(index)
    thresholds = (MODEL.friction_angle - MODEL.tilt, MODEL.friction_angle + MODEL.tilt)
    near = np.zeros(count, dtype=bool)
    for angles in (expected.critical_angle[:count], expected.critical_angle_best[:count]):
        for threshold in thresholds:
            near |= np.abs(angles - threshold) < 1e-6
    same = found.label[index] == expected.label[:count]
    assert (same | near).all()
    assert near.mean() < 0.01


OBJECTS = {
    "lopsided": shapes.lopsided,
    "cone": lambda: shapes.cone(0.25, sections=48),
    "tube": lambda: shapes.tube(sections=48),
    "torus": shapes.torus,
    "box": lambda: shapes.box((1.0, 1.5, 2.0)),
    "mug": lambda: from_library("mug.glb"),
    "wrench": lambda: from_library("wrench.glb"),
}


def from_library(name: str) -> Surface:
    mesh = load_mesh(shapes.LIBRARY / name, max_edge=1e9)
    return mesh.vertices, mesh.faces


def prepared(vertices: np.ndarray, faces: np.ndarray) -> ObjectMesh:
    """A mesh with edges of the same length in all representations: a part of the area's root."""
    area = trimesh.Trimesh(vertices - vertices.mean(axis=0), faces, process=False).area
    return load_mesh((vertices, faces), max_edge=0.15 * math.sqrt(area))


@pytest.mark.slow
@pytest.mark.parametrize("name", OBJECTS)
def test_equivalent_surfaces_have_the_same_labels(name: str) -> None:
    vertices, faces = OBJECTS[name]()
    expected = label_surface(prepared(vertices, faces), MODEL)
    for representation, surface, index in representations(vertices, faces):
        found = label_surface(prepared(*surface), MODEL)
        try:
            assert_same(expected, found, index)
        except AssertionError as error:
            raise AssertionError(f"{name} {representation}") from error


@pytest.mark.slow
def test_labels_do_not_depend_on_the_file_format(tmp_path: Path) -> None:
    """Coordinates are exact in 32 bits, so that every format stores the same values."""
    vertices, faces = shapes.lopsided(3)
    vertices = np.float64(np.float32(vertices))
    expected = label_surface(load_mesh((vertices, faces), max_edge=9.0), MODEL)
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    for suffix in ("stl", "ply", "off", "obj", "glb", "3mf"):
        path = tmp_path / f"same.{suffix}"
        mesh.export(path, **({"digits": 12} if suffix in {"off", "obj"} else {}))
        loaded = load_mesh(path, max_edge=9.0)
        rows = {tuple(v): i for i, v in enumerate(np.float32(loaded.file_points).tolist())}
        index = np.array([rows[tuple(v)] for v in np.float32(vertices).tolist()])
        assert_same(expected, label_surface(loaded, MODEL), index)
