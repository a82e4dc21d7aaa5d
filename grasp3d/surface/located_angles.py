"""Located angles of grasps on a surface: critical angles with all that is not known about contacts.

See `stability.located_angles`. They are the same where contact locations are known exactly and all
fingers are alike.
"""

import math

import numpy as np

from grasp3d.arrays import locked
from grasp3d.contact.contacts import Contacts
from grasp3d.settings import GraspModel
from grasp3d.stability.located_angles import (
    ContactLimits,
    PairLines,
    located_grasps,
    located_pairs,
)
from grasp3d.stability.sampled_normals import WorstAndBest
from grasp3d.surface.contacts import SurfaceContacts

AMBIGUOUS = (math.pi / 2.0, 0.0)
"""Worst and best angle of a grasp of three contacts and more with one on a crease: it is not
examined, and neither S nor U."""


def located_angles_of(
    grasps: SurfaceContacts,
    angles: WorstAndBest,
    model: GraspModel,
    *,
    lines: PairLines | None = None,
    threads: int | None = None,
) -> WorstAndBest:
    """Located angles of grasps on a surface.

    Args:
        grasps: The grasps, shape (b, n).
        angles: Their critical angles over the worst and the best normals [rad], shape (b,) each.
        model: What is known about the contacts, with lengths in the mesh's unit.
        lines: Two contacts: their lines; None: computed.
        threads: Threads; None: one per processor.

    Returns:
        (worst, best) [rad], shape (b,) each; inf where there is no grasp.
    """
    if model.is_uniform:
        return angles
    limits = ContactLimits.of(model.fingertips)
    if grasps.count == 2:
        worst, best = located_pairs(*angles, lines or grasps.lines, limits)
        return locked(worst), locked(best)
    found = np.full((2, grasps.size), math.inf)
    chosen = np.flatnonzero(np.isfinite(angles[0]))
    on_crease = grasps.on_crease[chosen].any(axis=1)
    found[:, chosen[on_crease]] = np.array(AMBIGUOUS)[:, None]
    smooth = chosen[~on_crease]
    if len(smooth):
        contacts = Contacts(grasps.points[smooth] - grasps.mesh.center, grasps.normals[smooth])
        found[:, smooth] = located_grasps(
            contacts, np.asarray(angles[0])[smooth], limits, threads=threads
        )
    return locked(found[0]), locked(found[1])
