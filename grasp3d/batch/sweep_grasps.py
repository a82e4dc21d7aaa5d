"""Grasps of a mesh for a sweep, whose best grasps depend on the location error.

Locations that are known less well cost a wide grasp less than a narrow one, so that other grasps
are best. Grasps are therefore searched for at several location errors, and at each location error
every vertex has the best of all that were found.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from grasp3d.settings import GraspModel
from grasp3d.settings.lengths import AnyLength
from grasp3d.stability.angle_distributions import SampledAngles
from grasp3d.system.context import within

if TYPE_CHECKING:
    from grasp3d.surface.labels import SurfaceLabels

MAX_SEARCHES = 5
"""Most searches for the grasps of one mesh."""


@dataclass(frozen=True, eq=False)
class BestOfSeveral:
    """Labels of one surface from several searches, of which each vertex has the best grasp."""

    searches: Sequence["SurfaceLabels"]

    def angle_distribution(self, *, location_error: Any) -> SampledAngles:
        """Distribution of critical angles at a location error; see `SurfaceLabels`."""
        angles = [one.angle_distribution(location_error=location_error) for one in self.searches]
        return replace(
            angles[0],
            worst=np.minimum.reduce([one.worst for one in angles]),
            best=np.minimum.reduce([one.best for one in angles]),
            limit=min(one.limit for one in angles),
        )


def search_at_each(
    label: Callable[[GraspModel], "SurfaceLabels"],
    model: GraspModel,
    location_errors: Sequence[AnyLength],
) -> BestOfSeveral:
    """Search for the grasps of a mesh at several location errors.

    Args:
        label: Labels the mesh with a model.
        model: The model of every search, but for its location error.
        location_errors: In increasing order; of more than `MAX_SEARCHES` some, from the smallest to
            the largest.
    """
    last = len(location_errors) - 1
    indices = {round(index) for index in np.linspace(0, last, min(last + 1, MAX_SEARCHES))}
    searches = []
    for number, index in enumerate(sorted(indices)):
        with within(number / len(indices), (number + 1) / len(indices)):
            searches.append(label(replace(model, location_error=location_errors[index])))
    return BestOfSeveral(searches)
