"""Render a mug labelled for points and for a gripper, and the gripper at two kinds of grasps.

    python scripts/make_reach_picture.py -o docs/reach.png

The mug stands on a table, which the gripper must not enter. Needs OpenGL (EGL or a display).
"""

import argparse
import math
from pathlib import Path

from grasp3d import (
    GraspModel,
    ParallelGripper,
    Sampling,
    SurfaceLabels,
    Table,
    best_grasps,
    label_surface,
    load_mesh,
)
from grasp3d.hand.shapes import hand_triangles
from grasp3d.hand.triangles import Triangles
from grasp3d.plots.painting import paint_labels
from grasp3d.plots.rendering import View
from grasp3d.plots.style import Drawing, label_patches, new_figure, styled
from grasp3d.stability.label import MEANING
from grasp3d.surface.grasp_table import GraspTable

OBJECT = Path(__file__).parents[1] / "meshes" / "mug.glb"
GRIPPER = ParallelGripper.preset("robotiq_2f85")
MODEL = GraspModel(friction=0.5, sensor_resolution=math.radians(22.6))
FINENESS = 1.0 / 100.0
"""Longest edge as a fraction of the object's size."""
HANDLE = 0.03
"""Opening [m] below which a grasp is one of the handle or the wall."""
PIXELS = (560, 600)
SPANS = (0.15, 0.33)
"""Heights of the pictures without and with the gripper [m]."""


def held(grasps: GraspTable, *, narrow: bool) -> int:
    """The first grasp that is narrow, or wide."""
    return next(k for k, w in enumerate(grasps.opening) if (w < HANDLE) == narrow)


def drawn(grasps: GraspTable, number: int) -> Triangles:
    """The gripper at a grasp."""
    reach = grasps.reach
    assert reach is not None
    opening = float(reach.opening[number])
    return hand_triangles(GRIPPER, opening, pose=reach.poses[number], unit="m")


@styled
def figure(view: View) -> Drawing:
    """Lay out the labels and the two grasps."""
    mesh = load_mesh(OBJECT, max_edge=load_mesh(OBJECT).size * FINENESS)
    low, high = GRIPPER.limits
    points = label_surface(mesh, MODEL, sampling=Sampling(min_opening=low, max_opening=high))
    labels = label_surface(mesh, MODEL, hand=GRIPPER, table=Table.below(mesh))
    grasps = best_grasps(labels, 40)
    wide, narrow = (held(grasps, narrow=narrow) for narrow in (False, True))
    panels: list[tuple[str, SurfaceLabels, Triangles | None]] = [
        ("two points, same stroke", points, None),
        (f"gripper {GRIPPER.name}, on a table", labels, None),
        (f"across, approach {margin(grasps, wide)}", labels, drawn(grasps, wide)),
        (f"handle, approach {margin(grasps, narrow)}", labels, drawn(grasps, narrow)),
    ]
    drawing = new_figure(1.8 * len(panels), 2.8)
    for axes, (title, shown, hand) in zip(drawing.subplots(1, 4), panels, strict=True):
        span = SPANS[hand is not None]
        axes.imshow(paint_labels(shown, view=view, size=PIXELS, beside=hand, span=span))
        axes.set_title(title)
        if hand is None:
            parts = shown.fractions().items()
            axes.set_xlabel("  ".join(f"{name} {100.0 * part:.0f} %" for name, part in parts))
        axes.set(xticks=[], yticks=[])
        axes.grid(visible=False)
        axes.spines[:].set_visible(False)
    drawing.legend(handles=label_patches(MEANING["label"]), loc="outside lower center", ncols=3)
    return drawing


def margin(grasps: GraspTable, number: int) -> str:
    """The approach margin of a grasp."""
    assert grasps.reach is not None
    return f"±{math.degrees(grasps.reach.approach_margin[number]):.0f}°"


def main() -> None:
    """Render and write the picture."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("reach.png"))
    view = View(math.radians(-70.0), math.radians(25.0))
    figure(view).savefig(parser.parse_args().output, dpi=130)


if __name__ == "__main__":
    main()
