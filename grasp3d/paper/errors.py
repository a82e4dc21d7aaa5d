"""Tables of what the paper names and works out no more: locations, friction, further errors."""

import math
from collections.abc import Callable, Iterator, Sequence

from grasp3d.contact.sensor import Sensor
from grasp3d.paper.markdown import fraction_cells, percent, resolution_cell, table
from grasp3d.paper.objects import ScannedObject
from grasp3d.paper.paper_settings import PaperSettings
from grasp3d.planar import Circle, square
from grasp3d.settings import DEGREE
from grasp3d.stability.angle_distributions import (
    AngleDistribution,
    SphereAngles,
    accuracy_ceiling,
)

RADIUS = 10.0
"""Radius of the paper's hemispherical fingertip [mm]."""
FIELDS = (4.0, 9.0)
"""Receptive fields of the paper's two fingertips, about [mm]."""
OPENINGS = (20.0, 40.0, 80.0)
"""Openings at which the turn of the line is compared [mm]."""
LOCATIONS = (0.05, 0.1)
"""Location errors, in radii or half sides."""
FRICTION_ERROR = 0.2
"""Friction error, as a fraction of the friction."""
NORMAL_ERROR = 3.0 * DEGREE
"""Further error of the normals [rad]."""


def receptive_fields() -> str:
    """Write a table of how far location and normal may be off for flat and round tips (Fig. 4)."""
    head = ("fingertip", "receptive field", "location ±", "normals, α",
            *(f"line turns, opening {opening:g} mm" for opening in OPENINGS),
            *(f"friction above, {opening:g} mm" for opening in OPENINGS))  # fmt: skip
    rows = []
    for field in FIELDS:
        for name, radius in (("flat", math.inf), (f"round, radius {RADIUS:g} mm", RADIUS)):
            tip = Sensor(field, radius)
            rows.append(
                [name, f"{field:g} mm", f"{tip.location_uncertainty:g} mm",
                 f"{math.degrees(tip.resolution):.1f}°",
                 *(f"{math.degrees(tip.line_error(opening)):.1f}°" for opening in OPENINGS),
                 *(f"{tip.required_friction_at(opening):.3f}" for opening in OPENINGS)]
            )  # fmt: skip
    return (
        "How far the true contact and normal may be from the perceived ones within one receptive "
        "field. On a flat tip only the location is uncertain, on a round one the normal as well: "
        "each is off by up to half of what is given for the whole field. The uncertain locations "
        "turn the line of two opposing fingers, and 'friction above' is the coefficient that two "
        "such fingers need on parallel faces (`Sensor.required_friction_at`); the paper counts the "
        "normals alone, tan(α/2).\n\n" + table(head, rows)
    )


def uncertainties(settings: PaperSettings, objects: Sequence[ScannedObject]) -> str:
    """Write a table of fractions S, M and U of shapes and scanned objects under further errors.

    Args:
        settings: Friction and resolutions.
        objects: Scanned objects; those that have a closed form appear with that.
    """
    head = ("object", "α", "errors", "S", "M", "U", "ceiling S + U + M/2")
    rows = []
    for model in settings.models:
        for name, angles_at in _shapes(objects):
            for text, location, friction_error, normal_error in _cases(settings.friction):
                found = angles_at(location).fractions(
                    friction=settings.friction,
                    sensor_resolution=model.sensor_resolution,
                    friction_error=friction_error,
                    normal_error=normal_error,
                )
                cells = [*fraction_cells(found), percent(accuracy_ceiling(found))]
                rows.append([name, resolution_cell(model), text, *cells])
    return (
        f"μ = {settings.friction:g}. The paper names friction, contact location and joint encoders "
        "(Sec. III-A, IV-B) beside the normals of its sensor and gives no figure for them. "
        "Locations of both contacts are known to within a fraction of the radius (circle, sphere, "
        "cylinder), of half a side (square, box) or of half the size (a real object), friction to "
        "within 20 %, normals to 3° beyond α/2, as joint encoders cause it. Circle, square and "
        "sphere are in closed form, the others scanned with one finger fixed. With the smallest "
        "and largest friction angles β₋ and β₊, a = α/2 + normal error, θ = β₋ − a and the "
        "location error δ, on a circle of radius R S = (θ + asin(sin θ − 2δ/R))/π while "
        "δ < R sin θ, and U = 1 − 2(β₊ + a)/π whatever δ is: the normals of two contacts lie "
        "symmetrically about their line, and no other line is nearer to both. The figures "
        "`extension_errors` and `extension_map` show them, the former beside random true contacts, "
        "normals and frictions.\n\n" + table(head, rows, left=3)
    )


def _shapes(
    objects: Sequence[ScannedObject],
) -> Iterator[tuple[str, Callable[[float], AngleDistribution]]]:
    """Names, and the angles at a location error given in radii or half sides."""
    yield "circle", lambda location: Circle().angle_distribution(location_error=location)
    yield "square", lambda location: square().angle_distribution(location_error=location)
    yield "sphere, by area", SphereAngles
    for scanned in objects:
        if scanned.closed_form is None:
            yield f"{scanned.name}, by area", _angles_of(scanned)


def _angles_of(scanned: ScannedObject) -> Callable[[float], AngleDistribution]:
    def angles_at(location: float) -> AngleDistribution:
        labels = scanned.scans[0]
        return labels.angle_distribution(location_error=location * scanned.length)

    return angles_at


def _cases(friction: float) -> Iterator[tuple[str, float, float, float]]:
    """Names, location errors, friction errors and normal errors."""
    error = FRICTION_ERROR * friction
    yield "none", 0.0, 0.0, 0.0
    for location in LOCATIONS:
        yield f"location {location:g}", location, 0.0, 0.0
    yield f"friction ± {error:g}", 0.0, error, 0.0
    degrees = math.degrees(NORMAL_ERROR)
    yield f"normals {degrees:g}°", 0.0, 0.0, NORMAL_ERROR
    text = f"location {LOCATIONS[-1]:g}, friction ± {error:g}, normals {degrees:g}°"
    yield text, LOCATIONS[-1], error, NORMAL_ERROR
