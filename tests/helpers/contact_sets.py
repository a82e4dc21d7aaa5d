"""Grasps of any numbers of contacts, and their closure by linear programs."""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog

from grasp3d import Contacts, epsilon, force_closure
from grasp3d.contact.contacts import turned
from grasp3d.stability.classification import ContactSets
from tests.helpers.oracles import cone_edges
from tests.helpers.tilts import random_tilts

Floats = NDArray[np.float64]

EDGES = 24
"""Edges of the pyramids inside and around each cone."""

WEIGHT = 1e-9
"""Smallest weight that counts as positive."""


class Sets(NamedTuple):
    """Random grasps, and what is known about their normals."""

    sets: ContactSets
    tilt: Floats
    friction: float

    @property
    def angles(self) -> tuple[float, float]:
        """Friction angles, as `label_sets` takes them."""
        return math.atan(self.friction), math.atan(self.friction)


def random_sets(size: int, seed: int, *, alike: bool = False) -> Sets:
    """Contacts around a ball, 2 to 6 of each grasp."""
    rng = np.random.default_rng(seed)
    row = np.repeat(np.arange(size), rng.integers(2, 7, size=size))
    points = rng.normal(size=(len(row), 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    second = np.flatnonzero(np.diff(row, prepend=-1) > 0) + 1
    points[second] = 0.2 * points[second] - points[second - 1]  # roughly opposite to the first one
    normals = -points + 0.3 * rng.normal(size=points.shape)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    friction = float(rng.uniform(0.4, 1.2))
    tilt = rng.uniform(0.0, 0.6 * math.atan(friction), size=1 if alike else len(row))
    tilt = np.broadcast_to(tilt, len(row)).copy()
    return Sets(ContactSets(size=size, row=row, points=points, normals=normals), tilt, friction)


def closes(points: Floats, normals: Floats, friction: float, *, around: bool) -> bool:
    """Whether a grasp is force-closed with pyramids inside its cones, or around them.

    It is where their edges balance with weights that are all positive: they span what cones span.
    """
    slope = friction / math.cos(math.pi / EDGES) if around else friction
    edges = np.concatenate([cone_edges(normal, math.atan(slope), EDGES) for normal in normals])
    arms = np.repeat(points, EDGES, axis=0)
    wrenches = np.concatenate([edges, np.cross(arms, edges)], axis=1)  # (n m, 6)
    count = len(wrenches)
    # Weights w + t with w >= 0: the smallest one, t, is to be as large as possible.
    columns = np.concatenate([wrenches, wrenches.sum(axis=0, keepdims=True)]).T
    result = linprog(
        np.append(np.zeros(count), -1.0),
        A_eq=np.vstack([columns, np.append(np.ones(count), count)]),
        b_eq=np.append(np.zeros(6), 1.0),
    )
    return bool(result.status == 0 and result.x[-1] > WEIGHT)


def true_normals(
    one: Sets, grasp: int | np.integer[Any], count: int, rng: np.random.Generator
) -> Floats:
    """Normals that may be true (count + 2, n, 3): random, and those that hurt and help most."""
    mine = one.sets.row == grasp
    points, normals, tilt = one.sets.points[mine], one.sets.normals[mine], one.tilt[mine]
    beta = math.atan(one.friction)
    found = [random_tilts(normals, tilt, rng) for _ in range(count)]
    # Away from a motion that separates the contacts, or is hardest to resist.
    contacts = Contacts(points, normals, one.friction)
    u = epsilon(contacts, cone_offset=-np.minimum(tilt, beta)).certificate.direction
    found.append(turned(normals, -(u[:3] + np.cross(u[3:], points)), tilt))
    # Toward forces that balance.
    wide = force_closure(contacts, cone_offset=1.5 - beta)
    forces = wide.certificate.equilibrium[:, :3]
    found.append(normals if np.isnan(forces).any() else turned(normals, forces, tilt))
    return np.array(found)
