"""What proves an answer about a grasp, and how the answer was reached."""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from grasp3d._kernels import growing_hull
from grasp3d._kernels.wrench_problem import Answers
from grasp3d.arrays import Floats, shaped
from grasp3d.contact.contacts import Contacts
from grasp3d.contact.friction_cones import tangents


class Status(IntEnum):
    """How an answer was reached."""

    CONVERGED = growing_hull.CONVERGED
    """As close as asked for."""
    UNDECIDED = growing_hull.UNDECIDED
    """Closed or not: the interval contains 0, and is narrower than rounding can tell, or tilts
    exceed friction (see `cone_offset`)."""
    STALLED = growing_hull.STALLED
    """Rounding stopped the search; the interval holds."""
    EXHAUSTED = growing_hull.EXHAUSTED
    """The hull outgrew its memory; the interval reached holds."""


@dataclass(frozen=True, eq=False)
class Certificate:
    """What proves an answer; plain linear algebra checks it."""

    direction: Floats
    """Unit direction, shape (..., 6). Where the grasp is not closed it separates: no wrench of any
    contact has a positive product with it. Where it is closed, the wrench that is hardest to
    resist lies against it: the support of the grasp wrench space there is `upper`. In a
    `ForceClosure` it is meaningful only where not closed."""
    equilibrium: Floats
    """Where the grasp is closed, forces that balance, every one of them inside its friction cone
    and none zero, shape (..., n, 4): force along x, y, z, and torsional moment about the normal
    [mesh unit]. For given wrenches their weights, shape (..., n). nan where not closed, and where
    cones are outer_offset to 90 degrees or more."""


def certificate_of(answers: Answers, batch: tuple[int, ...], equilibrium: Floats) -> Certificate:
    """Shape the proofs of a flat batch like the batch."""
    return Certificate(shaped(answers.direction, batch), shaped(equilibrium, batch))


def contact_forces(contacts: Contacts, mixes: Floats) -> Floats:
    """Forces and torsional moments (b, n, 4) from their parts along the contacts' axes."""
    normals = contacts.normals.reshape(*mixes.shape[:2], 3)
    axes = np.stack([normals, *tangents(normals)], axis=-2)  # (b, n, 3, 3)
    forces = (mixes[..., None, :3] @ axes)[..., 0, :]
    moments = mixes[..., 3] * contacts.torsion_radius.reshape(mixes.shape[:2])
    return np.concatenate([forces, moments[..., None]], axis=-1)
