"""Numbers quoted from the text of Wan & Howe 2018, beside the same numbers computed."""

import math

from grasp3d.contact.sensor import Sensor, resolution_limit
from grasp3d.paper.markdown import percent, table
from grasp3d.planar import circle_fractions, square_fractions
from grasp3d.stability.angle_distributions import SphereAngles, accuracy_ceiling

RADIUS = 10.0
"""Radius of the paper's hemispherical fingertip [mm]."""
ROUNDED_ARC = 4.0
"""The paper's arc at friction 0.2 [mm]."""
COARSE = math.radians(22.6)
"""Resolution at which the paper reads a value from its Fig. 8 [rad]."""
READ_AT = 1.0
"""Friction of that figure."""
SHAPES = ("circle", "square", "sphere")
"""Shapes that are compared; fractions of the perimeter, of the sphere by area."""
SPHERE = (0.2, 1.0)
"""Range of friction for which the sphere is compared."""

HEAD = ("quantity", "in the paper", "computed", "closed form", "compared")
QUOTED = {
    0.5: ("α ≤ 2 atan μ ≈ 53°", "about 9 mm", "at least 10"),
    0.2: ("22.6°", "about 4 mm", "50"),
}
"""By friction: the bound on the resolution, the arc on the fingertip, the number of sensors (Sec.
IV-A)."""
ALMOST = "almost 20 %"
HALF = "reduced by approximately half"
"""What the paper expects of the second fingertip instead of the first (Sec. IV-A)."""
CEILING = "not above 90 %"
"""Accuracy of predictors at that resolution (Sec. IV-C)."""


def quoted_numbers() -> str:
    """Write the table of the paper's numbers beside those computed here."""
    rows = [row for friction in QUOTED for row in _design(friction)]
    return table(HEAD, [*rows, *_ambiguous(), _halved(), _ceiling()], left=len(HEAD))


def _design(friction: float) -> list[tuple[str, ...]]:
    bound, arc, sensors = QUOTED[friction]
    limit = math.degrees(resolution_limit(friction))
    sensor = Sensor.limiting(friction, RADIUS)
    discs, caps = sensor.sensors_by_discs, sensor.sensors_by_caps
    tip = f"fingertip of {2.0 * RADIUS / 10.0:g} cm diameter, μ = {friction:g}"
    return [
        (f"bound on α, μ = {friction:g} (Sec. IV-A)", bound, f"{limit:.2f}°", "2 atan μ",
         "the same; at the bound itself no two fingers are surely stable, so α < 2 atan μ"),
        (f"arc, {tip}", arc, f"{sensor.receptive_field:.2f} mm", "α · radius", "the same, rounded"),
        (f"sensors, {tip}", sensors, f"{discs} (equal discs), {caps} (spherical caps)",
         "8 / α² and 1 / (1 − cos(α/2)), rounded up", _counted(sensors, sensor)),
    ]  # fmt: skip


def _counted(quoted: str, sensor: Sensor) -> str:
    """Compare numbers of sensors, counted by discs as in the paper."""
    if quoted.rsplit(maxsplit=1)[-1] == str(sensor.sensors_by_discs):
        return "the same"
    rounded = Sensor(ROUNDED_ARC, RADIUS).sensors_by_discs
    return (
        f"**differs**: the arc is {sensor.receptive_field:.2f} mm; rounded to {ROUNDED_ARC:g} mm "
        f"before counting it gives {rounded}"
    )


def _ambiguous() -> list[tuple[str, ...]]:
    """Ambiguous fractions at the resolution at which the paper reads its Fig. 8."""
    circle, square, _ = (found["M"] for found in _shapes(COARSE))
    spheres = [
        SphereAngles().fractions(friction=friction, sensor_resolution=COARSE)["M"]
        for friction in SPHERE
    ]
    least = math.tan(COARSE / 2.0)
    quantity = f"ambiguous at α = {math.degrees(COARSE):g}°"
    return [
        (f"{quantity}, circle, μ = {READ_AT:g} (Fig. 8)", ALMOST, percent(circle),
         "2α / π while α/2 ≤ β and β + α/2 ≤ 90°",
         f"**differs**: a value read off a curve; ours holds for μ {least:.2f} to {1 / least:.2f}"),
        (f"{quantity}, square, μ = {READ_AT:g}", "–", percent(square),
         "from the polygon, `grasp3d.planar.square`", "not what Fig. 8 shows, but nearer"),
        (f"{quantity}, sphere by area, μ = {SPHERE[0]:g} to {SPHERE[1]:g}", "–",
         " to ".join(percent(fraction) for fraction in spheres), "sin 2β · sin α",
         "depends on μ, unlike on the circle"),
    ]  # fmt: skip


def _halved() -> tuple[str, ...]:
    """Ambiguous fractions at the resolutions of the paper's two fingertips."""
    coarse, fine = (resolution_limit(friction) for friction in QUOTED)
    pairs = [(one["M"], two["M"]) for one, two in zip(_shapes(coarse), _shapes(fine), strict=True)]
    values = "; ".join(
        f"{name}: {percent(before)} → {percent(after)}"
        for name, (before, after) in zip(SHAPES, pairs, strict=True)
    )
    least, most = (pick(after / before for before, after in pairs) for pick in (min, max))
    change = f"α = {math.degrees(coarse):.4g}° → {math.degrees(fine):.4g}°"
    return (
        f"ambiguous region, {change}, μ = {READ_AT:g} (Sec. IV-A)", HALF, values,
        "M at both resolutions",
        f"agrees: between {percent(least)} and {percent(most)} of it remain",
    )  # fmt: skip


def _ceiling() -> tuple[str, ...]:
    """Best accuracies at the resolution at which the paper reads its Fig. 8."""
    values = "; ".join(
        f"{name}: {percent(accuracy_ceiling(found))}"
        for name, found in zip(SHAPES, _shapes(COARSE), strict=True)
    )
    return (
        f"best accuracy at α = {math.degrees(COARSE):g}°, μ = {READ_AT:g} (Sec. IV-C)", CEILING,
        values, "S + U + M / 2", "agrees: all are below 90 %, the sphere's by most",
    )  # fmt: skip


def _shapes(resolution: float) -> tuple[dict[str, float], ...]:
    """Fractions of `SHAPES` at the friction at which the paper reads its Fig. 8."""
    functions = (circle_fractions, square_fractions, SphereAngles().fractions)
    return tuple(
        fractions(friction=READ_AT, sensor_resolution=resolution) for fractions in functions
    )
