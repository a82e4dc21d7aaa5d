"""The settings of a library's labels, as text."""

import math
from collections.abc import Iterator

from grasp3d.batch.batch_settings import BatchSettings
from grasp3d.hand.reach_settings import ReachSettings
from grasp3d.quality.loads import Load
from grasp3d.settings import GraspModel, MeshOptions, Sampling
from grasp3d.settings.lengths import Measure, describe_length
from grasp3d.settings.model_text import friction_text


def describe_settings(settings: BatchSettings) -> list[tuple[str, str]]:
    """Name and value of each setting, as text.

    Args:
        settings: Settings of the batch; some are left out where they have their default value.
    """
    parts = _model(settings.model), _search(settings), _load(settings.load), _mesh(settings.mesh)
    return [setting for part in parts for setting in part]


def _friction(model: GraspModel) -> str:
    angles = [_degrees(math.atan(one)) for one in dict.fromkeys(model.friction_interval)]
    return f"μ {friction_text(model)} (cone of β {' to '.join(angles)})"


def _degrees(angle: float) -> str:
    return f"{math.degrees(angle):.4g}°"


def _model(model: GraspModel) -> Iterator[tuple[str, str]]:
    yield "Friction", _friction(model)
    yield "Sensor resolution", f"α {_degrees(model.sensor_resolution)}"
    if model.location_error:
        yield "Contact locations", f"within {_length(model.location_error)}"
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
    search = settings.sampling
    if isinstance(search, Sampling):
        yield "Grip", {"both": "squeeze or expand"}.get(search.grip, search.grip)
        yield "Opening", _range(search.min_opening, search.max_opening)
    else:
        yield "Distances between contacts", _range(search.min_separation or 0.0, search.max_opening)
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
        parts.append(f"{load.density:.4g} kg/m³")
    parts.append(str(load.task))
    if load.grip_force is not None:
        parts.append(f"{load.grip_force:.4g} N per finger")
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
    yield "Sharp edges", f"faces that meet at more than {_degrees(options.crease_angle)}"
    if options.max_edge is not None:
        yield "Longest edge", _length(options.max_edge)
    if options.unit is not None:
        yield "Unit of the files", options.unit
