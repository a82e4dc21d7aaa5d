"""Limits of the pairs of contacts that a search keeps, and what the best of them depends on."""

import math
from dataclasses import dataclass

from grasp3d._kernels.search.antipodal_candidates import PairLimits
from grasp3d._kernels.search.rays import SMALLEST_OPENING
from grasp3d.mesh import ObjectMesh
from grasp3d.settings import GraspModel, Sampling

OPENING_SLACK = 1e-6
"""Tolerance of the limits of openings, in object sizes: larger than rounding errors of files."""


@dataclass(frozen=True)
class Ranking:
    """Uncertainties of the contacts that the best of several grasps depends on.

    Those that cost every grasp the same do not count.
    """

    location: float = 0.0
    """Sum of the location errors of both contacts, in the mesh's unit."""
    first_extra: float = 0.0
    """Angle by which the finger at the vertex is known less well than the other finger [rad]."""
    second_extra: float = 0.0
    """The same of the other finger; one of the two is 0 [rad]."""

    @classmethod
    def of(cls, model: GraspModel) -> "Ranking":
        """The uncertainties of a model for two fingers, with lengths in the mesh's unit."""
        if model.is_uniform:
            return cls()
        first, second = model.fingertips
        difference = (first.least_friction_angle - first.tilt) - (
            second.least_friction_angle - second.tilt
        )
        return cls(
            first.location_error + second.location_error,
            max(-difference, 0.0),
            max(difference, 0.0),
        )


ALIKE = Ranking()
"""Contacts that are known exactly and equally well: the best grasp has the smallest angle."""


def pair_limits(mesh: ObjectMesh, sampling: Sampling, cone: float, ranking: Ranking) -> PairLimits:
    """Limits of pairs of contacts in the normalised frame, openings with a tolerance for rounding.

    Args:
        mesh: The surface.
        sampling: Limits of openings.
        cone: Largest critical angle that is searched for [rad].
        ranking: Uncertainties of the contacts.
    """
    location = ranking.location / mesh.size
    return PairLimits(
        max(sampling.min_opening / mesh.size - OPENING_SLACK, SMALLEST_OPENING),
        sampling.max_opening / mesh.size + OPENING_SLACK,
        location,
        math.cos(cone) if location > 0.0 else -2.0,
    )


def largest_cost(cone: float, ranking: Ranking) -> float:
    """Largest cost of a grasp whose critical angle is within the search cone [rad]."""
    return cone if ranking.location == 0.0 else min(cone + math.pi / 2.0, math.pi)
