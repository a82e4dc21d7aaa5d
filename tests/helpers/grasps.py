"""Grasps for tests: regular, degenerate and random ones."""

import json
import math
from dataclasses import fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp3d import Contacts
from grasp3d.quality import EpsilonOptions
from tests.helpers import shapes
from tests.helpers.random_grasps import REGULAR, Shape, random_contacts

Floats = NDArray[np.float64]

PAIR = REGULAR["antipodal pair"]
TRIANGLE = REGULAR["three at 120 deg"]
TETRAHEDRON = REGULAR["tetrahedron"]
OCTAHEDRON = np.vstack([np.eye(3), -np.eye(3)])
REGULAR_SHAPES = {
    "pair": PAIR,
    "triangle": TRIANGLE,
    "tetrahedron": TETRAHEDRON,
    "octahedron": OCTAHEDRON,
}

NAMES = ("points", "normals", "friction", "torsion_radius")
"""Arrays of point contacts."""

LINE = Contacts([[-1, 0, 0], [0, 0, 0], [1, 0, 0]], [[1, 0, 0], [0, 1, 0], [-1, 0, 0]], 0.5)


def just_off_a_line(gap: float) -> Contacts:
    return Contacts([[-1, 0, 0], [0, gap, 0], [1, 0, 0]], LINE.normals, 0.5)


def reference(name: str) -> list[dict[str, Any]]:
    """Cases of a reference file with independent results; skips the test if it is absent."""
    cases: list[dict[str, Any]] = json.loads(shapes.shared("reference", name).read_text())
    return cases


def of_case(case: dict[str, Any]) -> Contacts:
    return Contacts(case["points"], case["inward_normals"], case["mu"], case["torsion_radius"])


def of_force_case(case: dict[str, Any]) -> Contacts:
    torsion = case["torsion_per_normal_force"]
    return Contacts(case["points"], case["inward_normals"], case["friction"], torsion)


def regular_on_ball(name: str, friction: float = 0.5, torsion_radius: float = 0.0) -> Contacts:
    """A regular grasp of the unit ball."""
    points = REGULAR_SHAPES[name]
    return Contacts(points, -points, friction, torsion_radius)


def random_grasp(fingers: int, seed: int, *, soft: bool = False) -> Contacts:
    """One random grasp."""
    return one(random_contacts(Shape(fingers, 8, soft=soft), 1, seed), 0)


def frictionless_grasp(seed: int, fingers: int = 16) -> Contacts:
    """Contacts on a ball with tilted normals, mostly enough for closure without friction."""
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(fingers, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    normals = -points + 0.6 * rng.normal(size=points.shape)
    return Contacts(points, normals, 0.0)


def one(contacts: Contacts, *index: int) -> Contacts:
    """One grasp of a batch."""
    return Contacts(*(getattr(contacts, name)[index] for name in NAMES))


def changed(contacts: Contacts, **fields: Any) -> Contacts:
    """The same contacts with some fields replaced."""
    return Contacts(*(fields.get(name, getattr(contacts, name)) for name in NAMES))


def at_angle(contacts: Contacts, beta: float) -> Contacts:
    """The same contacts with another friction angle."""
    return changed(contacts, friction=math.tan(beta))


def stacked(single: list[Contacts]) -> Contacts:
    """A batch of single grasps."""
    return Contacts(*(np.stack([getattr(c, name) for c in single]) for name in NAMES))


def with_options(**arguments: Any) -> dict[str, Any]:
    """Return keyword arguments with those of `EpsilonOptions` collected in `options`."""
    names = {field.name for field in fields(EpsilonOptions)}
    options = EpsilonOptions(**{name: arguments.pop(name) for name in names & set(arguments)})
    return {**arguments, "options": options}
