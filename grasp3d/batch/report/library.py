"""Data of the library page: a row for each mesh, and curves over all meshes."""

import math
from collections import defaultdict
from collections.abc import Collection, Sequence
from typing import Any

import numpy as np

from grasp3d.batch.batch_settings import BatchSettings
from grasp3d.batch.report.settings_text import describe_settings, summarise_settings
from grasp3d.batch.row import AreaFractions, Row
from grasp3d.meanings import SAFE_LABELS
from grasp3d.settings import GraspModel
from grasp3d.settings.lengths import METRES, AnyLength, Measure

VIEWS, VIEW_SUFFIX = "report/objects/", ".js"
"""Path of the objects' scripts below the output folder, and their suffix."""

REPORT = "report/"

DIGITS = 6
"""Significant digits of the numbers in the page."""

AXES = {
    "friction": "Friction μ",
    "frictionError": "Friction error",
    "normalError": "Normal error",
    "locationError": "Location error",
}
"""Axes of the grid besides the sensor resolution, which is the curves' horizontal axis."""

QUARTILES = (0.25, 0.5, 0.75)

_NUMBERS = {
    "grasps": "stable_grasps",
    "stable": "stable",
    "ambiguous": "ambiguous",
    "noGrasp": "no_grasp_found",
    "epsilon": "epsilon_p50",
    "size": "size",
    "vertices": "vertices",
    "seconds": "seconds",
    "held": "held",
    "payload": "payload_best",
    "forceNeeded": "grip_force_needed",
}
_ANGLES = {
    "spare": "spare_resolution",
    "margin": "approach_margin",
    "angle": "critical_angle_p50",
    "resolution50": "required_resolution_50",
    "resolution80": "required_resolution_80",
    "resolution90": "required_resolution_90",
    "spareAngle": "margin_p50",
}
_TEXTS = {"name": "mesh", "outcome": "outcome", "error": "error", "warnings": "warnings"}
_VERDICT = {"verdict": "verdict", "verdictText": "verdict_text", "holdsText": "holds_text"}
COLUMNS = (*_TEXTS, *_VERDICT, "unit", "stem", "thumbnail", *_NUMBERS, *_ANGLES)
"""Columns of the table; angles are in degrees, null: unknown, for a labelled mesh infinite."""


def library_data(rows: Collection[Row], settings: BatchSettings) -> dict[str, Any]:
    """Collect the data of the page.

    Args:
        rows: All meshes.
        settings: Settings of the labels.
    """
    model, found = settings.model, curves(rows)
    return {
        "friction": model.friction,
        "resolution": _rounded(math.degrees(model.sensor_resolution)),
        "uncertain": is_uncertain(model),
        "certainty": SAFE_LABELS if model.certainty == "safe" else "",
        "summary": summarise_settings(settings),
        "settings": describe_settings(settings),
        "columns": COLUMNS,
        "rows": [_values(row) for row in rows],
        "axes": axes_of(found),
        "curves": found,
        "curve": _curve_of(model, found),
    }


def is_uncertain(model: GraspModel) -> bool:
    """Whether anything but the sensor's normals is uncertain.

    Args:
        model: Model of the labels.
    """
    errors = (model.friction_error, model.normal_error, model.location_error, model.per_finger)
    return any(errors)


def object_list(rows: Collection[Row]) -> list[tuple[str, str]]:
    """Stems and names of the meshes with a page, in the order of the rows."""
    return [(stem, row.mesh) for row in rows if (stem := stem_of(row))]


def stem_of(row: Row) -> str:
    """Stem of a mesh's page; empty where it has none."""
    return row.view.removeprefix(VIEWS).removesuffix(VIEW_SUFFIX)


def curves(rows: Collection[Row]) -> list[dict[str, Any]]:
    """Quartiles of the area fractions over the labelled meshes, for each friction of the grid.

    And for each error of friction, normals and locations, if the grid has several.

    Returns:
        By friction and errors: `friction`; `errors` of friction, normals [rad] and locations [mm];
        `at`, the same four as text; `resolution` [degrees]; `meshes`, the number of meshes at each
        resolution; `S`, `M` and `U`, the quartiles at each resolution, none where no mesh has the
        value; `searched`, the number of meshes with M and U.
    """
    grid: dict[_Errors, dict[float, list[AreaFractions]]] = defaultdict(lambda: defaultdict(list))
    for row in rows:
        for one in row.fractions:
            grid[_errors_of(one, row.unit)][one.sensor_resolution].append(one)
    found = []
    for errors, by_resolution in sorted(grid.items()):
        resolutions = sorted(by_resolution)
        columns = [by_resolution[resolution] for resolution in resolutions]
        found.append(
            {
                "friction": errors[0],
                "errors": [_rounded(error) for error in errors[1:4]],
                "at": _texts_of(*errors),
                "resolution": [_rounded(math.degrees(resolution)) for resolution in resolutions],
                "meshes": [len(column) for column in columns],
                "S": [_quartiles([one.stable for one in column]) for column in columns],
                "M": [_quartiles([one.ambiguous for one in column]) for column in columns],
                "U": [_quartiles([one.no_grasp_found for one in column]) for column in columns],
                "searched": [
                    sum(one.ambiguous is not None for one in column) for column in columns
                ],
            }
        )
    return found


def axes_of(found: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """What is chosen for the curves: friction and its errors, each with the values of the grid.

    Args:
        found: The curves, ordered by friction and errors.

    Returns:
        By axis: `name`; `title`, as it is shown; `values`, the texts that occur in `at`, ascending.
    """
    axes = []
    for number, (name, title) in enumerate(AXES.items()):
        order = {one["at"][number]: [one["friction"], *one["errors"]][number] for one in found}
        axes.append({"name": name, "title": title, "values": sorted(order, key=order.__getitem__)})
    return axes


_Errors = tuple[float, float, float, float, str]
"""Friction, its error, the error of normals [rad], that of locations and its unit."""


def _errors_of(one: AreaFractions, unit: str | None) -> _Errors:
    """Settings of area fractions; locations in millimetres, or in an unknown unit."""
    metres = {str(name): size for name, size in METRES.items()}.get(unit or "", 0.0)
    known = metres > 0.0 and one.location_error > 0.0
    location = 1000.0 * metres * one.location_error if known else one.location_error
    return (
        one.friction,
        one.friction_error,
        one.normal_error,
        float(f"{location:.9g}"),
        "mm" if known else "",
    )


def _curve_of(model: GraspModel, found: Sequence[dict[str, Any]]) -> int:
    """Number of the curve that is nearest to a model; a length without a unit is the largest."""
    length: AnyLength = model.location_error
    location = (
        1000.0 * length.metres if isinstance(length, Measure) else (math.inf if length else 0.0)
    )
    wanted = (model.friction, model.friction_error, model.normal_error, location)
    return min(
        range(len(found)),
        key=lambda number: [
            -at if math.isinf(to) else abs(at - to)
            for at, to in zip(
                (found[number]["friction"], *found[number]["errors"]), wanted, strict=True
            )
        ],
        default=0,
    )


def _texts_of(
    friction: float, error: float, normals: float, location: float, unit: str
) -> list[str]:
    """Friction and errors as texts: '0.5', '0.1', '2°', '1 mm'."""
    normal = f"{math.degrees(normals):.6g}°"
    return [f"{friction:.6g}", f"{error:.6g}", normal, f"{location:.6g} {unit}".rstrip()]


def _quartiles(values: Sequence[float | None]) -> list[float] | None:
    known = [value for value in values if value is not None]
    return [_rounded(float(one)) for one in np.quantile(known, QUARTILES)] if known else None


def _values(row: Row) -> list[Any]:
    """Values of one mesh, in the order of `COLUMNS`."""
    angles = [getattr(row, name) for name in _ANGLES.values()]
    return [
        *(str(getattr(row, name)) for name in _TEXTS.values()),
        *(getattr(row, name) or "" for name in _VERDICT.values()),
        row.unit or "",
        stem_of(row),
        row.thumbnail.removeprefix(REPORT),
        *(_rounded(getattr(row, name)) for name in _NUMBERS.values()),
        *(None if angle is None else _rounded(math.degrees(angle)) for angle in angles),
    ]


def _rounded(value: Any) -> Any:
    return float(f"{value:.{DIGITS}g}") if isinstance(value, float) else value
