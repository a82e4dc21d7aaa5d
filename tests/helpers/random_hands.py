"""Random grasps of hands with joints: coupled ones, joints at stops, heavy links."""

import numpy as np

import grasp3d
from grasp3d.arrays import Floats
from grasp3d.contact.friction_cones import turned
from grasp3d.quality.hand_forces.actuation import Actuation
from grasp3d.quality.hand_forces.hand_grasp import HandGrasp
from grasp3d.quality.hand_forces.payloads import HandPayload


def random_hand(generator: np.random.Generator) -> HandGrasp:
    """2 to 5 contacts about a round object, on fingers of 2 to 15 joints in all."""
    count = int(generator.integers(2, 6))
    directions = generator.normal(size=(count, 3))
    directions[1] = -directions[0] + 0.3 * generator.normal(size=3)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    points = directions * generator.uniform(0.02, 0.05, size=3)
    normals = -directions + 0.25 * generator.normal(size=(count, 3))
    contacts = grasp3d.Contacts(points, normals, generator.uniform(0.3, 1.2, size=count))
    joints = int(generator.integers(2, 16))
    jacobian = 0.04 * generator.normal(size=(count, 3, joints))
    if generator.random() < 0.5:  # fingers of their own, and perhaps a palm
        finger = generator.integers(0, count, size=joints)
        jacobian *= (finger == np.arange(count)[:, None])[:, None]
    return HandGrasp(contacts, jacobian, random_actuation(generator, joints))


def random_actuation(generator: np.random.Generator, joints: int) -> Actuation:
    """Motors, or differentials over several joints, with stops and links that weigh something."""
    arms = None
    actuators = joints
    if joints > 2 and generator.random() < 0.4:
        actuators = int(generator.integers(joints - 2, joints + 1))
        arms = np.eye(joints)[:actuators]
        arms[:, actuators:] = 0.7 * (generator.random((actuators, joints - actuators)) < 0.4)
    most = generator.uniform(0.2, 1.0, size=actuators)
    stops = generator.choice([-1, 0, 0, 0, 1], size=joints) * (generator.random() < 0.4)
    loaded = generator.random() < 0.4
    links = 0.003 * generator.normal(size=(joints, 3)) if loaded else None
    return Actuation.of_hand(most, joints=joints, arms=arms, stops=stops, links=links)


def driven(grasp: HandGrasp, actuation: Actuation) -> HandGrasp:
    """The same grasp with other drives."""
    return HandGrasp(grasp.contacts, grasp.jacobian, actuation, most_force=grasp.most_force)


def with_normals(grasp: HandGrasp, normals: Floats) -> HandGrasp:
    """The same grasp with other unit normals (n, 3)."""
    contacts = grasp3d.Contacts(grasp.contacts.points, normals, grasp.contacts.friction)
    return HandGrasp(contacts, grasp.jacobian, grasp.actuation, most_force=grasp.most_force)


def worst_grasp(found: HandPayload, tilts: Floats) -> HandGrasp:
    """The grasp with each normal turned away from the relative velocity of a proof.

    With the full friction cones about these normals the same motions prove what they prove for the
    cones beta - a about the given ones: the bound over all tilts is reached.
    """
    grasp = found.slice.grasp
    normals = grasp.contacts.normals
    velocities = grasp.velocities(found.limiting.twist, found.limiting.motion)
    return with_normals(grasp, turned(normals, -(velocities[:, None] @ grasp.frames)[:, 0], tilts))
