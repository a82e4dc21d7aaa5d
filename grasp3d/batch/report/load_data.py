"""Data of the object page that a load adds."""

from typing import TYPE_CHECKING, Any

from grasp3d.grasps.holding_verdict import HoldingVerdict
from grasp3d.surface.held_area import held_fractions

if TYPE_CHECKING:
    from grasp3d.surface.labels import SurfaceLabels


def load_data(labels: "SurfaceLabels") -> dict[str, Any] | None:
    """The load of a labelled surface; None: there is none.

    Returns:
        `text`, the verdict as a sentence; `mass` [kg] and `available` [N], None where not known;
        `held`, the area fractions of S, M and U with the force at hand, or None; `how` the forces
        are known; `remedy`, what would help where most grasps hold nothing, or empty.
    """
    holding = labels.holding
    if holding is None:
        return None
    return {
        "text": str(HoldingVerdict.of(holding)),
        "mass": holding.mass,
        "available": holding.available,
        "held": held_fractions(labels),
        "how": holding.how,
        "remedy": holding.remedy,
    }
