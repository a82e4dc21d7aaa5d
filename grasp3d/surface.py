"""Labels on a surface: where on this object is a two-finger grasp reliable?"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import IntEnum
from functools import cached_property
from typing import Literal

import numpy as np
import numpy.typing as npt

from grasp3d._kernels import antipodal as kernels
from grasp3d.arrays import Bytes, Floats, locked
from grasp3d.errors import SearchCoverageError, SettingError
from grasp3d.mesh import ObjectMesh
from grasp3d.mesh.places import nearest_place
from grasp3d.processors import available_processors
from grasp3d.sampling.antipodal import best_grasps, contact_normals, contact_surface
from grasp3d.settings import GraspModel, Sampling, search_cone
from grasp3d.stability import Label, label_angles, max_resolution

Progress = Callable[[float], None]

ROUNDING = 1e-9
"""Angle by which a question may exceed the search cone [rad]."""


class Reason(IntEnum):
    """Why a vertex has no grasp at all."""

    FOUND = kernels.FOUND
    """It has one."""
    NO_PARTNER = kernels.NO_PARTNER
    """No ray within the search cone met a place for the second finger."""
    OPENING = kernels.OPENING
    """Every partner was outside the opening limits."""
    OFF_SURFACE = 3
    """The vertex belongs to no face."""
    SAME_PLACE = 4
    """The vertex is where the fixed finger stands."""


@dataclass(frozen=True)
class SearchReport:
    """How far the search for grasps went."""

    cone: float
    """Half-angle about the inward normals within which every direction counted [rad]."""
    rays: int
    """Rays traced."""
    rounds: int
    """Rounds of refinement about the best grasps."""
    still_falling: float
    """Share of the vertices that the last trial of their neighbours' partners still improved."""


@dataclass(frozen=True, eq=False)
class SurfaceLabels:
    """One value per vertex: the best grasp found there and how reliable it is.

    Arrays have one row per vertex of `mesh`, positions are in its unit and frame. An S is a proof:
    `partner` names the second contact and the critical angle of that grasp is exact. In mode
    'label' a U says that no grasp was found; in mode 'scan', where the grasp is given, that it is
    surely unstable.
    """

    mesh: ObjectMesh
    model: GraspModel
    sampling: Sampling | None
    """How grasps were searched; None in a scan, where they are given."""
    mode: Literal["label", "scan"]
    critical_angle: Floats
    """Critical friction angle over the worst normals of the contacts [rad]; inf: no grasp. (V,)"""
    critical_angle_best: Floats
    """The same over the best normals; differs at creases only. (V,)"""
    partner: Floats
    """Second contact of the vertex's best grasp; nan where there is none. (V, 3)"""
    partner_normal: Floats
    """Inward unit normal at the second contact. (V, 3)"""
    opening: Floats
    """Distance between the two contacts. (V,)"""
    grip: npt.NDArray[np.int8]
    """+1: the fingers squeeze, -1: they push apart, 0: no grasp. (V,)"""
    reason: Bytes
    """`Reason` codes. (V,)"""
    search: SearchReport

    @cached_property
    def label(self) -> Bytes:
        """`Label` codes, shape (V,): 0 U, 1 M, 2 S."""
        return locked(label_angles(self.critical_angle, self.critical_angle_best, self.model))

    @cached_property
    def max_resolution(self) -> Floats:
        """Coarsest sensor resolution below which the grasp is S [rad], shape (V,); 0: none."""
        return locked(max_resolution(self.critical_angle, self.model))

    def relabel(
        self, *, friction: float | None = None, sensor_resolution: float | None = None
    ) -> "SurfaceLabels":
        """Label the same grasps for another friction or resolution: a threshold, no new rays.

        Args:
            friction: Coulomb coefficient; None: unchanged.
            sensor_resolution: Resolution alpha [rad]; None: unchanged.

        Raises:
            SearchCoverageError: Grasps that would now count were outside the search cone.
            SettingError: A value is outside its range.
        """
        model = GraspModel(
            friction=self.model.friction if friction is None else friction,
            sensor_resolution=(
                self.model.sensor_resolution if sensor_resolution is None else sensor_resolution
            ),
        )
        needed = search_cone(model, Sampling())
        if needed > max(self.search.cone, search_cone(self.model, Sampling())) + ROUNDING:
            raise SearchCoverageError(
                f"atan(friction) + alpha/2 is {math.degrees(needed):.4g} degrees, but grasps were "
                f"searched only up to {math.degrees(self.search.cone):.4g}; label the surface "
                f"again with Sampling(search_angle={needed:.4g})"
            )
        return replace(self, model=model)

    def fractions(self, *, weights: Literal["area", "vertex"] = "area") -> dict[str, float]:
        """Shares of the surface that are S, M and U.

        Args:
            weights: 'area': each vertex counts with the area around it; 'vertex': all alike.
        """
        return {
            label.name: float(self._weights(weights)[self.label == label].sum())
            for label in sorted(Label, reverse=True)
        }

    def angle_quantiles(
        self, levels: npt.ArrayLike, *, weights: Literal["area", "vertex"] = "area"
    ) -> Floats:
        """Quantiles of the critical angle over the surface [rad]; inf where no grasp was found.

        Args:
            levels: From 0 to 1, shape (k,).
            weights: As in `fractions`.

        Raises:
            SettingError: A level is outside its range.
        """
        shares = np.asarray(levels, dtype=np.float64)
        if not ((shares >= 0.0) & (shares <= 1.0)).all():
            raise SettingError(f"quantile levels must be from 0 to 1; got {levels!r}")
        order = np.argsort(self.critical_angle, kind="stable")
        reached = np.cumsum(self._weights(weights)[order])
        index = np.searchsorted(reached, shares * reached[-1])
        return np.asarray(self.critical_angle[order][np.minimum(index, len(order) - 1)])

    def _weights(self, weights: Literal["area", "vertex"]) -> Floats:
        if weights == "area":
            values = self.mesh.vertex_areas
        elif weights == "vertex":
            values = self.mesh.on_surface.astype(np.float64)
        else:
            raise SettingError(f"no weights are called {weights!r}; known: area, vertex")
        return np.asarray(values / values.sum())


def label_surface(
    mesh: ObjectMesh,
    model: GraspModel | None = None,
    *,
    sampling: Sampling | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> SurfaceLabels:
    """Find the best two-finger grasp through every vertex and tell how reliable it is.

    Args:
        mesh: The object's surface.
        model: Friction and sensor resolution.
        sampling: How grasps are searched.
        threads: Threads to use; None: one per processor. The result does not depend on it.
        progress: Called with the share of the work done, from 0 to 1.

    Raises:
        SettingError: The settings contradict each other.
    """
    model, sampling = model or GraspModel(), sampling or Sampling()
    threads = available_processors() if threads is None else threads
    if threads < 1:
        raise SettingError(f"threads must be at least 1; got {threads}")
    cone = search_cone(model, sampling)
    grasps = best_grasps(mesh, sampling, cone, threads=threads, progress=progress)
    return SurfaceLabels(
        mesh=mesh,
        model=model,
        sampling=sampling,
        mode="label",
        critical_angle=locked(grasps.worst),
        critical_angle_best=locked(grasps.best),
        partner=locked(grasps.partner),
        partner_normal=locked(grasps.partner_normal),
        opening=locked(np.linalg.norm(grasps.partner - mesh.vertices, axis=1)),
        grip=locked(grasps.grip),
        reason=locked(np.where(mesh.on_surface, grasps.reason, Reason.OFF_SURFACE), np.uint8),
        search=SearchReport(cone, grasps.rays, grasps.rounds, grasps.still_falling),
    )


def scan_surface(
    mesh: ObjectMesh, model: GraspModel | None = None, *, fixed: npt.ArrayLike
) -> SurfaceLabels:
    """Fix one finger and label every vertex as the place of the other (Wan & Howe 2018, Sec. IV).

    Here the grasp is given, so a U is a proof as well. Both ways to close count: squeezing and
    pushing apart.

    Args:
        mesh: The object's surface.
        model: Friction and sensor resolution.
        fixed: Place of the fixed finger, shape (3,) or (1, 3), moved to the nearest place of the
            surface.

    Raises:
        SettingError: `fixed` is not one finite point.
    """
    model = model or GraspModel()
    point = np.asarray(fixed, dtype=np.float64).reshape(-1)
    if point.shape != (3,) or not np.isfinite(point).all():
        raise SettingError(f"fixed must be one point of three finite numbers; got {fixed!r}")
    place, face, weights = nearest_place(mesh, (point - mesh.center) / mesh.size)
    normals = _normals_at(mesh, face, weights)
    count = len(mesh.vertices)
    worst, best = np.empty(count), np.empty(count)
    grip = np.empty(count, dtype=np.int8)
    kernels.scan(place, normals, mesh.normalized, contact_normals(mesh), worst, best, grip)
    middle = normals.sum(axis=0)
    snapped = mesh.from_normalized(place)
    reason = np.where(np.isinf(worst[mesh.canonical]), Reason.SAME_PLACE, Reason.FOUND)
    return SurfaceLabels(
        mesh=mesh,
        model=model,
        sampling=None,
        mode="scan",
        critical_angle=locked(worst[mesh.canonical]),
        critical_angle_best=locked(best[mesh.canonical]),
        partner=locked(np.tile(snapped, (count, 1))),
        partner_normal=locked(np.tile(middle / max(np.linalg.norm(middle), 1e-300), (count, 1))),
        opening=locked(np.linalg.norm(snapped - mesh.vertices, axis=1)),
        grip=locked(grip[mesh.canonical]),
        reason=locked(np.where(mesh.on_surface, reason, Reason.OFF_SURFACE), np.uint8),
        search=SearchReport(cone=math.pi, rays=0, rounds=0, still_falling=0.0),
    )


def _normals_at(mesh: ObjectMesh, face: int, weights: Floats) -> Floats:
    """Normals that a contact on a face may have, shape (k, 3)."""
    sets, found = contact_normals(mesh), np.empty((2, 3))
    count, vertex = kernels.normals_at(face, tuple(weights), contact_surface(mesh), sets, found)
    if vertex >= 0:
        first = sets.start[vertex]
        return sets.normals[first : first + sets.counts[vertex]].copy()
    return found[:count].copy()
