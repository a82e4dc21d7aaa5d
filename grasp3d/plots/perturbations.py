"""Figure of a scan's labels, those of its noisy copies, and those with the errors to enter."""

from typing import Any

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure

from grasp3d.arrays import Bytes
from grasp3d.plots.figures import (
    LABEL_COLORS,
    PAGE,
    as_text,
    fractions_text,
    label_patches,
    new_figure,
    show_picture,
    styled,
)
from grasp3d.rendering.opengl import View
from grasp3d.settings.model_text import error_texts
from grasp3d.stability.label import MEANING, Label
from grasp3d.surface.labelling import label_surface
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.validating.perturbing.perturb import Perturbation

HEIGHT = 3.1
"""Height of the figure [inch]."""
PIXELS = (720, 720)
FRACTIONS = LinearSegmentedColormap.from_list("S", ["#3F3F46", "#D4D7DB", LABEL_COLORS[Label.S]])
"""Colours of the fraction of copies: from dark grey to the colour of S."""


@styled
def perturbation_figure(noisy: Perturbation, *, view: View | None = None) -> Figure:
    """Draw a scan's labels, the fraction of its copies that is S, and the advised labels.

    Args:
        noisy: The labels of the noisy copies.
        view: Direction of view; None: from above and the side.

    Raises:
        OutputError: OpenGL is not available.
    """
    from grasp3d.viewer.scene.stills import draw_labels

    labels = noisy.labels

    def panel(title: str, shown: SurfaceLabels) -> tuple[str, Bytes, str]:
        picture = draw_labels(shown, view=view, size=PIXELS)
        return title, picture, fractions_text(shown.fractions())

    copies = f"fraction of {noisy.settings.copies} noisy copies that are S"
    panels = [panel("as scanned", labels), (copies, _paint_fractions(noisy, view), "")]
    if noisy.advice.stable_fraction > 0.0:
        advised = label_surface(labels.mesh, noisy.model, sampling=labels.sampling)
        errors = ",\n".join(error_texts(noisy.model, labels.mesh.unit))
        panels.append(panel(f"with {errors or 'no further error'}", advised))
    figure = new_figure(PAGE, HEIGHT)
    grid = figure.subplots(1, len(panels), squeeze=False)[0]
    for axes, (title, image, below) in zip(grid, panels, strict=True):
        show_picture(axes, image, title, below)
    figure.suptitle(as_text(labels.mesh.report.source), fontsize="medium")
    scale: dict[str, Any] = {"orientation": "horizontal", "shrink": 0.7, "aspect": 30, "pad": 0.02}
    figure.colorbar(ScalarMappable(cmap=FRACTIONS), ax=grid[1], **scale)
    figure.legend(handles=label_patches(MEANING["label"]), loc="outside lower center", ncols=3)
    return figure


def _paint_fractions(noisy: Perturbation, view: View | None) -> Bytes:
    """Render the surface in the colours of the fraction of copies that are S."""
    from grasp3d.viewer.scene.stills import draw_colors

    colors = np.asarray(255.0 * FRACTIONS(noisy.stable)[:, :3], dtype=np.uint8)
    return draw_colors(noisy.mesh, colors, view=view, size=PIXELS)
