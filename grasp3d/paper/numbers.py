"""numbers.md: the paper's numbers beside ours, fractions S, M and U.

Its text, and the numbers that the paper states, are in the template of the same name.
"""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from grasp3d.contact.sensor import Sensor
from grasp3d.paper.figures import PaperSettings, ScannedObject
from grasp3d.planar import Circle, Outline, Square, scan
from grasp3d.settings import DEGREE, GraspModel
from grasp3d.stability.angle_distributions import AngleDistribution, SphereAngles, accuracy_ceiling

RADIUS = 10.0
"""Radius of the paper's hemispherical fingertip [mm]."""
FIELDS = (4.0, 9.0)
"""Receptive fields of the paper's two fingertips, about [mm]."""
OPENINGS = (20.0, 40.0, 80.0)
"""Openings at which the turn of the line is compared [mm]."""

DEGREES = (5.0, 10.0, 15.0, 22.6, 30.0, 45.0, 60.0, 90.0, 100.0, 120.0)
"""Resolutions of the tables [degrees]."""
SLIPPERY = 0.2
"""Friction of the second set of tables, where the four combinations fail at small resolutions."""
ARC = 65
"""Forces with which a planar cone approximates the arc between its two edges."""
FEW_POINTS = 72
"""Points at which epsilon at the effective friction is compared."""

COARSE = 22.6 * DEGREE
"""Resolution at which the paper reads a value from its Fig. 8, at friction 1 [rad]."""
OUTLINES: dict[str, Outline] = {"circle": Circle(), "square": Square()}
SHAPES: dict[str, AngleDistribution] = {**OUTLINES, "sphere": SphereAngles()}


def numbers_page(settings: PaperSettings, objects: Sequence[ScannedObject]) -> str:
    """Write the page.

    Args:
        settings: Friction and resolutions.
        objects: Scanned objects in space.
    """
    fingertips = [Sensor.limiting(friction, RADIUS) for friction in (0.5, SLIPPERY)]
    limits = [sensor.resolution for sensor in fingertips]
    before, after, coarse = (
        {name: _fractions(shape, GraspModel(1.0, angle)) for name, shape in SHAPES.items()}
        for angle in (*limits, COARSE)
    )
    remaining = [after[name]["M"] / before[name]["M"] for name in SHAPES]
    slippery = _fractions(SHAPES["sphere"], GraspModel(SLIPPERY, COARSE))
    template = Path(__file__).with_suffix(".md").read_text(encoding="utf-8")
    return template.format(
        friction=settings.friction,
        sensors=fingertips,
        limits=np.degrees(limits),
        rounded=Sensor(4.0, RADIUS),
        before={name: _cells(fractions) for name, fractions in before.items()},
        after={name: _cells(fractions) for name, fractions in after.items()},
        coarse={name: _cells(fractions) for name, fractions in coarse.items()},
        slippery=percent(slippery["M"]),
        remaining=[percent(min(remaining)), percent(max(remaining))],
        least=math.tan(COARSE / 2.0),
        most=1.0 / math.tan(COARSE / 2.0),
        at_resolutions=_at_resolutions(settings),
        effective=_effective(settings),
        outlines="\n\n".join(
            _over(outline, friction)
            for friction in dict.fromkeys((settings.friction, SLIPPERY))
            for outline in OUTLINES.values()
        ),
        in_space=_in_space(objects),
        tips=_tips(),
    )


def _at_resolutions(settings: PaperSettings) -> str:
    rows = []
    for one in [scan(outline, model) for model in settings.models for outline in OUTLINES.values()]:
        differing = (one.label_extremes != one.label).sum()
        rows.append(
            {
                "object": one.outline.name,
                "α": _alpha(one.model),
                **_cells(_fractions(one.outline, one.model)),
                "points whose hulls disagree": f"{differing} of {len(one.label)}",
            }
        )
    return _table(rows)


def _effective(settings: PaperSettings) -> str:
    opposite = FEW_POINTS // 2
    rows = [
        {
            "α": _alpha(one.model),
            "forces of a cone": str(one.edges),
            "ε, perceived normals": f"{one.epsilon[opposite]:.4f}",
            "smallest ε over the tilts": f"{one.epsilon_min[opposite]:.4f}",
            "ε at μ_eff": f"{one.epsilon_effective[opposite]:.4f}",
            "largest difference around the circle": (
                f"{np.abs(one.epsilon_effective - one.epsilon_min).max():.1e}"
            ),
        }
        for model in settings.models
        for one in (scan(Circle(), model, points=FEW_POINTS, edges=edges) for edges in (2, ARC))
    ]
    return _table(rows, left=0)


def _over(outline: Outline, friction: float) -> str:
    rows = []
    for degrees in DEGREES:
        model = GraspModel(friction=friction, sensor_resolution=degrees * DEGREE)
        scanned = scan(outline, model)
        four, rings = (
            percent(float(scanned.weights[labels != scanned.label].sum()))
            for labels in (scanned.label_four, scanned.label_extremes)
        )
        parts = scanned.fractions(scanned.label_four).items()
        rows.append(
            {
                "α": _alpha(model),
                **_cells(_fractions(outline, model)),
                **{f"{name}, four": percent(part) for name, part in parts},
                "labels that differ": four,
                "labels that differ, with rings": rings,
            }
        )
    bound = math.degrees(2.0 * math.atan(friction))
    title = f"## The {outline.name} over the resolution, μ = {friction:g}, 2β = {bound:.2f}°"
    return f"{title}\n\n{_table(rows, left=0)}"


def _in_space(objects: Sequence[ScannedObject]) -> str:
    rows = []
    for scanned in objects:
        for result in scanned.scans:
            ours, exact = result.fractions(), scanned.closed_form
            closed = {} if exact is None else _cells(_fractions(exact, result.model))
            rows.append(
                {
                    "object": scanned.name,
                    "α": _alpha(result.model),
                    **_cells(ours),
                    **{f"{name}, closed form": closed.get(name, "–") for name in ours},
                }
            )
    return _table(rows)


def _tips() -> str:
    rows = [
        {
            "fingertip": "flat" if tip.flat else f"round, radius {RADIUS:g} mm",
            "receptive field": f"{tip.receptive_field:g} mm",
            "location ±": f"{tip.location_uncertainty:g} mm",
            "normals, α": f"{math.degrees(tip.resolution):.1f}°",
            **{
                f"line turns, opening {opening:g} mm": f"{tip.line_error(opening) / DEGREE:.1f}°"
                for opening in OPENINGS
            },
            **{
                f"friction above, {opening:g} mm": f"{tip.required_friction_at(opening):.3f}"
                for opening in OPENINGS
            },
        }
        for field in FIELDS
        for tip in (Sensor(field, math.inf), Sensor(field, RADIUS))
    ]
    return _table(rows)


def _fractions(angles: AngleDistribution, model: GraspModel) -> dict[str, float]:
    return angles.fractions(friction=model.friction, sensor_resolution=model.sensor_resolution)


def _table(rows: Sequence[Mapping[str, str]], *, left: int = 1) -> str:
    """Write a table of rows by heading, whose first columns are text, the others numbers."""
    rule = [":---"] * left + ["---:"] * (len(rows[0]) - left)
    lines = [list(rows[0]), rule, *(row.values() for row in rows)]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def percent(fraction: float) -> str:
    """Write a fraction in percent with one decimal."""
    return f"{100.0 * fraction + 0.0:.1f} %"


def _cells(fractions: dict[str, float]) -> dict[str, str]:
    """Cells of the fractions S, M and U, and of the accuracy ceiling."""
    parts = {**fractions, "ceiling": accuracy_ceiling(fractions)}
    return {name: percent(part) for name, part in parts.items()}


def _alpha(model: GraspModel) -> str:
    return f"{math.degrees(model.sensor_resolution):.4g}°"
