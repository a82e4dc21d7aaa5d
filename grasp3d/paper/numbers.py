"""numbers.md: the paper's numbers beside ours, fractions S, M, U, errors of sampled normals."""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from grasp3d.paper.errors import receptive_fields, uncertainties
from grasp3d.paper.markdown import fraction_cells, percent, table
from grasp3d.paper.objects import ScannedObject
from grasp3d.paper.paper_settings import PaperSettings
from grasp3d.paper.quoted import quoted_numbers
from grasp3d.planar import Circle, Outline, PlanarScan, scan, square
from grasp3d.settings import GraspModel
from grasp3d.stability.angle_distributions import AngleDistribution, accuracy_ceiling

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


def numbers_page(
    settings: PaperSettings, objects: Sequence[ScannedObject], sampled: Mapping[str, str]
) -> str:
    """Write the page.

    Args:
        settings: Friction and resolutions.
        objects: Scanned objects in space.
        sampled: Further sections, by title: sampled labels against exact ones.
    """
    sections = {
        "The numbers in the text": quoted_numbers(),
        "Fractions at the resolutions of Fig. 7 and 9": _shown(settings),
        "ε at the effective friction": _effective(settings),
        **{
            f"The {outline.name} over the resolution, μ = {friction:g}": _over(outline, friction)
            for friction in dict.fromkeys((settings.friction, SLIPPERY))
            for outline in (Circle(), square())
        },
        "In space": _in_space(objects, settings),
        "Receptive field and location (Fig. 4)": receptive_fields(),
        "Further uncertainties": uncertainties(settings, objects),
        **sampled,
    }
    parts = [_HEAD, *(f"## {title}\n\n{text}" for title, text in sections.items())]
    return "\n\n".join(parts) + "\n"


_HEAD = """# Wan & Howe 2018, recomputed

Q. Wan, R. D. Howe, "Modeling the Effects of Contact Sensor Resolution on Grasp Success", IEEE
Robotics and Automation Letters, 2018. Quoted numbers are in the columns 'in the paper' only; all
others were computed when this page was written. β = atan μ is the friction angle, α the sensor
resolution; S: surely stable, M: ambiguous, U: surely unstable."""


def _shown(settings: PaperSettings) -> str:
    head = ("object", "α", "S", "M", "U", "ceiling S + U + M/2", "points whose hulls disagree")
    rows = []
    for model in settings.models:
        for outline in (Circle(), square()):
            found = scan(outline, model)
            exact = _fractions(outline, model)
            differing = int((found.label_extremes != found.label).sum())
            rows.append(
                [outline.name, _degrees(model), *fraction_cells(exact),
                 percent(accuracy_ceiling(exact)), f"{differing} of {len(found.label)}"]
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
            found = scan(Circle(), model, points=FEW_POINTS, edges=edges)
            opposite = FEW_POINTS // 2
            difference = float(np.abs(found.epsilon_effective - found.epsilon_min).max())
            values = (found.epsilon, found.epsilon_min, found.epsilon_effective)
            rows.append(
                [_degrees(model), str(edges), *(f"{value[opposite]:.4f}" for value in values),
                 f"{difference:.1e}"]
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
        exact, found = _fractions(outline, model), scan(outline, model)
        four, rings = _differing(found)
        rows.append(
            [f"{degrees:g}°", *fraction_cells(exact), percent(accuracy_ceiling(exact)),
             *fraction_cells(found.fractions(of="four")), percent(four), percent(rings)]
        )  # fmt: skip
        if four > LEAST:
            differing.append(f"{degrees:g}°")
    bound = math.degrees(2.0 * math.atan(friction))
    where = f"here at α = {', '.join(differing)}" if differing else "nowhere in this table"
    return (
        f"Fractions of the perimeter in closed form, and from the hulls of the paper's four "
        f"combinations of extreme cones alone, over {len(found.label)} points. The four differ "
        f"from the closed form where α > 2β = {bound:.2f}° (at 2β itself at single points): "
        f"{where}. Then the extreme cones of a contact leave a gap between them, and a grasp line "
        "within it is labelled U although it is M. Rings of normals in the gap, at most 2β apart, "
        "correct that (last column). Fractions from points differ from the closed form by at most "
        "a few spacings of the points.\n\n" + table(head, rows, left=0)
    )


def _differing(found: PlanarScan) -> tuple[float, float]:
    """Fractions of the perimeter where the four, and all tested normals, differ from the labels."""
    four, rings = (
        float(found.weights[labels != found.label].sum())
        for labels in (found.label_four, found.label_extremes)
    )
    return four, rings


def _in_space(objects: Sequence[ScannedObject], settings: PaperSettings) -> str:
    head = ("object", "α", "S", "M", "U", "ceiling", "S, closed form", "M, closed form",
            "U, closed form")  # fmt: skip
    rows = []
    for scanned in objects:
        for found in scanned.scans:
            exact = scanned.closed_form
            ours = found.fractions()
            closed = ["–"] * 3 if exact is None else fraction_cells(_fractions(exact, found.model))
            rows.append(
                [scanned.name, _degrees(found.model), *fraction_cells(ours),
                 percent(accuracy_ceiling(ours)), *closed]
            )  # fmt: skip
    return (
        f"μ = {settings.friction:g}. Area fractions, one finger fixed, the other scanned over all "
        "vertices; the paper announces these counterparts. On the sphere S = sin²(β − α/2) "
        "and M = sin 2β · sin α while α/2 ≤ β and β + α/2 ≤ 90°.\n\n" + table(head, rows)
    )


def _fractions(angles: AngleDistribution, model: GraspModel) -> dict[str, float]:
    return angles.fractions(friction=model.friction, sensor_resolution=model.sensor_resolution)


def _degrees(model: GraspModel) -> str:
    return f"{math.degrees(model.sensor_resolution):.4g}°"
