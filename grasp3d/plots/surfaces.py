"""Figure of a labelled surface beside its area fractions over the sensor's resolution."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from grasp3d.arrays import Bytes
from grasp3d.plots.fraction_figures import CLOSED_FORM, draw_fractions
from grasp3d.plots.style import (
    PAGE,
    fractions_text,
    label_patches,
    new_figure,
    show_picture,
    styled,
)
from grasp3d.rendering import Finger
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.sweeps import Sweep

HEIGHT = 2.75
"""Height of the figure [inch]."""
PICTURE, CURVES = 1.0, 1.12
"""Width ratio of a picture and the curves."""

_SHOWN: dict[str, Any] = {
    "color": "black", "linestyle": "none", "marker": "v", "markersize": 4.0, "clip_on": False,
}  # fmt: skip


@styled
def surface_figure(
    scans: Sequence[SurfaceLabels],
    pictures: Sequence[Bytes],
    sweep: Sweep,
    *,
    closed_form: Sweep | None = None,
) -> Figure:
    """Draw the surface at some resolutions, and beside it the area fractions over all.

    The counterpart in space of Wan & Howe 2018, Fig. 7 to 10.

    Args:
        scans: The surface's labels at each resolution.
        pictures: Pictures of the same surfaces, shape (h, w, 3) each; none: only the fractions.
        sweep: Area fractions at one friction.
        closed_form: The same fractions in closed form, drawn over them.
    """
    shown = len(pictures)
    figure = new_figure(PAGE if shown else PAGE / 2.0, HEIGHT)
    grid = figure.subplots(1, shown + 1, width_ratios=[PICTURE] * shown + [CURVES], squeeze=False)
    for axes, scan, picture in zip(grid[0, :shown], scans, pictures, strict=bool(shown)):
        title = rf"$\alpha$ = {math.degrees(scan.model.sensor_resolution):.4g}°"
        show_picture(axes, picture, title, fractions_text(scan.fractions()))
    curves = grid[0, -1]
    draw_fractions(curves, sweep, label="area fraction", closed_form=closed_form)
    if shown:
        angles = [math.degrees(scan.model.sensor_resolution) for scan in scans]
        curves.plot(angles, np.ones(shown), transform=curves.get_xaxis_transform(), **_SHOWN)
    handles: list[Any] = [*label_patches()]
    if closed_form is not None:
        handles.append(Line2D([], [], label="closed form", **CLOSED_FORM))
    if shown:
        handles.append(Line2D([], [], label="shown", **_SHOWN))
    figure.legend(
        handles=handles,
        loc="outside lower center",
        ncols=len(handles) if shown else 2,
        handlelength=1.8,
        columnspacing=1.4,
    )
    return figure


def fixed_fingers(scan: SurfaceLabels) -> list[Finger]:
    """The fixed fingers of a scan, for pictures."""
    points, normals = scan.grasps.positions[0, 1:], scan.grasps.contacts.normals[0, 1:]
    return [Finger(point, normal) for point, normal in zip(points, normals, strict=True)]
