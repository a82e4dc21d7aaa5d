"""A damaged and repaired surface has the volume, centre of mass and labels of the sound one."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest
import trimesh
from hypothesis import example, given, settings
from hypothesis import strategies as st

from grasp3d import GraspModel, Sampling, SurfaceLabels, label_surface, load_mesh
from tests.helpers import shapes
from tests.helpers.shapes import Surface

MODEL = GraspModel(friction=0.35)
COARSE = 1e9
JITTER = 1e-8
"""Errors of positions as a fraction of the size: less than what welding assumes as rounding."""


@dataclass(frozen=True)
class Damaged:
    vertices: np.ndarray
    faces: np.ndarray
    origin: np.ndarray
    """Corresponding vertex of the sound surface."""


def shuffled(damaged: Damaged, rng: np.random.Generator) -> Damaged:
    return replace(damaged, faces=damaged.faces[rng.permutation(len(damaged.faces))])


def soup(damaged: Damaged, rng: np.random.Generator) -> Damaged:
    """Separate vertices for every face."""
    del rng
    corners = damaged.faces.ravel()
    own = np.arange(len(corners)).reshape(-1, 3)
    return Damaged(damaged.vertices[corners], own, damaged.origin[corners])


def jittered_soup(damaged: Damaged, rng: np.random.Generator) -> Damaged:
    split = soup(damaged, rng)
    far = JITTER * np.linalg.norm(np.ptp(split.vertices, axis=0)) / math.sqrt(3.0)
    return replace(split, vertices=split.vertices + rng.uniform(-far, far, split.vertices.shape))


def turned(damaged: Damaged, rng: np.random.Generator) -> Damaged:
    del rng
    return replace(damaged, faces=damaged.faces[:, ::-1])


def partly_turned(damaged: Damaged, rng: np.random.Generator) -> Damaged:
    turn = rng.random(len(damaged.faces)) < 0.3
    return replace(damaged, faces=np.where(turn[:, None], damaged.faces[:, ::-1], damaged.faces))


def with_repeated_faces(damaged: Damaged, rng: np.random.Generator) -> Damaged:
    again = rng.integers(0, len(damaged.faces), len(damaged.faces) // 4)
    return replace(
        damaged, faces=np.concatenate([damaged.faces, damaged.faces[again][:, [1, 2, 0]]])
    )


def twice(damaged: Damaged, rng: np.random.Generator) -> Damaged:
    """Two copies over the same vertices; one of the two may be inside out."""
    other = damaged.faces[:, :: int(rng.choice([1, -1]))]
    return replace(damaged, faces=np.concatenate([damaged.faces, other]))


def twice_apart(damaged: Damaged, rng: np.random.Generator) -> Damaged:
    """Two copies, the second over separate vertices that are off by rounding."""
    count = len(damaged.vertices)
    step = np.spacing(np.abs(damaged.vertices).max()) * rng.integers(-1, 2, damaged.vertices.shape)
    other = damaged.faces[:, :: int(rng.choice([1, -1]))] + count
    return Damaged(
        np.concatenate([damaged.vertices, damaged.vertices + step]),
        np.concatenate([damaged.faces, other[rng.permutation(len(other))]]),
        np.concatenate([damaged.origin, damaged.origin]),
    )


def with_a_hole(damaged: Damaged, rng: np.random.Generator) -> Damaged:
    return replace(
        damaged, faces=np.delete(damaged.faces, rng.integers(len(damaged.faces)), axis=0)
    )


DAMAGE: dict[str, Callable[[Damaged, np.random.Generator], Damaged]] = {
    kind.__name__: kind
    for kind in (
        with_a_hole,
        twice,
        with_repeated_faces,
        partly_turned,
        turned,
        twice_apart,
        soup,
        jittered_soup,
        shuffled,
    )
}
"""Kinds of damage in the order in which they are applied."""


def blob() -> Surface:
    """As uneven as `shapes.lopsided`, with fewer vertices."""
    vertices, faces = shapes.sphere(3)
    x, y, z = vertices.T
    radius = 1.0 + 0.25 * x * y + 0.15 * z**3 + 0.1 * np.sin(3.0 * x + y) + 0.2 * y**2
    return vertices * radius[:, None] * (1.0, 0.8, 1.3), faces


def ring() -> Surface:
    vertices, faces = shapes.arrays(
        trimesh.creation.torus(1.0, 0.4, major_sections=24, minor_sections=12)
    )
    return vertices * (1.0, 0.7, 1.2) + 0.1 * np.sin(2.0 * vertices[:, [1, 2, 0]]), faces


def mug() -> Surface:
    mesh = load_mesh(shapes.LIBRARY / "mug.glb", max_edge=COARSE)
    return mesh.vertices, mesh.faces


SOUND: dict[str, Callable[[], Surface]] = {"blob": blob, "ring": ring, "mug": mug}


def labelled(vertices: np.ndarray, faces: np.ndarray) -> SurfaceLabels:
    mesh = load_mesh((vertices, faces), max_edge=COARSE * np.ptp(vertices))
    return label_surface(mesh, MODEL, sampling=Sampling(rays=16))


@cache
def sound(name: str) -> SurfaceLabels:
    return labelled(*SOUND[name]())


def damage(name: str, kinds: set[str], seed: int) -> Damaged:
    vertices, faces = SOUND[name]()
    rng = np.random.default_rng(seed)
    damaged = Damaged(vertices, faces, np.arange(len(vertices)))
    for kind, apply in DAMAGE.items():
        if kind in kinds:
            damaged = apply(damaged, rng)
    return damaged


def assert_repaired(
    name: str, damaged: Damaged, motion: tuple[np.ndarray, float, np.ndarray]
) -> None:
    """Check volume, centre of mass, and the label of every vertex of the file."""
    turn, scale, shift = motion
    expected = sound(name)
    found = labelled(damaged.vertices @ turn.T * scale + shift, damaged.faces)
    assert found.mesh.report.closed
    assert found.mesh.volume == pytest.approx(expected.mesh.volume * scale**3, rel=1e-6)
    middle = turn @ expected.mesh.center_mass * scale + shift
    assert found.mesh.center_mass == pytest.approx(middle, abs=1e-6 * found.mesh.size)
    own = slice(0, len(damaged.vertices))
    same = found.label[own] == expected.label[damaged.origin]
    near = np.zeros(len(same), dtype=bool)
    for threshold in (MODEL.friction_angle - MODEL.tilt, MODEL.friction_angle + MODEL.tilt):
        near |= np.abs(expected.critical_angle[damaged.origin] - threshold) < 1e-4
        near |= np.abs(expected.critical_angle_best[damaged.origin] - threshold) < 1e-4
    assert (same | near).all()
    assert near.mean() < 0.01


IDENTITY = (np.eye(3), 1.0, np.zeros(3))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["blob", "ring"])
@pytest.mark.parametrize("kind", DAMAGE)
def test_one_kind_of_damage_is_repaired(name: str, kind: str) -> None:
    damaged = damage(name, {kind}, 1)
    assert not np.array_equal(damaged.faces, sound(name).mesh.faces)
    assert_repaired(name, damaged, IDENTITY)


@pytest.mark.slow
@given(
    st.sampled_from(["blob", "ring"]),
    st.sets(st.sampled_from(sorted(DAMAGE))),
    st.integers(0, 1000),
    st.floats(-6.0, 6.0),
    st.floats(0.0, 1e4),
)
@settings(max_examples=30, deadline=None)
@example("blob", {"partly_turned", "with_a_hole", "shuffled", "twice_apart"}, 1, 0.0, 0.0)
@example("blob", {"twice_apart", "soup", "partly_turned", "twice", "shuffled"}, 0, 0.0, 0.0)
def test_combined_damage_is_repaired_in_any_pose(
    name: str, kinds: set[str], seed: int, power: float, far: float
) -> None:
    scale = 10.0**power
    shift = far * scale * np.array([1.0, -0.5, 0.3])
    assert_repaired(name, damage(name, kinds, seed), (shapes.rotation(seed), scale, shift))


@pytest.mark.slow
def test_a_mug_is_repaired() -> None:
    damaged = damage("mug", {"with_a_hole", "partly_turned", "jittered_soup", "shuffled"}, 2)
    assert_repaired("mug", damaged, (shapes.rotation(3), 1e-3, np.array([1.0, 2.0, 3.0])))


@pytest.mark.slow
@pytest.mark.parametrize("name", SOUND)
@pytest.mark.parametrize("level", ["none", "safe", "full"])
def test_a_sound_surface_is_not_changed(name: str, level: str) -> None:
    vertices, faces = SOUND[name]()
    mesh = load_mesh((vertices, faces), max_edge=COARSE, repair=level)  # type: ignore[arg-type]
    assert mesh.report.repairs == mesh.report.warnings == ()
    assert np.array_equal(mesh.faces, faces)
    assert np.array_equal(mesh.vertices, vertices)
