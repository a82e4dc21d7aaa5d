"""Draw what `validate_physics.py` found: slip of facets, success over the margin, grip forces.

python scripts/validate_physics.py -o physics
python scripts/make_physics_picture.py physics -o docs/physics.png
"""

import argparse
import math
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from grasp3d import GraspModel, Label
from grasp3d.physics.simulation import rates_by
from grasp3d.plots.formats import save_as
from grasp3d.plots.style import LABEL_COLORS, LINES, Drawing, new_figure, styled
from grasp3d.system.tables import read_columns

BORDERS = np.array([-70.0, -50.0, -40.0, -30.0, -22.6, -17.0, -11.3, -5.7, 0.0, 4.0, 8.0, 16.0])
"""Of the bins of the margin [degrees]."""


@styled
def physics_figure(folder: Path, condition: str) -> Drawing:
    """The figure of the tables of a folder.

    Args:
        folder: What `validate_physics.py` wrote.
        condition: Which of its conditions is drawn.
    """
    figure = new_figure(height=2.5)
    axes = figure.subplots(1, 3, width_ratios=(1.0, 1.7, 1.0))
    _draw_facets(axes[0], read_columns(folder / "facets.csv"))
    _draw_margins(axes[1], sorted(folder.glob(f"{condition}_*.csv")))
    _draw_forces(axes[2], read_columns(folder / "forces.csv"))
    return figure


def _draw_facets(axes: Axes, columns: dict[str, np.ndarray]) -> None:
    computed = np.degrees(columns["critical_angle"])
    axes.plot([0.0, 90.0], [0.0, 90.0], color="#999999", linewidth=0.7)
    axes.plot(
        computed, np.degrees(columns["slip_friction_angle"]), ".", color="#0072B2", markersize=3
    )
    axes.set(
        xlabel="critical friction angle β* [°]",
        ylabel="slips below [°]",
        title=f"{len(computed)} pairs of facets",
        xlim=(0, 90),
        ylim=(0, 90),
    )


def _draw_margins(axes: Axes, paths: list[Path]) -> None:
    tables = [read_columns(path) for path in paths]
    margin, success, held, fate = (
        np.concatenate([table[name] for table in tables])
        for name in ("margin", "success", "held", "fate")
    )
    known = fate != "broken"
    border = -math.degrees(GraspModel().sensor_resolution)
    for label, low, high in (
        (Label.U, BORDERS[0], border),
        (Label.M, border, 0.0),
        (Label.S, 0.0, BORDERS[-1]),
    ):
        axes.axvspan(low, high, color=LABEL_COLORS[label], alpha=0.18, linewidth=0.0)
        axes.text(0.5 * (low + high), 1.06, label.name, ha="center", va="bottom")
    for values, name, style, shift in (
        (held, "object held", LINES[1], 0.4),
        (success, "grasp held", LINES[0], -0.4),
    ):
        rates = list(rates_by(np.degrees(margin[known]), values[known].astype(bool), BORDERS))
        rows = [number for number, rate in enumerate(rates) if rate.count]
        middles = 0.5 * (BORDERS[:-1] + BORDERS[1:])[rows] + shift
        rate = np.array([rates[number].rate for number in rows])
        low, high = (
            np.array([getattr(rates[number], end) for number in rows]) for end in ("low", "high")
        )
        axes.errorbar(
            middles, rate, np.abs([low - rate, high - rate]), label=name, marker="o", markersize=3,
            elinewidth=0.8, capsize=1.5, **style,
        )  # fmt: skip
    axes.set(
        xlabel="margin [°]",
        ylabel="fraction",
        xlim=(BORDERS[0], BORDERS[-1]),
        ylim=(-0.04, 1.15),
        yticks=np.linspace(0.0, 1.0, 6),
    )
    axes.set_title(f"{int(known.sum())} grasps of {len(paths)} objects")
    axes.legend(loc="center left")


def _draw_forces(axes: Axes, columns: dict[str, np.ndarray]) -> None:
    most = 1.1 * max(columns["computed"].max(), columns["simulated"].max())
    axes.plot([0.0, most], [0.0, most], color="#999999", linewidth=0.7)
    soft = columns["soft"].astype(bool)
    for name, mine, marker in (("hard tips", ~soft, "o"), ("soft tips", soft, "^")):
        axes.plot(
            columns["computed"][mine], columns["simulated"][mine], marker, label=name, markersize=3
        )
    axes.set(
        xlabel="computed grip force [N]",
        ylabel="smallest force that holds [N]",
        title=f"{len(soft)} loads of 1 N",
        xlim=(0.0, most),
        ylim=(0.0, most),
    )
    axes.legend(loc="upper left")


def main() -> None:
    """Draw the tables of a folder."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("-o", "--output", type=Path, default=Path("physics.png"))
    parser.add_argument("--condition", default="normals")
    options = parser.parse_args()
    save_as(physics_figure(options.folder, options.condition), options.output)


if __name__ == "__main__":
    main()
