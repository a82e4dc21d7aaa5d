"""Random grasps of hands with joints, and an oracle for their payloads."""

import math
from typing import NamedTuple

import numpy as np
from scipy.optimize import linprog

import grasp3d
from grasp3d.arrays import Floats
from grasp3d.contact.contacts import tangents
from grasp3d.quality.actuation import Actuation
from grasp3d.quality.hand_forces import HandGrasp


def random_hand(generator: np.random.Generator) -> HandGrasp:
    """A hand with 2 to 5 contacts about a round object, on fingers of 2 to 15 joints in all."""
    count = int(generator.integers(2, 6))
    directions = generator.normal(size=(count, 3))
    directions[1] = -directions[0] + 0.3 * generator.normal(size=3)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    points = directions * generator.uniform(0.02, 0.05, size=3)
    normals = -directions + 0.25 * generator.normal(size=(count, 3))
    contacts = grasp3d.Contacts(points, normals, generator.uniform(0.3, 1.2, size=count))
    joints = int(generator.integers(2, 16))
    jacobian = 0.04 * generator.normal(size=(count, 3, joints))
    if generator.random() < 0.5:  # separate fingers, and perhaps a palm
        finger = generator.integers(0, count, size=joints)
        jacobian *= (finger == np.arange(count)[:, None])[:, None]
    return HandGrasp(contacts, jacobian, random_actuation(generator, joints))


def random_actuation(generator: np.random.Generator, joints: int) -> Actuation:
    """Motors at most joints, some with stops, and links that may have weight."""
    most = generator.uniform(0.2, 1.0, size=joints)
    if joints > 2 and generator.random() < 0.4:
        most[int(generator.integers(joints - 2, joints + 1)) :] = 0.0
    stops = generator.choice([-1, 0, 0, 0, 1], size=joints) * (generator.random() < 0.4)
    loaded = generator.random() < 0.4
    links = 0.003 * generator.normal(size=(joints, 3)) if loaded else None
    return Actuation(most, stops=stops, links=links)


def driven(grasp: HandGrasp, actuation: Actuation) -> HandGrasp:
    """The same grasp with other drives."""
    return HandGrasp(grasp.contacts, grasp.jacobian, actuation, most_force=grasp.most_force)


def with_normals(grasp: HandGrasp, normals: Floats) -> HandGrasp:
    """The same grasp with other unit normals (n, 3)."""
    contacts = grasp3d.Contacts(grasp.contacts.points, normals, grasp.contacts.friction)
    return HandGrasp(contacts, grasp.jacobian, grasp.actuation, most_force=grasp.most_force)


class ByPolygons(NamedTuple):
    """Payload of one wrench with polygonal friction cones, by linear programming."""

    payload: float
    """Payload; also 0 if not even a zero load is held."""
    velocities: Floats
    """Relative velocities at the contacts that prove it, shape (n, 3)."""


def by_polygons(
    grasp: HandGrasp,
    wrench: Floats,
    angles: Floats,
    *,
    outside: bool,
    edges: int = 48,
    weighs: bool = False,
) -> ByPolygons:
    """Payload of one wrench, by polygonal cones in or around those of half-angles (n,).

    The unknowns are weights of the cones' edges, the drives as they are, and the load. Edges have
    normal components of 1 if the polygons are around the cones, and lengths of 1 if they are
    inside, so that limits on weights are limits on forces. With `weighs` the links have weight; the
    wrench is then that of 1 kg.
    """
    contacts, drives = grasp.contacts, grasp.actuation
    wide = np.tan(angles) / (math.cos(math.pi / edges) if outside else 1.0)
    turn = 2.0 * math.pi * np.arange(edges) / edges
    first, second = tangents(contacts.normals)
    around = np.cos(turn)[:, None] * first[:, None] + np.sin(turn)[:, None] * second[:, None]
    forces = contacts.normals[:, None] + wide[:, None, None] * around  # (n, m, 3)
    if not outside:
        forces /= np.linalg.norm(forces, axis=-1, keepdims=True)
    moments = np.cross(contacts.points[:, None], forces)
    torques = np.einsum("nip,nmi->nmp", grasp.jacobian, forces)
    rows = np.concatenate([forces, moments, torques], axis=-1).reshape(-1, 6 + drives.joints)
    links = drives.links if weighs and drives.links is not None else np.zeros((drives.joints, 3))
    of_drives = np.concatenate([np.zeros((6, drives.columns.shape[1])), -drives.columns])
    load = np.concatenate([wrench, np.zeros(drives.joints)])[:, None]
    equations = np.concatenate([rows.T, of_drives, load], axis=1)
    right = np.concatenate([np.zeros(6), -links @ wrench[:3]])
    capped = np.kron(np.eye(contacts.count), np.ones(edges))
    capped = np.pad(capped, ((0, 0), (0, equations.shape[1] - capped.shape[1])))
    most = drives.limits.tolist()
    ranges = [(0, None)] * len(rows) + [(-one, one) for one in most]
    ranges += [(0, None)] * (drives.columns.shape[1] - len(most)) + [(0, None)]
    cost = np.zeros(equations.shape[1])
    cost[-1] = -1.0
    found, least = (
        linprog(
            sign * cost, A_eq=equations, b_eq=right, A_ub=capped,
            b_ub=np.full(contacts.count, grasp.most_force), bounds=ranges,
        )
        for sign in (1.0, -1.0)
    )  # fmt: skip
    if found.status == 2 or least.fun > 1e-9:
        return ByPolygons(0.0, np.zeros((contacts.count, 3)))
    assert found.status == 0
    moved = found.eqlin.marginals
    velocities = moved[:3] - np.cross(contacts.points, moved[3:6]) + grasp.jacobian @ moved[6:]
    return ByPolygons(-found.fun, velocities)
