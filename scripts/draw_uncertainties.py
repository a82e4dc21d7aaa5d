"""Draw the fractions S, M and U over the uncertainties that Wan & Howe name but work out no more.

    python scripts/draw_uncertainties.py FOLDER

They are those of friction, contact location and joint encoders (Sec. III-A and IV-B). Beside them
are fractions of random true grasps, an independent check of the closed form: contacts, normals and
frictions are drawn within their bounds, and each true grasp is decided by the definition alone. The
figures are extension_errors and extension_map; a table is printed.
"""

import argparse
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from grasp3d.arrays import Bools, Floats
from grasp3d.paper.figures import ScannedObject, solids
from grasp3d.paper.markdown import fraction_cells, percent, resolution_cell, table
from grasp3d.paper.paper_settings import PaperSettings
from grasp3d.planar import Circle, square
from grasp3d.plots.figures import PAGE, label_patches, new_figure, save, styled
from grasp3d.plots.fractions import axis_numbers, stack_fractions
from grasp3d.plots.heat_maps import heat_map_figure
from grasp3d.settings import DEGREE, GraspModel
from grasp3d.stability.angle_distributions import AngleDistribution, SphereAngles, accuracy_ceiling
from grasp3d.surface.sweeps import Sweep, sweep

PANEL_HEIGHT = 2.5
"""Height of the figure of all errors [inches]."""
_SAMPLED: dict[str, Any] = {
    "color": "black", "marker": "o", "markersize": 3.0, "linestyle": "none", "clip_on": False,
    "markerfacecolor": "none", "markeredgewidth": 0.8,
}  # fmt: skip
STEPS = 120
"""Steps of the swept uncertainties."""
SAMPLED = 5
"""Values of each uncertainty at which fractions are sampled."""
NORMAL_ERROR = 15.0 * DEGREE
"""Largest further error of normals [rad]."""
FRICTION_ERROR = 0.5
"""Largest friction error, as a fraction of the friction."""
CONTOURS = (0.1, 0.25, 0.4)
"""Fractions S that are drawn as lines."""

GRASPS = 360
"""Perceived grasps, evenly around the circle."""
TRUE = 400
"""True grasps of each perceived one."""
EXTREME = 0.7
"""Fraction of the errors that are as large as possible."""
SEED = 2018
LOCATIONS = (0.05, 0.1)
"""Location errors, in radii or half sides."""
TABLE_FRICTION_ERROR = 0.2
"""Friction error, as a fraction of the friction."""
TABLE_NORMAL_ERROR = 3.0 * DEGREE
"""Further error of the normals [rad]."""


@dataclass(frozen=True, eq=False)
class ErrorPanel:
    """Fractions over one uncertainty."""

    sweep: Sweep
    """One row; its columns are the uncertainty."""
    title: str
    """Of the horizontal axis, with a unit."""
    sampled: Sequence[tuple[float, float, float]] = ()
    """Sampled fractions: the uncertainty as it is drawn, S, and U."""


@styled
def error_fractions_figure(panels: Sequence[ErrorPanel], *, title: str, label: str) -> Figure:
    """Draw stacked fractions over each uncertainty, side by side.

    Args:
        panels: At least one.
        title: Title of the figure.
        label: Name of the fractions.
    """
    figure = new_figure(PAGE, PANEL_HEIGHT)
    grid = figure.subplots(1, len(panels), sharey=True, squeeze=False)[0]
    for axes, panel in zip(grid, panels, strict=True):
        stack_fractions(axes, panel.sweep)
        numbers = axis_numbers(panel.sweep, panel.sweep.columns)
        axes.set(xlabel=panel.title, xlim=(0.0, numbers[-1]))
        axes.xaxis.set_major_locator(MaxNLocator(5, steps=[1, 2, 5, 10]))
        for at, stable, unstable in panel.sampled:
            axes.plot([at, at], [100.0 * stable, 100.0 * (1.0 - unstable)], **_SAMPLED)
    grid[0].set_ylabel(f"{label} [%]")
    figure.suptitle(title, fontsize="medium")
    handles: list[Any] = [*label_patches()]
    if any(panel.sampled for panel in panels):
        handles.append(Line2D([], [], label="bounds of S and U, sampled", **_SAMPLED))
    figure.legend(handles=handles, loc="outside lower center", ncols=4)
    return figure


def over_errors(settings: PaperSettings) -> Figure:
    """Draw fractions of the circle over location, friction and normal errors, in closed form."""
    model = settings.models[0]
    panels = [
        _panel(model, "location_error", largest_location(model), "location error [radii]"),
        _panel(model, "friction_error", FRICTION_ERROR * model.friction, r"friction error $\pm$"),
        _panel(model, "normal_error", NORMAL_ERROR, "further error of normals [°]"),
    ]
    degrees = math.degrees(model.sensor_resolution)
    return error_fractions_figure(
        panels,
        title=rf"circle, $\mu$ = {model.friction:g}, $\alpha$ = {degrees:.4g}°, "
        "the other errors 0",
        label="fraction of the perimeter",
    )


def over_resolution_and_location(settings: PaperSettings) -> Figure:
    """Draw S and M of the circle over resolution and location error, as maps."""
    return heat_map_figure([resolution_and_location(settings)], fractions=CONTOURS)


def resolution_and_location(settings: PaperSettings) -> Sweep:
    """Fractions of the circle over resolution and location error, in radii, up to where S ends."""
    exact = GraspModel(friction=settings.friction, sensor_resolution=0.0)
    return sweep(
        Circle(),
        friction=settings.friction,
        sensor_resolution=np.linspace(0.0, 2.0 * exact.friction_angle, STEPS + 1),
        location_error=np.linspace(0.0, largest_location(exact), STEPS + 1),
        name="circle of radius 1",
        mode="scan",
    )


def largest_location(model: GraspModel) -> float:
    """Location error from which on no grasp of a circle of radius 1 is S; at least 0.05.

    The fingers opposite each other are S while asin(error) < beta - alpha / 2.
    """
    return max(0.05, math.sin(max(model.effective_friction_angle, 0.0)))


def _panel(model: GraspModel, name: str, largest: float, title: str) -> ErrorPanel:
    """Fractions over one uncertainty from 0 to the largest, and sampled ones at a few."""
    values = np.linspace(0.0, largest, STEPS + 1)
    fractions = sweep(
        Circle(),
        friction=model.friction,
        sensor_resolution=model.sensor_resolution,
        name="circle",
        mode="scan",
        **{name: values},
    )
    return ErrorPanel(fractions, title, _sampled(model, name, values[:: STEPS // SAMPLED]))


def _sampled(model: GraspModel, name: str, values: Floats) -> list[tuple[float, float, float]]:
    in_degrees = name == "normal_error"
    sampled = []
    for value in values.tolist():
        settings = {
            "friction": model.friction,
            "sensor_resolution": model.sensor_resolution,
            name: value,
        }
        number = math.degrees(value) if in_degrees else value
        sampled.append((number, *sampled_fractions(GraspModel(**settings))))
    return sampled


def sampled_fractions(model: GraspModel, *, true: int = TRUE) -> tuple[float, float]:
    """Fractions of perceived grasps of a circle of radius 1 that hold always, and never.

    Args:
        model: Friction and its error, tilt and location error in radii.
        true: True grasps of each.

    Returns:
        (S, U). Sampling misses some true grasps that fail or hold, so both are a little too large.
    """
    rng = np.random.default_rng(SEED)
    turn = (np.arange(GRASPS) + 0.5) * (2.0 * math.pi / GRASPS)
    angles = np.stack([np.zeros(GRASPS), turn], axis=1)
    points = np.stack([np.cos(angles), np.sin(angles)], axis=-1)  # (g, 2, 2)
    held = _held(points, angles + math.pi, model, true, rng)
    return float(held.all(axis=1).mean()), 1.0 - float(held.any(axis=1).mean())


def _held(
    points: Floats, normals: Floats, model: GraspModel, true: int, rng: np.random.Generator
) -> Bools:
    """Force closure of random true grasps, shape (g, true).

    Args:
        points: Perceived contacts, shape (g, 2, 2).
        normals: Polar angles of their normals [rad], shape (g, 2).
        model: What is known about them.
        true: True grasps of each perceived one.
        rng: Random numbers.
    """
    shape = (len(points), true, 2)
    direction = rng.uniform(0.0, 2.0 * math.pi, shape)
    radius = float(model.location_error) * np.abs(_errors(shape, rng))
    shift = radius[..., None] * np.stack([np.cos(direction), np.sin(direction)], axis=-1)
    apart = np.diff(points[:, None] + shift, axis=2)[:, :, 0]  # (g, true, 2)
    line = np.arctan2(apart[..., 1], apart[..., 0])[..., None] + [0.0, math.pi]
    turn = line - normals[:, None] - model.tilt * _errors(shape, rng)
    off = np.abs(np.remainder(turn + math.pi, 2.0 * math.pi) - math.pi)
    cone = np.arctan(model.friction + model.friction_error * _errors(shape, rng))
    return np.asarray((off < cone).all(axis=-1) | (math.pi - off < cone).all(axis=-1))


def _errors(shape: tuple[int, ...], rng: np.random.Generator) -> Floats:
    """Errors from -1 to 1, most of them at the ends."""
    ends = rng.choice([-1.0, 1.0], shape)
    return np.where(rng.random(shape) < EXTREME, ends, rng.uniform(-1.0, 1.0, shape))


def uncertainties(settings: PaperSettings, objects: Sequence[ScannedObject]) -> str:
    """Write a table of fractions S, M and U of shapes and scanned objects under further errors.

    Args:
        settings: Friction and resolutions.
        objects: Scanned objects; those that have a closed form appear with that.
    """
    head = ("object", "α", "errors", "S", "M", "U", "ceiling S + U + M/2")
    rows = []
    for model in settings.models:
        for name, angles_at in _distributions(objects):
            for text, location, friction_error, normal_error in _cases(settings.friction):
                fractions = angles_at(location).fractions(
                    friction=settings.friction,
                    sensor_resolution=model.sensor_resolution,
                    friction_error=friction_error,
                    normal_error=normal_error,
                )
                cells = [*fraction_cells(fractions), percent(accuracy_ceiling(fractions))]
                rows.append([name, resolution_cell(model), text, *cells])
    return (
        f"μ = {settings.friction:g}. The paper names friction, contact location and joint encoders "
        "(Sec. III-A, IV-B) beside the normals of its sensor and gives no figure for them. "
        "Locations of both contacts are known to within a fraction of the radius (circle, sphere, "
        "cylinder) or of half a side (square, box), friction to "
        "within 20 %, normals to 3° beyond α/2, as joint encoders cause it. Circle, square and "
        "sphere are in closed form, the others scanned with one finger fixed. With the smallest "
        "and largest friction angles β₋ and β₊, a = α/2 + normal error, θ = β₋ − a and the "
        "location error δ, on a circle of radius R S = (θ + asin(sin θ − 2δ/R))/π while "
        "δ < R sin θ, and U = 1 − 2(β₊ + a)/π whatever δ is: the normals of two contacts lie "
        "symmetrically about their line, and no other line is nearer to both. The figures "
        "`extension_errors` and `extension_map` show them, the former beside random true contacts, "
        "normals and frictions.\n\n" + table(head, rows, left=3)
    )


def _distributions(
    objects: Sequence[ScannedObject],
) -> Iterator[tuple[str, Callable[[float], AngleDistribution]]]:
    """Names, and the angles at a location error given in radii or half sides."""
    yield "circle", lambda location: Circle().angle_distribution(location_error=location)
    yield "square", lambda location: square().angle_distribution(location_error=location)
    yield "sphere, by area", SphereAngles
    for scanned in objects:
        if scanned.closed_form is None:
            yield f"{scanned.name}, by area", partial(_angles_at, scanned)


def _angles_at(scanned: ScannedObject, location: float) -> AngleDistribution:
    return scanned.scans[0].angle_distribution(location_error=location)


def _cases(friction: float) -> Iterator[tuple[str, float, float, float]]:
    """Names, location errors, friction errors and normal errors."""
    error = TABLE_FRICTION_ERROR * friction
    yield "none", 0.0, 0.0, 0.0
    for location in LOCATIONS:
        yield f"location {location:g}", location, 0.0, 0.0
    yield f"friction ± {error:g}", 0.0, error, 0.0
    degrees = math.degrees(TABLE_NORMAL_ERROR)
    yield f"normals {degrees:g}°", 0.0, 0.0, TABLE_NORMAL_ERROR
    text = f"location {LOCATIONS[-1]:g}, friction ± {error:g}, normals {degrees:g}°"
    yield text, LOCATIONS[-1], error, TABLE_NORMAL_ERROR


def main() -> None:
    """Write the figures, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    folder, settings = parser.parse_args().folder, PaperSettings()
    folder.mkdir(parents=True, exist_ok=True)
    save(over_errors(settings), folder / "extension_errors")
    save(over_resolution_and_location(settings), folder / "extension_map")
    print(uncertainties(settings, list(solids(settings))))


if __name__ == "__main__":
    main()
