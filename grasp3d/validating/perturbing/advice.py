"""Errors to enter for a noisy scan: measured on its copies, and checked with their labels."""

import math
from dataclasses import dataclass, replace

import numpy as np

from grasp3d.arrays import Bools, Floats
from grasp3d.surface.labelling import label_surface
from grasp3d.surface.labels import SurfaceLabels

MOST_UNCONFIRMED = 0.01
"""Largest fraction of the area that is S with the advised errors where fewer copies than required
are S: single vertices with triangles of unusual shape must not decide for all."""


MUCH_LESS = 0.5
"""Part of the area that is S with the measured turn which the check may at most cost."""


@dataclass(frozen=True)
class Advice:
    """What to enter for a scan, so that what is S is S in most noisy copies.

    The normal error of the model that was given is contained in that to enter.
    """

    normal_error: float
    """To enter as `normal_error` [rad]: the larger of the measured turn of the normals and the
    least error that passes the check. Where that leaves too little S, the measured turn."""
    location_error: float
    """To enter as `location_error`, in the mesh's unit."""
    measured_turn: float
    """Angle within which the normals turned, at the level of the settings, over area and copies
    [rad]."""
    least_normal_error: float
    """The smallest normal error that passes the check, with that location error [rad]; inf: none
    does."""
    stable_fraction: float
    """Area fraction that is S with the errors to enter."""
    unconfirmed_fraction: float
    """Fraction of that area where fewer copies than required are S."""

    @property
    def passed(self) -> bool:
        """Whether the check is passed: with these errors nearly all of S is S in enough copies."""
        return self.stable_fraction > 0.0 and self.unconfirmed_fraction <= MOST_UNCONFIRMED


def advise(labels: SurfaceLabels, confirmed: Bools, turn: float, across: float) -> Advice:
    """Choose errors with which S holds in most copies, and check them.

    The surface is labelled again with the location error; as its margin falls by every further
    normal error as much, one labelling checks all of them.

    Args:
        labels: The labels of the surface itself.
        confirmed: Whether enough copies are S at each vertex, (V,).
        turn: Measured turn of the normals [rad].
        across: Measured shift of the contacts, in the mesh's unit.
    """
    location, areas = _rounded_up(across), labels.mesh.vertex_areas
    model = replace(labels.model, location_error=location)
    located = label_surface(labels.mesh, model, sampling=labels.sampling)
    least = least_error(located.margin, confirmed, areas)
    error = math.radians(
        _rounded_up(math.degrees(error_to_enter(located.margin, least, turn, areas)))
    )
    stable = located.margin > error
    area, own = float(areas[stable].sum()), labels.model.normal_error
    return Advice(
        normal_error=own + error,
        location_error=location,
        measured_turn=turn,
        least_normal_error=own + least,
        stable_fraction=area / float(areas.sum()),
        unconfirmed_fraction=float(areas[stable & ~confirmed].sum()) / area if area else 0.0,
    )


def error_to_enter(margin: Floats, least: float, turn: float, areas: Floats) -> float:
    """Choose the larger of two errors, unless it leaves much less S than the measured turn.

    On some scans a rough part, such as a fine thread, is S in too few copies at any error that
    leaves anything S elsewhere.

    Args:
        margin: Margins without normal error [rad], (V,).
        least: The least error that passes the check [rad]; inf: none.
        turn: Measured turn of the normals [rad].
        areas: Areas of the vertices, (V,).
    """
    larger = max(turn, least)
    area, most = (float(areas[margin > error].sum()) for error in (larger, turn))
    return larger if area > MUCH_LESS * most else turn


def least_error(margin: Floats, confirmed: Bools, areas: Floats) -> float:
    """The smallest error that leaves nearly only confirmed vertices S.

    Args:
        margin: Margins [rad]: with an error e, vertices whose margin is above e are S; (V,).
        confirmed: Whether enough copies are S there, (V,).
        areas: Areas of the vertices, (V,).

    Returns:
        The error [rad], at least 0; inf: whatever the error, too much of what is S is not
        confirmed, or nothing is S.
    """
    rows = np.flatnonzero(margin > 0.0)
    rows = rows[np.argsort(-margin[rows], kind="stable")]
    area = np.cumsum(areas[rows])
    failed = np.cumsum(np.where(confirmed[rows], 0.0, areas[rows]))
    passing = (failed <= MOST_UNCONFIRMED * area) & (area > 0.0)
    # An error at one vertex's margin excludes it: a border must lie between different margins.
    below = np.append(margin[rows][1:], 0.0)
    passing &= below < margin[rows]
    return float(below[passing].min()) if passing.any() else math.inf


def _rounded_up(number: float) -> float:
    """Round up to two digits, as what is typed."""
    if not 0.0 < number < math.inf:
        return number
    step = 10.0 ** (math.floor(math.log10(number)) - 1)
    return float(f"{math.ceil(number / step - 1e-9) * step:.12g}")
