"""Wrench resistance: the force per finger that a given wrench needs."""

import numpy as np

from grasp3d.quality.grip_forces import Resistance, grip_force
from grasp3d.quality.measures.geometry import GraspGeometry
from grasp3d.quality.measures.metric import Measured

RTOL = 1e-6
"""Fraction of the force that may lie between its bounds; the larger one is given."""


def wrench_resistance(grasps: GraspGeometry) -> Measured:
    """Smallest normal force of every finger that resists the given wrench (Mahler et al. 2019)."""
    if grasps.wrench is None:
        missing = np.ones(grasps.size, dtype=bool)
        return Measured.of(np.full(grasps.size, np.nan), (missing, "no wrench is given"))
    found = grip_force(grasps.contacts, grasps.wrench, rtol=RTOL, threads=grasps.threads)
    return Measured.of(
        found.value,
        (
            found.resistance == Resistance.NO_SUCH_WRENCH,
            "the fingers can apply no wrench of that kind, however hard they press",
        ),
        (~np.isfinite(found.value), "the fingers cannot push that way, however hard they press"),
    )
