"""Poses on a mesh, with outcomes drawn from a known function of the margin."""

import numpy as np
from numpy.typing import NDArray

from grasp3d import ObjectMesh
from grasp3d.arrays import unit_rows
from grasp3d.formats.poses import GraspPoses

Array = NDArray[np.float64]


def poses_on(
    mesh: ObjectMesh, count: int, seed: int, stroke: float, within: float = 0.7
) -> GraspPoses:
    """Poses whose closing axis joins two points of the surface, from any side.

    Args:
        mesh: The object, whose unit is known.
        count: Number of poses.
        seed: Seed.
        stroke: Largest distance of the two points [mesh unit].
        within: Largest angle between the axis and the normal at the first point [rad].
    """
    random = np.random.default_rng(seed)
    points, inward = mesh.vertices[mesh.on_surface], mesh.normals[mesh.on_surface]
    found: list[Array] = []
    while len(found) < count:
        one = random.integers(len(points))
        lines = points - points[one]
        lengths = np.linalg.norm(lines, axis=1)
        along = (lines @ inward[one]) / np.maximum(lengths, 1e-12)
        fits = (along > np.cos(within)) & (lengths < stroke) & (lengths > 0.05 * stroke)
        if not fits.any():
            continue
        other = random.choice(np.flatnonzero(fits))
        found.append(pose_between(points[one], points[other], random.normal(size=3)))
    return GraspPoses(poses=np.array(found), unit=mesh.unit)


def pose_between(one: Array, other: Array, toward: Array) -> Array:
    """Pose with its TCP in the middle of two points, and an approach near a given direction."""
    x = unit_rows((other - one)[None])[0]
    z = toward - (toward @ x) * x
    z /= np.linalg.norm(z)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([x, np.cross(z, x), z], axis=1)
    pose[:3, 3] = 0.5 * (one + other)
    return pose


def chances(margins: Array, middle: float = 0.0, width: float = 0.1) -> Array:
    """Probabilities to hold: logistic in the margin [rad]; 0.02 without a margin."""
    with np.errstate(over="ignore"):
        likely = 1.0 / (1.0 + np.exp(-(margins - middle) / width))
    return np.where(np.isnan(margins), 0.02, likely)


def expected_roc_auc(margins: Array, held: Array) -> float:
    """Mean ROC-AUC of the margin over many draws of outcomes from probabilities to hold."""
    values = np.where(np.isnan(margins), -np.inf, margins)
    above = (values[:, None] > values) + 0.5 * (values[:, None] == values)
    pairs = held[:, None] * (1.0 - held)
    np.fill_diagonal(pairs, 0.0)
    return float((pairs * above).sum() / pairs.sum())
