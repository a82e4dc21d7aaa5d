"""Grasps of an object, for `grasp3d design --object`."""

import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from grasp3d.cli import progress_bars
from grasp3d.cli.design_command import GraspOptions
from grasp3d.contact.budget import FingerDesign, GraspSamples
from grasp3d.errors import SettingError
from grasp3d.mesh import load_mesh
from grasp3d.mesh.plausible_lengths import refuse_lengths
from grasp3d.settings import GraspModel, MeshOptions, Sampling
from grasp3d.settings.lengths import METRES, AnyLength, Unit
from grasp3d.settings.uncertainty import friction_interval
from grasp3d.surface.area_statistics import vertex_weights
from grasp3d.surface.labelling import label_surface
from grasp3d.system.context import within

TYPICAL_ERROR = 0.01
"""Location error of the second search if none is given, as a fraction of the object's size."""


def grasps_of(
    options: GraspOptions,
    designs: Sequence[FingerDesign],
    unit: Unit,
    lengths: Mapping[str, AnyLength | None],
) -> tuple[GraspSamples, str]:
    """Search an object for the best grasps at each vertex, and give their angles and openings.

    The largest friction has the widest search: every grasp is found that any of the designs makes
    S. Which grasp is the best depends on the location error, so there are two: the best where
    locations are exact, and the best at the location error of the designs.

    Args:
        options: The mesh and how it is searched.
        designs: The same finger at several frictions; lengths in `unit`.
        unit: Unit of the lengths, and of the openings returned.
        lengths: As they were given, with a unit; those that cannot be meant for an object of this
            size are refused.

    Returns:
        The grasps, two at each vertex, weighted by area, and the name of the mesh with its number
        of vertices.

    Raises:
        MeshError: The mesh cannot be read.
        SettingError: The unit of the mesh is not known, a length cannot be meant, or no grasp was
            found.
    """
    assert options.object is not None
    mesh = load_mesh(options.object, MeshOptions(unit=options.unit))
    name = mesh.report.source
    if mesh.unit is None:
        raise SettingError(
            f"the unit of {name} is not known, but a design is in {unit}: give the unit of its "
            "coordinates with --unit"
        )
    refuse_lengths(mesh, **lengths)
    widest = math.inf if options.max_opening is None else options.max_opening
    scale = METRES[mesh.unit] / METRES[unit]
    columns = []
    with progress_bars.progress(f"searching {name}", quiet=False):
        for number, model in enumerate(_models(designs, mesh.size * scale, unit)):
            with within(0.5 * number, 0.5 * number + 0.5):
                labels = label_surface(mesh, model, sampling=Sampling(max_opening=widest))
            columns.append((labels.critical_angle, labels.opening * scale))
    critical, opening = (np.stack(column, axis=1) for column in zip(*columns, strict=True))
    if not np.isfinite(critical).any():
        raise SettingError(
            f"no grasp was found on {name} with these settings: use a larger --max-opening or "
            "--friction"
        )
    opening = np.where(np.isfinite(critical), opening, np.inf)
    samples = GraspSamples(critical, opening, vertex_weights(mesh, "area"))
    return samples, f"{name}, {len(mesh.vertices):,} vertices"


def _models(designs: Sequence[FingerDesign], size: float, unit: Unit) -> Iterator[GraspModel]:
    """Models of the two searches: with exact locations, and with the location error."""
    widest = max(designs, key=lambda design: friction_interval(design.friction)[1])
    uncertainty = widest.uncertainty
    given_error = float(uncertainty.location_error)
    for error in (0.0, given_error if given_error > 0.0 else TYPICAL_ERROR * size):
        yield GraspModel(
            friction=friction_interval(widest.friction),
            sensor_resolution=uncertainty.sensor_resolution,
            normal_error=uncertainty.normal_error,
            location_error=f"{error} {unit}",
        )
