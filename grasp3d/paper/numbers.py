"""numbers.md: the paper's numbers beside ours, fractions S, M and U."""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from grasp3d.contact.sensor import Sensor, resolution_limit
from grasp3d.paper.figures import ScannedObject
from grasp3d.paper.paper_settings import PaperSettings
from grasp3d.planar import Circle, Outline, Square, scan
from grasp3d.settings import GraspModel
from grasp3d.stability.angle_distributions import AngleDistribution, SphereAngles, accuracy_ceiling

RADIUS = 10.0
"""Radius of the paper's hemispherical fingertip [mm]."""
FIELDS = (4.0, 9.0)
"""Receptive fields of the paper's two fingertips, about [mm]."""
OPENINGS = (20.0, 40.0, 80.0)
"""Openings at which the turn of the line is compared [mm]."""


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


DEGREES = (5.0, 10.0, 15.0, 22.6, 30.0, 45.0, 60.0, 90.0, 100.0, 120.0)
"""Resolutions of the tables [degrees]."""
SLIPPERY = 0.2
"""Friction of the second set of tables, where the four combinations fail at small resolutions."""
ARC = 65
"""Forces with which a planar cone approximates the arc between its two edges."""
FEW_POINTS = 72
"""Points at which epsilon at the effective friction is compared."""
LEAST = 5e-4
"""Smallest fraction that is listed."""

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


def numbers_page(settings: PaperSettings, objects: Sequence[ScannedObject]) -> str:
    """Write the page.

    Args:
        settings: Friction and resolutions.
        objects: Scanned objects in space.
    """
    sections = {
        "The numbers in the text": quoted_numbers(),
        "Fractions at the resolutions of Fig. 7 and 9": _fractions_at_resolutions(settings),
        "ε at the effective friction": _effective(settings),
        **{
            f"The {outline.name} over the resolution, μ = {friction:g}": _over(outline, friction)
            for friction in dict.fromkeys((settings.friction, SLIPPERY))
            for outline in (Circle(), Square())
        },
        "In space": _in_space(objects, settings),
        "Receptive field and location (Fig. 4)": receptive_fields(),
    }
    parts = [_HEAD, *(f"## {title}\n\n{text}" for title, text in sections.items())]
    return "\n\n".join(parts) + "\n"


_HEAD = """# Wan & Howe 2018, recomputed

Q. Wan, R. D. Howe, "Modeling the Effects of Contact Sensor Resolution on Grasp Success", IEEE
Robotics and Automation Letters, 2018. Quoted numbers are in the columns 'in the paper' only; all
others were computed when this page was written. β = atan μ is the friction angle, α the sensor
resolution; S: surely stable, M: ambiguous, U: surely unstable."""


def _fractions_at_resolutions(settings: PaperSettings) -> str:
    head = ("object", "α", "S", "M", "U", "ceiling S + U + M/2", "points whose hulls disagree")
    rows = []
    for model in settings.models:
        for outline in (Circle(), Square()):
            scanned = scan(outline, model)
            exact = _fractions(outline, model)
            differing = int((scanned.label_extremes != scanned.label).sum())
            rows.append(
                [outline.name, resolution_cell(model), *fraction_cells(exact),
                 percent(accuracy_ceiling(exact)), f"{differing} of {len(scanned.label)}"]
            )  # fmt: skip
    return (
        f"μ = {settings.friction:g}. Fractions of the perimeter in closed form; on the circle S = "
        "2(β − α/2)/π and M = 2α/π while α/2 ≤ β and β + α/2 ≤ 90°. The last column compares the "
        "exact labels of the scanned points with labels from the wrench hulls of all tested "
        "normals alone.\n\n" + table(head, rows)
    )


def _effective(settings: PaperSettings) -> str:
    head = ("α", "forces of a cone", "ε, perceived normals", "smallest ε over the tilts",
            "ε at μ_eff", "largest difference around the circle")  # fmt: skip
    rows = []
    for model in settings.models:
        for edges in (2, ARC):
            scanned = scan(Circle(), model, points=FEW_POINTS, edges=edges)
            opposite = FEW_POINTS // 2
            difference = float(np.abs(scanned.epsilon_effective - scanned.epsilon_min).max())
            values = (scanned.epsilon, scanned.epsilon_min, scanned.epsilon_effective)
            rows.append(
                [resolution_cell(model), str(edges),
                 *(f"{value[opposite]:.4f}" for value in values), f"{difference:.1e}"]
            )  # fmt: skip
    return (
        f"Circle, μ = {settings.friction:g}, fingers opposite each other. With round cones the "
        "smallest ε over all tilts is exactly ε at μ_eff = tan(β − α/2). Cones of two unit forces, "
        "as in the plane of the paper, are cut off by the straight line between them, the more the "
        "wider they are: there ε at μ_eff is somewhat larger than the smallest ε, while force "
        "closure is the same at all points. More forces between the two reduce the difference.\n\n"
        + table(head, rows, left=0)
    )


def _over(outline: Outline, friction: float) -> str:
    head = ("α", "S", "M", "U", "ceiling", "S, four", "M, four", "U, four", "labels that differ",
            "labels that differ, with rings")  # fmt: skip
    rows, differing = [], []
    for degrees in DEGREES:
        model = GraspModel(friction=friction, sensor_resolution=math.radians(degrees))
        exact, scanned = _fractions(outline, model), scan(outline, model)
        four, rings = (
            float(scanned.weights[labels != scanned.label].sum())
            for labels in (scanned.label_four, scanned.label_extremes)
        )
        rows.append(
            [f"{degrees:g}°", *fraction_cells(exact), percent(accuracy_ceiling(exact)),
             *fraction_cells(scanned.fractions(of="four")), percent(four), percent(rings)]
        )  # fmt: skip
        if four > LEAST:
            differing.append(f"{degrees:g}°")
    bound = math.degrees(2.0 * math.atan(friction))
    where = f"here at α = {', '.join(differing)}" if differing else "nowhere in this table"
    return (
        f"Fractions of the perimeter in closed form, and from the hulls of the paper's four "
        f"combinations of extreme cones alone, over {len(scanned.label)} points. The four differ "
        f"from the closed form where α > 2β = {bound:.2f}° (at 2β itself at single points): "
        f"{where}. Then the extreme cones of a contact leave a gap between them, and a grasp line "
        "within it is labelled U although it is M. Rings of normals in the gap, at most 2β apart, "
        "correct that (last column). Fractions from points differ from the closed form by at most "
        "a few spacings of the points.\n\n" + table(head, rows, left=0)
    )


def _in_space(objects: Sequence[ScannedObject], settings: PaperSettings) -> str:
    head = ("object", "α", "S", "M", "U", "ceiling", "S, closed form", "M, closed form",
            "U, closed form")  # fmt: skip
    rows = []
    for scanned in objects:
        for result in scanned.scans:
            exact = scanned.closed_form
            ours = result.fractions()
            closed = ["–"] * 3 if exact is None else fraction_cells(_fractions(exact, result.model))
            rows.append(
                [scanned.name, resolution_cell(result.model), *fraction_cells(ours),
                 percent(accuracy_ceiling(ours)), *closed]
            )  # fmt: skip
    return (
        f"μ = {settings.friction:g}. Area fractions, one finger fixed, the other scanned over all "
        "vertices; the paper announces these counterparts. On the sphere S = sin²(β − α/2) "
        "and M = sin 2β · sin α while α/2 ≤ β and β + α/2 ≤ 90°.\n\n" + table(head, rows)
    )


def _fractions(angles: AngleDistribution, model: GraspModel) -> dict[str, float]:
    return angles.fractions(friction=model.friction, sensor_resolution=model.sensor_resolution)


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
    circle, square, _ = (fractions["M"] for fractions in _shapes(COARSE))
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
         "`grasp3d.planar.Square`", "not what Fig. 8 shows, but nearer"),
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
        f"{name}: {percent(accuracy_ceiling(fractions))}"
        for name, fractions in zip(SHAPES, _shapes(COARSE), strict=True)
    )
    return (
        f"best accuracy at α = {math.degrees(COARSE):g}°, μ = {READ_AT:g} (Sec. IV-C)", CEILING,
        values, "S + U + M / 2", "agrees: all are below 90 %, the sphere's by most",
    )  # fmt: skip


def _shapes(resolution: float) -> tuple[dict[str, float], ...]:
    """Fractions of `SHAPES` at the friction at which the paper reads its Fig. 8."""
    shapes: tuple[AngleDistribution, ...] = (Circle(), Square(), SphereAngles())
    return tuple(
        shape.fractions(friction=READ_AT, sensor_resolution=resolution) for shape in shapes
    )


def table(head: Sequence[str], rows: Sequence[Sequence[str]], *, left: int = 1) -> str:
    """Write a table.

    Args:
        head: Headings.
        rows: Cells, as many in each row as there are headings.
        left: Number of left-aligned columns of text; the others are right-aligned numbers.
    """
    rule = [":---"] * left + ["---:"] * (len(head) - left)
    return "\n".join(f"| {' | '.join(row)} |" for row in (head, rule, *rows))


def percent(fraction: float) -> str:
    """Write a fraction in percent with one decimal."""
    return f"{100.0 * fraction + 0.0:.1f} %"


def fraction_cells(fractions: Mapping[str, float]) -> list[str]:
    """Write the fractions S, M and U, one cell each."""
    return [percent(fractions[name]) for name in ("S", "M", "U")]


def resolution_cell(model: GraspModel) -> str:
    """Write the resolution of a model in degrees."""
    return f"{math.degrees(model.sensor_resolution):.4g}°"
