"""A damaged and repaired surface has the volume, centre of mass and labels of the sound one."""

import math
from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
import trimesh
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from grasp3d import GraspModel, Sampling, SurfaceLabels, label_surface, load_mesh
from grasp3d.arrays import Floats, Ints
from tests.helpers import shapes
from tests.helpers.shapes import Surface

MODEL = GraspModel(friction=0.35)
COARSE = 1e9
JITTER = 1e-8
"""Errors of positions as a fraction of the size: less than what welding assumes as rounding."""


def ring() -> Surface:
    vertices, faces = shapes.arrays(
        trimesh.creation.torus(1.0, 0.4, major_sections=24, minor_sections=12)
    )
    return vertices * (1.0, 0.7, 1.2) + 0.1 * np.sin(2.0 * vertices[:, [1, 2, 0]]), faces


def mug() -> Surface:
    mesh = load_mesh(shapes.LIBRARY / "mug.glb", max_edge=COARSE)
    return mesh.vertices, mesh.faces


SOUND: dict[str, Callable[[], Surface]] = {
    "blob": lambda: shapes.lopsided(3),
    "ring": ring,
    "mug": mug,
}


def labelled(vertices: np.ndarray, faces: np.ndarray) -> SurfaceLabels:
    mesh = load_mesh((vertices, faces), max_edge=COARSE * np.ptp(vertices))
    return label_surface(mesh, MODEL, sampling=Sampling(rays=16))


@cache
def sound(name: str) -> SurfaceLabels:
    return labelled(*SOUND[name]())


KINDS = (
    "hole", "twice", "repeated", "partly turned", "turned", "copy", "soup", "jitter", "shuffled",
)  # fmt: skip


def damaged(name: str, kinds: set[str], seed: int) -> tuple[Floats, Ints, Ints]:
    """Vertices and faces with kinds of damage, and the vertex of the sound surface of each."""
    vertices, faces = SOUND[name]()
    origin, rng = np.arange(len(vertices)), np.random.default_rng(seed)
    if "hole" in kinds:
        faces = np.delete(faces, rng.integers(len(faces)), axis=0)
    if "twice" in kinds:  # perhaps inside out
        faces = np.concatenate([faces, faces[:, :: int(rng.choice([1, -1]))]])
    if "repeated" in kinds:
        again = rng.integers(0, len(faces), len(faces) // 4)
        faces = np.concatenate([faces, faces[again][:, [1, 2, 0]]])
    if "partly turned" in kinds:
        faces = np.where(rng.random((len(faces), 1)) < 0.3, faces[:, ::-1], faces)
    if "turned" in kinds:
        faces = faces[:, ::-1]
    if "copy" in kinds:  # over vertices that are off by rounding
        step = np.spacing(np.abs(vertices).max()) * rng.integers(-1, 2, vertices.shape)
        other = faces[:, :: int(rng.choice([1, -1]))] + len(vertices)
        faces = np.concatenate([faces, rng.permutation(other)])
        vertices = np.concatenate([vertices, vertices + step])
        origin = np.concatenate([origin, origin])
    if kinds & {"soup", "jitter"}:  # separate vertices for every face
        corners = faces.ravel()
        vertices, origin = vertices[corners], origin[corners]
        faces = np.arange(len(corners)).reshape(-1, 3)
    if "jitter" in kinds:
        far = JITTER * np.linalg.norm(np.ptp(vertices, axis=0)) / math.sqrt(3.0)
        vertices = vertices + rng.uniform(-far, far, vertices.shape)
    if "shuffled" in kinds:
        faces = rng.permutation(faces)
    return vertices, faces, origin


@pytest.mark.slow
@given(
    st.sampled_from(["blob", "ring"]),
    st.sets(st.sampled_from(KINDS)),
    st.integers(0, 1000),
    st.floats(-6.0, 6.0),
    st.floats(0.0, 1e4),
)
@settings(max_examples=30, deadline=None)
@example("blob", {"partly turned", "hole", "shuffled", "copy"}, 1, 0.0, 0.0)
@example("blob", {"copy", "soup", "partly turned", "twice", "shuffled"}, 0, 0.0, 0.0)
@example("mug", {"hole", "partly turned", "jitter", "shuffled"}, 2, -3.0, 1.0)
def test_a_damaged_surface_is_repaired_in_any_pose(
    name: str, kinds: set[str], seed: int, power: float, far: float
) -> None:
    """Its volume, its centre of mass, and the label of every vertex of the file."""
    # Copies of a face whose corners are off by rounding are not all joined: the surface stays open.
    assume("jitter" not in kinds or not kinds & {"repeated", "twice", "copy"})
    vertices, faces, origin = damaged(name, kinds, seed)
    expected, scale = sound(name), 10.0**power
    turn, shift = shapes.rotation(seed), far * scale * np.array([1.0, -0.5, 0.3])
    found = labelled(vertices @ turn.T * scale + shift, faces)
    assert found.mesh.report.closed
    assert found.mesh.volume == pytest.approx(expected.mesh.volume * scale**3, rel=1e-6)
    middle = turn @ expected.mesh.center_mass * scale + shift
    assert found.mesh.center_mass == pytest.approx(middle, abs=1e-6 * found.mesh.size)
    own = slice(0, len(vertices))
    same = found.label[own] == expected.label[origin]
    near = np.zeros(len(same), dtype=bool)
    for threshold in (MODEL.friction_angle - MODEL.tilt, MODEL.friction_angle + MODEL.tilt):
        for angles in (expected.critical_angle, expected.critical_angle_best):
            near |= np.abs(angles[origin] - threshold) < 1e-4
    assert (same | near).all()
    assert near.mean() < 0.01


@pytest.mark.parametrize("name", SOUND)
@pytest.mark.parametrize("level", ["none", "safe", "full"])
def test_a_sound_surface_is_not_changed(name: str, level: str) -> None:
    vertices, faces = SOUND[name]()
    mesh = load_mesh((vertices, faces), max_edge=COARSE, repair=level)  # type: ignore[arg-type]
    assert mesh.report.repairs == mesh.report.warnings == ()
    assert np.array_equal(mesh.faces, faces)
    assert np.array_equal(mesh.vertices, vertices)
