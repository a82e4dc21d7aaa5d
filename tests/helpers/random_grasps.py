"""Grasps for tests and benchmarks: random ones, and regular ones with noise."""

import math
from typing import NamedTuple

import numpy as np

from grasp3d import Contacts
from grasp3d.arrays import Floats


class Shape(NamedTuple):
    """A kind of grasp: number of contacts, edges of their cones, and whether fingers are soft."""

    contacts: int
    edges: int
    soft: bool

    def __str__(self) -> str:
        """Return a name for a table."""
        return f"{self.contacts} {'soft' if self.soft else 'hard'} x {self.edges}"


SHAPES = [
    Shape(2, 8, soft=True),
    Shape(3, 8, soft=False),
    Shape(4, 8, soft=False),
    Shape(5, 8, soft=False),
    Shape(2, 16, soft=True),
    Shape(3, 16, soft=False),
    Shape(5, 16, soft=False),
]

SEED = 2018

TORSION_RADIUS = 0.3
"""Torsion radius of soft fingers, for contacts at a distance of about 1 from the centre."""


def random_contacts(shape: Shape, count: int, seed: int) -> Contacts:
    """Contacts near a ball's surface, normals roughly toward its centre, friction 0.3 to 1."""
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(count, shape.contacts, 3))
    points /= np.linalg.norm(points, axis=-1, keepdims=True)
    if shape.contacts == 2:
        points[:, 1] = -points[:, 0] + 0.1 * rng.normal(size=(count, 3))
    inward = -points / np.linalg.norm(points, axis=-1, keepdims=True)
    normals = inward + 0.25 * rng.normal(size=points.shape)
    points *= rng.uniform(0.7, 1.3, size=(count, shape.contacts, 1))
    friction = rng.uniform(0.3, 1.0, size=(count, 1))
    return Contacts(points, normals, friction, TORSION_RADIUS * shape.soft)


def random_grasps(fingers: int, count: int, seed: int = SEED) -> tuple[Contacts, Floats]:
    """Random contacts on a ball, and sensor resolutions [rad], shape (count, 1).

    Friction is 0.3 to 1, and the resolution up to twice the friction angle, so that S, M and U are
    all common.
    """
    rng = np.random.default_rng([seed, fingers])
    points = rng.normal(size=(count, fingers, 3))
    if fingers == 2:
        points[:, 1] = -points[:, 0] + 0.25 * rng.normal(size=(count, 3))
    points /= np.linalg.norm(points, axis=-1, keepdims=True)
    normals = -points + 0.25 * rng.normal(size=points.shape)
    contacts = Contacts(points, normals, rng.uniform(0.3, 1.0, size=(count, 1)))
    fraction = rng.uniform(0.0, 1.0, size=(count, 1))
    return contacts, 2.0 * fraction * contacts.friction_angle[:, :1]


REGULAR = {
    "antipodal pair": np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]]),
    "three at 120 deg": np.array(
        [[math.cos(t), math.sin(t), 0.0] for t in np.arange(3) * 2.0 * math.pi / 3.0]
    ),
    "tetrahedron": np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]) / math.sqrt(3.0),
}


def regular_contacts(name: str, count: int, noise: float, seed: int) -> Contacts:
    """Regular grasps of a unit ball with noise in every coordinate; the pair is soft."""
    rng = np.random.default_rng(seed)
    exact = np.broadcast_to(REGULAR[name], (count, *REGULAR[name].shape))
    points = exact + noise * rng.normal(size=exact.shape)
    normals = -exact + noise * rng.normal(size=exact.shape)
    return Contacts(points, normals, 0.5, TORSION_RADIUS * (len(REGULAR[name]) == 2))
