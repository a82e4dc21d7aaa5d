"""Draw ROC curves of the quality in the sensor's worst case and at the perceived normals.

    python scripts/evidence_data.py WORST PERCEIVED PICTURE

WORST and PERCEIVED are tables that `grasp3d validate -o` wrote for the same grasps, PERCEIVED with
`--sensor-resolution 0`. The curve of epsilon is drawn for comparison.
"""

import argparse
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

from grasp3d.outcomes.validation import roc_auc, roc_curve
from grasp3d.pictures.figures import styled

CURVES = (
    (0, "quality", "payload of the patches, worst case of the sensor", "#0072B2", "-"),
    (1, "quality", "the same at the perceived normals", "#D55E00", "--"),
    (0, "epsilon", "ε at the perceived normals", "#666666", ":"),
)


@styled
def draw(files: list[Path], path: Path) -> None:
    """Draw the curves."""
    tables = [pd.read_csv(file) for file in files]
    figure, axes = plt.subplots(figsize=(4.6, 3.4), layout="constrained")
    for which, column, text, color, line in CURVES:
        table = tables[which]
        values = np.nan_to_num(table[column].to_numpy(float), nan=-1e9)
        held = table["outcome"].to_numpy(float) == 1.0
        area, _, _ = roc_auc(held, values, np.arange(len(held)))
        axes.plot(*roc_curve(held, values), line, color=color, label=f"{text} {area:.2f}")
    axes.plot([0, 1], [0, 1], color="#CCCCCC", linewidth=0.8, zorder=0)
    axes.set(xlabel="failed grasps that are accepted", ylabel="held grasps that are accepted")
    axes.legend(loc="lower right", fontsize=7)
    figure.savefig(path, dpi=160)
    plt.close(figure)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    for name in ("worst", "perceived", "picture"):
        parser.add_argument(name, type=Path)
    words = parser.parse_args()
    draw([words.worst, words.perceived], words.picture)
