"""Printed reports of quality measures."""

import numpy as np
from rich.console import Console
from rich.table import Table

from grasp3d.cli.report import escaped
from grasp3d.quality.measures.geometry import Texts
from grasp3d.quality.measures.known import Metric
from grasp3d.quality.measures.measuring import MetricValues

LEVELS = (0.1, 0.5, 0.9)
"""Levels of the quantiles."""


def print_metrics(metrics: MetricValues, unit: str | None) -> None:
    """Print the quantiles of each measure over the grasps, and why some are undefined.

    Args:
        metrics: Values of the grasps.
        unit: Unit of lengths; None: not stated.
    """
    console = Console(emoji=False)
    table = Table("quality measure", "better", box=None, pad_edge=False)
    for heading in (*(f"{100.0 * level:.0f} %" for level in LEVELS), "undefined"):
        table.add_column(heading, justify="right", no_wrap=True)
    for metric in metrics.descriptions:
        values = np.ravel(metrics[metric.name])
        defined = values[~np.isnan(values)]
        name = escaped(f"{metric.name}{_unit_text(metric, unit)}")
        missing = len(values) - len(defined)
        table.add_row(name, metric.better, *_quantiles(defined), str(missing) if missing else "")
    console.print(table)
    for metric in metrics.descriptions:
        for line in _reasons(np.ravel(metrics.reasons[metric.name])):
            console.print(f"{metric.name} undefined: {escaped(line)}", soft_wrap=True)


def _quantiles(values: np.ndarray) -> list[str]:
    if not len(values):
        return ["none"] * len(LEVELS)
    return [f"{value:.4g}" for value in np.quantile(values, LEVELS)]


def _reasons(texts: Texts) -> list[str]:
    """The reasons with the numbers of grasps, the most frequent first."""
    reasons, counts = np.unique(texts[texts != ""], return_counts=True)
    order = np.argsort(-counts, kind="stable")
    return [f"{reasons[k]} ({counts[k]} of {len(texts)})" for k in order]


def _unit_text(metric: Metric, unit: str | None) -> str:
    """The unit of a measure in brackets; '' if it has none."""
    if not metric.unit:
        return ""
    length = unit or "unit of the mesh"
    return f" [{metric.unit.replace('length', length)}]"
