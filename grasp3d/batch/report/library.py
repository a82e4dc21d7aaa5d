"""What the page of a library is given: a row for each mesh, and curves over all of them."""

import math
from collections import defaultdict
from collections.abc import Collection, Sequence
from typing import Any

import numpy as np

from grasp3d.batch.batch_settings import BatchSettings
from grasp3d.batch.report.words import settings_in_words
from grasp3d.batch.row import Row, Share

VIEWS, VIEW_SUFFIX = "report/objects/", ".js"
"""Where the scripts of the objects lie, below the output folder."""

REPORT = "report/"

DIGITS = 6
"""Significant digits of the numbers in the page."""

QUARTILES = (0.25, 0.5, 0.75)

_NUMBERS = {
    "stable": "stable",
    "ambiguous": "ambiguous",
    "noGrasp": "no_grasp_found",
    "epsilon": "epsilon_p50",
    "size": "size",
    "vertices": "vertices",
    "seconds": "seconds",
}
_ANGLES = {
    "angle": "critical_angle_p50",
    "resolution50": "required_resolution_50",
    "resolution80": "required_resolution_80",
    "resolution90": "required_resolution_90",
}
_TEXTS = {"name": "mesh", "outcome": "outcome", "error": "error", "warnings": "warnings"}
COLUMNS = (*_TEXTS, "unit", "stem", "thumbnail", *_NUMBERS, *_ANGLES)
"""Of a mesh in the page; angles in degrees, null: not known, of a labelled mesh: infinite."""


def library_data(rows: Collection[Row], settings: BatchSettings) -> dict[str, Any]:
    """Collect what the page shows.

    Args:
        rows: All meshes.
        settings: What they were labelled with.
    """
    model = settings.model
    return {
        "friction": model.friction,
        "resolution": _short(math.degrees(model.sensor_resolution)),
        "settings": settings_in_words(settings),
        "columns": COLUMNS,
        "rows": [_values(row) for row in rows],
        "curves": curves(rows),
    }


def object_list(rows: Collection[Row]) -> list[tuple[str, str]]:
    """Stems and names of the meshes that have a page, in the order of the rows."""
    return [(stem, row.mesh) for row in rows if (stem := stem_of(row))]


def stem_of(row: Row) -> str:
    """Name of a mesh's page; empty where it has none."""
    return row.view.removeprefix(VIEWS).removesuffix(VIEW_SUFFIX)


def curves(rows: Collection[Row]) -> list[dict[str, Any]]:
    """Quartiles of the shares over the labelled meshes, a curve for each friction of the grid.

    Returns:
        By friction: `friction`; `resolution` [degrees]; `meshes`, how many each is taken over;
        `S`, `M` and `U`, the quartiles at each resolution, none where no mesh tells; `told`, how
        many meshes tell M and U.
    """
    at: dict[float, dict[float, list[Share]]] = defaultdict(lambda: defaultdict(list))
    for row in rows:
        for share in row.shares:
            at[share.friction][share.sensor_resolution].append(share)
    found = []
    for friction, shares in sorted(at.items()):
        columns = [shares[resolution] for resolution in sorted(shares)]
        found.append(
            {
                "friction": friction,
                "resolution": [_short(math.degrees(resolution)) for resolution in sorted(shares)],
                "meshes": [len(column) for column in columns],
                "S": [_quartiles([share.stable for share in column]) for column in columns],
                "M": [_quartiles([share.ambiguous for share in column]) for column in columns],
                "U": [_quartiles([share.no_grasp_found for share in column]) for column in columns],
                "told": [sum(one.ambiguous is not None for one in column) for column in columns],
            }
        )
    return found


def _quartiles(values: Sequence[float | None]) -> list[float] | None:
    told = [value for value in values if value is not None]
    return [_short(float(one)) for one in np.quantile(told, QUARTILES)] if told else None


def _values(row: Row) -> list[Any]:
    """The columns of one mesh."""
    angles = [getattr(row, name) for name in _ANGLES.values()]
    return [
        *(str(getattr(row, name)) for name in _TEXTS.values()),
        row.unit or "",
        stem_of(row),
        row.thumbnail.removeprefix(REPORT),
        *(_short(getattr(row, name)) for name in _NUMBERS.values()),
        *(None if angle is None else _short(math.degrees(angle)) for angle in angles),
    ]


def _short(value: Any) -> Any:  # noqa: ANN401
    return float(f"{value:.{DIGITS}g}") if isinstance(value, float) else value
