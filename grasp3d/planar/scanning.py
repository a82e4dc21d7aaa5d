"""The second finger scanned along an outline (Wan & Howe 2018, Sec. III-B)."""

import numpy as np

from grasp3d.arrays import Floats, locked
from grasp3d.errors import SettingError
from grasp3d.planar.contacts import STRAIGHT, TIE, OutlineContacts, critical_angles
from grasp3d.planar.located import ContactPairLimits, located_angles
from grasp3d.planar.outlines import Outline
from grasp3d.planar.planar_scan import PlanarScan
from grasp3d.planar.polygons import TINY
from grasp3d.settings import GraspModel, check_point_contacts, whole_number
from grasp3d.stability.thresholds import label_angles

FEWEST_POINTS = 8
FEWEST_EDGES = 2


def scan(
    outline: Outline,
    model: GraspModel | None = None,
    *,
    points: int = 720,
    edges: int = 2,
    rings: bool = True,
) -> PlanarScan:
    """Scan the second finger along an outline (Wan & Howe 2018, Sec. III-B).

    Args:
        outline: The curve, with the first finger fixed on it.
        model: Friction, sensor resolution, further uncertainties and actuation; None: the
            defaults. Lengths are numbers in the outline's unit. Its `edges` and `torsion_radius`
            have no effect in the plane.
        points: Number of evenly spaced points, the fixed finger's first, at least 8; corners are
            added. For fractions of the perimeter every edge should contain some.
        edges: Number of unit forces of a planar friction cone, at least 2, evenly spaced from one
            edge to the other; 2 in the paper. More approximate the arc between the edges: epsilon
            changes, force closure does not.
        rings: Whether to test more normals where the extreme, the perceived and the bisecting ones
            leave gaps of more than 2 beta.

    Raises:
        SettingError: A setting is outside its range, or all points are corners.

    Example:
        Contacts known to within a tenth of the circle's radius:

        >>> import grasp3d
        >>> model = grasp3d.GraspModel(friction=(0.9, 1.1), location_error=0.1)
        >>> found = grasp3d.planar.scan(grasp3d.planar.Circle(), model)
        >>> {name: round(fraction, 2) for name, fraction in found.fractions().items()}
        {'S': 0.27, 'M': 0.39, 'U': 0.34}
        >>> bool((found.located_angles[0] >= found.critical_angle).all())
        True
    """
    settings = GraspModel() if model is None else model
    check_point_contacts(settings)
    travel = _travel(outline, whole_number("points", points, FEWEST_POINTS))
    count = whole_number("edges of a planar cone", edges, FEWEST_EDGES)
    position = outline.fixed + travel
    contacts = outline.contacts_about_center(position)
    fixed = outline.contacts_about_center(position[:1])
    worst, best = critical_angles(fixed, contacts)
    located = (worst, best)
    if not settings.is_uniform:
        located = located_angles(fixed, contacts, ContactPairLimits.of_model(settings))
    return PlanarScan(
        outline=outline,
        model=settings,
        edges=count,
        rings=rings,
        position=locked(position),
        weights=locked(_weights(travel, contacts, outline.perimeter)),
        contacts=contacts,
        critical_angle=locked(worst),
        critical_angle_best=locked(best),
        located_angles=(locked(located[0]), locked(located[1])),
        label=locked(label_angles(located[0] + TIE, located[1] + TIE, settings)),
    )


def _travel(outline: Outline, points: int) -> Floats:
    """Arc lengths from the fixed finger: evenly spaced ones and the corners, in order."""
    even = np.linspace(0.0, outline.perimeter, points + 1)
    corners = np.remainder(outline.corner_positions - outline.fixed, outline.perimeter)
    apart = np.abs(corners[:, None] - even).min(axis=1) > TINY * outline.perimeter
    return np.sort(np.concatenate([even[:-1], corners[apart]]))


def _weights(travel: Floats, contacts: OutlineContacts, perimeter: float) -> Floats:
    """Fraction of the perimeter nearest to each point, except to corners and the fixed point."""
    weighted = contacts.half_range <= STRAIGHT
    weighted[0] = False
    smooth = np.flatnonzero(weighted)
    if len(smooth) == 0:
        raise SettingError("every point is a corner of the outline; scan more points")
    bounds = 0.5 * (travel[smooth[:-1] + 1] + travel[smooth[1:] - 1])
    weights = np.zeros(len(travel))
    weights[smooth] = np.diff(np.concatenate([[0.0], bounds, [perimeter]])) / perimeter
    return weights
