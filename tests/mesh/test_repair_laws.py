"""A damaged surface, mended, has the volume, centre of mass and labels of the sound one."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest
import trimesh
from hypothesis import example, given, settings
from hypothesis import strategies as st

from grasp3d import GraspModel, Sampling, SurfaceLabels, label_surface, load_mesh, mesh_from_arrays
from tests.helpers import shapes
from tests.helpers.shapes import Surface

MODEL = GraspModel(friction=0.35)
COARSE = 1e9
JITTER = 1e-8
"""Of the size: less than what welding takes for rounding."""


@dataclass(frozen=True)
class Guise:
    vertices: np.ndarray
    faces: np.ndarray
    origin: np.ndarray
    """Vertex of the sound surface that each one stands for."""


def shuffled(guise: Guise, rng: np.random.Generator) -> Guise:
    return replace(guise, faces=guise.faces[rng.permutation(len(guise.faces))])


def soup(guise: Guise, rng: np.random.Generator) -> Guise:
    """Every face with vertices of its own."""
    del rng
    corners = guise.faces.ravel()
    own = np.arange(len(corners)).reshape(-1, 3)
    return Guise(guise.vertices[corners], own, guise.origin[corners])


def jittered_soup(guise: Guise, rng: np.random.Generator) -> Guise:
    split = soup(guise, rng)
    far = JITTER * np.linalg.norm(np.ptp(split.vertices, axis=0)) / math.sqrt(3.0)
    return replace(split, vertices=split.vertices + rng.uniform(-far, far, split.vertices.shape))


def turned(guise: Guise, rng: np.random.Generator) -> Guise:
    del rng
    return replace(guise, faces=guise.faces[:, ::-1])


def partly_turned(guise: Guise, rng: np.random.Generator) -> Guise:
    turn = rng.random(len(guise.faces)) < 0.3
    return replace(guise, faces=np.where(turn[:, None], guise.faces[:, ::-1], guise.faces))


def with_repeated_faces(guise: Guise, rng: np.random.Generator) -> Guise:
    again = rng.integers(0, len(guise.faces), len(guise.faces) // 4)
    return replace(guise, faces=np.concatenate([guise.faces, guise.faces[again][:, [1, 2, 0]]]))


def twice(guise: Guise, rng: np.random.Generator) -> Guise:
    """Over the same vertices; one of the two may be inside out."""
    other = guise.faces[:, :: int(rng.choice([1, -1]))]
    return replace(guise, faces=np.concatenate([guise.faces, other]))


def twice_apart(guise: Guise, rng: np.random.Generator) -> Guise:
    """The second with vertices of its own that are off by rounding."""
    count = len(guise.vertices)
    step = np.spacing(np.abs(guise.vertices).max()) * rng.integers(-1, 2, guise.vertices.shape)
    other = guise.faces[:, :: int(rng.choice([1, -1]))] + count
    return Guise(
        np.concatenate([guise.vertices, guise.vertices + step]),
        np.concatenate([guise.faces, other[rng.permutation(len(other))]]),
        np.concatenate([guise.origin, guise.origin]),
    )


def with_a_hole(guise: Guise, rng: np.random.Generator) -> Guise:
    return replace(guise, faces=np.delete(guise.faces, rng.integers(len(guise.faces)), axis=0))


HARMS: dict[str, Callable[[Guise, np.random.Generator], Guise]] = {
    harm.__name__: harm
    for harm in (
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
"""In the order in which they are done."""


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
    mesh = mesh_from_arrays(vertices, faces, max_edge=COARSE * np.ptp(vertices))
    return label_surface(mesh, MODEL, sampling=Sampling(rays=16))


@cache
def sound(name: str) -> SurfaceLabels:
    return labelled(*SOUND[name]())


def harmed(name: str, harms: set[str], seed: int) -> Guise:
    vertices, faces = SOUND[name]()
    rng = np.random.default_rng(seed)
    guise = Guise(vertices, faces, np.arange(len(vertices)))
    for harm, inflict in HARMS.items():
        if harm in harms:
            guise = inflict(guise, rng)
    return guise


def assert_mended(name: str, guise: Guise, motion: tuple[np.ndarray, float, np.ndarray]) -> None:
    """Check volume, centre of mass, and the label of every vertex of the file."""
    turn, scale, shift = motion
    expected = sound(name)
    found = labelled(guise.vertices @ turn.T * scale + shift, guise.faces)
    assert found.mesh.report.closed
    assert found.mesh.volume == pytest.approx(expected.mesh.volume * scale**3, rel=1e-6)
    middle = turn @ expected.mesh.center_mass * scale + shift
    assert found.mesh.center_mass == pytest.approx(middle, abs=1e-6 * found.mesh.size)
    own = slice(0, len(guise.vertices))
    same = found.label[own] == expected.label[guise.origin]
    near = np.zeros(len(same), dtype=bool)
    for threshold in (MODEL.friction_angle - MODEL.tilt, MODEL.friction_angle + MODEL.tilt):
        near |= np.abs(expected.critical_angle[guise.origin] - threshold) < 1e-4
        near |= np.abs(expected.critical_angle_best[guise.origin] - threshold) < 1e-4
    assert (same | near).all()
    assert near.mean() < 0.01


STILL = (np.eye(3), 1.0, np.zeros(3))


@pytest.mark.parametrize("name", ["blob", "ring"])
@pytest.mark.parametrize("harm", HARMS)
def test_one_harm_is_mended(name: str, harm: str) -> None:
    guise = harmed(name, {harm}, 1)
    assert not np.array_equal(guise.faces, sound(name).mesh.faces)
    assert_mended(name, guise, STILL)


@given(
    st.sampled_from(["blob", "ring"]),
    st.sets(st.sampled_from(sorted(HARMS))),
    st.integers(0, 1000),
    st.floats(-6.0, 6.0),
    st.floats(0.0, 1e4),
)
@settings(max_examples=30, deadline=None)
@example("blob", {"twice_apart", "soup", "partly_turned", "twice", "shuffled"}, 0, 0.0, 0.0)
def test_harms_together_are_mended_wherever_it_is(
    name: str, harms: set[str], seed: int, power: float, far: float
) -> None:
    scale = 10.0**power
    shift = far * scale * np.array([1.0, -0.5, 0.3])
    assert_mended(name, harmed(name, harms, seed), (shapes.rotation(seed), scale, shift))


def test_a_mug_is_mended() -> None:
    guise = harmed("mug", {"with_a_hole", "partly_turned", "jittered_soup", "shuffled"}, 2)
    assert_mended("mug", guise, (shapes.rotation(3), 1e-3, np.array([1.0, 2.0, 3.0])))


@pytest.mark.parametrize("name", SOUND)
@pytest.mark.parametrize("level", ["none", "safe", "full"])
def test_nothing_is_done_to_a_sound_surface(name: str, level: str) -> None:
    vertices, faces = SOUND[name]()
    mesh = mesh_from_arrays(vertices, faces, max_edge=COARSE, repair=level)  # type: ignore[arg-type]
    assert mesh.report.repairs == mesh.report.warnings == ()
    assert np.array_equal(mesh.faces, faces)
    assert np.array_equal(mesh.vertices, vertices)
