"""Settings as text for the pages."""

import math
from collections.abc import Iterator

from grasp3d.batch.batch_settings import BatchSettings
from grasp3d.settings import GraspModel, MeshOptions, Sampling


def describe_settings(settings: BatchSettings) -> list[tuple[str, str]]:
    """Name and value of each setting, as text.

    Args:
        settings: Settings of the batch; some are left out where they have their default value.
    """
    return [*_model(settings.model), *_search(settings), *_mesh(settings.mesh)]


def _degrees(angle: float) -> str:
    return f"{math.degrees(angle):.4g}°"


def _model(model: GraspModel) -> Iterator[tuple[str, str]]:
    yield "Friction", f"μ {model.friction:.4g} (cone of β {_degrees(model.friction_angle)})"
    yield "Sensor resolution", f"α {_degrees(model.sensor_resolution)}"
    yield "Fingers", f"{model.fingers}{', soft' if model.torsion_radius else ''}"
    if model.method == "extremes":
        yield "Labels", f"from wrench hulls at {model.extreme_normals} extreme normals, sampled"
    else:
        yield "Labels", "from the critical friction angle, exact"
    cones = "circular cones" if model.edges is None else f"cones of {model.edges} edges"
    forces = "all fingers' forces" if model.actuation == "total" else "each finger's force"
    yield "Epsilon", f"{cones}, {forces} at most 1"
    if model.torsion_radius:
        yield "Torsion radius", f"{model.torsion_radius:.4g} (in each mesh's unit)"


def _search(settings: BatchSettings) -> Iterator[tuple[str, str]]:
    search: Sampling = settings.search
    if settings.model.fingers == 2:
        yield "Grip", {"both": "squeeze or expand"}.get(search.grip, search.grip)
        if limits := _range(search.min_opening, search.max_opening):
            yield "Opening", limits
    elif limits := _range(search.min_separation or 0.0, search.max_spread):
        yield "Distances between contacts", limits
    if search.search_angle is not None:
        yield "Search", f"grasps with β* up to {_degrees(search.search_angle)}"


def _range(least: float, most: float) -> str:
    """Limits of a length as text; empty where there are none."""
    limits = [f"at least {least:.4g}"] if least else []
    limits += [f"at most {most:.4g}"] if math.isfinite(most) else []
    return f"{' and '.join(limits)} (in each mesh's unit)" if limits else ""


def _mesh(options: MeshOptions) -> Iterator[tuple[str, str]]:
    yield "Repair", options.repair
    if options.patch_radius:
        yield "Patch radius", f"{options.patch_radius:.4g} (in each mesh's unit)"
    else:
        yield "Sharp edges", f"faces that meet at more than {_degrees(options.crease_angle)}"
    if options.max_edge is not None:
        yield "Longest edge", f"{options.max_edge:.4g} (in each mesh's unit)"
    if options.unit is not None:
        yield "Unit of the files", options.unit
