"""Data of the library page: a row for each mesh, curves over all meshes, settings as text."""

import math
from collections import defaultdict
from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from grasp3d.batch.batch_settings import BatchSettings
from grasp3d.batch.row import AreaFractions, Row
from grasp3d.hand.reach_settings import ReachSettings
from grasp3d.quality.loads import Load
from grasp3d.quality.task_texts import TaskText
from grasp3d.settings import GraspModel, MeshOptions, Sampling
from grasp3d.settings.lengths import METRES, AnyLength, Measure, describe_length
from grasp3d.settings.model_text import SAFE_LABELS, error_texts

VIEWS, VIEW_SUFFIX = "report/objects/", ".js"
"""Path of the objects' scripts below the output folder, and their suffix."""

REPORT = "report/"
"""Folder of the report, below the output folder."""

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
_VERDICT = {"verdict": "verdict", "verdictText": "verdict_text", "causes": "causes", "task": "task"}
COLUMNS = (*_TEXTS, *_VERDICT, "unit", "stem", "thumbnail", *_NUMBERS, *_ANGLES)
"""Columns of the table; angles are in degrees, null: unknown, for a labelled mesh infinite."""


def library_data(rows: Collection[Row], settings: BatchSettings) -> dict[str, Any]:
    """Collect the data of the page.

    Args:
        rows: All meshes.
        settings: Settings of the labels.
    """
    model, lines = settings.model, curves(rows)
    return {
        "friction": model.friction,
        "resolution": _rounded(math.degrees(model.sensor_resolution)),
        "uncertain": model.is_uncertain,
        "certainty": SAFE_LABELS if model.certainty == "safe" else "",
        "summary": summarise_settings(settings),
        "settings": describe_settings(settings),
        "columns": COLUMNS,
        "rows": [_values(row) for row in rows],
        "axes": axes_of(lines),
        "curves": lines,
        "curve": _curve_of(model, lines),
    }


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
    lines = []
    for errors, by_resolution in sorted(grid.items()):
        resolutions = sorted(by_resolution)
        columns = [by_resolution[resolution] for resolution in resolutions]
        lines.append(
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
    return lines


def axes_of(lines: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """What is chosen for the curves: friction and its errors, each with the values of the grid.

    Args:
        lines: The curves, ordered by friction and errors.

    Returns:
        By axis: `name`; `title`, as it is shown; `values`, the texts that occur in `at`, ascending.
    """
    axes = []
    for number, (name, title) in enumerate(AXES.items()):
        order = {one["at"][number]: [one["friction"], *one["errors"]][number] for one in lines}
        axes.append({"name": name, "title": title, "values": sorted(order, key=order.__getitem__)})
    return axes


_Errors = tuple[float, float, float, float, str]
"""Friction, its error, the error of normals [rad], that of locations and its unit."""


def _errors_of(one: AreaFractions, unit: str | None) -> _Errors:
    """Settings of area fractions; locations in millimetres, or in an unknown unit."""
    metres = {str(name): size for name, size in METRES.items()}.get(unit or "", 0.0)
    in_metres = metres > 0.0 and one.location_error > 0.0
    location = 1000.0 * metres * one.location_error if in_metres else one.location_error
    return (
        one.friction,
        one.friction_error,
        one.normal_error,
        float(f"{location:.9g}"),
        "mm" if in_metres else "",
    )


def _curve_of(model: GraspModel, lines: Sequence[dict[str, Any]]) -> int:
    """Number of the curve that is nearest to a model; a length without a unit is the largest."""
    length: AnyLength = model.location_error
    location = (
        1000.0 * length.metres if isinstance(length, Measure) else (math.inf if length else 0.0)
    )
    goal = (model.friction, model.friction_error, model.normal_error, location)
    return min(
        range(len(lines)),
        key=lambda number: [
            -at if math.isinf(to) else abs(at - to)
            for at, to in zip(
                (lines[number]["friction"], *lines[number]["errors"]), goal, strict=True
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
    numbers = [value for value in values if value is not None]
    return [_rounded(float(one)) for one in np.quantile(numbers, QUARTILES)] if numbers else None


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


def describe_settings(settings: BatchSettings) -> list[tuple[str, str]]:
    """Name and value of each setting, as text.

    Args:
        settings: Settings of the batch; some are left out where they have their default value.
    """
    parts = _model(settings.model), _search(settings), _load(settings.load), _mesh(settings.mesh)
    return [setting for part in parts for setting in part]


def summarise_settings(settings: BatchSettings) -> list[str]:
    """The settings on which every label depends, for the header: friction, sensor, search limits.

    Args:
        settings: Settings of the batch.
    """
    model, search = settings.model, dict(_search(settings))
    texts = [f"Friction {_friction(model)}"]
    texts.append(f"Sensor resolution α {_degrees(model.sensor_resolution)}")
    texts += [f"{name} {value}" for name, value in _errors(model)]
    texts.append(f"{model.fingers} {'soft ' if model.torsion_radius else ''}fingers")
    texts += [f"{name} {value}" for name, value in search.items()]
    return texts + [f"{name} {value}" for name, value in _load(settings.load)]


def _friction(model: GraspModel) -> str:
    smallest, largest = model.friction_interval
    number = f"{smallest:.4g} to {largest:.4g}" if smallest < largest else f"{model.friction:.4g}"
    angles = [_degrees(math.atan(one)) for one in dict.fromkeys((smallest, largest))]
    return f"μ {number} (cone of β {' to '.join(angles)})"


def _errors(model: GraspModel) -> Iterator[tuple[str, str]]:
    """What is uncertain beside friction and the sensor's normals; nothing if nothing is."""
    if model.normal_error:
        yield "Normals", f"within a further {_degrees(model.normal_error)}"
    if model.location_error:
        yield "Contact locations", f"within {_length(model.location_error)}"
    if model.per_finger:
        only_fingers = replace(model, normal_error=0.0, location_error=0.0)
        yield "Each finger", "; ".join(error_texts(only_fingers))


def _degrees(angle: float) -> str:
    return f"{math.degrees(angle):.4g}°"


def _model(model: GraspModel) -> Iterator[tuple[str, str]]:
    yield "Friction", _friction(model)
    yield "Sensor resolution", f"α {_degrees(model.sensor_resolution)}"
    yield from _errors(model)
    yield "Fingers", f"{model.fingers}{', soft' if model.torsion_radius else ''}"
    if model.method == "extremes":
        yield "Labels", f"from wrench hulls at {model.extreme_normals} extreme normals, sampled"
    else:
        yield "Labels", "from the critical friction angle, exact"
    cones = "circular cones" if model.edges is None else f"cones of {model.edges} edges"
    forces = "all fingers' forces" if model.actuation == "total" else "each finger's force"
    yield "Epsilon", f"{cones}, {forces} at most 1"
    if model.torsion_radius:
        yield "Torsion radius", _length(model.torsion_radius)


def _search(settings: BatchSettings) -> Iterator[tuple[str, str]]:
    search = settings.search
    if isinstance(search, Sampling):
        yield "Grip", {"both": "squeeze or expand"}.get(search.grip, search.grip)
        yield "Opening", _range(search.min_opening, search.max_opening)
    else:
        yield "Distances between contacts", _range(search.min_separation or 0.0, search.max_spread)
    yield from _reach(settings.reach)
    if search.search_angle is not None:
        yield "Search", f"grasps with β* up to {_degrees(search.search_angle)}"


def _reach(reach: ReachSettings) -> Iterator[tuple[str, str]]:
    hand = reach.hand
    if hand is None:
        return
    yield "Gripper", f"{hand.name}, stroke {1000.0 * hand.max_opening:.4g} mm"
    if reach.table == "stable":
        yield "Table", f"resting pose {reach.resting_pose}"
    elif reach.table == "as-is":
        yield "Table", f"below the mesh as it is, up {reach.up}"
    if reach.approach_within < math.pi:
        yield "Approach", f"within {_degrees(reach.approach_within)} of straight down"


def _load(load: Load | None) -> Iterator[tuple[str, str]]:
    """The load; nothing if there is none."""
    if load is None:
        return
    parts = []
    if load.mass is not None:
        parts.append(f"{load.mass:.4g} kg")
    if load.density is not None:
        several = load.density if isinstance(load.density, tuple) else (load.density,)
        parts.append(f"{', '.join(f'{one:.4g}' for one in several)} kg/m³")
    parts.append(str(load.task) if isinstance(load.task, TaskText) else "a given task")
    if load.grip_force is not None:
        parts.append(f"{load.grip_force:.4g} N per finger")
    if load.center_of_mass_radius:
        parts.append(f"centre of mass within {_length(load.center_of_mass_radius)}")
    yield "Load", ", ".join(parts)


def _range(least: float, most: float) -> str:
    """Limits of a length as text."""
    named = [("at least", least)] if least else []
    named += [("at most", most)] if most != math.inf else []
    numbers = not any(isinstance(length, Measure) for _, length in named)
    last = len(named) - 1
    limits = [
        f"{name} {describe_length(length) if numbers and at < last else _length(length)}"
        for at, (name, length) in enumerate(named)
    ]
    return " and ".join(limits) or "without limits"


def _length(length: float) -> str:
    """A length as it was given: with its unit, or in that of each mesh."""
    text = describe_length(length)
    return text if isinstance(length, Measure) else f"{text} (in each mesh's unit)"


def _mesh(options: MeshOptions) -> Iterator[tuple[str, str]]:
    yield "Repair", options.repair
    if options.patch_radius:
        yield "Patch radius", _length(options.patch_radius)
    else:
        yield "Sharp edges", f"faces that meet at more than {_degrees(options.crease_angle)}"
    if options.max_edge is not None:
        yield "Longest edge", _length(options.max_edge)
    if options.unit is not None:
        yield "Unit of the files", options.unit
